//! Input that does not fit: exit code 2, a message that names file and place, nothing written.

use std::fs;

use crate::common::{self, Fixture, HEADER, assert_refused, retina};

/// The scene with one thing spoilt is refused with these words, and the folder is not made.
fn refused(spoil: impl FnOnce(&Fixture), words: &[&str]) {
    let fixture = Fixture::new();
    spoil(&fixture);
    assert_refused(&fixture.render("out", &[]), words);
    assert!(!fixture.path("out").exists(), "the output folder was made");
}

fn edited(file: &str, from: &str, to: &str, words: &[&str]) {
    refused(|fixture| fixture.edit(file, from, to), words);
}

#[test]
fn models_that_are_missing_or_broken() {
    refused(|f| fs::remove_file(f.path("rock.glb")).unwrap(), &["rock.glb", "cannot be read"]);
    refused(
        |f| {
            let glb = fs::read(f.path("rock.glb")).unwrap();
            fs::write(f.path("rock.glb"), &glb[..glb.len() / 2]).unwrap();
        },
        &["rock.glb"],
    );
    refused(
        |f| {
            let picture = f.path("albedo.png");
            image::GrayImage::from_pixel(32, 16, image::Luma([128])).save(&picture).unwrap();
            let out = retina()
                .args(["body", "--radius-m", "1000", "--cells", "4", "--texels", "8", "--albedo"])
                .arg(&picture)
                .arg("--out")
                .arg(f.path("rock.glb"))
                .output()
                .unwrap();
            common::assert_done(&out);
            // The second half of the first texture is overwritten: it is a PNG, and does not decode.
            let mut glb = fs::read(f.path("rock.glb")).unwrap();
            let start = glb.windows(4).position(|four| four == b"IDAT").unwrap();
            glb[start + 4..start + 12].fill(0xff);
            fs::write(f.path("rock.glb"), glb).unwrap();
        },
        &["rock.glb", "image"],
    );
}

#[test]
fn unknown_keys_are_pointed_at_with_the_nearest_known_one() {
    edited(
        "scene.toml",
        "radiance_scale",
        "radiance_scael",
        &["scene.toml", "line 4", "did you mean `radiance_scale`?"],
    );
    edited("scene.toml", "shading =", "shadding =", &["line 11", "did you mean `shading`?"]);
    edited("scene.toml", "normal_albedo", "normal_albdeo", &["line 12", "did you mean `normal_albedo`?"]);
    edited("scene.toml", "\"none\"", "\"resampel\"", &["line 6", "did you mean `resample`?"]);
    edited("scene.toml", "\"lambert\"", "\"lambret\"", &["line 12", "did you mean `lambert`?"]);
    edited("setup.toml", "focal_mm", "focal_m", &["setup.toml", "did you mean `focal_mm`?"]);
    let layers =
        |f: &Fixture| f.write("scene.toml", &format!("{}[output]\nlayers = [\"dpeth\"]\n", common::SCENE));
    refused(layers, &["scene.toml", "line 14", "did you mean `depth`?"]);
    let halo = "trajectory = { kind = \"lumio-halo\", frames = 3, step = 1.0 }";
    edited(
        "scene.toml",
        "trajectory = \"poses.csv\"",
        halo,
        &["scene.toml", "line 3", "did you mean `step_s`?"],
    );
}

#[test]
fn values_that_do_not_fit_the_scene() {
    edited("scene.toml", "retina.scene/1", "retina.scene/9", &["key `schema`", "retina.scene/9"]);
    edited("scene.toml", "\"auto\"", "-1.0", &["scene.toml", "line 4", "radiance_scale"]);
    edited("scene.toml", "\"auto\"", "nan", &["scene.toml", "line 4"]);
    edited(
        "scene.toml",
        "\"lambert\"",
        "\"lambert\", porosity = 1.0",
        &["body `rock`", "photometry.porosity", "lambert"],
    );
    edited("scene.toml", "name = \"rock\"", "name = \"sun\"", &["body 1", "`sun`"]);
    edited("scene.toml", "shading = \"smooth\"", "reference_radius_m = 0.0", &["body `rock`", "reference"]);
    // The camera is 22.5 km from a rock of some 2 km.
    edited(
        "scene.toml",
        "shading = \"smooth\"",
        "reference_semi_axes_m = [1e3, 2e3, 1e9]",
        &["body `rock`", "is not of the mesh's size", "1.000000e9 m"],
    );
    refused(
        |f| {
            f.edit("scene.toml", "shading = \"smooth\"", "reference_radius_m = 9000.0");
            f.edit("poses.csv", "0,0,0,-22500", "0,0,0,-8000");
        },
        &["the camera is inside the reference ellipsoid of the body `rock`", "8.000000e3 m from the centre"],
    );
    edited("scene.toml", "calibration.toml", "elsewhere.toml", &["elsewhere.toml"]);
    edited(
        "calibration.toml",
        "setup = \"small\"",
        "setup = \"large\"",
        &["calibration.toml", "key `setup`", "`large`"],
    );
    // A distortion beyond measure, which does not fold: the images it asks for would have no end.
    for (from, to) in [
        ("[3, 0, 12.0, 0.0]", "[3, 0, 1e7, 0.0]"),
        ("[1, 0, 1.0, 0.0]", "[1, 0, 1e20, 0.0]"),
        ("[1, 0, 1.0, 0.0]", "[0, 0, 1e12, 0.0], [1, 0, 1.0, 0.0]"),
        ("[0, 1, 0.0, 1.0]", "[0, 1, 1e20, 1.0]"),
    ] {
        edited(
            "calibration.toml",
            from,
            to,
            &["calibration.toml", "key `distortion.terms`", "the distortion "],
        );
    }
    refused(
        |f| {
            f.edit("scene.toml", "calibration = \"calibration.toml\"\n", "");
            f.edit("scene.toml", "\"none\"", "\"direct\"");
        },
        &["scene.toml", "table `compensation`", "no calibration"],
    );
    edited(
        "scene.toml",
        "trajectory = \"poses.csv\"",
        "trajectory = { kind = \"lumio-halo\", frames = 3, step_s = 60.0 }",
        &["scene.toml", "key `trajectory`", "`rock`"],
    );
}

