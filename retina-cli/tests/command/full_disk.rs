//! `retina navigate full-disk` as a program, over folders as `retina render` writes them.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use serde_json::{Value, json};

use crate::spk;

const SIZE: [u32; 2] = [320, 240];
const FOCAL_PX: f64 = 3000.0;
const RADIUS_M: f64 = 1_737_400.0;
const DISTANCE_M: f64 = 60e6;

fn retina(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_retina")).args(arguments).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// What is drawn, beside what the truth says.
#[derive(Clone, Copy)]
struct Drawn {
    /// Of the body's centre, px.
    center_px: [f64; 2],
    /// Phase angle, deg; 180 is dark.
    phase_deg: f64,
    mirrored: bool,
    /// Focal length of the picture over that of the truth.
    focal: f64,
}

const FULL: Drawn = Drawn { center_px: [158.3, 121.6], phase_deg: 60.0, mirrored: false, focal: 1.0 };

/// A frame: a disc by the area that it covers (8 x 8 samples a pixel), encoded by (B / 255)^2.2, and its truth. The
/// body is a sphere so small that its outline is a circle of radius f tan(asin(R / d)) to 1e-3 px.
fn write_frame(dir: &Path, frame: usize, drawn: Drawn) {
    for name in ["frames", "truth"] {
        fs::create_dir_all(dir.join(name)).unwrap();
    }
    let angle = (RADIUS_M / DISTANCE_M).asin();
    let radius = drawn.focal * FOCAL_PX * angle.tan();
    let phase = drawn.phase_deg.to_radians();
    let lit = |x: f64, y: f64| {
        let u = if drawn.mirrored { f64::from(SIZE[0]) - x } else { x } - drawn.center_px[0];
        let (u, v) = (u / radius, (y - drawn.center_px[1]) / radius);
        u * u + v * v < 1.0 && u > -phase.cos() * (1.0 - v * v).sqrt()
    };
    let pixels: Vec<u8> = (0..SIZE[0] * SIZE[1])
        .map(|k| {
            let (x, y) = (f64::from(k % SIZE[0]), f64::from(k / SIZE[0]));
            let hits = (0..64).filter(|s| {
                let at = |v: u32| (f64::from(v) + 0.5) / 8.0;
                lit(x + at(s % 8), y + at(s / 8))
            });
            let share = hits.count() as f64 / 64.0;
            (255.0 * (0.8 * share).powf(1.0 / 2.2)).round() as u8
        })
        .collect();
    image::GrayImage::from_raw(SIZE[0], SIZE[1], pixels)
        .unwrap()
        .save(dir.join(format!("frames/{frame:06}.png")))
        .unwrap();
    let [cx, cy] = [f64::from(SIZE[0]) / 2.0, f64::from(SIZE[1]) / 2.0];
    let sight = [(drawn.center_px[0] - cx) / FOCAL_PX, (drawn.center_px[1] - cy) / FOCAL_PX];
    let norm = (1.0 + sight[0] * sight[0] + sight[1] * sight[1]).sqrt();
    let position = [sight[0], sight[1], 1.0].map(|v| v / norm * DISTANCE_M);
    let truth = json!({
        "schema": "retina.truth/1", "frame": frame, "time_s": 8.7e8 + 3600.0 * frame as f64,
        "camera_from_inertial": [1.0, 0.0, 0.0, 0.0],
        "image_px": {"fx": FOCAL_PX, "fy": FOCAL_PX, "cx": cx, "cy": cy, "width": SIZE[0], "height": SIZE[1]},
        "compensation": "none", "radiance_scale": 1.0,
        "bodies": {"moon": {
            "position_camera_m": position, "camera_from_body": [1.0, 0.0, 0.0, 0.0],
            "sun_direction_body": [phase.sin(), 0.0, -phase.cos()], "phase_deg": drawn.phase_deg,
            "reference_radius_m": RADIUS_M,
        }},
        "camera_position_m": position.map(|v| -v), "camera_velocity_m_s": null, "stars": [],
    });
    fs::write(dir.join(format!("truth/{frame:06}.json")), truth.to_string()).unwrap();
}

fn navigate(dir: &Path, more: &[&str]) -> Output {
    let mut arguments = vec!["navigate", "full-disk", dir.to_str().unwrap()];
    arguments.extend(more);
    retina(&arguments)
}

fn document(dir: &Path) -> Value {
    let out = navigate(dir, &["--json"]);
    assert_eq!(out.status.code(), Some(0), "{}", text(&out.stderr));
    serde_json::from_slice(&out.stdout).unwrap()
}

#[test]
fn positions_are_the_drawn_ones_and_a_second_run_keeps_them() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path().join("render");
    for frame in 0..3 {
        let center_px = [158.3 + 0.37 * frame as f64, 121.6];
        write_frame(&dir, frame, Drawn { center_px, ..FULL });
    }
    let found = document(&dir);
    assert_eq!(found["schema"], "retina.navigation-full-disk/1");
    assert_eq!((&found["kind"], &found["mapping"]), (&json!("screen"), &json!("pinhole")));
    for frame in found["frames"].as_array().unwrap() {
        assert_eq!(frame["outcome"], "solved");
        let error = |k: usize| frame["error_m"][k].as_f64().unwrap();
        // A pixel is 20 km across; 0.03 px of 86.9 in the radius are 21 km of the range.
        assert!(error(0).abs() < 600.0 && error(1).abs() < 600.0 && error(2).abs() < 21e3, "{frame}");
        assert!(frame["nees"].as_f64().unwrap() < 11.4, "{frame}");
    }
    let out = folder.path().join("out");
    let [out_name, page] =
        [out.clone(), folder.path().join("page.html")].map(|p| p.to_str().unwrap().to_owned());
    let first = navigate(&dir, &["--out", &out_name, "--frames", "0..2", "--report", &page]);
    assert_eq!(first.status.code(), Some(0), "{}", text(&first.stderr));
    let part = fs::read_to_string(out.join("frames.jsonl")).unwrap();
    assert_eq!(part.lines().count(), 3);
    // A line that was cut short is measured again, a finished one kept as it is.
    fs::write(out.join("frames.jsonl"), &part[..part.len() - 40]).unwrap();
    assert_eq!(navigate(&dir, &["--out", &out_name]).status.code(), Some(0));
    let whole = fs::read_to_string(out.join("frames.jsonl")).unwrap();
    assert!(whole.starts_with(&part) && whole.lines().count() == 4, "{whole}");
    let html = fs::read_to_string(&page).unwrap();
    assert!(html.contains("<svg") && !html.contains("http-equiv") && !html.contains("src="));
    // The same folder with something else known of the limb is another sequence.
    let other = navigate(&dir, &["--out", &out_name, "--limb-height-m", "500"]);
    assert_eq!(other.status.code(), Some(2));
    assert!(text(&other.stderr).contains("another sequence"), "{}", text(&other.stderr));
}

