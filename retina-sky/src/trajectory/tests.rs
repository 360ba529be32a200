//! Tests of the trajectory table.

use super::*;
use proptest::prelude::*;
use retina_files::Place;

const CAMERA: &str = "time_s,camera_x_m,camera_y_m,camera_z_m,\
    camera_from_inertial_w,camera_from_inertial_x,camera_from_inertial_y,camera_from_inertial_z";

fn parse(text: &str) -> Result<Trajectory, InputError> {
    Trajectory::parse(Path::new("poses.csv"), text, &["moon".to_owned(), "phobos".to_owned()])
}

#[test]
fn columns_are_read_by_name_in_any_order() {
    // The contract's example quaternion takes (1, 0, 0) to (0, 1, 0), z up: scalar first.
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let text = format!(
        "# poses\nmoon_z_m,camera_from_inertial_z,camera_from_inertial_y,camera_from_inertial_x,\
         camera_from_inertial_w,camera_z_m,camera_y_m,camera_x_m,time_s,moon_x_m,moon_y_m,camera_vx_m_s,\
         camera_vy_m_s,camera_vz_m_s\n9,{half},0,0,{half},3,2,1,0.5,7,8,4,5,6\n"
    );
    let trajectory = parse(&text).unwrap();
    let pose = &trajectory.frames[0];
    assert!((pose.camera_from_inertial * DVec3::X - DVec3::Y).length() < 1e-15);
    assert_eq!((pose.time_s, pose.camera_position_m), (0.5, DVec3::new(1.0, 2.0, 3.0)));
    assert_eq!((pose.camera_velocity_m_s, pose.sun_position_m), (Some(DVec3::new(4.0, 5.0, 6.0)), None));
    let moon = BodyPose { position_m: DVec3::new(7.0, 8.0, 9.0), body_from_inertial: DQuat::IDENTITY };
    let absent = BodyPose { position_m: DVec3::ZERO, body_from_inertial: DQuat::IDENTITY };
    assert_eq!((pose.bodies["moon"], pose.bodies["phobos"]), (moon, absent));
    assert_eq!(trajectory.given["moon"], BodyColumns { position: true, orientation: false });
    assert_eq!(trajectory.given["phobos"], BodyColumns::default());
    assert_eq!(trajectory.error_at(0, "x").place, Place::Line(3));
    assert_eq!(trajectory.error_at(1, "x").place, Place::Named("frame 1".to_owned()));
}

#[test]
fn quaternions_are_normalised_within_a_thousandth_and_refused_beyond() {
    let with = |w: &str| parse(&format!("{CAMERA}\n0,1,2,3,{w},0,0,0\n"));
    for (w, expected) in [("1.0009", 1.0), ("-0.9991", -1.0)] {
        assert!((with(w).unwrap().frames[0].camera_from_inertial.w - expected).abs() < 1e-15, "{w}");
    }
    for w in ["1.0011", "0.9989", "0", "1e200"] {
        let error = with(w).unwrap_err();
        assert_eq!(error.place, Place::Cell(2, "camera_from_inertial_w".to_owned()), "{w}");
        assert!(error.problem.contains("not unit"));
    }
}

#[test]
fn what_does_not_fit_is_refused_with_its_place_and_mend() {
    let refused = |text: &str| parse(text).unwrap_err();
    let row = "0,1,2,3,1,0,0,0";
    assert!(refused(&format!("{CAMERA}\n")).problem.contains("no frames"));
    assert!(refused("").problem.contains("no table"));
    let unknown = refused(&format!("{CAMERA},moon_x\n{row},1\n"));
    assert!(unknown.problem.contains("`moon_x`") && unknown.help.unwrap().contains("`moon_x_m`"));
    let missing = refused(&format!("{}\n1,2,3,1,0,0,0\n", CAMERA.trim_start_matches("time_s,")));
    assert!(missing.problem.contains("`time_s`"));
    for (columns, lacking) in [
        ("sun_x_m,sun_y_m", "sun_z_m"),
        ("moon_x_m,moon_z_m", "moon_y_m"),
        ("moon_from_inertial_w", "moon_from_inertial_x, moon_from_inertial_y, moon_from_inertial_z"),
        ("camera_vx_m_s,camera_vz_m_s", "camera_vy_m_s"),
    ] {
        let cells = columns.split(',').map(|_| "0").collect::<Vec<_>>().join(",");
        let error = refused(&format!("{CAMERA},{columns}\n{row},{cells}\n"));
        assert!(error.help.unwrap().contains(&format!("add {lacking},")), "{columns}");
    }
    for bad in ["nan", "inf", "", "1e999", "one"] {
        let error = refused(&format!("{CAMERA},sun_x_m,sun_y_m,sun_z_m\n{row},0,0,0\n{row},1,{bad},3\n"));
        assert_eq!(error.place, Place::Cell(3, "sun_y_m".to_owned()), "{bad}");
        let error = refused(&format!("{CAMERA}\n{bad},1,2,3,1,0,0,0\n"));
        assert_eq!(error.place, Place::Cell(2, "time_s".to_owned()), "{bad}");
    }
    let error = Trajectory::parse(Path::new("p.csv"), CAMERA, &["camera".to_owned()]).unwrap_err();
    assert!(error.problem.contains("`camera`"));
    assert!(Trajectory::read("no/such/poses.csv", &[]).unwrap_err().problem.contains("cannot be read"));
}

