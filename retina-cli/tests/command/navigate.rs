//! `retina navigate` as a program.

use std::path::Path;
use std::process::{Command, Output};

use glam::{DQuat, DVec3};
use retina_navigation::stars::StarCamera;
use retina_navigation::synthetic::sources;
use retina_sky::ephemeris::Ephemeris;
use retina_sky::observer::Observer;
use serde_json::Value;

fn retina(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_retina")).args(arguments).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// A 16-bit PNG of the sky at right ascension 83 deg, declination -2 deg (Orion), or of nothing.
fn write_image(path: &Path, stars: bool) {
    let (width, height) = (1024u32, 768u32);
    let camera = StarCamera::from_field(14f64.to_radians(), [width, height]).pinhole;
    // A fixed pattern stands in for noise.
    let mut values: Vec<f64> = (0..width * height)
        .map(|i| 100.0 + f64::from((i.wrapping_mul(2_654_435_761)) >> 24) / 32.0)
        .collect();
    if stars {
        let (ra, dec) = (83f64.to_radians(), (-2f64).to_radians());
        let axis = DVec3::new(dec.cos() * ra.cos(), dec.cos() * ra.sin(), dec.sin());
        // North up: x is west, y south.
        let east = DVec3::new(-ra.sin(), ra.cos(), 0.0);
        let north = axis.cross(east);
        let rows = glam::DMat3::from_cols(-east, -north, axis).transpose();
        let observer =
            Observer::new(&Ephemeris::analytic(), 20.0 * 365.25 * 86_400.0, DVec3::ZERO, None).unwrap();
        for source in sources(&observer, DQuat::from_mat3(&rows), &camera, 7.0).unwrap() {
            let at = camera.pixel(source.line_of_sight);
            let light = 20_000.0 * 10f64.powf(0.4 * (3.0 - source.magnitude));
            for y in (at.y - 8.0).max(0.0) as u32..((at.y + 8.0) as u32).min(height) {
                for x in (at.x - 8.0).max(0.0) as u32..((at.x + 8.0) as u32).min(width) {
                    let off2 = (f64::from(x) + 0.5 - at.x).powi(2) + (f64::from(y) + 0.5 - at.y).powi(2);
                    values[(y * width + x) as usize] += light * (-0.5 * off2 / 0.81).exp() / 5.089;
                }
            }
        }
    }
    let pixels: Vec<u16> = values.iter().map(|v| v.round().min(65535.0) as u16).collect();
    image::ImageBuffer::<image::Luma<u16>, _>::from_raw(width, height, pixels).unwrap().save(path).unwrap();
}

#[test]
fn an_image_is_solved_and_an_empty_one_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (orion, empty) = (folder.path().join("orion.png"), folder.path().join("empty.png"));
    write_image(&orion, true);
    write_image(&empty, false);
    let [orion, empty] = [&orion, &empty].map(|path| path.to_str().unwrap());
    let out = retina(&["navigate", "stars", orion, empty, "--fov-deg", "14", "--json"]);
    assert_eq!(out.status.code(), Some(0), "{}", text(&out.stderr));
    let document: Value = serde_json::from_slice(&out.stdout).unwrap();
    let (first, second) = (&document["images"][0], &document["images"][1]);
    assert_eq!(document["schema"], "retina.navigation-stars/1");
    assert_eq!(first["solved"], true);
    // A pixel is 49 arcsec; the attitude is good to an arcsec, roll to ten.
    assert!((first["ra_deg"].as_f64().unwrap() - 83.0).abs() < 1e-3, "{first}");
    assert!((first["dec_deg"].as_f64().unwrap() + 2.0).abs() < 1e-3);
    assert!(first["roll_deg"].as_f64().unwrap().abs() < 0.01);
    assert!(first["matches"].as_u64().unwrap() > 30 && first["rms_arcsec"].as_f64().unwrap() < 12.0);
    assert!(first["solve_ms"].is_number() && first["planets"].is_array() && first["file"] == orion);
    assert_eq!((&second["solved"], &second["reason"]), (&Value::from(false), &Value::from("too_few_points")));
    // A refused image writes over no table of stars, and what was given is told to be in doubt.
    let csv = folder.path().join("stars.csv");
    std::fs::write(&csv, "kept").unwrap();
    let out = retina(&["navigate", "stars", empty, "--fov-deg", "14", "--csv", csv.to_str().unwrap()]);
    assert_eq!((out.status.code(), std::fs::read_to_string(&csv).unwrap()), (Some(0), "kept".to_owned()));
    assert!(text(&out.stdout).contains("try without the field of view"), "{}", text(&out.stdout));
    // Asked for all, one refused image is exit code 1, and so are residuals beyond the limit.
    assert_eq!(retina(&["navigate", "stars", empty, "--fov-deg", "14", "--all"]).status.code(), Some(1));
    let strict = retina(&["navigate", "stars", orion, "--fov-deg", "14", "--rms-arcsec", "0.001"]);
    assert_eq!(strict.status.code(), Some(1));
    assert!(text(&strict.stderr).contains("0.001 were asked for"), "{}", text(&strict.stderr));
    // A mirrored image is refused as one, and solved when said to be one.
    let mirrored = retina(&["navigate", "stars", orion, "--fov-deg", "14", "--mirrored"]);
    assert!(text(&mirrored.stdout).contains("mirrored left to right"), "{}", text(&mirrored.stdout));
}

