//! Power readings to a calibration, and a scene shown with it.

use std::fs;
use std::path::Path;
use std::process::Output;

use crate::common::{
    self, AU_M, FOCAL_PX, Fixture, HEADER, assert_done, assert_refused, counts, json, retina,
};
use serde_json::Value;

const GAMMA: f64 = 1.8;
/// A pixel at 255, red, green, blue, W m^-2.
const FULL_W_M2: [f64; 3] = [3e-8, 4e-8, 2e-8];

/// Readings without noise of (B / 255)^1.8, with a meter's zero of 1e-6 W m^-2.
fn table() -> String {
    let mut text = String::from("channel,digital_count,square_px,irradiance_w_m2,sigma_w_m2\n");
    for (channel, full) in ["r", "g", "b"].iter().zip(FULL_W_M2) {
        for count in [0, 2, 4, 8, 16, 32, 64, 96, 128, 160, 192, 224, 255] {
            for square in [0.0f64, 100.0, 300.0] {
                let light = square * square * full * (f64::from(count) / 255.0).powf(GAMMA);
                text += &format!("{channel},{count},{square},{},{}\n", light + 1e-6, 1e-9 + 1e-3 * light);
            }
        }
    }
    text
}

fn calibrate(fixture: &Fixture, more: &[&str]) -> Output {
    let mut command = retina();
    command.args(["calibrate", "radiometry", "--json", "--setup"]).arg(fixture.path("setup.toml"));
    command.arg("--data").arg(fixture.path("power.csv")).args(more).output().unwrap()
}

fn out(fixture: &Fixture, name: &str) -> String {
    fixture.path(name).to_str().unwrap().to_owned()
}

/// White of a pixel at equal counts, W m^-2 nm^-1: eq. 10 with the table's own closed form.
fn white_w_m2_nm(document: &Value, count: u8) -> f64 {
    let number = |value: &Value| value.as_f64().unwrap();
    let eta = &document["efficiency"];
    let full: f64 = FULL_W_M2.iter().enumerate().map(|(c, full)| full * number(&eta[c])).sum();
    full * (f64::from(count) / 255.0).powf(GAMMA) / number(&document["bandwidth_nm"])
}

#[test]
fn the_readings_become_a_calibration_that_a_scene_is_shown_with() {
    let fixture = Fixture::new();
    fixture.write("power.csv", &table());
    let file = out(&fixture, "response.toml");
    let report = out(&fixture, "report.html");
    let figures = out(&fixture, ".");
    let document = json(&calibrate(&fixture, &["--out", &file, "--report", &report, "--figures", &figures]));
    assert_eq!(document["schema"], "retina.radiometry-calibration/1");
    assert_eq!(document["monotone"], true);
    for (channel, full) in ["r", "g", "b"].iter().zip(FULL_W_M2) {
        let found = &document["channels"][channel];
        assert!((found["gamma"]["value"].as_f64().unwrap() - GAMMA).abs() < 1e-4, "{found}");
        assert!((found["full_w_m2"]["value"].as_f64().unwrap() / full - 1.0).abs() < 1e-4);
        assert!((found["zero_w_m2"]["value"].as_f64().unwrap() - 1e-6).abs() < 1e-9);
    }
    assert!(fs::read_to_string(&report).unwrap().contains("</svg>"));
    assert!(fixture.path("response.svg").is_file() && fixture.path("magnitude.svg").is_file());

    // A star at 2.5 deg: its counts, by the table's closed form, are as bright as it is.
    fixture.write(
        "scene.toml",
        "schema = \"retina.scene/1\"\nsetup = \"setup.toml\"\ntrajectory = \"poses.csv\"\n[compensation]\n\
         mode = \"none\"\ncalibration = \"response.toml\"\n[stars]\nfaintest_magnitude = 9.0\n\
         catalogue = \"stars.csv\"\nplanets = false\n",
    );
    let epoch_s = -8.75 * 365.25 * 86_400.0;
    fixture.write("poses.csv", &format!("{HEADER}\n{epoch_s},{AU_M},0,0,1,0,0,0,0,0,0\n"));
    fixture.write(
        "stars.csv",
        "id,ra_deg,dec_deg,pm_ra_mas_yr,pm_dec_mas_yr,parallax_mas,v_mag,b_v\na,30,87.5,0,0,0,1.0,\n",
    );
    assert_done(&fixture.render("out", &[]));
    let image = counts(&fixture.path("out/frames/000000.png"));
    let mut light = 0.0;
    for (i, &count) in image.iter().enumerate() {
        let at = [(i % 160) as f64 + 0.5 - 80.0, (i / 160) as f64 + 0.5 - 50.0];
        let r2 = (at[0].powi(2) + at[1].powi(2)) / FOCAL_PX.powi(2);
        light += white_w_m2_nm(&document, count) * (1.0 + r2).powf(-1.5);
    }
    // Eq. 7; 0.01 mag is what three pixels of whole counts reach.
    let magnitude = -2.5 * (light / 3.67e-11).log10();
    assert!((magnitude - 1.0).abs() < 0.01, "{magnitude}");
    let truth: Value =
        serde_json::from_slice(&fs::read(fixture.path("out/truth/000000.json")).unwrap()).unwrap();
    let told = truth["stars"][0]["displayed_magnitude"].as_f64().unwrap();
    assert!((told - magnitude).abs() < 1e-3, "{told} {magnitude}");
}

