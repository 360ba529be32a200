//! Tables that no calibration can come from are refused with words that say why.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

mod common;

use std::path::PathBuf;

use common::{LIKELY, wide};
use glam::DVec2;
use retina_calibration::geometry::{CalibrateOptions, calibrate, write_calibration};
use retina_formats::{Calibration, PointsTable};
use retina_geometry::Intrinsics;

fn refusal(change: impl Fn(&mut PointsTable)) -> String {
    let mut table = LIKELY.table(&wide(), 6, 60, 3);
    table.files.push((PathBuf::from("points.csv"), String::new()));
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
    assert!(text.contains("not on the screen") && text.contains("screen_y_px"), "{text}");
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
        ("a,1,2,10,3,4,w,90,5", "one roll of the camera"),
    ] {
        let error = read(row).unwrap_err().to_string();
        assert!(error.contains(said), "{error}");
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
