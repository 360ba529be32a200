//! The commands about files and the machine: new, check, doctor, completions, man; errors for programs.

use std::path::{Path, PathBuf};
use std::process::Output;

use crate::common::{self, Fixture, assert_done, assert_refused, json, retina, stderr};

fn in_folder(folder: &Path, arguments: &[&str]) -> Output {
    retina().current_dir(folder).args(arguments).output().unwrap()
}

fn asset(name: &str) -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets").join(name).display().to_string()
}

/// The name of a setup that ships stands for it, beside a folder of that name, too; a file of that name goes before.
#[test]
fn setups_that_ship_go_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let run = |setup: &str, out: &str| {
        in_folder(folder.path(), &["simulate", "power", "--setup", setup, "--seed", "1", "--out", out])
    };
    assert_done(&run("wide-fov", "wide-fov"));
    assert_done(&run("wide-fov", "again"));
    assert_done(&run(&asset("setups/wide-fov.toml"), "by-path"));
    let table = |name: &str| std::fs::read_to_string(folder.path().join(name).join("power.csv")).unwrap();
    assert_eq!(table("wide-fov"), table("by-path"));
    assert_refused(&run("wide-fow", "none"), &["wide-fow", "setups that ship: wide-fov, narrow-fov"]);
    std::fs::write(folder.path().join("narrow-fov"), "no setup").unwrap();
    assert_refused(&run("narrow-fov", "none"), &["narrow-fov"]);
}

#[test]
fn what_is_started_reads_and_renders() {
    let folder = tempfile::tempdir().unwrap();
    let run = |arguments: &[&str]| in_folder(folder.path(), arguments);
    assert_done(&run(&["new", "scene", "--out", "scene.toml"]));
    // The scene's setup came along; a campaign beside it takes the same.
    assert_done(&run(&["new", "campaign", "--out", "campaign.toml"]));
    let checked = json(&run(&["check", "setup.toml", "scene.toml", "campaign.toml", "--json"]));
    assert_eq!(checked["ok"], true, "{checked}");
    let kinds: Vec<&str> = (0..3).map(|k| checked["files"][k]["kind"].as_str().unwrap()).collect();
    assert_eq!(kinds, ["facility setup", "scene", "far-range campaign"]);
    assert_done(&run(&["render", "scene.toml", "--frames", "0..1", "--out", "frames"]));
    assert_eq!(json(&run(&["check", "frames", "--json"]))["files"][0]["kind"], "folder of frames");
    // The paper's wide configuration, key for key.
    let own = std::fs::read_to_string(folder.path().join("setup.toml")).unwrap();
    let with_defaults =
        own.replace("# wavelength_nm", "wavelength_nm").replace("# [response] ", "[response] ");
    let with_defaults = with_defaults.replace("# gamma", "gamma").replace("# brightest", "brightest");
    let with_defaults = with_defaults.replace("# [optics] ", "[optics] ").replace("# linewidth", "linewidth");
    assert_ne!(with_defaults, own);
    std::fs::write(folder.path().join("whole.toml"), with_defaults).unwrap();
    assert_done(&run(&["check", "whole.toml"]));
    // What is there is not written over.
    assert_refused(&run(&["new", "setup", "--out", "setup.toml"]), &["setup.toml", "is there already"]);
    assert_eq!(std::fs::read_to_string(folder.path().join("setup.toml")).unwrap(), own);
    assert_refused(&run(&["new", "setup", "--out", "other/setup.yaml"]), &["extension"]);
    assert!(!folder.path().join("other").exists());
    assert_done(&run(&["new", "scene", "--out", "other/folder/scene.toml"]));
    assert_done(&run(&["check", "other/folder/setup.toml"]));
}