#[test]
fn what_is_no_lit_limb_is_refused_by_name_and_the_run_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    write_frame(dir, 0, Drawn { phase_deg: 180.0, ..FULL });
    write_frame(dir, 1, Drawn { phase_deg: 172.0, ..FULL });
    write_frame(dir, 2, Drawn { center_px: [-84.0, 121.6], phase_deg: 5.0, ..FULL });
    write_frame(dir, 3, Drawn { mirrored: true, phase_deg: 100.0, ..FULL });
    write_frame(dir, 4, FULL);
    let found = document(dir);
    let outcome = |k: usize| found["frames"][k]["outcome"].as_str().unwrap().to_owned();
    assert_eq!(outcome(0), "no_body", "in eclipse");
    assert!(["thin_crescent", "no_body"].contains(&outcome(1).as_str()), "{}", outcome(1));
    assert!(["cut_by_frame", "no_body", "thin_crescent"].contains(&outcome(2).as_str()), "{}", outcome(2));
    // Lit from where the Sun is not.
    assert_ne!(outcome(3), "solved");
    assert_eq!(outcome(4), "solved");
    assert_eq!(found["summary"]["solved"], 1);
    assert!(found["frames"][0]["message"].as_str().unwrap().contains("no lit body"));
}

/// From one image a focal length cannot be told from a distance: what shows it is the truth, or any range that is known.
#[test]
fn a_wrong_focal_length_is_a_wrong_range_and_shows_in_the_normalised_error() {
    let folder = tempfile::tempdir().unwrap();
    write_frame(folder.path(), 0, Drawn { focal: 1.02, ..FULL });
    let found = document(folder.path());
    let frame = &found["frames"][0];
    assert_eq!(frame["outcome"], "solved");
    let range = frame["error_m"][2].as_f64().unwrap() / DISTANCE_M;
    assert!((range + 0.0196).abs() < 1e-3, "{range}");
    assert!(frame["nees"].as_f64().unwrap() > 100.0, "{frame}");
}

