//! `retina import`, lens baselines, and `retina fit --camera-model`.

use std::path::{Path, PathBuf};

use crate::common::{assert_done, assert_refused, retina};
use serde_json::Value;

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../retina-import/tests/fixtures").join(name)
}

/// A command on the imported folder.
fn on(folder: &Path, command: &str, arguments: &[&str]) -> std::process::Output {
    retina()
        .arg(command)
        .arg("--setup")
        .arg(folder.join("setup.toml"))
        .arg("--data")
        .arg(folder.join("points.csv"))
        .args(arguments)
        .output()
        .unwrap()
}

fn rms(folder: &Path, baseline: &str) -> f64 {
    let done = on(folder, "compare", &["--json", "--baseline", baseline]);
    assert_done(&done);
    let result: Value = serde_json::from_slice(&done.stdout).unwrap();
    result["rms"].as_f64().unwrap()
}

#[test]
fn a_calibration_goes_through_the_workbench_and_back() {
    let folder = tempfile::tempdir().unwrap();
    for (source, name, baseline, written) in [
        ("mrcal", "opencv8.cameramodel", "rational", "lens.cameramodel"),
        ("opencv", "fisheye.json", "fisheye", "lens.yaml"),
        ("opencv", "rational.yaml", "rational", "lens.json"),
    ] {
        let out = folder.path().join(name);
        let done = retina()
            .args(["import", source, "--json"])
            .arg(fixture(name))
            .arg("--out")
            .arg(&out)
            .output()
            .unwrap();
        assert_done(&done);
        let result: Value = serde_json::from_slice(&done.stdout).unwrap();
        assert_eq!(result["schema"], "retina.import/1");
        assert!(result["rows"].as_u64().unwrap() > 300, "{result}");
        // 0.05 px of noise at 520 or 700 px a radian: 20 or 15 arcsec.
        let own = rms(&out, baseline);
        assert!((10.0..25.0).contains(&own) && rms(&out, "fisheye:equisolid") > 3.0 * own, "{name}: {own}");
        let lens = folder.path().join(written);
        let path = lens.to_str().unwrap();
        assert_done(&on(&out, "fit", &["--baseline", baseline, "--camera-model", path]));
        // What was written is that program's: it is read as its file.
        let text = std::fs::read_to_string(&lens).unwrap();
        assert!(
            text.contains(if source == "mrcal" { "LENSMODEL_OPENCV8" } else { "camera_matrix" }),
            "{text}"
        );
        assert_done(&on(&out, "diagnose", &["--json", "--baseline", baseline, "--flips", "199"]));
    }
    let out = folder.path().join("fisheye.json");
    let model = folder.path().join("lens.cameramodel");
    let path = model.to_str().unwrap();
    assert_refused(
        &on(&out, "fit", &["--baseline", "fisheye", "--camera-model", path]),
        &["mrcal has no lens model of this kind", "fisheye:kannala-brandt"],
    );
    assert_refused(
        &on(&out, "fit", &["--camera-model", path]),
        &["--camera-model", "writes the lens of a baseline that is a lens model"],
    );
    assert_refused(
        &on(&out, "compare", &["--baseline", "fisheye:orthographic"]),
        &["is no baseline", "fisheye:equisolid"],
    );
}

#[test]
fn what_cannot_be_imported_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let import = |arguments: &[&str], file: PathBuf| {
        retina().arg("import").args(arguments).arg(file).arg("--out").arg(&out).output().unwrap()
    };
    assert_refused(
        &import(&["mrcal"], fixture("nothing.cameramodel")),
        &["nothing.cameramodel", "cannot be read"],
    );
    assert_refused(&import(&["mrcal"], fixture("rational.yaml")), &["rational.yaml", "line 1"]);
    assert_refused(&import(&["opencv"], fixture("opencv8.vnl")), &["opencv8.vnl"]);
    assert_refused(
        &import(&["opencv", "--pixel-um", "0"], fixture("rational.yaml")),
        &["--pixel-um", "0.1 to 1000"],
    );
    assert!(!out.exists());
}
