//! SPK kernels in the place of the analytical ephemerides: scenes, trajectories, star images, far range.

use std::fs;
use std::path::Path;
use std::process::Output;

use crate::common::{self, AU_M, Fixture, HEADER, assert_done, assert_refused, json};
use crate::spk::{Circle, kernel, solar_system};
use glam::{DQuat, DVec3};
use serde_json::Value;

const LIGHT_SPEED_M_S: f64 = 299_792_458.0;
/// When the kernels begin: 2027-03-16T20:13:20 TDB.
const FROM_S: f64 = 8.585e8;
const TDB_S: f64 = FROM_S + 40.0 * 86_400.0;
/// [`TDB_S`].
const EPOCH: &str = "2027-04-25T20:13:20 TDB";

fn retina(arguments: &[&str]) -> Output {
    common::retina().args(arguments).output().unwrap()
}

/// Mars of [`solar_system`], where its light left, from a place.
fn mars_from_m(place_m: DVec3) -> DVec3 {
    let mars = solar_system().into_iter().find(|body: &Circle| body.target == 4).unwrap();
    let mut to_m = DVec3::ZERO;
    for _ in 0..8 {
        let then_s = TDB_S - to_m.length() / LIGHT_SPEED_M_S;
        to_m = DVec3::from_array(mars.state_km(then_s)[0]) * 1e3 - place_m;
    }
    to_m
}

fn write_kernel(path: &Path, bodies: &[Circle]) {
    fs::write(path, kernel(bodies, FROM_S, 20)).unwrap();
}

#[test]
fn a_scene_shows_the_planets_where_its_kernel_has_them() {
    let fixture = Fixture::new();
    let place_m = DVec3::X * AU_M;
    let q = DQuat::from_rotation_arc(mars_from_m(place_m).normalize(), DVec3::Z);
    let scene = "schema = \"retina.scene/1\"\nsetup = \"setup.toml\"\ntrajectory = \"poses.csv\"\n\
                 [ephemeris]\nkernels = [\"sky.bsp\"]\n[stars]\nfaintest_magnitude = 4.0\n";
    fixture.write("scene.toml", scene);
    fixture
        .write("poses.csv", &format!("{HEADER}\n{TDB_S},{AU_M},0,0,{},{},{},{},0,0,0\n", q.w, q.x, q.y, q.z));
    write_kernel(&fixture.path("sky.bsp"), &solar_system());
    assert_done(&fixture.render("out", &[]));
    let truth: Value =
        serde_json::from_slice(&fs::read(fixture.path("out/truth/000000.json")).unwrap()).unwrap();
    let points = truth["stars"].as_array().unwrap();
    let mars = points.iter().find(|point| point["id"] == "mars").unwrap();
    for (axis, centre) in [80.0, 50.0].into_iter().enumerate() {
        // The Sun deflects by some milliarcseconds; the light-time, left out, would be 0.1 px.
        let at = mars["screen_px"][axis].as_f64().unwrap();
        assert!((at - centre).abs() < 1e-3, "{mars}");
    }
    // Another kernel's frames are not mixed in, though its name is the same.
    let mut moved = solar_system();
    moved[4].radius_km += 1.0;
    write_kernel(&fixture.path("sky.bsp"), &moved);
    assert_refused(&fixture.render("out", &["--resume"]), &["holds the frames of another scene"]);
    // Without an Earth and a Moon, the theories do not lend theirs.
    write_kernel(&fixture.path("sky.bsp"), &solar_system()[..9]);
    assert_refused(&fixture.render("new", &[]), &["earth (NAIF 399)", "sky.bsp"]);
    fixture.write("scene.toml", &scene.replace("sky.bsp", "setup.toml"));
    assert_refused(&fixture.render("new", &[]), &["is no SPICE kernel"]);
    fixture.write("scene.toml", &scene.replace("sky.bsp", "none.bsp"));
    assert_refused(&fixture.render("new", &[]), &["`ephemeris.kernels`", "none.bsp"]);
}