#[test]
fn what_does_not_fit_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    write_image(&path, false);
    let image = path.to_str().unwrap();
    let setup = concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/setups/wide-fov.toml");
    for (arguments, part) in [
        (vec!["--fov-deg", "0"], "is not a field of view (found `0`"),
        (vec!["--fov-deg", "13..10"], "is not a field of view (found `13..10`"),
        (
            vec!["--setup", setup],
            "the image does not have the size of the setup's camera (found 1024 x 768 pixels, expected 2048 x 1536)",
        ),
        (vec!["--fov-deg", "11", "--time", "soon"], "`soon` is not an epoch"),
        (
            vec!["--fov-deg", "11", "--time", "2027-01-01", "--position-m", "1,2"],
            "is not a vector (found `1,2`",
        ),
        (
            vec!["--fov-deg", "11", "--focal-percent", "90"],
            "--focal-percent: the value is out of range (found 90, expected 0 to 20)",
        ),
        (
            vec!["--fov-deg", "11", "--rms-arcsec", "NaN"],
            "--rms-arcsec: the value is out of range (found NaN",
        ),
        (vec!["--fov-deg", "11", "--calibration", "none.toml"], "cannot be used with"),
        (vec!["--fov-deg", "11", "--time", "1000-01-01"], "the years 1900 to 2100"),
    ] {
        let mut all = vec!["navigate", "stars", image];
        all.extend(arguments);
        let out = retina(&all);
        assert_eq!(out.status.code(), Some(2), "{all:?}");
        assert!(text(&out.stderr).contains(part), "{all:?}: {}", text(&out.stderr));
        assert!(out.stdout.is_empty());
    }
    // What the other images say is not lost for one that cannot be read.
    let missing = folder.path().join("missing.png");
    let out = retina(&["navigate", "stars", image, missing.to_str().unwrap(), "--fov-deg", "11", "--json"]);
    assert_eq!(out.status.code(), Some(2));
    assert!(text(&out.stderr).contains("missing.png"), "{}", text(&out.stderr));
    let document: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!(document["images"][1]["reason"], "unreadable");
    assert!(document["images"][1]["message"].as_str().unwrap().contains("missing.png: cannot be read"));
    // One alone has its document too, and of several each its own reason.
    let raw = folder.path().join("raw.raf");
    std::fs::write(&raw, b"FUJIFILMCCD-RAW 0201").unwrap();
    let (missing, raw) = (missing.to_str().unwrap(), raw.to_str().unwrap());
    let out = retina(&["navigate", "stars", missing, "--fov-deg", "11", "--json"]);
    assert_eq!(out.status.code(), Some(2));
    let document: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!(document["images"].as_array().unwrap().len(), 1);
    let said = text(&retina(&["navigate", "stars", missing, raw, "--fov-deg", "11"]).stderr);
    assert!(said.contains("missing.png: cannot be read"), "{said}");
    assert!(said.contains("raw.raf: is camera raw data") && said.contains("dcraw -4 -T"), "{said}");
    assert!(document["images"][0]["solved"].is_boolean());
}

