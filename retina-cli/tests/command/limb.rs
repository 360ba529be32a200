//! `retina navigate limb` on drawn photographs of a body of known place.

use std::path::{Path, PathBuf};
use std::process::Output;

use crate::common::{self, assert_refused, retina};
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
    assert!((of(&["--body", "Moon"]) / of(&[]) - 1.0).abs() < 1e-12);
    let small = document(&photo, &["--radii-m", "0.5"]);
    assert!(small["notes"].to_string().contains("in km"), "{small}");
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
        (vec!["--focal-percent", "-1"], vec!["--focal-percent", "-1", "0 to 20"]),
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

/// A frame of the shipped Moon among stars, rendered, and as a linear photograph of 16 bits: (folder, photograph, truth).
fn rendered_among_stars(folder: &tempfile::TempDir) -> (PathBuf, PathBuf, Value) {
    let assets = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets");
    let scene = folder.path().join("scene.toml");
    let text = format!(
        "schema = \"retina.scene/1\"\nsetup = \"{assets}/setups/narrow-fov.toml\"\n\
         trajectory = {{ kind = \"lumio-halo\", frames = 1, step_s = 300.0, epoch = \"2027-08-04T00:00:00\" }}\n\
         radiance_scale = \"auto\"\n[compensation]\nmode = \"none\"\n[[body]]\nname = \"moon\"\n\
         model = \"{assets}/bodies/moon.glb\"\nshading = \"smooth\"\n\
         photometry = {{ model = \"lunar-lambert\", normal_albedo = 0.12 }}\n[stars]\nfaintest_magnitude = 8.25\n",
        assets = assets.display()
    );
    std::fs::write(&scene, text).unwrap();
    let out = folder.path().join("frames-of-it");
    let done = retina().arg("render").arg(&scene).arg("--out").arg(&out).output().unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let truth = std::fs::read_to_string(out.join("truth/000000.json")).unwrap();
    let truth: Value = serde_json::from_str(&truth).unwrap();
    // The screen's counts by its response, (B / 255)^2.2, made linear, and the stars drawn brighter beside a Moon that the
    // screen dims: V 4 has 20 000 DN in a Gaussian spot of 0.9 px.
    let counts = image::open(out.join("frames/000000.png")).unwrap().to_luma8();
    let (width, height) = counts.dimensions();
    let mut light: Vec<f64> =
        counts.pixels().map(|count| (f64::from(count.0[0]) / 255.0).powf(2.2) * 40_000.0).collect();
    for star in truth["stars"].as_array().unwrap() {
        let [x, y] = [0, 1].map(|k| number(&star["screen_px"][k]));
        let flux = 20_000.0 * 10f64.powf(0.4 * (4.0 - number(&star["magnitude"])));
        for row in (y as u32).saturating_sub(6)..(y as u32 + 7).min(height) {
            for column in (x as u32).saturating_sub(6)..(x as u32 + 7).min(width) {
                let off = (f64::from(column) + 0.5 - x).powi(2) + (f64::from(row) + 0.5 - y).powi(2);
                light[(row * width + column) as usize] +=
                    flux * (-0.5 * off / 0.81).exp() / (std::f64::consts::TAU * 0.81);
            }
        }
    }
    let photo = folder.path().join("photo.png");
    image::ImageBuffer::<image::Luma<u16>, Vec<u16>>::from_fn(width, height, |x, y| {
        let noise = (x.wrapping_mul(2_654_435_761) ^ y.wrapping_mul(2_246_822_519)).rotate_left(13);
        let noise = f64::from(noise.wrapping_mul(3_266_489_917) >> 16) / 65_536.0 * 40.0;
        image::Luma([(200.0 + noise + light[(y * width + x) as usize]).min(65_535.0) as u16])
    })
    .save(&photo)
    .unwrap();
    (out, photo, truth)
}

fn vector3(value: &Value) -> [f64; 3] {
    [0, 1, 2].map(|k| number(&value[k]))
}

fn apart(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt()
}

