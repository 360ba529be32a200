use super::*;
use crate::time::parse_epoch;

fn few(frames: usize) -> DeepSpace {
    DeepSpace { frames, seed: 7, ..DeepSpace::default() }
}

#[test]
fn the_default_is_the_papers() {
    let default = DeepSpace::default();
    assert_eq!(default.frames, 5000);
    let epochs = ["2025-01-01", "2035-01-01"].map(|text| parse_epoch(text).unwrap());
    assert_eq!(default.epochs_tdb_s, epochs);
}

#[test]
fn each_frame_has_its_planet_in_the_field_and_the_sun_far_off() {
    let wanted = few(300);
    let (trajectory, planets) = wanted.generate(&Ephemeris::analytic()).unwrap();
    assert_eq!((trajectory.frames.len(), planets.len()), (300, 300));
    let edge = wanted.field_rad.map(|angle| (angle / 2.0).tan());
    for (pose, planet) in trajectory.frames.iter().zip(&planets) {
        assert!(pose.time_s >= wanted.epochs_tdb_s[0] && pose.time_s <= wanted.epochs_tdb_s[1]);
        let observer = Observer::new(
            &Ephemeris::analytic(),
            pose.time_s,
            pose.camera_position_m,
            pose.camera_velocity_m_s,
        )
        .unwrap();
        let seen = seen_planet(&observer, *planet).unwrap().unwrap();
        let r = pose.camera_from_inertial * seen.direction;
        assert!((r.x / r.z).abs() <= edge[0] + 1e-12 && (r.y / r.z).abs() <= edge[1] + 1e-12 && r.z > 0.0);
        let from_camera_m = pose.sun_position_m.unwrap() - pose.camera_position_m;
        let distance_au = from_camera_m.length() / ASTRONOMICAL_UNIT_M;
        assert!((0.7 - 1e-6..=5.2 + 1e-6).contains(&distance_au));
        // 1e-3 rad for aberration, which moves the two apart by less.
        assert!(separation_rad(seen.direction, from_camera_m) > wanted.sun_exclusion_rad - 1e-3);
        assert!((pose.camera_from_inertial.length() - 1.0).abs() < 1e-14);
        // Circular speed: 29.78 km/s at 1 au, less by the root of the distance; across the Sun's direction.
        let velocity_m_s = pose.camera_velocity_m_s.unwrap() - observer.bodies().sun.velocity_m_s;
        assert!((velocity_m_s.length() * distance_au.sqrt() - 29_784.7).abs() < 1.0);
        assert!(
            velocity_m_s.dot(from_camera_m).abs() < 1e-3 * velocity_m_s.length() * from_camera_m.length()
        );
        let pole = from_ecliptic(0.0, PI / 2.0);
        assert!(pole.dot((-from_camera_m).cross(velocity_m_s)) > 0.0, "prograde");
        let latitude_rad = (pole.dot(-from_camera_m) / from_camera_m.length()).asin();
        assert!(latitude_rad.abs() <= wanted.greatest_latitude_rad + 1e-6);
    }
    for planet in &wanted.planets {
        let share = planets.iter().filter(|chosen| *chosen == planet).count();
        // Mercury and Venus are seldom far from the Sun when seen from farther out.
        let least = if *planet <= Planet::Earth { 1 } else { 20 };
        assert!((least..=120).contains(&share), "{planet:?}: {share} of 300");
    }
}