#[test]
fn what_does_not_fit_leaves_nothing_behind() {
    let fixture = Fixture::new();
    fixture.write("power.csv", &table().replace("b,255,300", "b,300,255"));
    let file = out(&fixture, "new.toml");
    assert_refused(
        &calibrate(&fixture, &["--out", &file]),
        &["power.csv", "line 118", "`digital_count`", "found 300"],
    );
    assert!(!fixture.path("new.toml").exists());
    fixture.write("power.csv", &table());
    fixture.edit("calibration.toml", "setup = \"small\"", "setup = \"large\"");
    let held = fs::read(fixture.path("calibration.toml")).unwrap();
    let calibration = out(&fixture, "calibration.toml");
    assert_refused(&calibrate(&fixture, &["--out", &calibration]), &["found `large`, expected `small`"]);
    assert_eq!(fs::read(fixture.path("calibration.toml")).unwrap(), held);
    assert_refused(&calibrate(&fixture, &["--out", &out(&fixture, "a.txt")]), &["`.toml`"]);
}

/// A meter by command before a screen that is a folder: interrupted, gone on with, fitted.
#[test]
fn a_laboratory_reads_its_meter_by_command() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    fs::create_dir(path("screen")).unwrap();
    // Watts on 9.5 mm: gamma 2.4, a zero of 2e-9 W m^-2, and no number after 40 readings the first time.
    let meter = "n=$(cat count 2>/dev/null || echo 0); n=$((n + 1)); echo $n > count; \
                 [ $n != 41 ] || { echo busy; exit 0; }; \
                 awk -v c=$RETINA_CHANNEL -v b=$RETINA_DIGITAL_COUNT -v n=$RETINA_SQUARE_PX 'BEGIN { \
                 f = c == \"r\" ? 3e-11 : c == \"g\" ? 5e-11 : c == \"b\" ? 2e-11 : 1e-10; \
                 print (n * n * f * (1e-4 + (1 - 1e-4) * (b / 255) ^ 2.4) + 2e-9) * 3.14159265 / 4 * 9.5e-3 ^ 2 }'";
    let run = || {
        let setup = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/setups/wide-fov.toml");
        let mut command = retina();
        command.current_dir(folder.path()).args(["lab", "calibrate", "radiometry", "--setup"]).arg(setup);
        command.args(["--screen", "folder:screen", "--meter", &format!("exec:{meter}"), "--out", "out"]);
        command.args(["--meter-diameter-mm", "9.5", "--readings", "1", "--settle-s", "0", "--json"]);
        command.args(["--counts", "4,8,16,32,64,128,192,255", "--squares", "100,400"]).output().unwrap()
    };
    let stopped = run();
    assert_eq!(stopped.status.code(), Some(2));
    assert!(
        common::stderr(&stopped).contains("printed `busy`, not a number"),
        "{}",
        common::stderr(&stopped)
    );
    let done = run();
    assert_done(&done);
    // Two squares, four channels, eight counts and a dark reading; 40 of them and `busy` came before.
    assert_eq!(fs::read_to_string(path("count")).unwrap().trim(), "73");
    assert_eq!(fs::read_to_string(path("out/power.csv")).unwrap().lines().count(), 73);
    let document = json(&done);
    for channel in ["r", "g", "b"] {
        let gamma = document["channels"][channel]["gamma"]["value"].as_f64();
        let gamma = gamma.unwrap_or_else(|| panic!("{document:#}"));
        assert!((gamma - 2.4).abs() < 0.01, "{channel}: {gamma}");
    }
    assert!(path("out/calibration.toml").is_file() && path("out/radiometry.html").is_file());
}
