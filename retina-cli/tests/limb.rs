//! `retina navigate limb` on drawn photographs of a body of known place.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

mod common;

use std::path::{Path, PathBuf};
use std::process::Output;

use common::{assert_refused, retina};
use serde_json::Value;

const SIZE: [u32; 2] = [320, 240];
const FOCAL_PX: f64 = 25.0e3 / 3.45;
const CENTER: [f64; 2] = [171.3, 118.6];
/// The Moon over the site of the test of `retina-sky site` (Skyfield, DE421): 372 743.479 km.
const MOON_M: f64 = 372_743_479.0;

/// A disc as 16-bit samples: limb of `radius_px` about [`CENTER`], terminator of a phase, the Sun at a position angle
/// (0 up, 90 left), pixels by the share of 8 x 8 places that are lit, a floor with a pattern as noise.
fn draw(path: &Path, radius_px: f64, phase_deg: f64, sun_deg: f64, light: f64) {
    let (sin, cos) = sun_deg.to_radians().sin_cos();
    let lit = |x: f64, y: f64| {
        let [dx, dy] = [(x - CENTER[0]) / radius_px, (y - CENTER[1]) / radius_px];
        let (towards, across) = (-dx * sin - dy * cos, dx * cos - dy * sin);
        let limb2 = 1.0 - across * across;
        dx * dx + dy * dy < 1.0 && towards > -phase_deg.to_radians().cos() * limb2.max(0.0).sqrt()
    };
    let picture =
        image::ImageBuffer::<image::Luma<u16>, Vec<u16>>::from_fn(SIZE[0], SIZE[1], |column, row| {
            let part = |k: u32, at: u32| f64::from(at) + (f64::from(k) + 0.5) / 8.0;
            let places = (0..64u32).filter(|k| lit(part(k % 8, column), part(k / 8, row))).count();
            let hash = (column.wrapping_mul(2_654_435_761) ^ row.wrapping_mul(2_246_822_519)).rotate_left(13);
            let noise = f64::from(hash.wrapping_mul(3_266_489_917) >> 16) / 65_536.0 * 200.0;
            image::Luma([(1000.0 + noise + light * places as f64 / 64.0).min(65_535.0) as u16])
        });
    picture.save(path).unwrap();
}

fn limb(photo: &Path, more: &[&str]) -> Output {
    retina().args(["navigate", "limb"]).arg(photo).args(more).output().unwrap()
}

const CAMERA: [&str; 4] = ["--focal-mm", "25", "--pixel-um", "3.45"];

