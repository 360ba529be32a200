//! `retina optics constraints`, `design` and `search`: the machine interface, setups that are read back, refusals.

use crate::common::{assert_done, assert_refused, json, retina};
use retina_geometry::Setup;

fn optics(arguments: &[&str]) -> std::process::Output {
    retina().arg("optics").args(arguments).output().unwrap()
}

/// The ends of the field as worked out independently: 2.06 to 18.84 deg (digits beyond were cut).
#[test]
fn constraints_in_the_machine_interface() {
    let output = optics(&["constraints", "--f-c", "86.8", "--f-r", "82.8", "--json"]);
    assert_done(&output);
    let document = json(&output);
    assert_eq!(document["schema"], "retina.optics-constraints/1");
    assert!((document["field_min_deg"].as_f64().unwrap() - 2.06).abs() < 0.005);
    assert!((document["field_max_deg"].as_f64().unwrap() - 18.84).abs() < 0.01);
    assert_eq!(document["limit_at_min"], "total_length");
    assert_eq!(document["limit_at_max"], "relay_vignetting");
    let none = json(&optics(&["constraints", "--f-c", "700", "--f-r", "200", "--json"]));
    assert!(none["field_min_deg"].is_null() && none["limit_at_max"] == "none", "{none}");
}

#[test]
fn the_grid_is_drawn_and_listed() {
    let folder = tempfile::tempdir().unwrap();
    let svg = folder.path().join("fields.svg");
    let flags =
        ["constraints", "--f-c", "86.8", "--f-r", "82.8", "--grid", "--grid-count", "9", "--json", "--svg"];
    let output = retina().arg("optics").args(flags).arg(&svg).output().unwrap();
    assert_done(&output);
    let grid = &json(&output)["grid"];
    assert_eq!(grid["ranges"].as_array().unwrap().len(), 81);
    // f_c = f_r = 80 mm: the third step of 20 mm from 40 mm, row by row.
    let range = &grid["ranges"][2 * 9 + 2];
    let model = json(&optics(&["constraints", "--f-c", "80", "--f-r", "80", "--json"]));
    let degrees = range["max_rad"].as_f64().unwrap().to_degrees();
    assert!((degrees - model["field_max_deg"].as_f64().unwrap()).abs() < 1e-9);
    assert!(std::fs::read_to_string(&svg).unwrap().starts_with("<svg"));
}

/// The written setup is a setup, of the camera and the magnification that were asked for: matched by the
/// diagonal the camera's height sees 1200 * 1.566 / 1.388 rows.
#[test]
fn a_designs_setup_is_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let (out, svg) = (folder.path().join("setup.toml"), folder.path().join("bench.svg"));
    for (match_by, rows) in [("height", 1200.0), ("diagonal", 1353.3)] {
        let output = retina()
            .args(["optics", "design", "--camera-focal-mm", "50", "--f-c", "86.8", "--f-r", "82.8", "--json"])
            .args(["--name", "narrow \"b\"", "--match-by", match_by, "--out"])
            .arg(&out)
            .arg("--svg")
            .arg(&svg)
            .output()
            .unwrap();
        assert_done(&output);
        let document = json(&output);
        let setup = Setup::read(&out).unwrap();
        assert_eq!(setup.name, "narrow \"b\"");
        assert!((setup.facility.observed_rows_px.unwrap() - rows).abs() < 0.1);
        assert!((setup.camera_vertical_field_rad().to_degrees() - 6.07).abs() < 0.005);
        let m = document["magnification"].as_f64().unwrap();
        assert!((m + if match_by == "height" { 0.783 } else { 0.694 }).abs() < 5e-4, "{m}");
        assert!(document["margins"]["total_length_mm"].as_f64().unwrap() > 0.0);
        // A display's row over the camera's 1536 by what the camera sees of it; brighter by longer focal lengths.
        let prediction = &document["prediction"];
        let across = prediction["screen_pixel_camera_px"].as_f64().unwrap();
        assert!((across - 1536.0 / rows).abs() < 1e-3, "{across}");
        let [white, faintest] = [0, 1].map(|k| prediction["displayed_magnitudes"][k].as_f64().unwrap());
        assert!((faintest - white - 2.5 * 2.2 * 255f64.log10()).abs() < 1e-9);
        assert!(std::fs::read_to_string(&svg).unwrap().contains("s_oc"));
    }
}