#[test]
fn screens_without_area() {
    edited("setup.toml", "width_px = 160", "width_px = 0", &["setup.toml", "screen.width_px"]);
    edited("setup.toml", "height_px = 100", "height_px = 0", &["setup.toml", "screen.height_px"]);
}

#[test]
fn trajectories_with_bad_cells() {
    edited("poses.csv", "-22500", "nan", &["poses.csv", "line 3", "camera_z_m", "nan"]);
    edited("poses.csv", "1,0,0,0", "3,0,0,0", &["poses.csv", "line 3", "camera_from_inertial_w", "norm"]);
    edited("poses.csv", "sun_y_m,sun_z_m", "sun_y_m,sun_q_m", &["poses.csv", "sun_q_m"]);
    edited("poses.csv", "60,0,0", "60,0", &["poses.csv", "line 4"]);
    refused(|f| f.write("poses.csv", &format!("{HEADER}\n")), &["poses.csv", "no frames"]);
    refused(|f| fs::remove_file(f.path("poses.csv")).unwrap(), &["poses.csv", "cannot be read"]);
}

/// One frame: camera position, attitude (w, x, y, z), Sun.
fn one_pose(fixture: &Fixture, camera: [f64; 3], attitude: [f64; 4], sun: [f64; 3]) {
    let cells: Vec<String> =
        [0.0].iter().chain(&camera).chain(&attitude).chain(&sun).map(|v| format!("{v:e}")).collect();
    fixture.write("poses.csv", &format!("{HEADER}\n{}\n", cells.join(",")));
}

const AHEAD: [f64; 4] = [1.0, 0.0, 0.0, 0.0];
const TURNED: [f64; 4] = [0.0, 1.0, 0.0, 0.0];
const SUN: [f64; 3] = [0.0, 0.0, -1.496e11];

