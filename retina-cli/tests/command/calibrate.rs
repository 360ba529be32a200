//! `retina pattern` and `retina calibrate geometry`.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use crate::common::{SETUP, assert_done, assert_refused, retina};

/// A table of the small screen (K_f 900 px, camera 1000 px a unit): r = r_u (1 + 2 r^2), exact.
fn table(path: &Path, swapped: bool) {
    let mut text = String::from("image,screen_x_px,screen_y_px,digital_count,camera_x_px,camera_y_px\n");
    for image in 0..6 {
        for i in 0..60u32 {
            let at =
                [f64::from((i * 37 + image * 11) % 100) + 30.5, f64::from((i * 53 + image * 7) % 80) + 10.5];
            let [x, y] = [(at[0] - 80.0) / 900.0, (at[1] - 50.0) / 900.0];
            let gain = 1.0 + 2.0 * (x * x + y * y);
            let camera = [60.0 + 1000.0 * x * gain, 45.0 + 1000.0 * y * gain];
            let [cx, cy] = if swapped { [camera[1], camera[0]] } else { camera };
            writeln!(text, "{image},{},{},{},{cx},{cy}", at[0], at[1], 40 + (i * 29) % 200).unwrap();
        }
    }
    fs::write(path, text).unwrap();
}

#[test]
fn a_table_becomes_a_calibration_that_warp_takes() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    fs::write(at("setup.toml"), SETUP).unwrap();
    table(&at("points.csv"), false);
    let done = retina()
        .args(["calibrate", "geometry", "--json", "--setup"])
        .arg(at("setup.toml"))
        .arg("--data")
        .arg(at("points.csv"))
        .arg("--out")
        .arg(at("calibration.toml"))
        .arg("--residuals")
        .arg(at("residuals.csv"))
        .arg("--report")
        .arg(at("report.html"))
        .output()
        .unwrap();
    assert_done(&done);
    let json: serde_json::Value = serde_json::from_slice(&done.stdout).unwrap();
    assert_eq!(json["schema"], "retina.geometry-calibration/1");
    for key in ["points", "outliers", "coefficients", "covariance", "fraction_within_10_arcsec"] {
        assert!(!json[key].is_null(), "{key}");
    }
    // The inverse of r_u (1 + 2 r_u^2) is a series; up to degree 7 it leaves far less than an arcsecond here.
    assert!(json["heldout"]["percentiles_arcsec"]["99"].as_f64().unwrap() < 1.0, "{json}");
    // One a panel: two over magnitude, density and distribution, three over the field.
    assert_eq!(fs::read_to_string(at("report.html")).unwrap().matches("<svg").count(), 7);
    assert_eq!(fs::read_to_string(at("residuals.csv")).unwrap().lines().count(), 361);
    image::GrayImage::from_pixel(160, 100, image::Luma([40])).save(at("in.png")).unwrap();
    let warped = retina()
        .arg("warp")
        .arg(at("in.png"))
        .arg("--setup")
        .arg(at("setup.toml"))
        .arg("--calibration")
        .arg(at("calibration.toml"))
        .args(["--direction", "upstream", "--out"])
        .arg(at("out.png"))
        .output()
        .unwrap();
    assert_done(&warped);
}

#[test]
fn what_does_not_fit_is_refused_and_nothing_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    fs::write(at("setup.toml"), SETUP).unwrap();
    table(&at("points.csv"), true);
    let swapped = retina()
        .args(["calibrate", "geometry", "--setup"])
        .arg(at("setup.toml"))
        .arg("--data")
        .arg(at("points.csv"))
        .arg("--out")
        .arg(at("calibration.toml"))
        .output()
        .unwrap();
    assert_refused(&swapped, &["points.csv", "do not belong together", "swap camera_x_px and camera_y_px"]);
    assert!(!at("calibration.toml").exists());
    // Inputs stay what they are, and each is one campaign.
    table(&at("points.csv"), false);
    let before = fs::read(at("points.csv")).unwrap();
    let calibrate = |more: &[&str]| {
        let paths: Vec<_> = more
            .iter()
            .map(|word| if word.contains('.') { at(word).into() } else { (*word).into() })
            .collect::<Vec<std::ffi::OsString>>();
        retina()
            .args(["calibrate", "geometry", "--setup"])
            .arg(at("setup.toml"))
            .arg("--data")
            .arg(at("points.csv"))
            .arg("--out")
            .arg(at("calibration.toml"))
            .args(paths)
            .output()
            .unwrap()
    };
    assert_refused(&calibrate(&["--residuals", "points.csv"]), &["points.csv", "is an input"]);
    assert_refused(&calibrate(&["--data", "points.csv"]), &["points.csv", "given twice"]);
    assert_refused(&calibrate(&["--reference-log10-irradiance", "nan"]), &["NaN"]);
    assert!(!at("calibration.toml").exists());
    assert_eq!(fs::read(at("points.csv")).unwrap(), before);
    let many = retina()
        .args(["pattern", "--points", "5000", "--setup"])
        .arg(at("setup.toml"))
        .arg("--out")
        .arg(at("pattern"))
        .output()
        .unwrap();
    assert_refused(&many, &["told apart", "--points"]);
    assert!(!at("pattern").exists());
}
