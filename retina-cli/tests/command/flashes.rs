//! Flashes on a body: where, how bright, for how long, hidden, what is refused, and whether the detector finds them.

use std::fs;

use crate::common::{
    DISTANCE_M, FOCAL_PX, Fixture, RADIUS_M, assert_done, assert_refused, contents, counts, json, retina,
    stderr,
};
use serde_json::Value;

/// Frame 5 of the fixture: the Sun 75 deg from behind the camera, which sees the body from -z.
const FRAME: &str = "5..6";
/// Begin of its exposure, s.
const TIME_S: f64 = 300.0;
/// A place in its night: (-0.766, 0, -0.643), the Sun in (0.966, 0, -0.259).
const NIGHT: [f64; 2] = [-40.0, 180.0];
const SCALE: f64 = 0.05;

/// A scene whose table holds these flashes: time, latitude, longitude, magnitude, duration.
fn fixture(flashes: &[[f64; 5]]) -> Fixture {
    let fixture = Fixture::new();
    fixture.edit("scene.toml", "\"auto\"", &SCALE.to_string());
    let scene =
        format!("{}[flashes]\ntable = \"flashes.csv\"\nexposure_s = 2.0\n", text(&fixture, "scene.toml"));
    fixture.write("scene.toml", &scene);
    let row =
        |flash: &[f64; 5]| format!("{},{},{},{},{}\n", flash[0], flash[1], flash[2], flash[3], flash[4]);
    let rows: String = flashes.iter().map(row).collect();
    fixture.write("flashes.csv", &format!("time_s,latitude_deg,longitude_deg,magnitude,duration_s\n{rows}"));
    fixture
}

fn text(fixture: &Fixture, name: &str) -> String {
    fs::read_to_string(fixture.path(name)).unwrap()
}

fn flashes(fixture: &Fixture) -> Vec<Value> {
    let truth: Value = serde_json::from_str(&text(fixture, "out/truth/000005.json")).unwrap();
    truth["flashes"].as_array().unwrap().clone()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap()
}

/// Light of frame 5 within 4 px of a place, a pixel at full count being 1: gamma 2.2.
fn light(fixture: &Fixture, at: [f64; 2]) -> f64 {
    let image = counts(&fixture.path("out/frames/000005.png"));
    let near = |i: usize| ((i % 160) as f64 + 0.5 - at[0]).hypot((i / 160) as f64 + 0.5 - at[1]) < 4.0;
    image.iter().enumerate().filter(|(i, _)| near(*i)).map(|(_, &b)| (f64::from(b) / 255.0).powf(2.2)).sum()
}

/// Where the pinhole has a place of the sphere, px: the body's axes are the camera's.
fn pixel([latitude_deg, longitude_deg]: [f64; 2]) -> [f64; 2] {
    let (latitude, longitude) = (latitude_deg.to_radians(), longitude_deg.to_radians());
    let z = DISTANCE_M + RADIUS_M * latitude.sin();
    let across = RADIUS_M * latitude.cos();
    [80.0 + FOCAL_PX * across * longitude.cos() / z, 50.0 + FOCAL_PX * across * longitude.sin() / z]
}

#[test]
fn a_flash_stands_where_the_sphere_has_it_and_is_as_bright() {
    let fixture = fixture(&[[TIME_S - 1.0, NIGHT[0], NIGHT[1], -3.0, 100.0]]);
    assert_done(&fixture.render("out", &["--frames", FRAME]));
    let found = flashes(&fixture);
    assert_eq!(found.len(), 1);
    let at = pixel(NIGHT);
    for (axis, expected) in at.iter().enumerate() {
        // A facet of the mesh lies up to 1.2 m inside the sphere: 0.04 px across at most.
        assert!((number(&found[0]["screen_px"][axis]) - expected).abs() < 0.04, "{found:?} {at:?}");
        assert!((number(&found[0]["displayed_px"][axis]) - expected).abs() < 0.1, "{found:?} {at:?}");
    }
    // It takes the radiance scale as stars do: 3.25 mag; a full pixel is -1.44.
    let shown = -1.44 - 2.5 * light(&fixture, at).log10();
    assert!((shown - (-3.0 - 2.5 * SCALE.log10())).abs() < 0.05, "{shown}");
    assert_eq!((&found[0]["shown"], &found[0]["hidden"]), (&Value::from(true), &Value::from(false)));
    // Eq. 7: 3.67e-11 W m^-2 nm^-1 at magnitude 0, times 10^1.2.
    let mean = number(&found[0]["mean_irradiance_w_m2_nm"]);
    assert!((mean / (3.67e-11 * 10f64.powf(1.2)) - 1.0).abs() < 1e-12);
}