#[test]
fn every_asset_is_known_and_damage_is_seen() {
    let fixture = Fixture::new();
    let mut files: Vec<PathBuf> = Vec::new();
    for kind in ["setups", "scenarios", "calibrations", "optics", "corto"] {
        for entry in std::fs::read_dir(asset(kind)).unwrap() {
            files.push(entry.unwrap().path());
        }
    }
    files.retain(|file| file.extension().is_none_or(|extension| extension != "csv"));
    files.extend(
        ["rock.glb", "poses.csv", "scene.toml", "setup.toml", "calibration.toml"]
            .map(|name| fixture.path(name)),
    );
    let checked = json(&retina().arg("check").args(&files).arg("--json").output().unwrap());
    assert_eq!(checked["files"].as_array().unwrap().len(), files.len());
    assert_eq!(checked["ok"], true, "{checked}");
    // A calibration is held to the setup that is given beside it.
    fixture.edit("calibration.toml", "[3, 0, 12.0, 0.0]", "[3, 0, 1e9, 0.0]");
    let both = [fixture.path("setup.toml"), fixture.path("calibration.toml")];
    let bad = retina().arg("check").args(&both).arg("--json").output().unwrap();
    assert_eq!(bad.status.code(), Some(2));
    let document: serde_json::Value = serde_json::from_slice(&bad.stdout).unwrap();
    assert_eq!((&document["files"][0]["ok"], &document["files"][1]["ok"]), (&true.into(), &false.into()));
    // A slip in a key, a table of nothing, a picture that is none, an unknown file.
    fixture.edit("scene.toml", "trajectory =", "trajektory =");
    fixture.write("table.csv", "a,b\n1,2\n");
    fixture.write("picture.png", "none");
    fixture.write("notes.md", "none");
    fixture.write("truth.json", r#"{"schema": "retina.truth/1"}"#);
    fixture.write("other.json", r#"{"schema": "retina.nonsense/9"}"#);
    for (name, words) in [
        ("scene.toml", ["trajektory", "did you mean `trajectory`?"]),
        ("table.csv", ["none of the known tables", "a, b"]),
        ("picture.png", ["picture.png", "convert the image"]),
        ("truth.json", ["truth of a frame", "key `frame`"]),
        ("other.json", ["retina.nonsense/9", "no document of RETINA"]),
        ("notes.md", ["`.md`", "no file that RETINA knows"]),
        ("nowhere.toml", ["nowhere.toml", "cannot be read"]),
    ] {
        assert_refused(&retina().arg("check").arg(fixture.path(name)).output().unwrap(), &words);
    }
}

#[test]
fn an_error_is_a_document_under_json() {
    let fixture = Fixture::new();
    fixture.edit("setup.toml", "bits = 12", "bitz = 12");
    let out = fixture.render("out", &["--json"]);
    assert_eq!(out.status.code(), Some(2));
    let document: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!(document["schema"], "retina.error/1");
    assert!(document["input"]["file"].as_str().unwrap().ends_with("setup.toml"), "{document}");
    assert_eq!(document["input"]["line"], 16, "{document}");
    assert!(document["input"]["problem"].as_str().unwrap().contains("bitz"));
    // An option that is not known, too.
    let out = retina().args(["render", "scene.toml", "--otu", "x", "--json"]).output().unwrap();
    let document: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    assert!(document["message"].as_str().unwrap().contains("--otu"), "{document}");
    assert!(stderr(&out).contains("--otu"));
}

#[test]
fn the_machine_and_the_shell() {
    let folder = tempfile::tempdir().unwrap();
    let run = |arguments: &[&str]| in_folder(folder.path(), arguments);
    let found = json(&run(&["doctor", "--json"]));
    let names: Vec<&str> = found["findings"]
        .as_array()
        .unwrap()
        .iter()
        .map(|finding| finding["name"].as_str().unwrap())
        .collect();
    for name in ["version", "processor", "memory", "renderer", "caches", "disk"] {
        assert!(names.contains(&name), "{names:?}");
    }
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let printed = run(&["completions", shell]);
        assert_done(&printed);
        assert!(String::from_utf8_lossy(&printed.stdout).contains("investigate"), "{shell}");
    }
    assert_done(&run(&["man", "--out", "man"]));
    assert!(folder.path().join("man/retina-render.1").is_file());
}

#[test]
fn linear_images_are_split_into_screens_that_add_up() {
    let fixture = common::Fixture::new();
    std::fs::create_dir(fixture.path("linear")).unwrap();
    let samples: Vec<u16> = (0..160 * 100).map(|at| (at * 4) as u16).collect();
    let linear = |name: &str, width: u32| {
        image::ImageBuffer::<image::Luma<u16>, _>::from_raw(
            width,
            100,
            samples[..width as usize * 100].to_vec(),
        )
        .unwrap()
        .save(fixture.path(name))
        .unwrap();
    };
    linear("linear/ramp.png", 160);
    let run = |more: &[&str]| {
        let mut command = common::retina();
        command
            .args(["lab", "split"])
            .arg(fixture.path("linear"))
            .arg("--setup")
            .arg(fixture.path("setup.toml"));
        command.arg("--out").arg(fixture.path("split")).args(more).output().unwrap()
    };
    for (shares, said) in [("0.1,0.9", "--shares"), ("1", "--shares"), ("0.5,0.4", "add up to 1")] {
        common::assert_refused(&run(&["--shares", shares]), &[said]);
        assert!(!fixture.path("split").exists());
    }
    let told = common::json(&run(&["--shares", "0.9,0.09,0.01", "--json"]));
    let part = |key: &str| told[key].as_f64().unwrap();
    assert!(
        part("largest_error") < 1e-4 && part("relative_rms") < 0.05 * part("relative_rms_of_one"),
        "{told}"
    );
    let table = std::fs::read_to_string(fixture.path("split/split.csv")).unwrap();
    assert!(table.contains("ramp.png") && table.contains(",screens/ramp-3.png,0.01"), "{table}");
    // The screens add up to the image.
    let level = |count: u8| (f64::from(count) / 255.0).powf(2.2);
    let screens = [1, 2, 3].map(|part| {
        image::open(fixture.path(&format!("split/screens/ramp-{part}.png"))).unwrap().to_luma8().into_raw()
    });
    for (at, wanted) in samples.iter().enumerate() {
        let sum: f64 =
            screens.iter().zip([0.9, 0.09, 0.01]).map(|(screen, share)| share * level(screen[at])).sum();
        assert!((sum - f64::from(*wanted) / 65535.0).abs() < 1e-4, "{at}");
    }
    common::assert_refused(&run(&[]), &["is there already"]);
    std::fs::remove_dir_all(fixture.path("split")).unwrap();
    // All are looked at before anything is written.
    linear("linear/x,y.png", 160);
    common::assert_refused(&run(&[]), &["x,y.png", "cannot name its image"]);
    assert!(!fixture.path("split").exists());
    std::fs::remove_file(fixture.path("linear/x,y.png")).unwrap();
    linear("linear/narrow.png", 80);
    common::assert_refused(&run(&[]), &["narrow.png", "another size", "160 x 100 px"]);
    assert!(!fixture.path("split").exists());
}