#[test]
fn a_search_reports_as_the_interface_says() {
    let flags =
        ["search", "--part", "AC508-1", "--part", "AC508-2", "--part", "AC508-750", "--candidates", "200"];
    let search = |match_by: &[&str]| {
        let all = [&flags[..], &["--leaders", "1", "--json"], match_by].concat();
        retina().arg("optics").args(all).output().unwrap()
    };
    // The reference's figures are of the diagonal; the default is the height's, as `design` has it: -1.566.
    let by_height = json(&search(&[]));
    assert_eq!(by_height["match_by"], "height");
    let m = by_height["designs"][0]["configurations"][0]["m"].as_f64().unwrap();
    assert!((m + 1.566).abs() < 5e-4, "{m}");
    let output = search(&["--match-by", "diagonal"]);
    assert_done(&output);
    let document = json(&output);
    assert_eq!(document["schema"], "retina.optics-search/1");
    assert_eq!(document["match_by"], "diagonal");
    let best = &document["designs"][0];
    assert!(best["worst_rms_um"].as_f64().unwrap() <= 14.6, "{best}");
    assert!((best["relay_efl_mm"].as_f64().unwrap() - 82.8).abs() < 1e-6);
    assert_eq!(best["lenses"].as_array().unwrap().len(), 5);
    assert!(best["lenses"][0]["part"].is_string() && best["lenses"][0]["reversed"].is_boolean());
    assert!(best["lenses"][0]["gap_after_mm"].is_number());
    let wide = &best["configurations"][0];
    assert!((wide["m"].as_f64().unwrap() + 1.388).abs() < 5e-4);
    for key in ["pupil_to_first_vertex_mm", "collimator_to_relay_mm", "relay_to_screen_mm"] {
        assert!(wide[key].as_f64().unwrap() > 0.0, "{key}");
    }
    assert_eq!(wide["fields"].as_array().unwrap().len(), 3);
    assert!(wide["fields"][2]["tan"].is_number() && wide["fields"][2]["vignetted_fraction"].is_number());
}

#[test]
fn numbers_that_cannot_be_are_refused() {
    let refused = |arguments: &[&str], words: &[&str]| assert_refused(&optics(arguments), words);
    refused(&["constraints", "--f-c", "0", "--f-r", "82.8"], &["--f-c", "not a positive number"]);
    refused(&["constraints", "--f-c", "86.8", "--f-r", "82.8", "--svg", "x.svg"], &["add --grid"]);
    refused(&["design", "--camera-focal-mm", "25", "--f-c", "86.8", "--f-r", "nan"], &["--f-r"]);
    refused(&["search", "--part", "NONE"], &["no stock lens is left"]);
    refused(&["search", "--relay-lenses", "9"], &["relay lenses", "2 or 3"]);
}

#[test]
fn a_design_that_does_not_fit_the_bench_is_no_success() {
    let design = ["optics", "design", "--camera-focal-mm", "10", "--f-c", "86.8", "--f-r", "82.8", "--json"];
    let output = retina().args(design).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("the design does not fit the bench:") && said.contains("r_c by "), "{said}");
    let document: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(document["margins"]["collimator_vignetting_mm"].as_f64().unwrap() < 0.0);
    assert_eq!(document["match_by"], "height");
}

#[test]
fn options_that_mean_nothing_are_refused() {
    let refused = |arguments: &[&str], word: &str| {
        let out =
            std::process::Command::new(env!("CARGO_BIN_EXE_retina")).arg("optics").args(arguments).output();
        let out = out.unwrap();
        let text = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(2), "{arguments:?}: {text}");
        assert!(text.contains(word), "{arguments:?}: {text}");
    };
    for scale in ["nan", "-1", "0", "inf"] {
        refused(&["spots", "reference-1.3fc-wide", "--scale", scale], "above 0");
    }
    for gap in ["nan", "-3"] {
        refused(&["tolerance", "reference-1.3fc-wide", "--gap-um", gap], "from 0 to 100000");
    }
    refused(&["layout", "reference-1.3fc-wide", "--svg", "layout.png"], "`.svg`");
    refused(&["layout", "reference-1.3fc-wide", "--png", "layout.svg"], "`.png`");
    refused(&["layout", "reference-1.3fc-wide"], "--svg FILE");
    refused(&["tolerance", "reference-1.3fc-wide", "--gap-um", "1e9"], "from 0 to 100000");
    refused(&["trace", "reference-1.3fc-wide", "--pupil", "2,2"], "outside the pupil");
    refused(&["trace", "reference-1.3fc-wide", "--field", "0,1e5"], "at most 1e2");
    refused(&["constraints", "--f-c", "1e9", "--f-r", "82.8"], "longer than any bench");
    refused(&["psf", "reference-1.3fc-wide", "--pitch-um", "5"], "too coarse: at most 3.3");
    let design =
        ["design", "--camera-focal-mm", "25", "--f-c", "86.8", "--f-r", "82.8", "--out", "setup.toml"];
    refused(&[&design[..], &["--name", "two\nlines"]].concat(), "control characters");
}