#[test]
fn a_frame_shows_the_mean_over_its_exposure() {
    // One second of the exposure's two: half the light, 0.7526 mag.
    for (begin_s, duration_s) in [(-3.0, 4.0), (1.0, 50.0), (0.5, 1.0)] {
        let fixture = fixture(&[[TIME_S + begin_s, NIGHT[0], NIGHT[1], -3.0, duration_s]]);
        assert_done(&fixture.render("out", &["--frames", FRAME]));
        let shown = -1.44 - 2.5 * light(&fixture, pixel(NIGHT)).log10();
        assert!((shown - (-3.0 + 0.7526 - 2.5 * SCALE.log10())).abs() < 0.05, "{begin_s}: {shown}");
        assert!((number(&flashes(&fixture)[0]["exposure_share"]) - 0.5).abs() < 1e-12);
    }
    // Before and after it there is none, and the user is told of those that no frame shows.
    let fixture = fixture(&[[TIME_S - 1.0, 0.0, 180.0, -3.0, 0.9], [TIME_S + 2.1, 0.0, 180.0, -3.0, 9.0]]);
    let out = fixture.render("out", &["--frames", FRAME]);
    assert_done(&out);
    assert!(flashes(&fixture).is_empty());
    assert!(stderr(&out).contains("2 of 2 flashes"), "{}", stderr(&out));
}

#[test]
fn a_flash_behind_the_limb_or_below_the_least_count_is_not_shown() {
    let without = fixture(&[[0.0, 0.0, 0.0, 0.0, 1.0]]);
    assert_done(&without.render("out", &["--frames", FRAME]));
    let dark = counts(&without.path("out/frames/000005.png"));
    // From 22.5 radii the limb is at latitude -2.55 deg (sin = 1 / 22.5); a facet of the mesh ends at the equator.
    for (latitude, magnitude, hidden) in [(40.0, -3.0, true), (1.0, -3.0, true), (-40.0, 20.0, false)] {
        let fixture = fixture(&[[TIME_S, latitude, 180.0, magnitude, 2.0]]);
        assert_done(&fixture.render("out", &["--frames", FRAME]));
        let found = &flashes(&fixture)[0];
        assert_eq!((&found["hidden"], &found["shown"]), (&hidden.into(), &false.into()), "{found}");
        assert_eq!(counts(&fixture.path("out/frames/000005.png")), dark);
    }
    let fixture = fixture(&[[TIME_S, -4.0, 180.0, -3.0, 2.0]]);
    assert_done(&fixture.render("out", &["--frames", FRAME]));
    assert_eq!(flashes(&fixture)[0]["shown"], true);
}

#[test]
fn a_magnitude_at_a_distance_goes_by_the_inverse_square() {
    let fixture = fixture(&[[TIME_S, -90.0, 0.0, 2.0, 2.0]]);
    fixture.edit("scene.toml", "exposure_s", "seen_from_m = 215000.0\nexposure_s");
    assert_done(&fixture.render("out", &["--frames", FRAME]));
    // From 215 km to the near point at 21.5 km: a tenth, five magnitudes; the mesh's own pole is a vertex or 1.2 m lower.
    assert!((number(&flashes(&fixture)[0]["magnitude"]) + 3.0).abs() < 2e-4);
}