#[test]
fn stars_and_the_terrain_of_the_limb_give_the_cameras_place() {
    let folder = tempfile::tempdir().unwrap();
    let (dir, photo, truth) = rendered_among_stars(&folder);
    let moon = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/bodies/moon.glb");
    let moon = moon.to_str().unwrap();
    let fov = ["--fov-deg", "9.7", "--stars", "--time", "2027-08-04T00:00:00 TDB"];
    let place_of = |more: &[&str]| {
        let out = limb(&photo, &[&fov[..], more, &["--json"]].concat());
        assert_eq!(out.status.code(), Some(0), "{}", String::from_utf8_lossy(&out.stderr));
        let found: Value = serde_json::from_slice(&out.stdout).unwrap();
        assert!(found["place"].is_object(), "{found}");
        found
    };
    let known = place_of(&["--silhouette", moon]);
    let ellipsoid = place_of(&[]);
    // -A^T P: the camera relative to the body, by the truth's attitude A (scalar first) and place P.
    let [w, x, y, z] = [0, 1, 2, 3].map(|k| number(&truth["camera_from_inertial"][k]));
    let [px, py, pz] = vector3(&truth["bodies"]["moon"]["position_camera_m"]);
    let (vx, vy, vz) = (-x, -y, -z);
    let [tx, ty, tz] = [2.0 * (vy * pz - vz * py), 2.0 * (vz * px - vx * pz), 2.0 * (vx * py - vy * px)];
    let at = [
        -(px + w * tx + vy * tz - vz * ty),
        -(py + w * ty + vz * tx - vx * tz),
        -(pz + w * tz + vx * ty - vy * tx),
    ];
    let [off_m, off_ellipsoid_m] = [&known, &ellipsoid].map(|found| {
        let body = vector3(&truth["bodies"]["moon"]["position_camera_m"]);
        let range_m = body.iter().map(|x| x * x).sum::<f64>().sqrt();
        let found_m = vector3(&found["place"]["position_from_body_m"]);
        let found_range_m = found_m.iter().map(|x| x * x).sum::<f64>().sqrt();
        println!("range off by {:.1} km of {:.0}", 1e-3 * (found_range_m - range_m), 1e-3 * range_m);
        apart(found_m, at)
    });
    println!("off by {off_m:.0} m with the silhouette, {off_ellipsoid_m:.0} m without");
    assert_eq!(known["body"]["outline"], "silhouette");
    assert!(number(&known["range_sigma_m"]) < 0.3 * number(&ellipsoid["range_sigma_m"]));
    assert!(off_m < 4.0 * number(&known["range_sigma_m"]) && off_m < 15e3, "{off_m}");
    // The same silhouette at the attitude that the truth has.
    let sequence = retina()
        .args(["navigate", "full-disk"])
        .arg(&dir)
        .args(["--silhouette", moon, "--limb-height-sigma-m", "190", "--json"])
        .output()
        .unwrap();
    let found: Value = serde_json::from_slice(&sequence.stdout).unwrap();
    let error = vector3(&found["frames"][0]["error_m"]);
    assert!(apart(error, [0.0; 3]) < 25e3 && number(&found["frames"][0]["nees"]) < 16.0, "{found}");
    // A mesh that is turned is another outline, or another place.
    let turned = limb(
        &photo,
        &["--fov-deg", "9.7", "--silhouette", moon, "--camera-from-body", "0.3,0.5,-0.2,0.7", "--json"],
    );
    let turned: Value = serde_json::from_slice(&turned.stdout).unwrap();
    assert!(
        turned["solved"] == false || number(&turned["rms_px"]) > 2.0 * number(&known["rms_px"]),
        "{turned}"
    );
    let words = ["moon.glb", "a silhouette depends on the attitude", "--stars with --time"];
    assert_refused(&limb(&photo, &["--fov-deg", "9.7", "--silhouette", moon]), &words);
}

#[test]
fn a_mask_hides_what_is_beside_the_body() {
    let folder = tempfile::tempdir().unwrap();
    let photo = photograph(&folder, 51.3, 20_000.0);
    // A bright wall that touches the Moon from the right.
    let wall = folder.path().join("wall.png");
    let mut picture = image::open(&photo).unwrap().to_luma16();
    let first = (CENTER[0] + 8.0) as u32;
    for (x, _, pixel) in picture.enumerate_pixels_mut() {
        if x > first {
            pixel.0[0] = 30_000;
        }
    }
    picture.save(&wall).unwrap();
    let mask = folder.path().join("mask.png");
    image::ImageBuffer::<image::Luma<u8>, Vec<u8>>::from_fn(SIZE[0], SIZE[1], |x, _| {
        image::Luma([if x > first { 0 } else { 255 }])
    })
    .save(&mask)
    .unwrap();
    let smooth =
        ["--limb-height-m", "0", "--limb-height-sigma-m", "0", "--focal-percent", "0", "--sun-deg", "70"];
    let found = document(&wall, &[&smooth[..], &["--mask", mask.to_str().unwrap()]].concat());
    assert_eq!(found["solved"], true, "{found}");
    for axis in 0..2 {
        assert!((number(&found["center_px"][axis]) - CENTER[axis]).abs() < 0.3, "{found}");
    }
    let without = document(&wall, &smooth);
    assert!(without["solved"] == false || (number(&without["center_px"][0]) - CENTER[0]).abs() > 2.0);
    let words = ["mask.png", "does not have the size of the image"];
    image::ImageBuffer::<image::Luma<u8>, Vec<u8>>::new(SIZE[0], SIZE[1]).save(&mask).unwrap();
    let nothing = ["mask.png", "leaves nothing of the photograph", "invert"];
    assert_refused(&limb(&photo, &[&CAMERA[..], &["--mask", mask.to_str().unwrap()]].concat()), &nothing);
    std::fs::write(&mask, []).unwrap();
    image::ImageBuffer::<image::Luma<u8>, Vec<u8>>::new(10, 10).save(&mask).unwrap();
    assert_refused(&limb(&photo, &[&CAMERA[..], &["--mask", mask.to_str().unwrap()]].concat()), &words);
}
