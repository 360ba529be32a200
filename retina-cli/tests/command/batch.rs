//! Runs: resumed, sharded, selected; the automatic radiance scale; what is written.

use std::fs;
use std::io::Write as _;

use crate::common::{self, Fixture, assert_done, contents, counts, json, stderr};

#[test]
fn a_killed_run_is_finished_with_the_same_bytes() {
    let fixture = Fixture::with_frames(40);
    assert_done(&fixture.render("whole", &[]));
    let mut child =
        fixture.render_command("killed", &[]).stderr(std::process::Stdio::null()).spawn().unwrap();
    let manifest = fixture.path("killed/manifest.jsonl");
    let lines = || fs::read_to_string(&manifest).map_or(0, |text| text.lines().count());
    while lines() < 5 {
        assert!(child.try_wait().unwrap().is_none(), "it finished before it could be killed");
        std::thread::yield_now();
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let finished = lines();
    assert!((5..40).contains(&finished), "{finished}");
    // Everything that has its name is whole.
    let whole = contents(&fixture.path("whole"));
    for (path, bytes) in contents(&fixture.path("killed")) {
        let name = path.to_string_lossy().into_owned();
        if !name.contains(".part-") && !name.ends_with(".jsonl") {
            assert_eq!(Some(&bytes), whole.get(&path), "{name}");
        }
    }
    // What a kill may leave at its worst.
    fs::write(fixture.path("killed/frames/.part-left"), "x").unwrap();
    fs::OpenOptions::new()
        .append(true)
        .open(&manifest)
        .unwrap()
        .write_all(b"{\"schema\":\"retina.mani")
        .unwrap();
    let summary = json(&fixture.render("killed", &["--resume", "--json"]));
    assert!(summary["frames_skipped"].as_u64().unwrap() >= finished as u64 - 1);
    assert_eq!(contents(&fixture.path("killed")), whole);
    let again = json(&fixture.render("killed", &["--resume", "--json"]));
    assert_eq!((again["frames_done"].as_u64(), again["frames_skipped"].as_u64()), (Some(0), Some(40)));
}

#[test]
fn a_damaged_frame_is_made_again() {
    let fixture = Fixture::new();
    assert_done(&fixture.render("out", &[]));
    let whole = contents(&fixture.path("out"));
    fs::write(fixture.path("out/frames/000003.png"), "torn").unwrap();
    fs::remove_file(fixture.path("out/truth/000001.json")).unwrap();
    let summary = json(&fixture.render("out", &["--resume", "--json"]));
    assert_eq!((summary["frames_done"].as_u64(), summary["frames_skipped"].as_u64()), (Some(2), Some(4)));
    assert_eq!(contents(&fixture.path("out")), whole);
}

#[test]
fn shards_at_once_into_one_folder_are_one_run() {
    let fixture = Fixture::with_frames(12);
    fixture.edit("scene.toml", "\"none\"", "\"resample\"");
    assert_done(&fixture.render("one", &[]));
    let shards: Vec<_> = (0..3)
        .map(|i| {
            fixture
                .render_command("shards", &["--shard", &format!("{i}/3")])
                .stderr(std::process::Stdio::piped())
                .spawn()
                .unwrap()
        })
        .collect();
    for shard in shards {
        assert_done(&shard.wait_with_output().unwrap());
    }
    let (mut one, mut parts) = (contents(&fixture.path("one")), contents(&fixture.path("shards")));
    // The sheet is of the frames that were there when the last shard looked.
    let sheet = std::path::Path::new("contact-sheet.png");
    assert!(one.remove(sheet).is_some() && parts.remove(sheet).is_some());
    assert_eq!(one, parts);
    let empty = json(&fixture.render("more", &["--frames", "0..2", "--shard", "7/9", "--json"]));
    assert_eq!(empty["frames_done"].as_u64(), Some(0));
}

#[test]
fn a_selection_holds_the_frames_asked_for() {
    let fixture = Fixture::new();
    assert_done(&fixture.render("out", &["--frames", "1..6", "--every", "2"]));
    let names: Vec<_> = contents(&fixture.path("out/frames")).into_keys().collect();
    assert_eq!(
        names.iter().map(|n| n.to_str().unwrap()).collect::<Vec<_>>(),
        ["000001.png", "000003.png", "000005.png"]
    );
}

#[test]
fn the_brightest_pixel_of_the_sequence_is_just_below_saturation() {
    let fixture = Fixture::new();
    let whole = json(&fixture.render("whole", &["--json"]));
    let brightest = |name: &str| *counts(&fixture.path(name)).iter().max().unwrap();
    let most = (0..6).map(|i| brightest(&format!("whole/frames/{i:06}.png"))).max().unwrap();
    assert!((253..=255).contains(&most), "{most}");
    assert_eq!(whole["saturated_px"].as_u64(), Some(0));
    // Phase 0 is the brightest frame of a Lambert sphere; without it the scale is the same.
    let part = json(&fixture.render("part", &["--frames", "4..6", "--json"]));
    assert_eq!(part["radiance_scale"], whole["radiance_scale"]);
    assert_eq!(
        fs::read(fixture.path("part/frames/000005.png")).unwrap(),
        fs::read(fixture.path("whole/frames/000005.png")).unwrap()
    );
    // Radiance 0.12 * 1.856 / pi at 1 au, times the scale and a pixel's solid angle, is count 254:
    // 3.67e-11 * 10^(1.44 / 2.5) * (254 / 255)^2.2.
    let full = 3.67e-11 * 10f64.powf(1.44 / 2.5) * (254f64 / 255.0).powf(2.2);
    let expected = full * 900.0 * 900.0 * std::f64::consts::PI / (0.12 * 1.856);
    let scale = whole["radiance_scale"].as_f64().unwrap();
    assert!((scale / expected - 1.0).abs() < 2e-3, "{scale} {expected}");
}

#[test]
fn saturated_pixels_are_counted_and_told() {
    let fixture = Fixture::new();
    let scale = json(&fixture.render("auto", &["--json"]))["radiance_scale"].as_f64().unwrap();
    fixture.edit("scene.toml", "\"auto\"", &format!("{}", 4.0 * scale));
    let output = fixture.render("bright", &["--frames", "0..1", "--json"]);
    let told = json(&output)["saturated_px"].as_u64().unwrap();
    // At phase 0 the radiance goes with cos i: above a quarter of the centre's out to sin i = 0.968.
    let expected = std::f64::consts::PI * (40.0 * 0.968f64).powi(2);
    assert!((told as f64 / expected - 1.0).abs() < 0.02, "{told} {expected}");
    assert!(stderr(&output).contains("brighter than the screen can show"));
    let line = fs::read_to_string(fixture.path("bright/manifest.jsonl")).unwrap();
    let line: serde_json::Value = serde_json::from_str(&line).unwrap();
    assert_eq!(line["saturated_px"].as_u64(), Some(told));
    for key in ["index", "inputs", "outputs", "seed", "radiance_scale", "adapter", "driver"] {
        assert!(!line[key].is_null(), "{key}");
    }
    assert_eq!(line["adapter"], "cpu");
}

#[test]
fn the_sheet_is_made_and_made_again() {
    let fixture = Fixture::new();
    assert_done(&fixture.render("out", &[]));
    let sheet = fixture.path("out/contact-sheet.png");
    let bytes = fs::read(&sheet).unwrap();
    // Six frames of 160 x 100 in rows of three, 4 px apart.
    let image = image::open(&sheet).unwrap();
    assert_eq!((image.width(), image.height()), (3 * 164 + 4, 2 * 104 + 4));
    fs::remove_file(&sheet).unwrap();
    assert_done(&common::retina().arg("sheet").arg(fixture.path("out")).output().unwrap());
    assert_eq!(fs::read(&sheet).unwrap(), bytes);
}

#[test]
fn trajectories_about_a_body_are_generated() {
    let fixture = Fixture::new();
    let generated = |table: &str| {
        let text = common::SCENE.replace("trajectory = \"poses.csv\"", &format!("trajectory = {table}"));
        fixture.write("scene.toml", &text);
    };
    for (number, (table, phases)) in [
        (r#"{ kind = "phase-sweep", frames = 3, distance_m = 22500, phases_deg = [0, 90] }"#, [0.0, 45.0, 90.0]),
        (r#"{ kind = "approach", frames = 3, distances_m = [60e3, 20e3], phase_deg = 30 }"#, [30.0; 3]),
        (r#"{ kind = "orbit", frames = 3, step_s = 60, distance_m = 22500, period_h = 0.1, normal = [1, 0, 0] }"#, [90.0; 3]),
        (r#"{ kind = "flyby", frames = 3, closest_m = 20e3, speed_m_s = 1e-6, phase_deg = 60 }"#, [60.0; 3]),
    ]
    .into_iter()
    .enumerate()
    {
        generated(table);
        let out = format!("out{number}");
        assert_done(&fixture.render(&out, &[]));
        for (frame, phase) in phases.into_iter().enumerate() {
            let path = fixture.path(&format!("{out}/truth/{frame:06}.json"));
            let truth: serde_json::Value = serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap();
            let rock = &truth["bodies"]["rock"];
            assert!((rock["phase_deg"].as_f64().unwrap() - phase).abs() < 1e-4, "{table}: {rock}");
            let centre = rock["center_px"][0].as_f64().unwrap();
            assert!((centre - 80.0).abs() < 1e-6, "{table}: {centre}");
        }
    }
    // Written as a table, the same frames come of it.
    let table = fixture.path("own.csv");
    let mut command = common::retina();
    assert_done(
        &command
            .args(["trajectory", "--scene"])
            .arg(fixture.path("scene.toml"))
            .arg("--out")
            .arg(&table)
            .output()
            .unwrap(),
    );
    generated("\"own.csv\"");
    assert_done(&fixture.render("table", &[]));
    assert_eq!(
        fs::read(fixture.path("table/frames/000001.png")).unwrap(),
        fs::read(fixture.path("out3/frames/000001.png")).unwrap()
    );
    for (table, words) in [
        (r#"{ kind = "orbit", frames = 3, distance_m = 1e4 }"#, ["period_h", "needs a key"]),
        (r#"{ kind = "flyby", frames = 3, closest_m = -1, speed_m_s = 1 }"#, ["closest_m", "-1"]),
        (
            r#"{ kind = "approach", frames = 3, distances_m = [1e5, 1e4], jacobi = 3 }"#,
            ["jacobi", "no such key"],
        ),
        (
            r#"{ kind = "phase-sweep", frames = 3, distance_m = 1e5, phases_deg = [0, 200] }"#,
            ["phases_deg", "200"],
        ),
        (
            r#"{ kind = "phase-sweep", frames = 3, distance_m = 1e5, normal = [0, 0, 0] }"#,
            ["normal", "no length"],
        ),
        (
            r#"{ kind = "orbit", frames = 3, distance_m = 1e4, period_h = 1, spin = { period_h = 0 } }"#,
            ["spin.period_h", "not 0"],
        ),
    ] {
        generated(table);
        common::assert_refused(&fixture.render("bad", &[]), &words);
    }
}

/// A cube of twelve triangles that fills the image: none of their middles is in it. The scale is that of its lit face.
#[test]
fn a_body_that_fills_the_image_has_an_automatic_scale() {
    let fixture = Fixture::new();
    let corners =
        [[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1], [-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]];
    let mut cube: String = corners.iter().map(|[x, y, z]| format!("v {x}e3 {y}e3 {z}e3\n")).collect();
    for [a, b, c, d] in [[1, 4, 3, 2], [5, 6, 7, 8], [1, 2, 6, 5], [3, 4, 8, 7], [1, 5, 8, 4], [2, 3, 7, 6]] {
        cube += &format!("f {a} {b} {c}\nf {a} {c} {d}\n");
    }
    fixture.write("rock.obj", &cube);
    fixture.edit("scene.toml", "rock.glb", "rock.obj");
    fixture.edit("scene.toml", "\"smooth\"", "\"flat\"");
    fixture.edit(
        "scene.toml",
        "\"poses.csv\"",
        "{ kind = \"phase-sweep\", frames = 2, step_s = 60, distance_m = 2.0e3, phases_deg = [10, 20] }",
    );
    assert_done(&fixture.render("out", &[]));
    let image = image::open(fixture.path("out/frames/000000.png")).unwrap().to_luma8();
    assert!(image.pixels().all(|pixel| pixel.0[0] > 200), "{:?}", image.get_pixel(80, 50));
}

/// A body of 58 800 triangles: what is computed of its shape goes into the user's cache folder, and comes from there. The
/// frames are the same; a file there that is damaged does no harm.
#[test]
fn what_is_computed_of_a_large_body_is_kept_for_the_next_run() {
    let fixture = Fixture::with_frames(1);
    fs::write(fixture.path("rock.glb"), common::sphere(70)).unwrap();
    let render = |out: &str, more: &[&str]| {
        let mut command = fixture.render_command(out, &[&["--backend", "native"], more].concat());
        assert_done(&command.env("XDG_CACHE_HOME", fixture.path("cache")).output().unwrap());
        contents(&fixture.path(out).join("frames"))
    };
    let kept = || -> Vec<std::path::PathBuf> {
        let folder = fs::read_dir(fixture.path("cache/retina/bodies"));
        folder.map_or(Vec::new(), |files| files.map(|file| file.unwrap().path()).collect())
    };
    let without = render("without", &["--no-cache"]);
    assert_eq!(kept().len(), 0);
    assert_eq!(render("first", &[]), without);
    let [path] = &kept()[..] else { panic!("{:?}", kept()) };
    let whole = fs::read(path).unwrap();
    assert_eq!(render("second", &[]), without);
    fs::write(path, &whole[..whole.len() / 2]).unwrap();
    assert_eq!(render("third", &[]), without);
    assert_eq!((kept().len(), fs::read(path).unwrap() == whole), (1, true));
}