#[test]
fn drawn_flashes_are_in_the_night_and_the_same_whatever_the_shard() {
    let fixture = Fixture::new();
    fixture.edit("scene.toml", "\"auto\"", "0.05");
    let drawn =
        "[flashes]\nexposure_s = 1.0\nnumber = 4\nmagnitudes = [-4.0, -2.0]\ndurations_s = [0.5, 3.0]\n";
    fixture.write("scene.toml", &format!("{}{drawn}", text(&fixture, "scene.toml")));
    assert_done(&fixture.render("out", &[]));
    for shard in ["1/2", "0/2"] {
        assert_done(&fixture.render("parts", &["--shard", shard, "--resume"]));
    }
    let [whole, parts] = ["out", "parts"].map(|name| contents(&fixture.path(name)));
    for (name, bytes) in
        whole.iter().filter(|(name, _)| name.starts_with("frames") || name.starts_with("truth"))
    {
        assert_eq!(parts.get(name), Some(bytes), "{name:?}");
    }
    let found = flashes(&fixture);
    assert_eq!(found.len(), 4);
    let phase = 75f64.to_radians();
    for flash in &found {
        let (latitude, longitude) =
            (number(&flash["latitude_deg"]).to_radians(), number(&flash["longitude_deg"]).to_radians());
        let towards_sun = latitude.cos() * longitude.cos() * phase.sin() - latitude.sin() * phase.cos();
        assert!(towards_sun < 0.0 && latitude < 0.0, "{flash}");
        assert!(
            (0.0..=1.0).contains(&number(&flash["exposure_share"])) && number(&flash["exposure_share"]) > 0.0
        );
    }
    // Frame 0 is full: there is no night to be seen.
    let full: Value = serde_json::from_str(&text(&fixture, "out/truth/000000.json")).unwrap();
    assert!(full["flashes"].as_array().unwrap().len() < 4);
    // Another seed, other flashes.
    fixture.edit("scene.toml", "radiance_scale", "seed = 2\nradiance_scale");
    assert_done(&fixture.render("other", &["--frames", FRAME]));
    assert_ne!(text(&fixture, "other/truth/000005.json"), text(&fixture, "out/truth/000005.json"));
}

#[test]
fn flashes_that_do_not_fit_are_refused() {
    let table = "time_s,latitude_deg,longitude_deg,magnitude,duration_s\n";
    for (row, words) in [
        ("1,95,0,5,1\n", ["latitude_deg", "95"]),
        ("1,0,0,5,0\n", ["duration_s", "above 0"]),
        ("1,0,0,99,1\n", ["magnitude", "99"]),
        ("1,0,0,nan,1\n", ["magnitude", "line 2"]),
        ("1,0,0,,1\n", ["magnitude", "empty"]),
    ] {
        let fixture = fixture(&[]);
        fixture.write("flashes.csv", &format!("{table}{row}"));
        assert_refused(&fixture.render("out", &[]), &words);
    }
    for (from, to, words) in [
        ("exposure_s = 2.0", "exposure_s = 0.0", ["exposure_s", "above 0"]),
        ("exposure_s = 2.0", "exposure_s = 2.0\nbody = \"moon\"", ["moon", "rock"]),
        ("exposure_s = 2.0", "exposure_s = 2.0\nbrightness = 3", ["brightness", "magnitudes"]),
        ("exposure_s = 2.0", "exposure_s = 2.0\nnumber = 3", ["magnitudes", "durations_s"]),
        ("exposure_s = 2.0", "exposure_s = 2.0\nseen_from_m = -1.0", ["seen_from_m", "above 0"]),
        ("table = \"flashes.csv\"\n", "", ["table", "number"]),
        ("table = \"flashes.csv\"", "table = \"none.csv\"", ["none.csv", "flashes.table"]),
    ] {
        let fixture = fixture(&[[TIME_S, 0.0, 180.0, 0.0, 1.0]]);
        fixture.edit("scene.toml", from, to);
        assert_refused(&fixture.render("out", &[]), &words);
        assert!(!fixture.path("out").exists());
    }
}

