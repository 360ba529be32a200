//! Tables that no calibration can come from are refused with words that say why.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

mod common;

use common::{LIKELY, wide};
use glam::DVec2;
use retina_calibration::geometry::{CalibrateOptions, calibrate, write_calibration};
use retina_formats::{Calibration, PointsTable, SourceFile};
use retina_geometry::Intrinsics;

fn refusal(change: impl Fn(&mut PointsTable)) -> String {
    let mut table = LIKELY.table(&wide(), 6, 60, 3);
    table.files.push(SourceFile::new("points.csv", String::new()));
    change(&mut table);
    let error = calibrate(&table, &wide(), &CalibrateOptions::default()).unwrap_err();
    format!("{error}; {}", error.help.clone().unwrap_or_default())
}

#[test]
fn tables_that_say_too_little_are_refused() {
    let text = refusal(|table| table.rows.truncate(12));
    assert!(text.contains("points.csv: there are too few points (found 12"), "{text}");
    let text = refusal(|table| table.rows.iter_mut().for_each(|row| row.saturated = true));
    assert!(text.contains("every point is saturated") && text.contains("shorter exposures"), "{text}");
    let text = refusal(|table| {
        for row in &mut table.rows {
            row.screen_px.y = 300.0 + 0.2 * row.screen_px.x;
            row.camera_px.y = 200.0 + 0.2 * row.camera_px.x;
        }
    });
    assert!(text.contains("the points lie on a line"), "{text}");
}

#[test]
fn swapped_columns_are_named() {
    let swap = |v: &mut DVec2| *v = DVec2::new(v.y, v.x);
    let text = refusal(|table| table.rows.iter_mut().for_each(|row| swap(&mut row.camera_px)));
    assert!(
        text.contains("do not belong together") && text.contains("swap camera_x_px and camera_y_px"),
        "{text}"
    );
    let text = refusal(|table| table.rows.iter_mut().for_each(|row| swap(&mut row.screen_px)));
    assert!(
        text.contains("do not belong together") && text.contains("screen_x_px and screen_y_px"),
        "{text}"
    );
    let text =
        refusal(|table| table.rows.iter_mut().for_each(|row| row.camera_px.x = 2048.0 - row.camera_px.x));
    assert!(text.contains("mirror"), "{text}");
    let text = refusal(|table| {
        let places: Vec<DVec2> = table.rows.iter().rev().map(|row| row.camera_px).collect();
        table.rows.iter_mut().zip(places).for_each(|(row, place)| row.camera_px = place);
    });
    assert!(text.contains("matched wrongly"), "{text}");
}

#[test]
fn cells_that_do_not_fit_are_refused_and_unknown_columns_are_not() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("points.csv");
    let read = |row: &str| {
        let head = "image,screen_x_px,screen_y_px,digital_count,camera_x_px,camera_y_px,channel,camera_roll_deg,humidity";
        std::fs::write(&path, format!("{head}\na,1,2,10,3,4,w,0,5\n{row}\n")).unwrap();
        PointsTable::read(std::slice::from_ref(&path))
    };
    assert_eq!(read("a,1,2,10,3,4,r,0,5").unwrap().rows.len(), 2);
    for (row, said) in [
        ("a,1,2,0,3,4,w,0,5", "line 3, column `digital_count`"),
        ("a,1,2,10,nan,4,w,0,5", "not a finite number"),
        ("a,1,2,10,3,4,x,0,5", "column `channel`"),
    ] {
        let error = read(row).unwrap_err().to_string();
        assert!(error.contains(said), "{error}");
    }
}