#[test]
fn geometry_that_cannot_be() {
    let place = ["poses.csv", "line 2", "frame 0"];
    let with = |words: &[&'static str]| [&place[..], words].concat();
    refused(
        |f| one_pose(f, [0.0, 0.0, -22_500.0], TURNED, SUN),
        &with(&["`rock` is behind the camera", "may_be_behind"]),
    );
    refused(|f| one_pose(f, [0.0, 0.0, -900.0], AHEAD, SUN), &with(&["inside the body `rock`", "mesh"]));
    refused(|f| one_pose(f, [0.0; 3], AHEAD, SUN), &with(&["inside the body `rock`"]));
    refused(
        |f| one_pose(f, [0.0, 0.0, -22_500.0], AHEAD, [0.0, 0.0, -500.0]),
        &with(&["Sun is inside the body `rock`"]),
    );
    refused(
        |f| one_pose(f, [0.0, 0.0, -22_500.0], AHEAD, [0.0, 0.0, -1.5e8]),
        &with(&["inside the Sun", "metres"]),
    );
    // 9000 m aside at 22 500 m: 21.8 deg off, field 10.2 x 6.4 deg.
    refused(
        |f| one_pose(f, [9000.0, 0.0, -22_500.0], AHEAD, SUN),
        &with(&["no body is in view", "21.80 deg", "10.16 x 6.36 deg"]),
    );
    refused(
        |f| {
            f.edit("scene.toml", "\"none\"", "\"direct\"");
            one_pose(f, [1500.0, 0.0, -500.0], AHEAD, SUN);
        },
        &with(&["direct", "camera's plane"]),
    );
    refused(
        |f| {
            f.write(
                "poses.csv",
                &common::poses(1)
                    .lines()
                    .map(|line| {
                        let cells: Vec<&str> = line.split(',').collect();
                        format!("{}\n", cells[..cells.len().min(8)].join(","))
                    })
                    .collect::<String>(),
            )
        },
        &["poses.csv", "line 3", "where the Sun is", "sun_x_m"],
    );
}

#[test]
fn what_is_meant_is_allowed() {
    let fixture = Fixture::new();
    fixture.edit("scene.toml", "\"auto\"", "0.1\nallow_empty_frames = true");
    fixture.edit("scene.toml", "shading", "may_be_behind = true\nshading");
    one_pose(&fixture, [0.0, 0.0, -22_500.0], TURNED, SUN);
    common::assert_done(&fixture.render("out", &[]));
    assert!(common::counts(&fixture.path("out/frames/000000.png")).iter().all(|&count| count == 0));
    let truth: serde_json::Value =
        serde_json::from_slice(&fs::read(fixture.path("out/truth/000000.json")).unwrap()).unwrap();
    assert!(truth["bodies"]["rock"]["limb_ellipse_px"].is_null());
}

#[test]
fn no_lit_surface_leaves_no_brightest_pixel() {
    refused(
        |f| one_pose(f, [0.0, 0.0, -22_500.0], AHEAD, [0.0, 0.0, 1.496e11]),
        &["scene.toml", "key `radiance_scale`", "lit surface"],
    );
}

#[test]
fn arguments_that_do_not_fit() {
    let fixture = Fixture::new();
    for (more, words) in [
        (&["--frames", "5..2"][..], "5..2"),
        (&["--frames", "3..3"], "3..3"),
        (&["--frames", "0..7"], "0..6"),
        (&["--frames", "9.."], "0..6"),
        (&["--frames", "x"], "A..B"),
        (&["--every", "0"], "--every"),
        (&["--shard", "2/2"], "I/N"),
        (&["--backend", "quantum"], "quantum"),
        (&["--framse", "0..2"], "--framse"),
    ] {
        assert_refused(&fixture.render("out", more), &[words]);
        assert!(!fixture.path("out").exists());
    }
    assert_refused(&retina().arg("render").output().unwrap(), &["SCENE"]);
}

#[test]
fn folders_that_belong_to_something_else() {
    let fixture = Fixture::new();
    common::assert_done(&fixture.render("out", &["--frames", "0..2"]));
    let before = common::contents(&fixture.path("out"));
    let unchanged = |words: &[&str], more: &[&str]| {
        assert_refused(&fixture.render("out", more), words);
        assert_eq!(common::contents(&fixture.path("out")), before);
    };
    unchanged(&["out", "--resume"], &[]);
    unchanged(&["quality", "`default`", "`best`"], &["--resume", "--quality", "best"]);
    fixture.edit("scene.toml", "0.12", "0.13");
    unchanged(&["out", "another scene"], &["--resume"]);
    unchanged(&["out", "another scene"], &["--frames", "4..5"]);

    let fixture = Fixture::new();
    fs::create_dir_all(fixture.path("out/frames")).unwrap();
    assert_refused(&fixture.render("out", &["--resume"]), &["out", "frames", "batch.json"]);
    fixture.write("file", "x");
    assert_refused(&fixture.render("file", &[]), &["file", "is not a folder"]);
    assert_refused(
        &retina().arg("sheet").arg(fixture.path("out")).output().unwrap(),
        &["frames", "no frames"],
    );
}

#[test]
fn what_a_user_easily_gets_wrong_is_said_in_his_words() {
    edited("scene.toml", "\"auto\"", "\"auto\"\nallow_empty_frames = 3", &["scene.toml", "true or false"]);
    edited("scene.toml", "setup.toml", "stup.toml", &["stup.toml", "cannot be read"]);
    let help = |f: &Fixture| {
        f.edit("scene.toml", "rock.glb", "rok.glb");
        let text = common::stderr(&f.render("out", &[]));
        assert!(text.contains("named by the key `model`"), "{text}");
    };
    help(&Fixture::new());
    refused(
        |f| f.write("poses.csv", &common::poses(2).replace(',', ";")),
        &["poses.csv", "semicolons", "commas"],
    );
    refused(
        |f| {
            let poses = common::poses(1).replace("camera_from_inertial_x", "a").replace("camera_y_m", "b");
            f.write("poses.csv", &poses.replace(",a,", ",sun_a,").replace(",b,", ",sun_b,"));
        },
        &["poses.csv"],
    );
    // Two bodies without columns stand at one place.
    refused(
        |f| {
            let second = common::SCENE.split("[[body]]").nth(1).unwrap().replace("\"rock\"", "\"stone\"");
            f.write("scene.toml", &format!("{}[[body]]{second}", common::SCENE));
        },
        &["`rock` and `stone` stand at the same place"],
    );
}
