//! `retina investigate` from a table to files that the other commands take.

use std::fmt::Write as _;
use std::path::Path;

use crate::common::{assert_done, assert_refused, json, retina};

/// Readings of a power meter that grow with the humidity, the more the larger the square is. Noise of 0.4 %.
fn readings(series: usize) -> String {
    let mut state = 7u64;
    // A linear congruential generator (D. E. Knuth's MMIX), and twelve of its numbers for a normal one.
    let mut uniform = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let mut text = String::from("channel,digital_count,square_px,irradiance_w_m2,series,time_s,humidity\n");
    for number in 0..series {
        let humidity = 30.0 + 40.0 * uniform();
        for (k, count) in [8.0f64, 24.0, 60.0, 120.0, 255.0].into_iter().cycle().take(20).enumerate() {
            let side = [20.0f64, 60.0, 100.0, 200.0][(number + k) % 4];
            let wet = 0.02 * ((humidity - 50.0) / 20.0) * (side / 200.0).sqrt();
            let noise = 0.004 * ((0..12).map(|_| uniform()).sum::<f64>() - 6.0);
            let read = side * side * (count / 255.0).powf(2.2) * (1.0 + wet) * (1.0 + noise) * 2e-9;
            let time_s = 30 * (20 * number + k);
            let _ = writeln!(text, "w,{count},{side},{read:e},s{number:02},{time_s},{humidity:.2}");
        }
    }
    text
}

fn asked(folder: &Path, table: &str, more: &[&str]) -> std::process::Output {
    std::fs::write(folder.join("power.csv"), table).unwrap();
    let setup = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/setups/wide-fov.toml");
    let mut command = retina();
    command.current_dir(folder).args(["investigate", "--data", "power.csv", "--setup"]).arg(setup);
    command.args(more).output().unwrap()
}

#[test]
fn a_formula_that_is_found_is_an_effect_for_fit() {
    let folder = tempfile::tempdir().unwrap();
    let out = asked(folder.path(), &readings(24), &["--out", "found", "--report", "page.html", "--json"]);
    let said = json(&out);
    assert_eq!((&said["schema"], &said["verdict"]), (&"retina.investigation/1".into(), &"found".into()));
    assert!(said["terms"][0]["covariates"].as_array().unwrap().contains(&"humidity".into()), "{said}");
    // What programs read: whether, how sure, and each formula with its file, equivalent ones after it.
    assert!(said["found"] == true && said["p_value"].as_f64().unwrap() <= 0.01, "{said}");
    let formulas = said["formulas"].as_array().unwrap();
    assert_eq!(
        formulas.len(),
        said["terms"]
            .as_array()
            .unwrap()
            .iter()
            .map(|t| 1 + t["rivals"].as_array().unwrap().len())
            .sum::<usize>()
    );
    let mut texts: Vec<&str> = Vec::new();
    for formula in formulas {
        let file = std::fs::read_to_string(folder.path().join(formula["file"].as_str().unwrap())).unwrap();
        let value = formula["value"].as_str().unwrap();
        assert!(
            file.contains(&format!("value = \"{value}\"")) && !texts.contains(&value),
            "{formula}\n{file}"
        );
        texts.push(value);
        let [columns, complexity, error] = ["columns", "complexity", "heldout_rms"].map(|key| &formula[key]);
        assert!(columns.as_array().unwrap().contains(&"humidity".into()) && complexity.is_u64(), "{formula}");
        assert!((0.003..0.006).contains(&error.as_f64().unwrap()), "{formula}");
    }
    let next = &said["next_measurement"];
    assert_eq!(
        next.is_null(),
        said["terms"].as_array().unwrap().iter().all(|t| t["rivals"] == serde_json::json!([]))
    );
    let page = std::fs::read_to_string(folder.path().join("page.html")).unwrap();
    assert!(page.contains("found_1") && page.contains("<svg") && !page.contains("src=\"http"));

    let setup = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/setups/wide-fov.toml");
    let mut fit = retina();
    fit.current_dir(folder.path()).args(["fit", "--data", "power.csv", "--effect", "found/found_1.toml"]);
    let fitted = fit.arg("--setup").arg(setup).output().unwrap();
    assert_done(&fitted);
    assert!(String::from_utf8(fitted.stdout).unwrap().contains("found_1.amplitude_1"));
}

#[test]
fn what_cannot_be_halved_is_refused_and_nothing_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let out = asked(folder.path(), &readings(1), &["--out", "found", "--report", "page.html"]);
    assert_refused(&out, &["too few groups", "expected at least 12"]);
    assert!(!folder.path().join("found").exists() && !folder.path().join("page.html").exists());
    let out = asked(folder.path(), &readings(24), &["--out", "power.csv"]);
    assert_refused(&out, &["--out", "is no folder"]);
    let out = asked(folder.path(), &readings(24), &["--terms", "0"]);
    assert_refused(&out, &["--terms"]);
}

/// What was found in one table is tried on the next, and named there.
#[test]
fn a_kept_formula_is_tried_by_diagnose() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    assert_done(&asked(folder, &readings(24), &["--out", "kept", "--terms", "1"]));
    std::fs::write(folder.join("kept/of_points.toml"), "name = \"of_points\"\nunit = \"arcsec\"\ndx = \"a * x\"\ndy = \"a * y\"\n[parameters]\na = { start = 1.0, unit = \"arcsec\" }\n").unwrap();
    let diagnosed = |table: &str, catalogue: &str| {
        std::fs::write(folder.join("power.csv"), table).unwrap();
        let setup = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/setups/wide-fov.toml");
        let mut command = retina();
        command.current_dir(folder).args(["diagnose", "--data", "power.csv", "--json", "--setup"]).arg(setup);
        command.args(["--catalogue", catalogue]).output().unwrap()
    };
    // Twenty other series of the same instrument.
    let out = diagnosed(&readings(20), "kept");
    assert_done(&out);
    let said = String::from_utf8(out.stdout).unwrap();
    // It or a rival in the same folder, which the first table could not tell from it.
    assert!(said.contains("\"name\": \"found_1") && !said.contains("\"verdict\": \"unknown\""), "{said}");
    assert!(said.contains("of_points.toml was not tried"), "{said}");
    // Where nothing depends on it, it is not taken.
    let dry =
        readings(24).lines().map(|line| line.replace("humidity", "other")).collect::<Vec<_>>().join("\n");
    let out = diagnosed(&(dry + "\n"), "kept");
    assert_done(&out);
    assert!(String::from_utf8(out.stdout).unwrap().contains("\"kept\": []"));
    std::fs::create_dir(folder.join("empty")).unwrap();
    assert_refused(&diagnosed(&readings(20), "empty"), &["--catalogue", "holds no formulas"]);
    assert_refused(&diagnosed(&readings(20), "nowhere"), &["--catalogue", "cannot be read"]);
}