#[test]
fn points_of_another_camera_are_refused_or_warned_of() {
    let text = refusal(|table| table.rows[7].camera_roll_deg = Some(90.0));
    assert!(text.contains("points.csv, line 9") && text.contains("one roll of the camera"), "{text}");
    let text = refusal(|table| table.rows[7].camera_px.x = 2090.0);
    assert!(text.contains("points.csv, line 9, column `camera_x_px`: the centroid lies outside"), "{text}");
    let text = refusal(|table| table.rows[7].screen_px.y = -0.1);
    assert!(text.contains("the point lies outside the screen"), "{text}");
    // The same table read for a camera of a longer focal length: everything fits but the scale.
    let mut other = wide();
    other.camera.focal_mm *= 1.33;
    let table = LIKELY.table(&wide(), 6, 60, 3);
    let result = calibrate(&table, &other, &CalibrateOptions::default()).unwrap();
    assert!(result.warnings.is_empty(), "K_f follows the camera: {:?}", result.warnings);
    other.facility.observed_rows_px = Some(900.0);
    let result = calibrate(&table, &other, &CalibrateOptions::default()).unwrap();
    assert!(result.warnings[0].contains("at 1.33"), "{:?}", result.warnings);
    // A table that names its setup is refused by another, and by the same one after a change.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("points.csv");
    table.write(&path, &wide()).unwrap();
    let read = PointsTable::read(&[path]).unwrap();
    assert_eq!(read.rows.len(), table.rows.len());
    read.check_setup(&wide()).unwrap();
    let text = |setup: &retina_geometry::Setup| {
        let error = calibrate(&read, setup, &CalibrateOptions::default()).unwrap_err();
        format!("{error}; {}", error.help.clone().unwrap_or_default())
    };
    assert!(text(&other).contains("before the setup was changed"), "{}", text(&other));
    other.name = "other".into();
    assert!(text(&other).contains("with another setup (found `wide-fov`"), "{}", text(&other));
}

#[test]
fn a_term_given_twice_and_a_wild_one_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("calibration.toml");
    let read = |terms: &str| {
        let head = "schema = \"retina.calibration/1\"\nsetup = \"wide-fov\"\n[distortion]\n";
        std::fs::write(&path, format!("{head}terms = [[1, 0, 1, 0], [0, 1, 0, 1], {terms}]\n")).unwrap();
        Calibration::read(&path, &wide()).map_err(|error| error.to_string())
    };
    assert!(read("[3, 0, 0.1, 0]").is_ok());
    let error = read("[3, 0, 0.1, 0], [3, 0, 0.1, 0]").unwrap_err();
    assert!(error.contains("row 4: the term is given twice (found x^3 y^0"), "{error}");
    for wild in ["1e7", "1e20", "1e300"] {
        let error = read(&format!("[3, 0, {wild}, 0], [0, 3, 0, {wild}]")).unwrap_err();
        assert!(error.contains("`distortion.terms`"), "{error}");
    }
}

#[test]
fn a_calibration_is_refused_by_another_setup() {
    let setup = wide();
    let table = LIKELY.table(&setup, 6, 100, 3);
    let result = calibrate(&table, &setup, &CalibrateOptions::default()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("calibration.toml");
    write_calibration(&path, &result, &table, &setup).unwrap();
    assert!(Calibration::read(&path, &setup).is_ok());
    let refused = |change: fn(&mut retina_geometry::Setup)| {
        let mut other = wide();
        change(&mut other);
        Calibration::read(&path, &other).unwrap_err().to_string()
    };
    assert!(refused(|setup| setup.name = "narrow-fov".into()).contains("another setup"));
    assert!(refused(|setup| setup.camera.focal_mm = 25.5).contains("another K_f"));
    let other_k = refused(|setup| {
        setup.facility.intrinsics =
            Some(Intrinsics { fx_px: 5600.0, fy_px: 5600.0, cx_px: 960.0, cy_px: 600.0 });
    });
    assert!(other_k.contains("provenance.k_f_px"), "{other_k}");
    assert!(refused(|setup| setup.camera.height_px = 1500).contains("another"));
    let unchanged = std::fs::read(&path).unwrap();
    write_calibration(&path, &result, &table, &setup).unwrap();
    assert_eq!(std::fs::read(&path).unwrap(), unchanged, "the same bytes each time");
}