#[test]
fn a_written_trajectory_reads_back_bit_for_bit() {
    let halo = crate::halo::LumioHalo { frames: 40, step_s: 7000.0, ..Default::default() };
    let (made, _) = halo.generate(&crate::ephemeris::Ephemeris::analytic()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("poses.csv");
    retina_files::write_atomic(&path, made.to_csv().as_bytes()).unwrap();
    let back = Trajectory::read(&path, &["moon".to_owned()]).unwrap();
    assert_eq!((&back.frames, &back.given), (&made.frames, &made.given));
    assert_eq!(back.to_csv(), made.to_csv());
}

#[test]
fn frames_that_lack_a_column_leave_an_empty_cell() {
    let (mut made, _) = crate::halo::LumioHalo { frames: 2, ..Default::default() }
        .generate(&crate::ephemeris::Ephemeris::analytic())
        .unwrap();
    made.frames[1].sun_position_m = None;
    let error = Trajectory::parse(Path::new("p.csv"), &made.to_csv(), &["moon".to_owned()]).unwrap_err();
    assert_eq!(error.place, Place::Cell(3, "sun_x_m".to_owned()));
}

fn pose() -> impl Strategy<Value = FramePose> {
    let vector =
        || prop::array::uniform3(prop::num::f64::NORMAL | prop::num::f64::ZERO).prop_map(DVec3::from_array);
    let turn = || {
        (prop::array::uniform3(-1.0..1.0_f64), -3.0..3.0_f64).prop_map(|(axis, angle_rad)| {
            DQuat::from_axis_angle((DVec3::from_array(axis) + DVec3::Z * 2.0).normalize(), angle_rad)
                .normalize()
        })
    };
    (prop::num::f64::NORMAL, vector(), turn(), vector(), vector(), turn()).prop_map(
        |(time_s, camera_position_m, camera_from_inertial, velocity, position_m, body_from_inertial)| {
            FramePose {
                time_s,
                camera_position_m,
                camera_from_inertial,
                camera_velocity_m_s: Some(velocity),
                sun_position_m: None,
                bodies: BTreeMap::from([(
                    "2003 \"UB\", 313".to_owned(),
                    BodyPose { position_m, body_from_inertial },
                )]),
            }
        },
    )
}

proptest! {
    #[test]
    fn any_frames_read_back_bit_for_bit(frames in prop::collection::vec(pose(), 1..4)) {
        let made = Trajectory::new(Path::new("p.csv"), frames);
        let names: Vec<String> = made.given.keys().cloned().collect();
        let back = Trajectory::parse(Path::new("p.csv"), &made.to_csv(), &names).unwrap();
        prop_assert_eq!(&back.frames, &made.frames);
        prop_assert_eq!(back.to_csv(), made.to_csv());
    }

    #[test]
    fn any_bytes_are_taken_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("poses.csv");
        std::fs::write(&path, &bytes).unwrap();
        let _ = Trajectory::read(&path, &["moon".to_owned()]);
    }

    #[test]
    fn any_cells_below_a_good_header_are_taken_or_refused(
        cells in prop::collection::vec("[-+0-9.eE\",#\n naif]{0,12}", 1..20),
    ) {
        let _ = parse(&format!("{CAMERA}\n{}\n", cells.join(",")));
    }
}