#[test]
fn a_trajectory_points_at_the_planet_of_the_kernel() {
    let folder = tempfile::tempdir().unwrap();
    let [bsp, out] =
        ["sky.bsp", "site.csv"].map(|name| folder.path().join(name).to_str().unwrap().to_owned());
    write_kernel(Path::new(&bsp), &solar_system());
    let run = |epoch: &str| {
        let site = ["--latitude-deg", "45", "--longitude-deg", "9", "--target", "mars", "--epoch", epoch];
        let rest = ["--ephemeris", &bsp, "--out", &out, "--json"];
        retina(&[&["trajectory", "--kind", "site"][..], &site, &rest].concat())
    };
    let done = run(EPOCH);
    assert_eq!(json(&done)["ephemeris"], "sky.bsp");
    let table = fs::read_to_string(&out).unwrap();
    let mut lines = table.lines().filter(|line| !line.starts_with('#'));
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    let row: Vec<f64> = lines.next().unwrap().split(',').map(|cell| cell.parse().unwrap()).collect();
    let cell = |name: &str| row[header.iter().position(|column| *column == name).unwrap()];
    let vector =
        |name: &str| DVec3::from_array(["x", "y", "z"].map(|axis| cell(&format!("camera_{axis}{name}"))));
    assert!((cell("time_s") - TDB_S).abs() < 1e-3);
    let camera_m = vector("_m");
    let earth_m = [3, 399].map(|target| {
        let body = solar_system().into_iter().find(|body| body.target == target).unwrap();
        DVec3::from_array(body.state_km(TDB_S)[0]) * 1e3
    });
    // On the Earth's surface: 6367.5 km at 45 deg.
    assert!(((camera_m - earth_m[0] - earth_m[1]).length() - 6_367_490.0).abs() < 100.0);
    let quaternion = ["x", "y", "z", "w"].map(|part| cell(&format!("camera_from_inertial_{part}")));
    let seen = DQuat::from_array(quaternion).inverse() * DVec3::Z;
    let to = mars_from_m(camera_m).normalize();
    let beta = DVec3::from_array(["vx", "vy", "vz"].map(|part| cell(&format!("camera_{part}_m_s"))))
        / LIGHT_SPEED_M_S;
    // Aberration to the first order; the second and the Sun's deflection are below 0.1 arcsec.
    let apparent = (to + beta - to * to.dot(beta)).normalize();
    assert!(seen.angle_between(apparent) < 5e-7, "{}", seen.angle_between(apparent));

    assert_refused(&run("2028-01-01"), &["2028-01-01", "2027-06-04"]);
    let standing = retina(&["trajectory", "--kind", "lumio-halo", "--step-s", "0", "--out", &out]);
    assert_refused(&standing, &["--step-s", "a time above 0"]);
}

#[test]
fn star_images_take_the_kernel_where_a_position_is_known() {
    let folder = tempfile::tempdir().unwrap();
    let [bsp, image] =
        ["sky.bsp", "dark.png"].map(|name| folder.path().join(name).to_str().unwrap().to_owned());
    write_kernel(Path::new(&bsp), &solar_system());
    image::ImageBuffer::<image::Luma<u16>, _>::from_pixel(64, 64, image::Luma([100u16]))
        .save(&image)
        .unwrap();
    let run = |more: &[&str]| {
        retina(&[&["navigate", "stars", image.as_str(), "--fov-deg", "10", "--json"][..], more].concat())
    };
    let made_with = |more: &[&str]| json(&run(more))["ephemeris"].clone();
    let known = ["--time", EPOCH, "--position-m", "earth"];
    assert_eq!(made_with(&[&known[..], &["--ephemeris", &bsp]].concat()), "sky.bsp");
    assert_eq!(made_with(&known), "analytic");
    assert_eq!(made_with(&["--time", EPOCH]), Value::Null);
    for (more, said) in [
        (&["--ephemeris", bsp.as_str()][..], "--position-m"),
        (&["--time", "2026-01-01", "--position-m", "earth", "--ephemeris", &bsp], "no ephemeris of"),
        (&["--time", EPOCH, "--position-m", "earth", "--ephemeris", &image], "is no SPICE kernel"),
    ] {
        assert_refused(&run(more), &[said]);
    }
}

#[test]
fn a_far_range_folder_belongs_to_its_kernel() {
    let folder = tempfile::tempdir().unwrap();
    let asset = concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/scenarios/far-range.toml");
    let setups = concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/setups");
    let own = fs::read_to_string(asset).unwrap().replace("../setups", setups);
    let own = own.split("[transfer]").next().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let scenario = path("far-range.toml");
    let run = |ephemeris: &str, out: &str| {
        fs::write(&scenario, own.replace("seed = 1", &format!("seed = 1\n{ephemeris}"))).unwrap();
        retina(&["navigate", "far-range", &scenario, "--out", &path(out), "--poses", "3", "--json"])
    };
    // Eleven years from 2024 December 27 hold the poses' epochs, 2025 to 2035, and the light-time before.
    fs::write(path("sky.bsp"), kernel(&solar_system(), 7.885e8, 1005)).unwrap();
    assert_eq!(json(&run("", "theory"))["ephemeris"], "analytic");
    assert_eq!(json(&run("ephemeris = [\"sky.bsp\"]", "kernel"))["ephemeris"], "sky.bsp");
    assert_refused(&run("ephemeris = [\"sky.bsp\"]", "theory"), &["holds poses of another scenario"]);
    fs::write(path("sky.bsp"), kernel(&solar_system(), FROM_S, 20)).unwrap();
    assert_refused(&run("ephemeris = [\"sky.bsp\"]", "short"), &["sky.bsp", "no ephemeris of"]);
}