#[test]
fn folders_that_do_not_fit_are_refused_with_file_found_and_expected() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path().join("render");
    write_frame(&dir, 0, FULL);
    write_frame(&dir, 1, FULL);
    let refused = |dir: &Path, more: &[&str], words: &[&str]| {
        let out = navigate(dir, more);
        let said = text(&out.stderr).split_whitespace().collect::<Vec<_>>().join(" ");
        assert_eq!(out.status.code(), Some(2), "{said}");
        for word in words {
            assert!(said.contains(word), "no `{word}` in: {said}");
        }
    };
    refused(&folder.path().join("none"), &[], &["there is no truth", "retina render"]);
    refused(&dir, &["--kind", "camera"], &["none are named", "--images"]);
    refused(&dir, &["--frames", "0..9"], &["0..2"]);
    refused(&dir, &["--body", "mars"], &["the body that is asked for is not in it", "moon", "mars"]);
    refused(&dir, &["--limb-height-sigma-m=-3"], &["--limb-height-sigma-m"]);
    // An image without truth; then truth that is another frame's.
    let truth = dir.join("truth/000001.json");
    let own = fs::read_to_string(&truth).unwrap();
    fs::remove_file(&truth).unwrap();
    refused(&dir, &[], &["an image has no truth", "000001"]);
    fs::write(&truth, own.replace("\"frame\":1", "\"frame\":7")).unwrap();
    refused(&dir, &[], &["truth of another frame", "000001.json", "7"]);
    fs::write(&truth, &own[..own.len() / 2]).unwrap();
    refused(&dir, &[], &["is not the truth of a frame", "000001.json"]);
    // The manifest knows which truth belongs to the folder.
    fs::write(&truth, &own).unwrap();
    for (name, what) in [("truth/000001.json", "truth"), ("frames/000001.png", "image")] {
        let line = json!({"index": 1, "inputs": {}, "outputs": {name: "0123456789abcdef"}});
        fs::write(dir.join("manifest.jsonl"), format!("{line}\n")).unwrap();
        refused(&dir, &[], &[&format!("not the {what} that was rendered"), "0123456789ab"]);
    }
    fs::remove_file(dir.join("manifest.jsonl")).unwrap();
    // Another size than the truth's camera.
    let small = image::GrayImage::new(64, 48);
    small.save(dir.join("frames/000001.png")).unwrap();
    refused(&dir, &[], &["another size", "64 x 48", "320 x 240"]);
    fs::remove_file(dir.join("frames/000001.png")).unwrap();
    refused(&dir, &[], &["an image is missing", "000001"]);
}

#[test]
fn a_kernel_serves_that_has_sun_earth_and_moon_and_no_other() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path().join("render");
    (0..3).for_each(|frame| write_frame(&dir, frame, FULL));
    let run = |bodies: &[spk::Circle], from_s: f64| {
        let bsp = folder.path().join("sky.bsp");
        fs::write(&bsp, spk::kernel(bodies, from_s, 20)).unwrap();
        navigate(&dir, &["--ephemeris", bsp.to_str().unwrap(), "--json"])
    };
    let bodies = spk::solar_system();
    let needed: Vec<spk::Circle> =
        bodies.iter().filter(|body| [10, 3, 399, 301].contains(&body.target)).copied().collect();
    let out = run(&needed, 8.69e8);
    assert_eq!(out.status.code(), Some(0), "{}", text(&out.stderr));
    let found: Value = serde_json::from_slice(&out.stdout).unwrap();
    assert!(!found.to_string().contains("no ephemeris"), "{found}");
    for (bodies, from_s, said) in
        [(&needed[..3], 8.69e8, "no ephemeris of moon (NAIF 301)"), (&needed[..], 8.585e8, "no ephemeris of")]
    {
        let out = run(bodies, from_s);
        let error = text(&out.stderr).split_whitespace().collect::<Vec<_>>().join(" ");
        assert_eq!(out.status.code(), Some(2), "{error}");
        let document: Value = serde_json::from_slice(&out.stdout).unwrap();
        assert_eq!(document["schema"], "retina.error/1");
        assert!(error.contains("sky.bsp") && error.contains(said), "{error}");
    }
    let high = navigate(&dir, &["--limb-height-m", "1e9"]);
    assert_eq!(high.status.code(), Some(2));
    let said = text(&high.stderr);
    assert!(said.contains("--limb-height-m") && said.contains("expected -200000 to 200000"), "{said}");
}

