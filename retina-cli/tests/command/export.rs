//! `retina export`: what each format holds, and what cannot be exported.

use std::fs;
use std::process::Output;

use crate::common::{Fixture, assert_done, assert_refused, contents, json, retina, stderr};
use serde_json::Value;

fn export(fixture: &Fixture, from: &str, format: &str, out: &str) -> Output {
    let mut command = retina();
    command
        .arg("export")
        .arg(fixture.path(from))
        .arg("--out")
        .arg(fixture.path(out))
        .args(["--format", format]);
    command.output().unwrap()
}

fn document(fixture: &Fixture, name: &str) -> Value {
    serde_json::from_str(&fs::read_to_string(fixture.path(name)).unwrap()).unwrap()
}

/// Six frames of a sphere with a disc of 40 px radius, with their masks.
fn rendered() -> Fixture {
    let fixture = Fixture::new();
    let scene = fs::read_to_string(fixture.path("scene.toml")).unwrap();
    fixture.write("scene.toml", &(scene + "[output]\nlayers = [\"mask\"]\n"));
    assert_done(&fixture.render("frames", &[]));
    fixture
}

/// Bytes of FITS data with their padding.
fn padded(bytes: usize) -> usize {
    bytes.next_multiple_of(2880)
}

#[test]
fn every_format_has_all_frames_and_the_same_bytes_again() {
    let fixture = rendered();
    for format in ["speedplus", "bop", "webdataset", "coco", "fits", "png16"] {
        assert_done(&export(&fixture, "frames", format, format));
        assert_done(&export(&fixture, "frames", format, "again"));
        assert_eq!(contents(&fixture.path(format)), contents(&fixture.path("again")), "{format}");
        fs::remove_dir_all(fixture.path("again")).unwrap();
        assert_refused(&export(&fixture, "frames", format, format), &["is there already"]);
        let record = document(&fixture, &format!("{format}/export.json"));
        let frames = &record["frames"];
        assert_eq!(frames["training"].as_u64().unwrap() + frames["validation"].as_u64().unwrap(), 6);
    }
    // The disc of an ellipse that is a circle: pi r^2 pixels in each mask, the centre in the middle.
    let truth = document(&fixture, "frames/truth/000000.json");
    let rock = &truth["bodies"]["rock"];
    let area = std::f64::consts::PI * rock["limb_ellipse_px"]["semi_axes_px"][0].as_f64().unwrap().powi(2);
    let mut annotated = 0;
    for part in ["train", "val"] {
        for entry in document(&fixture, &format!("coco/annotations/instances_{part}.json"))["annotations"]
            .as_array()
            .unwrap()
        {
            assert!((entry["area"].as_f64().unwrap() / area - 1.0).abs() < 0.02, "{}", entry["area"]);
            let runs: Vec<u64> = entry["segmentation"]["counts"]
                .as_array()
                .unwrap()
                .iter()
                .map(|n| n.as_u64().unwrap())
                .collect();
            assert_eq!(runs.iter().sum::<u64>(), 160 * 100);
            // +z of the body is away from the camera, which looks along it; -z faces it.
            let points: Vec<f64> =
                entry["keypoints"].as_array().unwrap().iter().map(|n| n.as_f64().unwrap()).collect();
            assert!((points[0] - 80.0).abs() < 1e-9 && (points[1] - 50.0).abs() < 1e-9);
            assert_eq!((points[5 * 3 + 2], points[6 * 3 + 2]), (1.0, 2.0), "{points:?}");
            annotated += 1;
        }
    }
    assert_eq!(annotated, 6);
    let camera = document(&fixture, "speedplus/camera.json");
    assert_eq!(camera["cameraMatrix"][0], serde_json::json!([900.0, 0.0, 80.0]));
    let pose = &document(&fixture, "speedplus/synthetic/train.json")[0];
    assert_eq!(pose["r_Vo2To_vbs_true"], rock["position_camera_m"]);
    // BOP counts pixels from the first one's centre, and lengths in mm.
    assert_eq!(document(&fixture, "bop/camera.json")["cx"], 79.5);
    let header = fs::read(fixture.path("fits/000000.fits")).unwrap();
    assert!(header.starts_with(b"SIMPLE  =                    T") && header.len().is_multiple_of(2880));
    // The same radiance in 16 bits: more than half of the full scale is used, and each pixel is right to half a step.
    let radiance: Vec<f32> = header[header.len() - padded(4 * 160 * 100)..]
        .chunks_exact(4)
        .map(|b| f32::from_be_bytes(b.try_into().unwrap()))
        .collect();
    let full =
        document(&fixture, "png16/scales.json")["full_scale_w_m2_sr_nm"]["000000.png"].as_f64().unwrap();
    let picture = image::open(fixture.path("png16/000000.png")).unwrap();
    assert_eq!(picture.color(), image::ColorType::L16);
    let picture = picture.into_luma16();
    assert!(picture.pixels().map(|pixel| pixel.0[0]).max().unwrap() >= 32_767);
    for (pixel, radiance) in picture.pixels().zip(&radiance) {
        assert!((f64::from(pixel.0[0]) - f64::from(*radiance) / full * 65_535.0).abs() < 0.51);
    }
    // Longer sequences keep the split.
    let names = |of: &Fixture| -> Vec<String> {
        let list = document(of, "speedplus/synthetic/validation.json");
        list.as_array().unwrap().iter().map(|pose| pose["filename"].as_str().unwrap().to_owned()).collect()
    };
    let longer = Fixture::with_frames(12);
    assert_done(&longer.render("frames", &[]));
    let said = export(&longer, "frames", "speedplus", "speedplus");
    assert_done(&said);
    assert!(stderr(&said).contains("masks are the ellipses"), "{}", stderr(&said));
    let first: Vec<String> =
        names(&longer).into_iter().filter(|name| name.as_str() < "img000006.png").collect();
    assert_eq!(first, names(&fixture));
}

#[test]
fn what_cannot_be_exported_is_refused_and_leaves_nothing() {
    let fixture = Fixture::new();
    let refused = |from: &str, words: &[&str]| {
        assert_refused(&export(&fixture, from, "coco", "out"), words);
        assert!(!fixture.path("out").exists());
        let left = fs::read_dir(fixture.path(".")).unwrap();
        assert!(left.flatten().all(|entry| !entry.file_name().to_string_lossy().starts_with(".part-")));
    };
    refused("nowhere", &["nowhere", "holds no frames"]);
    assert_done(&fixture.render("frames", &[]));
    assert_refused(&export(&fixture, "frames", "png16", "out"), &["frame 0", "no radiance"]);
    fixture.write("frames/truth/000003.json", "{}");
    refused("frames", &["frame 3", "not what its manifest says", "--resume"]);
    let share = retina()
        .arg("export")
        .arg(fixture.path("frames"))
        .args(["--format", "coco", "--validation", "1.5", "--out"])
        .arg(fixture.path("out"))
        .output()
        .unwrap();
    assert_refused(&share, &["--validation", "1.5"]);
    // A pre-distorted frame is no pinhole camera's: it is said.
    fixture.edit("scene.toml", "\"none\"", "\"direct\"");
    assert_done(&fixture.render("direct", &[]));
    let mut told = retina();
    told.arg("export")
        .arg(fixture.path("direct"))
        .args(["--format", "bop", "--json", "--out"])
        .arg(fixture.path("bop"));
    let told = json(&told.output().unwrap());
    assert!(told["notes"][0].as_str().unwrap().contains("compensation `direct`"), "{told}");
}