#[test]
fn a_meta_kernel_turns_bodies_and_results_say_so() {
    let folder = tempfile::tempdir().unwrap();
    let kernels = concat!(env!("CARGO_MANIFEST_DIR"), "/../retina-sky/tests/spice");
    let out = folder.path().join("halo.csv").to_str().unwrap().to_owned();
    let halo = |kernel: &str| {
        let kernel = format!("{kernels}/{kernel}");
        let frames = ["--frames", "2", "--step-s", "60", "--epoch", "2027-03-20", "--json"];
        retina(
            &[&["trajectory", "--kind", "lumio-halo", "--out", &out, "--ephemeris", &kernel], &frames[..]]
                .concat(),
        )
    };
    let document = json(&halo("constants.tpc"));
    assert_eq!(document["ephemeris"], "analytic, constants.tpc");
    assert_eq!(document["axes"], "IAU constants of constants.tpc");
    let by_text = fs::read_to_string(&out).unwrap();
    assert_eq!(json(&halo("all.tm"))["axes"], "MOON_ME (axes.bpc, frames.tf)");
    // The fixture's angles are not the real Moon's.
    assert_ne!(by_text, fs::read_to_string(&out).unwrap());
    let checked = json(&retina(&["check", &format!("{kernels}/all.tm"), "--json"]));
    let says = checked["files"][0]["says"].to_string();
    assert!(
        says.contains("leap.tls, constants.tpc, axes.bpc, frames.tf") && says.contains("moon (NAIF 301)"),
        "{says}"
    );
}

#[test]
fn a_scene_follows_a_spacecraft_of_kernels() {
    let fixture = Fixture::new();
    let kernels = concat!(env!("CARGO_MANIFEST_DIR"), "/../retina-sky/tests/spice/craft/craft.tm");
    let keys = r#"observer = "CRAFT", frame = "CRAFT_CAMERA", epoch = "2027-03-17T00:00 TDB", step_s = 600, frames = 3"#;
    let scene = |keys: &str| {
        format!(
            "schema = \"retina.scene/1\"\nsetup = \"setup.toml\"\ntrajectory = {{ kind = \"spice\", {keys} }}\n\
             [ephemeris]\nkernels = [\"{kernels}\"]\n[stars]\nfaintest_magnitude = 4.0\nplanets = false\n"
        )
    };
    let table = fixture.path("poses.csv");
    let (path, out) = (fixture.path("scene.toml"), table.to_str().unwrap());
    let written = |keys: &str| {
        fixture.write("scene.toml", &scene(keys));
        retina(&["trajectory", "--scene", path.to_str().unwrap(), "--out", out, "--json"])
    };
    assert_eq!(json(&written(keys))["frames"], 3);
    let text = fs::read_to_string(&table).unwrap();
    let head: Vec<&str> = text.lines().nth(1).unwrap().split(',').collect();
    assert!(head.contains(&"camera_vx_m_s") && head.contains(&"sun_x_m"), "{head:?}");
    assert_eq!(text.lines().count(), 5);
    // Another order of the same axes is another roll of the same boresight.
    assert_eq!(json(&written(&format!("{keys}, axes = [\"+y\", \"-x\", \"+z\"]")))["frames"], 3);
    assert_ne!(text, fs::read_to_string(&table).unwrap());
    fs::remove_file(&table).unwrap();
    for (from, to, said) in [
        (r#"observer = "CRAFT", "#, "", "`trajectory.observer`"),
        (r#"epoch = "2027-03-17T00:00 TDB", "#, "", "`trajectory.epoch`"),
        (r#"frame = "CRAFT_CAMERA", "#, "", "no body to point at"),
        ("CRAFT_CAMERA", "CRAFT_LIDAR", "no FRAME_CRAFT_LIDAR"),
        (r#""CRAFT""#, r#""LANDER""#, "no ephemeris of LANDER"),
        // Attitudes have a gap from 15 to 16 h 40 min after the first.
        ("2027-03-17T00:00", "2027-03-17T12:00", "with a gap from 2027-03-17T11:13:20.0000"),
        ("2027-03-17T00:00", "2027-03-19T12:00", "craft.bsp"),
        ("frames = 3", "frames = 3, axes = [\"+x\", \"+y\", \"-z\"]", "right-handed"),
        ("frames = 3", "frames = 3, spin = { period_h = 1 }", "has no such key"),
    ] {
        assert!(keys.contains(from), "{from}");
        assert_refused(&written(&keys.replacen(from, to, 1)), &[said, "scene.toml"]);
        assert!(!table.exists());
    }
    // The whole chain: stars as the craft's camera sees them.
    fixture.write("scene.toml", &scene(keys));
    assert_done(&fixture.render("out", &["--frames", "0..1"]));
    let says = json(&retina(&["check", &kernels.replace("craft.tm", "craft.bc"), "--json"]));
    assert!(says["files"][0]["says"].to_string().contains("attitudes of -999000"), "{says}");
    let says = json(&retina(&["check", &kernels.replace("craft.tm", "craft.tf"), "--json"]));
    assert!(says["files"][0]["says"].to_string().contains("the frames COMET_FIXED, CRAFT_BUS"), "{says}");
}