fn document(photo: &Path, more: &[&str]) -> Value {
    let camera = if more.contains(&"--pixel-um") { &CAMERA[..2] } else { &CAMERA[..] };
    let all = [camera, &["--json"], more].concat();
    let out = limb(photo, &all);
    assert_eq!(out.status.code(), Some(0), "{}", String::from_utf8_lossy(&out.stderr));
    serde_json::from_slice(&out.stdout).unwrap()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

fn photograph(folder: &tempfile::TempDir, phase_deg: f64, light: f64) -> PathBuf {
    let path = folder.path().join("moon.png");
    let radius_px = FOCAL_PX * (1_737_400.0 / MOON_M).asin().tan();
    draw(&path, radius_px, phase_deg, 70.0, light);
    path
}

#[test]
fn a_contradicted_range_is_noted() {
    let folder = tempfile::tempdir().unwrap();
    let photo = photograph(&folder, 51.3, 20_000.0);
    let place = ["--time", "2023-12-22T19:21:25Z", "--site", "45.848510,8.381019,455"];
    let noted = |more: &[&str]| {
        let found = document(&photo, &[&place[..], more].concat());
        assert_eq!(found["solved"], true, "{found}");
        found["notes"].as_array().unwrap().iter().any(|note| note.as_str().unwrap().contains("sigma off"))
    };
    assert!(!noted(&["--focal-percent", "0.5"]));
    // A pixel a tenth wider puts the Moon a tenth nearer.
    assert!(noted(&["--focal-percent", "0.5", "--limb-height-sigma-m", "500", "--pixel-um", "3.8"]));
}

#[test]
fn the_moon_is_found_within_its_sigma_with_and_without_the_sun() {
    let folder = tempfile::tempdir().unwrap();
    let photo = photograph(&folder, 51.3, 20_000.0);
    let picture = folder.path().join("limb.png");
    let place = ["--time", "2023-12-22T19:21:25Z", "--site", "45.848510,8.381019,455"];
    let drawn = ["--annotate", picture.to_str().unwrap()];
    // A drawn limb has no terrain; the focal length is exact.
    let smooth = ["--limb-height-m", "0", "--limb-height-sigma-m", "0", "--focal-percent", "0"];
    for more in
        [&smooth[..], &[&smooth[..], &["--sun-deg", "70"]].concat(), &[&smooth[..], &place, &drawn].concat()]
    {
        let found = document(&photo, more);
        assert_eq!((&found["schema"], &found["solved"]), (&"retina.navigation-limb/1".into(), &true.into()));
        for axis in 0..2 {
            let off = number(&found["center_px"][axis]) - CENTER[axis];
            assert!(off.abs() < 3.0 * number(&found["sigma_px"]["center_axes"][axis]), "{found}");
            assert!(off.abs() < 0.1, "{found}");
        }
        let [range_m, sigma_m] = ["range_m", "range_sigma_m"].map(|key| number(&found[key]));
        assert!((range_m - MOON_M).abs() < 3.0 * sigma_m && sigma_m < 0.005 * MOON_M, "{found}");
        assert!((number(&found["sun_deg"]) - 70.0).abs() < 4.0, "{found}");
        // The line of sight is the pinhole's of the centre.
        let sight: Vec<f64> = (0..3).map(|k| number(&found["line_of_sight"][k])).collect();
        let [x, y] = [0, 1].map(|k| (number(&found["center_px"][k]) - f64::from(SIZE[k]) / 2.0) / FOCAL_PX);
        assert!((sight[0] / sight[2] - x).abs() < 1e-9 && (sight[1] / sight[2] - y).abs() < 1e-9, "{found}");
        assert!(number(&found["points"]) > 10.0);
    }
    assert_eq!(std::fs::read(&picture).unwrap()[..4], *b"\x89PNG");
    let found = document(&photo, &[&smooth[..], &place].concat());
    assert!((number(&found["expected"]["range_m"]) - MOON_M).abs() < 20e3, "{found}");
    assert!((number(&found["expected"]["phase_deg"]) - 51.288).abs() < 0.01);
    assert!(number(&found["expected"]["range_off_sigma"]).abs() < 3.0, "{found}");
    // By default the terrain and the focal length are in sigma: 0.5 % of the range, and 2500 m of 1737 km.
    let found = document(&photo, &[]);
    let term = |name: &str| number(&found["range_sigma_terms_m"][name]);
    let range_m = number(&found["range_m"]);
    assert!((term("focal_length") - 0.005 * range_m).abs() < 1e-3 * range_m);
    assert!((term("limb_height") - range_m * 2500.0 / 1_738_100.0).abs() < 1e3, "{found}");
    let sum = ["points", "limb_height", "edge_model", "side", "focal_length"].map(|name| term(name).powi(2));
    assert!((sum.iter().sum::<f64>().sqrt() / number(&found["range_sigma_m"]) - 1.0).abs() < 1e-6);
}

#[test]
fn bodies_have_names_radii_or_meshes() {
    let folder = tempfile::tempdir().unwrap();
    let photo = photograph(&folder, 51.3, 20_000.0);
    let ratio = MOON_M / 1_737_400.0;
    let of = |more: &[&str]| number(&document(&photo, more)["range_m"]) / ratio;
    assert!((of(&["--radii-m", "5000"]) / 5000.0 - 1.0).abs() < 0.01);
    let mesh = folder.path().join("rock.glb");
    std::fs::write(&mesh, common::sphere(16)).unwrap();
    // Chords of 16 cells a face: 0.3 % less volume than the sphere of 1000 m.
    assert!((of(&["--body", mesh.to_str().unwrap()]) / common::RADIUS_M - 1.0).abs() < 0.015);
    let round = ["--radii-m", "1000,1000,800", "--camera-from-body", "1,0,0,0"];
    // Along the polar axis its outline is the equator.
    assert!((of(&round) / 1000.0 - 1.0).abs() < 0.01);
    for (more, words) in [
        (vec!["--body", "jupiter"], vec!["--body", "differ by 6.6 %", "--camera-from-body"]),
        (vec!["--body", "vulcan"], vec!["--body", "`vulcan`", "--radii-m"]),
        (vec!["--radii-m", "0"], vec!["--radii-m", "above 0 m"]),
        (vec!["--radii-m", "big"], vec!["--radii-m", "`big`", "a number of metres"]),
        (vec!["--camera-from-body", "0,0,0,0"], vec!["--camera-from-body", "is no rotation"]),
        (vec!["--sun-deg", "400"], vec!["--sun-deg", "400", "-360 to 360"]),
        (vec!["--time", "2023-12-22"], vec!["--time", "--site LAT,LON,HEIGHT"]),
        (
            vec!["--time", "2023-12-22", "--site", "95,0,0"],
            vec!["--site", "`95,0,0`", "no place on the Earth"],
        ),
        (
            vec!["--radii-m", "5", "--time", "2023-12-22", "--site", "5,0,0"],
            vec!["--body", "has no ephemeris"],
        ),
        (vec!["--annotate", photo.to_str().unwrap()], vec!["would be overwritten"]),
        (vec!["--annotate", "x.jpg"], vec!["x.jpg", "`.png`"]),
    ] {
        assert_refused(&limb(&photo, &[&CAMERA[..], &more].concat()), &words);
    }
    let words = ["moon.png", "focal length is not known", "--focal-mm F with --pixel-um P"];
    assert_refused(&limb(&photo, &[]), &words);
}

#[test]
fn a_refusal_says_what_was_seen_and_what_to_try() {
    let folder = tempfile::tempdir().unwrap();
    for (phase_deg, light, reason, words) in [
        (0.0, 0.0, "no_body", ["Nothing that is lit", "longer focal length"]),
        (165.0, 20_000.0, "thin_crescent", ["lit area up to", "smaller phase angle"]),
        (
            20.0,
            1e6,
            "saturated",
            ["% of it saturated, with a border like a circle of", "Expose for a shorter time"],
        ),
    ] {
        let photo = photograph(&folder, phase_deg, light);
        let found = document(&photo, &[]);
        assert_eq!((&found["solved"], &found["reason"]), (&false.into(), &reason.into()), "{found}");
        assert!(found["range_m"].is_null() && found["points"] == 0);
        let message = found["message"].as_str().unwrap();
        assert!(words.iter().all(|word| message.contains(word)), "{message}");
        // A picture of what was seen is drawn, too.
        let picture = folder.path().join("seen.png");
        let out = limb(&photo, &[&CAMERA[..], &["--annotate", picture.to_str().unwrap()]].concat());
        assert!(out.status.success() && String::from_utf8_lossy(&out.stdout).contains("refused"), "{out:?}");
        std::fs::remove_file(&picture).unwrap();
    }
}
