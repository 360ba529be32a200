//! `retina optics`: drawings, written designs, warnings, and output that cannot be written.

use std::fs::{File, OpenOptions};
use std::process::{Output, Stdio};

use crate::common::{assert_done, json, retina, stderr};

const WIDE: &str = "reference-1.3fc-wide";

fn optics(arguments: &[&str]) -> Output {
    retina().arg("optics").args(arguments).output().unwrap()
}

fn full_device() -> File {
    OpenOptions::new().write(true).open("/dev/full").unwrap()
}

/// Output that is lost is a failure; a reader that has gone away and a closed standard error are none.
#[cfg(target_os = "linux")]
#[test]
fn output_that_cannot_be_written_is_a_failure() {
    for arguments in [["trace", WIDE, "--json"], ["spots", WIDE, "--unclipped"], ["ghosts", WIDE, "--json"]] {
        let output = retina()
            .arg("optics")
            .args(arguments)
            .stdout(full_device())
            .stderr(Stdio::piped())
            .output()
            .unwrap();
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(stderr(&output).contains("standard output cannot be written"), "{}", stderr(&output));
    }
    let mut child = retina()
        .args(["optics", "psf", WIDE, "--json"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!((output.status.code(), stderr(&output)), (Some(0), String::new()));
    // Standard error on a full device: told to nobody, and no panic (101).
    let refused = retina().args(["optics", "spots", "nothing"]).stderr(full_device()).output().unwrap();
    assert_eq!(refused.status.code(), Some(2));
    let folder = tempfile::tempdir().unwrap();
    let drawn = retina()
        .args(["optics", "layout", WIDE, "--svg"])
        .arg(folder.path().join("a.svg"))
        .stderr(full_device())
        .output()
        .unwrap();
    assert_eq!(drawn.status.code(), Some(0));
}

/// Every command that draws writes both kinds, of the same picture: a PNG of two pixels for each px.
#[test]
fn drawings_are_written_as_svg_and_png() {
    let folder = tempfile::tempdir().unwrap();
    let (svg, png) = (folder.path().join("a.svg"), folder.path().join("a.png"));
    for (arguments, prefix) in [
        (&["spots", WIDE][..], ""),
        (&["fans", WIDE], ""),
        (&["field", WIDE, "--steps", "4"], ""),
        (&["field", WIDE, "--steps", "4"], "illumination-"),
        (&["wavefront", WIDE, "--pupil", "16"], ""),
        (&["psf", WIDE], ""),
        (&["psf", WIDE], "energy-"),
        (&["mtf", WIDE], ""),
        (&["ghosts", WIDE], ""),
        (&["tolerance", WIDE, "--trials", "20"], ""),
        (&["thermal", WIDE, "--temperatures-c", "15,25"], ""),
        (&["layout", WIDE], ""),
        (&["constraints", "--f-c", "86.8", "--f-r", "82.8", "--grid", "--grid-count", "9"], ""),
        (&["design", "--camera-focal-mm", "25", "--f-c", "86.8", "--f-r", "82.8"], ""),
    ] {
        let output = retina()
            .arg("optics")
            .args(arguments)
            .arg(format!("--{prefix}svg"))
            .arg(&svg)
            .arg(format!("--{prefix}png"))
            .arg(&png)
            .output()
            .unwrap();
        assert_done(&output);
        let text = std::fs::read_to_string(&svg).unwrap();
        let size = |name: &str| -> f64 {
            text.split(&format!(" {name}=\"")).nth(1).unwrap().split('"').next().unwrap().parse().unwrap()
        };
        let image = image::open(&png).unwrap().into_rgb8();
        assert_eq!(f64::from(image.width()), (2.0 * size("width")).ceil(), "{arguments:?}");
        assert_eq!(f64::from(image.height()), (2.0 * size("height")).ceil(), "{arguments:?}");
        // White paper with marks on it.
        let dark = image.pixels().filter(|pixel| pixel.0.iter().all(|&c| c < 128)).count();
        assert!(dark > 300, "{arguments:?}: {dark}");
        std::fs::remove_file(&svg).unwrap();
        std::fs::remove_file(&png).unwrap();
    }
}

/// The same figures from a search and from the files it writes, by the command line.
#[test]
fn a_searched_design_is_written_and_read() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("best.toml");
    let parts = ["--part", "AC508-150", "--part", "AC508-180", "--part", "AC508-250", "--part", "AC508-750"];
    let search = |more: &[&str]| {
        let mut command = retina();
        command.args(["optics", "search", "--candidates", "50", "--leaders", "1", "--json"]).args(parts);
        command.args(more).arg("--out").arg(&out).output().unwrap()
    };
    let document = json(&search(&["--rank", "2"]));
    for (configuration, name) in
        document["designs"][1]["configurations"].as_array().unwrap().iter().zip(["wide-fov", "narrow-fov"])
    {
        let file = folder.path().join(format!("best-{name}.toml"));
        // From the screen to the sensor: f_camera |M| / f_c.
        let focal_mm = if name == "wide-fov" { 25.0 } else { 50.0 };
        let scale = focal_mm * configuration["m"].as_f64().unwrap().abs() / 86.8;
        let spots = retina()
            .args(["optics", "spots", "--rings", "12", "--arms", "24", "--unclipped", "--json", "--scale"])
            .arg(format!("{scale:?}"))
            .arg(&file)
            .output()
            .unwrap();
        let spots = json(&spots);
        for (field, spot) in configuration["fields"]
            .as_array()
            .unwrap()
            .iter()
            .zip(spots["systems"][0]["fields"].as_array().unwrap())
        {
            let (searched, traced) = (field["rms_um"].as_f64().unwrap(), spot["rms_um"].as_f64().unwrap());
            assert!((searched - traced).abs() < 1e-9, "{name}: {searched} {traced}");
        }
    }
    let refused = search(&["--rank", "900"]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(stderr(&refused).contains("--rank"), "{}", stderr(&refused));
}

#[test]
fn a_search_without_a_design_says_what_was_in_the_way() {
    let flags = ["search", "--part", "AC508-1", "--part", "AC508-2", "--candidates", "20", "--leaders", "1"];
    let output = retina()
        .arg("optics")
        .args(flags)
        .args(["--match-by", "diagonal", "--max-length-mm", "300", "--json"])
        .output()
        .unwrap();
    let text = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "{text}");
    for word in ["20  too long from screen to collimator", "nearest miss", "by 129."] {
        assert!(text.contains(word), "`{word}` is not in {text}");
    }
    let document: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(document["designs"].as_array().unwrap().is_empty());
    assert_eq!(document["nearest_miss"]["exceeds"][0]["limit"], "total_length");
}

#[test]
fn what_a_figure_leaves_out_is_said() {
    let output = optics(&[
        "design",
        "--camera-focal-mm",
        "25",
        "--f-c",
        "86.8",
        "--f-r",
        "82.8",
        "--match-by",
        "width",
        "--json",
    ]);
    assert!(stderr(&output).contains("the screen has 1200"), "{}", stderr(&output));
    let document = json(&output);
    // 18.7 mm over 4 : 3 on 11.75 mm of 1200 rows: 1432.3 of them.
    assert!((document["rows_beyond_screen_px"].as_f64().unwrap() - 232.34).abs() < 0.01);
    assert_eq!(document["warnings"].as_array().unwrap().len(), 1);
    let mtf = optics(&["mtf", WIDE, "--highest-per-mm", "2"]);
    assert!(String::from_utf8_lossy(&mtf.stdout).contains("0.5 or more up to 2.0 /mm"));
    let small = optics(&["psf", WIDE, "--pixels", "64", "--pitch-um", "1", "--json"]);
    assert!(stderr(&small).contains("holds only"), "{}", stderr(&small));
    let tolerance = optics(&["tolerance", WIDE, "--trials", "10"]);
    assert!(String::from_utf8_lossy(&tolerance.stdout).contains("10 trials, seed 1; 0 failed"));
}

/// Every command that the optics' reference shows, in its order, and its example of a prescription.
#[test]
fn the_reference_shows_what_works() {
    let text = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/optics.md")).unwrap();
    let blocks = |kind: &str| -> Vec<String> {
        text.split(&format!("```{kind}\n"))
            .skip(1)
            .map(|rest| rest.split("```").next().unwrap().into())
            .collect()
    };
    let folder = tempfile::tempdir().unwrap();
    let run = |arguments: &str| {
        let words: Vec<&str> = arguments.split_whitespace().collect();
        let output = retina().args(words).current_dir(folder.path()).output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{arguments}: {}", stderr(&output));
    };
    std::fs::write(folder.path().join("doublet.toml"), &blocks("toml")[0]).unwrap();
    run("optics first-order doublet.toml");
    run("optics spots doublet.toml --png spots.png");
    let commands: Vec<String> = blocks("sh").concat().lines().map(str::to_owned).collect();
    assert!(commands.len() > 15, "{}", commands.len());
    for command in commands {
        run(command.strip_prefix("retina ").unwrap());
    }
}