#[test]
fn field_and_roll_are_filled_evenly() {
    let wanted = DeepSpace { planets: vec![Planet::Jupiter], ..few(400) };
    let (trajectory, planets) = wanted.generate(&Ephemeris::analytic()).unwrap();
    assert!(planets.iter().all(|planet| *planet == Planet::Jupiter));
    // Chi-squared of 8 bins, 7 degrees of freedom: beyond 24.3 once in a thousand.
    let even = |values: Vec<f64>| {
        let mut bins = [0.0_f64; 8];
        for value in &values {
            bins[((value * 8.0) as usize).min(7)] += 1.0;
        }
        let expected = values.len() as f64 / 8.0;
        let chi2: f64 = bins.iter().map(|n| (n - expected).powi(2) / expected).sum();
        assert!(chi2 < 24.3, "{bins:?}");
    };
    let tangents = |axis: usize| -> Vec<f64> {
        let edge = (wanted.field_rad[axis] / 2.0).tan();
        let place = |pose: &FramePose| {
            let observer = Observer::new(
                &Ephemeris::analytic(),
                pose.time_s,
                pose.camera_position_m,
                pose.camera_velocity_m_s,
            )
            .unwrap();
            let seen = seen_planet(&observer, Planet::Jupiter).unwrap().unwrap();
            let r = pose.camera_from_inertial * seen.direction;
            ([r.x, r.y][axis] / r.z / edge + 1.0) / 2.0
        };
        trajectory.frames.iter().map(place).collect()
    };
    even(tangents(0));
    even(tangents(1));
    // The turn about the planet's line of sight, from the attitude that is turned least.
    let roll = |pose: &FramePose| {
        let observer = Observer::new(
            &Ephemeris::analytic(),
            pose.time_s,
            pose.camera_position_m,
            pose.camera_velocity_m_s,
        )
        .unwrap();
        let seen = seen_planet(&observer, Planet::Jupiter).unwrap().unwrap();
        let facing = DQuat::from_rotation_arc(seen.direction, DVec3::Z);
        let aside = DQuat::from_rotation_arc(DVec3::Z, pose.camera_from_inertial * seen.direction);
        let turned = aside.inverse() * pose.camera_from_inertial * facing.inverse() * DVec3::X;
        turned.y.atan2(turned.x).rem_euclid(TAU) / TAU
    };
    even(trajectory.frames.iter().map(roll).collect());
}

#[test]
fn a_frame_does_not_depend_on_how_many_there_are() {
    let (long, _) = few(20).generate(&Ephemeris::analytic()).unwrap();
    let (short, _) = few(5).generate(&Ephemeris::analytic()).unwrap();
    assert_eq!(long.frames[..5], short.frames[..]);
    let (other, _) = DeepSpace { seed: 8, ..few(5) }.generate(&Ephemeris::analytic()).unwrap();
    assert!(other.frames.iter().zip(&short.frames).all(|(a, b)| a != b));
    assert!(short.frames[0] != short.frames[1]);
}

#[test]
fn the_table_comes_back_bit_for_bit() {
    let (trajectory, _) = few(40).generate(&Ephemeris::analytic()).unwrap();
    let back = Trajectory::parse(Path::new("poses.csv"), &trajectory.to_csv(), &[]).unwrap();
    assert_eq!(back.frames, trajectory.frames);
}

#[test]
fn what_cannot_be_made_is_refused() {
    let refused = |wanted: DeepSpace| wanted.generate(&Ephemeris::analytic()).unwrap_err().to_string();
    assert!(refused(few(0)).contains("one of its frames"));
    assert!(refused(DeepSpace { planets: Vec::new(), ..few(1) }).contains("one of its planets"));
    for (wanted, expected) in [
        (DeepSpace { epochs_tdb_s: [2.0, 1.0], ..few(1) }, "epochs_tdb_s"),
        (DeepSpace { sun_distance_au: [0.0, 1.0], ..few(1) }, "sun_distance_au"),
        (DeepSpace { sun_distance_au: [1.0, f64::NAN], ..few(1) }, "sun_distance_au"),
        (DeepSpace { greatest_latitude_rad: 2.0, ..few(1) }, "greatest_latitude_rad"),
        (DeepSpace { sun_exclusion_rad: -0.1, ..few(1) }, "sun_exclusion_rad"),
        (DeepSpace { field_rad: [0.2, 3.2], ..few(1) }, "field_rad"),
    ] {
        let text = refused(wanted);
        assert!(text.contains(expected) && text.contains("found"), "{text}");
    }
    assert!(refused(DeepSpace { epochs_tdb_s: [4e9, 5e9], ..few(1) }).contains("no ephemeris"));
    let outward = DeepSpace { planets: vec![Planet::Mercury], sun_exclusion_rad: 1.6, ..few(1) };
    assert!(refused(DeepSpace { sun_distance_au: [4.0, 5.2], ..outward }).contains("frame 0"));
}