#[test]
fn the_detector_finds_them_in_a_rendered_folder() {
    // Two in the night, one of them far too dim for the screen, one on the day side.
    let fixture = fixture(&[
        [TIME_S, NIGHT[0], NIGHT[1], -3.0, 2.0],
        [TIME_S, -50.0, 150.0, 25.0, 2.0],
        [TIME_S, -40.0, 0.0, -5.0, 2.0],
    ]);
    assert_done(&fixture.render("out", &["--frames", FRAME]));
    let out = retina()
        .args([
            "navigate",
            "flashes",
            "--json",
            "--limb-margin-px",
            "3",
            "--terminator-margin-px",
            "6",
            "--setup",
        ])
        .arg(fixture.path("setup.toml"))
        .arg(fixture.path("out"))
        .output()
        .unwrap();
    let found = json(&out);
    assert_eq!(found["schema"], "retina.navigation-flashes/1");
    let summary = &found["summary"];
    for (key, expected) in
        [("flashes", 3), ("watched", 2), ("found", 1), ("outside", 1), ("false_detections", 0)]
    {
        assert_eq!(summary[key], expected, "{key} {summary}");
    }
    let flash = &found["frames"][0]["flashes"][0];
    // Shown within 0.02 mag and 0.05 px; a pixel is 25 m across, 40 m along the surface, whose facets lie 1.2 m deep.
    assert!(number(&flash["error_magnitude"]).abs() < 0.05, "{flash}");
    assert!(number(&flash["error_m"]) < 6.0, "{flash}");
    // Photographs of another exposure than the scene's, their distortion not taken off: both are said beforehand.
    std::fs::create_dir_all(fixture.path("shots/images")).unwrap();
    let frame = "000005.png".to_owned();
    let shown = fixture.path("out/frames").join(&frame);
    std::fs::copy(&shown, fixture.path("shots/images").join(&frame)).unwrap();
    fixture.write(
        "shots/frames.csv",
        &format!("predicted,measured,exposure_s\n{},images/{frame},0.5\n", shown.display()),
    );
    let out = retina()
        .args(["navigate", "flashes", "--setup"])
        .arg(fixture.path("setup.toml"))
        .arg("--images")
        .arg(fixture.path("shots"))
        .arg(fixture.path("out"))
        .output()
        .unwrap();
    let said = String::from_utf8(out.stderr).unwrap();
    assert!(said.contains("exposed for 0.5 s") && said.contains("without a calibration"), "{said}");
    assert_refused(
        &retina()
            .args(["navigate", "flashes", "--false-alarms-per-frame", "0"])
            .arg(fixture.path("out"))
            .output()
            .unwrap(),
        &["--false-alarms-per-frame", "1e-12"],
    );
}

#[test]
fn a_scenario_that_does_not_fit_is_refused() {
    let fixture = Fixture::new();
    for (text, word) in [
        ("schema = \"retina.full-disk/1\"\nscene = \"scene.toml\"", "retina.flashes/1"),
        ("schema = \"retina.flashes/1\"\nscene = \"scene.toml\"\nbloom = 1", "bloom"),
        ("schema = \"retina.flashes/1\"\nscene = \"scene.toml\"\nblooming = 2.0", "blooming"),
        (
            "schema = \"retina.flashes/1\"\nscene = \"scene.toml\"\n[detector]\nmesh_px = 2",
            "detector.mesh_px",
        ),
        ("schema = \"retina.flashes/1\"\nscene = \"none.toml\"", "none.toml"),
    ] {
        fixture.write("flashes.toml", text);
        let out = retina()
            .args(["navigate", "flashes", "--out"])
            .arg(fixture.path("result"))
            .arg(fixture.path("flashes.toml"))
            .output()
            .unwrap();
        assert_refused(&out, &[word]);
    }
}