#[test]
fn a_jpeg_in_colour_is_solved_by_its_own_focal_length() {
    let folder = tempfile::tempdir().unwrap();
    let (png, jpeg, plain) =
        (folder.path().join("orion.png"), folder.path().join("orion.jpg"), folder.path().join("plain.jpg"));
    write_image(&png, true);
    let grey = image::open(&png).unwrap().into_luma16();
    let coded = image::RgbImage::from_fn(grey.width(), grey.height(), |x, y| {
        let light = (f64::from(grey.get_pixel(x, y).0[0]) / 20_000.0).clamp(0.0032, 1.0);
        image::Rgb([(255.0 * (1.055 * light.powf(1.0 / 2.4) - 0.055)) as u8; 3])
    });
    let mut bytes = Vec::new();
    image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, 90).encode_image(&coded).unwrap();
    std::fs::write(&plain, &bytes).unwrap();
    // 14 deg across 1024 of 1280 px: 43.2666 / 1280 * 512 / tan(7 deg) = 140.9 mm; EXIF has whole ones, here 141.
    let directories = b"II*\0\x08\0\0\0\x01\0\x69\x87\x04\0\x01\0\0\0\x1a\0\0\0\0\0\0\0\
        \x01\0\x05\xa4\x03\0\x01\0\0\0\x8d\0\0\0\0\0\0\0";
    let length = (directories.len() + 8) as u16;
    bytes.splice(2..2, [&b"\xff\xe1"[..], &length.to_be_bytes(), b"Exif\0\0", directories].concat());
    std::fs::write(&jpeg, &bytes).unwrap();
    let (jpeg, plain) = (jpeg.to_str().unwrap(), plain.to_str().unwrap());
    let out = retina(&["navigate", "stars", jpeg, "--json"]);
    assert_eq!(out.status.code(), Some(0), "{}", text(&out.stderr));
    let document: Value = serde_json::from_slice(&out.stdout).unwrap();
    let found = &document["images"][0];
    assert!(found["solved"].as_bool().unwrap(), "{found}");
    assert!((found["ra_deg"].as_f64().unwrap() - 83.0).abs() < 0.01, "{found}");
    let notes = found["notes"].to_string();
    assert!(notes.contains("linearised by the sRGB curve"), "{notes}");
    assert!(
        notes.contains("field of view by its EXIF, if it was not cropped: 12.97 to 15.20 deg"),
        "{notes}"
    );
    // Without EXIF any field is searched, and what is found is written; a field that is given counts alone.
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let [csv, wcs, drawing] = ["stars.csv", "sky.fits", "named.png"].map(path);
    let out =
        retina(&["navigate", "stars", plain, "--json", "--csv", &csv, "--wcs", &wcs, "--annotate", &drawing]);
    assert_eq!(out.status.code(), Some(0), "{}", text(&out.stderr));
    let document: Value = serde_json::from_slice(&out.stdout).unwrap();
    let found = &document["images"][0];
    assert!((found["ra_deg"].as_f64().unwrap() - 83.0).abs() < 0.01, "{found}");
    assert!(found["mirrored"] == false && found["pixel_aspect"] == 1.0, "{found}");
    let rows = std::fs::read_to_string(&csv).unwrap();
    assert!(rows.starts_with("id,magnitude,ra_deg,dec_deg,camera_x_px,"), "{rows}");
    assert_eq!(rows.lines().count() as u64, 1 + found["matches"].as_u64().unwrap());
    let header = std::fs::read(&wcs).unwrap();
    assert!(header.len() % 2880 == 0 && header.starts_with(b"SIMPLE  =                    T"));
    assert!(text(&header).contains("CTYPE1  = 'RA---TAN-SIP'"));
    assert_eq!(std::fs::read(&drawing).unwrap()[..4], *b"\x89PNG");
    let said = text(&retina(&["navigate", "stars", plain, plain, "--csv", &csv]).stderr);
    assert!(said.contains("--csv: is for one image") && said.contains("2 images"), "{said}");
    // An input is never written over, and no two outputs are one.
    let before = std::fs::read(&drawing).unwrap();
    let out = retina(&["navigate", "stars", plain, "--dark", &drawing, "--annotate", &drawing]);
    let said = text(&out.stderr);
    assert!(out.status.code() == Some(2) && said.contains("would be overwritten"), "{said}");
    assert!(std::fs::read(&drawing).unwrap() == before);
    let out = retina(&["navigate", "stars", plain, "--pixel-aspect", "0.1"]);
    let said = text(&out.stderr);
    assert!(
        out.status.code() == Some(2) && said.contains("--pixel-aspect") && said.contains("0.2 to 5"),
        "{said}"
    );
    // A mask of another size, and one that leaves nothing.
    let mask = |name: &str, [width, height]: [u32; 2]| {
        retina_image::CameraImage::new(width, height, 255.0).write_png(Path::new(&path(name))).unwrap();
        let out = retina(&["navigate", "stars", plain, "--mask", &path(name)]);
        (out.status.code(), text(&out.stdout) + &text(&out.stderr))
    };
    let (code, said) = mask("small.png", [10, 10]);
    assert!(code == Some(2) && said.contains("does not have the size of the image"), "{said}");
    let size = image::image_dimensions(plain).unwrap();
    let (code, said) = mask("all.png", [size.0, size.1]);
    assert!(code == Some(2) && said.contains("leaves nothing of the photograph"), "{said}");
    let said = text(&retina(&["navigate", "stars", jpeg, "--fov-deg", "14"]).stdout);
    assert!(said.contains("right ascension 8") && !said.contains("by its EXIF, if"), "{said}");
}