#[test]
fn photographs_of_another_folders_screens_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let [dir, other, bench] = ["a", "b", "bench"].map(|name| folder.path().join(name));
    write_frame(&dir, 0, FULL);
    write_frame(&other, 0, FULL);
    fs::create_dir_all(bench.join("images")).unwrap();
    fs::copy(dir.join("frames/000000.png"), bench.join("images/000000.png")).unwrap();
    let shown = other.join("frames/000000.png");
    let list = format!("predicted,measured\n{},images/000000.png\n", shown.display());
    fs::write(bench.join("frames.csv"), list).unwrap();
    let out = navigate(&dir, &["--images", bench.to_str().unwrap()]);
    let said = text(&out.stderr).split_whitespace().collect::<Vec<_>>().join(" ");
    assert_eq!(out.status.code(), Some(2), "{said}");
    assert!(said.contains("another folder's screens"), "{said}");
}

#[test]
fn a_scenario_is_read_strictly() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("x.toml");
    for (lines, words) in [
        ("schema = \"retina.scene/1\"\nscene = \"a.toml\"", "retina.full-disk/1"),
        ("schema = \"retina.full-disk/1\"\nscene = \"a.toml\"\nevry = 3", "evry"),
        ("schema = \"retina.full-disk/1\"\nscene = \"a.toml\"\nevery = 0", "every"),
        (
            "schema = \"retina.full-disk/1\"\nscene = \"a.toml\"\n[filter]\nterrain_time_h = 0.0",
            "terrain_time_h",
        ),
        ("schema = \"retina.full-disk/1\"\nscene = \"a.toml\"", "a.toml"),
    ] {
        fs::write(&file, lines).unwrap();
        let out = retina(&["navigate", "full-disk", file.to_str().unwrap(), "--out", "x"]);
        assert_eq!(out.status.code(), Some(2));
        assert!(text(&out.stderr).contains(words), "{}", text(&out.stderr));
    }
    let out = retina(&["navigate", "full-disk", file.to_str().unwrap(), "--kind", "camera"]);
    assert!(text(&out.stderr).contains("belongs to a folder of frames"), "{}", text(&out.stderr));
}

#[test]
fn results_do_not_take_the_place_of_others() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path().join("render");
    for frame in 0..3 {
        write_frame(&dir, frame, FULL);
    }
    // The rendered folder is no folder for results.
    let same = navigate(&dir, &["--out", dir.to_str().unwrap()]);
    assert_eq!(same.status.code(), Some(2));
    assert!(text(&same.stderr).contains("is the rendered folder itself"), "{}", text(&same.stderr));
    assert!(!dir.join("frames.jsonl").exists());
    // A part's document stands beside the whole's.
    let out = folder.path().join("out");
    let name = out.to_str().unwrap().to_owned();
    assert_eq!(navigate(&dir, &["--out", &name]).status.code(), Some(0));
    let whole = fs::read(out.join("full-disk.json")).unwrap();
    for more in [["--frames", "0..2"], ["--shard", "1/2"]] {
        assert_eq!(navigate(&dir, &["--out", &name, more[0], more[1]]).status.code(), Some(0));
    }
    assert_eq!(fs::read(out.join("full-disk.json")).unwrap(), whole);
    for (file, frames) in [("full-disk-0..2.json", 2), ("full-disk-1-of-2.json", 1)] {
        let part: Value = serde_json::from_slice(&fs::read(out.join(file)).unwrap()).unwrap();
        assert_eq!(part["frames"].as_array().unwrap().len(), frames, "{file}");
    }
    let wrong = navigate(&dir, &["--frames", "-1..2"]);
    assert_eq!(wrong.status.code(), Some(2));
    assert!(text(&wrong.stderr).contains("is not a range of frames"), "{}", text(&wrong.stderr));
}

#[test]
fn what_cannot_be_right_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path().join("render");
    // A picture whose focal length is 3 % beyond what is stated: 1800 km of 60 000.
    for frame in 0..3 {
        write_frame(&dir, frame, Drawn { focal: 1.03, ..FULL });
    }
    let found = navigate(&dir, &[]);
    assert_eq!(found.status.code(), Some(0));
    let said = text(&found.stderr);
    assert!(said.contains("do not belong together") && said.contains("NEES"), "{said}");
    assert!(said.contains("no manifest.jsonl"), "{said}");
    let right = folder.path().join("right");
    write_frame(&right, 0, FULL);
    let said = text(&navigate(&right, &[]).stderr);
    assert!(!said.contains("do not belong together"), "{said}");
    // A photograph in the place of a screen image: 12 bits.
    let image =
        image::ImageBuffer::<image::Luma<u16>, _>::from_pixel(SIZE[0], SIZE[1], image::Luma([3000u16]));
    image.save(right.join("frames/000000.png")).unwrap();
    let out = navigate(&right, &["--kind", "screen"]);
    assert_eq!(out.status.code(), Some(2));
    let said = text(&out.stderr);
    assert!(said.contains("--kind camera") && !said.contains("camera.bits"), "{said}");
}