#[test]
fn the_far_range_experiment_is_taken_up_where_it_was_left() {
    let folder = tempfile::tempdir().unwrap();
    let asset = concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/scenarios/far-range.toml");
    let setups = concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/setups");
    let own = std::fs::read_to_string(asset).unwrap().replace("samples = 100", "samples = 4");
    let scenario = folder.path().join("far-range.toml");
    std::fs::write(&scenario, own.replace("../setups", setups)).unwrap();
    let scenario = scenario.to_str().unwrap();
    let run_part = |out: &str, own: &[&str], name: &str| {
        let out = folder.path().join(out);
        let common = ["navigate", "far-range", scenario, "--out", out.to_str().unwrap()];
        let done = retina(&[&common, own].concat());
        assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
        std::fs::read_to_string(out.join(name)).unwrap()
    };
    let run = |out: &str, poses: &str| run_part(out, &["--poses", poses], "far-range.json");
    let whole = run("whole", "40");
    let document: Value = serde_json::from_str(&whole).unwrap();
    assert!(document["poses"]["attitude_found_percent"].as_f64().unwrap() >= 95.0, "{}", document["poses"]);
    assert_eq!(document["poses"]["attitude_wrong"], 0);
    assert!(document["transfer"]["final_three_sigma_km"].as_f64().unwrap() < 20_000.0);
    // Ten poses, the last line cut short, then the rest: the same document.
    run("parts", "10");
    let list = folder.path().join("parts/poses.jsonl");
    let lines = std::fs::read_to_string(&list).unwrap();
    std::fs::write(&list, &lines[..lines.len() - 20]).unwrap();
    assert!(run("parts", "40") == whole, "a run in two parts is the whole one");
    // Three shards, then the whole of them: 13 of 40 are 1 modulo 3, and have no transfer.
    for shard in ["0/3", "1/3", "2/3"] {
        let name = format!("far-range-{}-of-3.json", &shard[..1]);
        let part = run_part("shards", &["--poses", "40", "--shard", shard], &name);
        let part: Value = serde_json::from_str(&part).unwrap();
        assert_eq!(part["poses"]["poses"], if shard == "0/3" { 14 } else { 13 }, "{part}");
        assert_eq!(part["transfer"], Value::Null);
    }
    assert!(run("shards", "40") == whole, "the shards together are the whole");
    let own_list = std::fs::read_to_string(folder.path().join("shards/poses.jsonl")).unwrap();
    assert_eq!(own_list.lines().count(), 1, "no pose is run again: {own_list}");
    // Another scenario's poses are not mixed in.
    let other = own.replace("seed = 1", "seed = 2").replace("../setups", setups);
    std::fs::write(folder.path().join("far-range.toml"), other).unwrap();
    let out = folder.path().join("parts");
    let refused = retina(&["navigate", "far-range", scenario, "--out", out.to_str().unwrap()]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(text(&refused.stderr).contains("holds poses of another scenario"), "{}", text(&refused.stderr));
    // A planet named twice, an arrival that no ephemeris has, a calibration that nothing uses, a shard without poses:
    // refused before anything runs.
    let fresh = folder.path().join("fresh");
    let refuse = |scenario_text: String, flags: &[&str], words: &str| {
        std::fs::write(folder.path().join("far-range.toml"), scenario_text.replace("../setups", setups))
            .unwrap();
        let common = ["navigate", "far-range", scenario, "--out", fresh.to_str().unwrap()];
        let refused = retina(&[&common, flags].concat());
        assert_eq!(refused.status.code(), Some(2));
        assert!(text(&refused.stderr).contains(words), "{}", text(&refused.stderr));
        assert!(!fresh.join("poses.jsonl").exists());
    };
    refuse(own.replace("\"saturn\"]", "\"venus\"]"), &[], "a planet is named twice (found `venus`");
    refuse(own.replace("2034-06-01", "2100-06-01"), &[], "keys `transfer.arrival` and `transfer.days`");
    refuse(own.clone(), &["--calibration", "none.toml"], "none.toml: is not used");
    refuse(own.clone(), &["--poses", "3", "--shard", "5/9"], "--shard: contains no pose");
    // A planet that is none is named.
    let wrong = own.replace("\"saturn\"]", "\"pluto\"]").replace("../setups", setups);
    std::fs::write(folder.path().join("far-range.toml"), wrong).unwrap();
    let refused = retina(&["navigate", "far-range", scenario, "--out", out.to_str().unwrap()]);
    assert!(text(&refused.stderr).contains("key `transfer.planets`: is not a planet (found `pluto`"));
}

/// The calibrations that ship are not the virtual bench's: who photographs by one is told that it does not fit.
#[test]
fn a_far_range_on_another_bench_s_calibration_is_warned_of() {
    let folder = tempfile::tempdir().unwrap();
    let asset = concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/scenarios/far-range.toml");
    let run = |images: &str| {
        let out = folder.path().join(images);
        let few = ["--out", out.to_str().unwrap(), "--poses", "6", "--shard", "0/2"];
        let output = retina(&[&["navigate", "far-range", asset, "--images", images][..], &few].concat());
        assert!(output.status.success(), "{}", text(&output.stderr));
        text(&output.stderr)
    };
    let said = run("bench");
    assert!(said.contains("what their covariances allow") && said.contains("--calibration"), "{said}");
    let said = run("points");
    assert!(!said.contains("covariances"), "{said}");
}
