//! Stars and planets on the screen: where, how bright, hidden by bodies, and what is refused.

use std::fs;

use crate::common::{
    self, AU_M, DISTANCE_M, FOCAL_PX, Fixture, HEADER, RADIUS_M, assert_done, assert_refused, counts,
};
use serde_json::Value;

const CATALOGUE: &str = "id,ra_deg,dec_deg,pm_ra_mas_yr,pm_dec_mas_yr,parallax_mas,v_mag,b_v\n";
const SCENE: &str = r#"schema = "retina.scene/1"
setup = "setup.toml"
trajectory = "poses.csv"
[stars]
faintest_magnitude = 9.0
catalogue = "stars.csv"
planets = false
"#;
/// J1991.25, TDB seconds since J2000: proper motion is nil.
const EPOCH_S: f64 = -8.75 * 365.25 * 86_400.0;

/// A star `off_deg` from the north celestial pole, which the camera looks at: image x is right
/// ascension 0, y is 90 deg.
fn star(id: &str, ra_deg: f64, off_deg: f64, magnitude: f64) -> String {
    format!("{id},{ra_deg},{},0,0,0,{magnitude},\n", 90.0 - off_deg)
}

/// A scene of stars seen from 1 au.
fn fixture(stars: &[String]) -> Fixture {
    let fixture = Fixture::new();
    fixture.write("scene.toml", SCENE);
    fixture.write("poses.csv", &format!("{HEADER}\n{EPOCH_S},{AU_M},0,0,1,0,0,0,0,0,0\n"));
    fixture.write("stars.csv", &format!("{CATALOGUE}{}", stars.concat()));
    fixture
}

fn truth(fixture: &Fixture) -> Value {
    serde_json::from_slice(&fs::read(fixture.path("out/truth/000000.json")).unwrap()).unwrap()
}

fn pair(value: &Value) -> [f64; 2] {
    [0, 1].map(|k| value[k].as_f64().unwrap())
}

#[test]
fn a_star_stands_where_the_pinhole_has_it_and_is_as_bright() {
    let fixture =
        fixture(&[star("a", 30.0, 2.5, 1.0), star("b", 200.0, 1.0, 4.0), star("off", 0.0, 30.0, 0.0)]);
    assert_done(&fixture.render("out", &[]));
    let truth = truth(&fixture);
    assert_eq!(truth["radiance_scale"], 1.0, "stars alone are shown as bright as they are");
    let stars = truth["stars"].as_array().unwrap();
    assert_eq!(stars.iter().map(|s| s["id"].as_str().unwrap()).collect::<Vec<_>>(), ["a", "b"]);
    let tan = 2.5f64.to_radians().tan();
    let turn = 30f64.to_radians();
    let expected = [80.0 + FOCAL_PX * tan * turn.cos(), 50.0 + FOCAL_PX * tan * turn.sin()];
    let (wanted, shown) = (pair(&stars[0]["screen_px"]), pair(&stars[0]["displayed_px"]));
    for axis in 0..2 {
        // Light deflection at right angles to the Sun is 4 mas: 2e-5 px.
        assert!((wanted[axis] - expected[axis]).abs() < 5e-5, "{wanted:?} {expected:?}");
        assert!((shown[axis] - wanted[axis]).abs() < 0.03);
    }
    assert!((stars[0]["displayed_magnitude"].as_f64().unwrap() - 1.0).abs() < 0.01);

    // The counts themselves: gamma 2.2, 255 is magnitude -1.44 on the boresight, cos^3 off it.
    let image = counts(&fixture.path("out/frames/000000.png"));
    let (mut light, mut moment) = (0.0, [0.0; 2]);
    for (i, &count) in image.iter().enumerate() {
        let at = [(i % 160) as f64 + 0.5, (i / 160) as f64 + 0.5];
        if count > 0 && (at[0] - wanted[0]).hypot(at[1] - wanted[1]) < 3.0 {
            let r2 = ((at[0] - 80.0).powi(2) + (at[1] - 50.0).powi(2)) / FOCAL_PX.powi(2);
            let pixel = (f64::from(count) / 255.0).powf(2.2) * (1.0 + r2).powf(-1.5);
            light += pixel;
            moment = [moment[0] + pixel * at[0], moment[1] + pixel * at[1]];
        }
    }
    let magnitude = -1.44 - 2.5 * light.log10();
    assert!((magnitude - stars[0]["displayed_magnitude"].as_f64().unwrap()).abs() < 1e-9);
    assert!((moment[0] / light - shown[0]).hypot(moment[1] / light - shown[1]) < 1e-9);
}

#[test]
fn compensation_moves_a_star_to_where_the_facility_shows_it_right() {
    let fixture = fixture(&[star("a", 30.0, 2.5, 1.0)]);
    for mode in ["direct", "resample"] {
        let table = format!("[compensation]\nmode = \"{mode}\"\ncalibration = \"calibration.toml\"\n[stars]");
        fixture.write("scene.toml", &SCENE.replace("[stars]", &table));
        assert_done(&fixture.render("out", &[]));
        let shown = pair(&truth(&fixture)["stars"][0]["displayed_px"]);
        // The calibration's D: r = r_u (1 + 12 |r_u|^2).
        let undistorted = [(shown[0] - 80.0) / FOCAL_PX, (shown[1] - 50.0) / FOCAL_PX];
        let stretch = 1.0 + 12.0 * (undistorted[0].powi(2) + undistorted[1].powi(2));
        let tan = 2.5f64.to_radians().tan();
        let turn = 30f64.to_radians();
        let off_px =
            (undistorted[0] * stretch - tan * turn.cos()).hypot(undistorted[1] * stretch - tan * turn.sin());
        assert!(off_px * FOCAL_PX < 0.03, "{mode}: {off_px}");
        fs::remove_dir_all(fixture.path("out")).unwrap();
    }
}

/// [`fixture`] with the rock before the camera.
fn with_rock(stars: &[String]) -> Fixture {
    let fixture = fixture(stars);
    fixture.write(
        "scene.toml",
        &format!("{}[stars]\ncatalogue = \"stars.csv\"\nplanets = false\n", common::SCENE),
    );
    let columns = "rock_x_m,rock_y_m,rock_z_m,rock_from_inertial_w,rock_from_inertial_x,rock_from_inertial_y,rock_from_inertial_z";
    fixture.write(
        "poses.csv",
        &format!("{HEADER},{columns}\n{EPOCH_S},{AU_M},0,0,1,0,0,0,0,0,0,{AU_M},0,{DISTANCE_M},1,0,0,0\n"),
    );
    fixture
}

#[test]
fn a_body_hides_stars_and_the_others_take_its_radiance_scale() {
    let limb_deg = (RADIUS_M / DISTANCE_M).asin().to_degrees();
    let fixture = with_rock(&[
        star("behind", 10.0, 0.5 * limb_deg, -3.0),
        star("just-behind", 130.0, 0.985 * limb_deg, -3.0),
        star("just-beside", 130.0, 1.005 * limb_deg, -3.0),
        star("beside", 250.0, 1.2 * limb_deg, -3.0),
    ]);
    assert_done(&fixture.render("out", &[]));
    let truth = truth(&fixture);
    let scale = truth["radiance_scale"].as_f64().unwrap();
    assert!(scale < 0.5);
    let stars = truth["stars"].as_array().unwrap();
    let mut seen: Vec<&str> = stars.iter().map(|s| s["id"].as_str().unwrap()).collect();
    seen.sort_unstable();
    assert_eq!(seen, ["beside", "just-beside"]);
    for star in stars {
        let wanted = -3.0 - 2.5 * scale.log10();
        assert!((star["wanted_magnitude"].as_f64().unwrap() - wanted).abs() < 1e-9);
        assert!((star["displayed_magnitude"].as_f64().unwrap() - wanted).abs() < 0.1);
    }
}

#[test]
fn deep_space_poses_show_their_planet_and_are_the_same_again() {
    let fixture = fixture(&[]);
    let scene = SCENE.replace("\"poses.csv\"", "{ kind = \"deep-space\", frames = 3, planets = [\"mars\"] }");
    fixture.write(
        "scene.toml",
        &scene.replace("catalogue = \"stars.csv\"\nplanets = false\n", "").replace("9.0", "12.0"),
    );
    assert_done(&fixture.render("out", &[]));
    assert_done(&fixture.render("again", &["--frames", "1..2"]));
    for frame in 0..3 {
        let path = fixture.path(&format!("out/truth/{frame:06}.json"));
        let truth: Value = serde_json::from_slice(&fs::read(path).unwrap()).unwrap();
        let stars = truth["stars"].as_array().unwrap();
        let mars = stars.iter().find(|star| star["id"] == "mars").unwrap();
        assert!(mars["distance_m"].as_f64().unwrap() > 1e9 && mars["magnitude_extrapolated"].is_boolean());
    }
    let image = |dir: &str| fs::read(fixture.path(&format!("{dir}/frames/000001.png"))).unwrap();
    assert_eq!(image("out"), image("again"));
}

#[test]
fn what_does_not_fit_is_refused() {
    let refused = |spoil: &dyn Fn(&Fixture), words: &[&str]| {
        let fixture = fixture(&[star("a", 30.0, 2.5, 1.0)]);
        spoil(&fixture);
        assert_refused(&fixture.render("out", &[]), words);
        assert!(!fixture.path("out").exists());
    };
    refused(
        &|f| f.write("stars.csv", &format!("{CATALOGUE}a,10,20,0,0,0,3.0,\nb,10,bright,0,0,0,3.0,\n")),
        &["stars.csv", "line 3", "dec_deg", "bright"],
    );
    refused(
        &|f| f.write("stars.csv", &format!("{CATALOGUE}a,10,95,0,0,0,3.0,\n")),
        &["stars.csv", "line 2", "dec_deg", "95"],
    );
    refused(&|f| f.edit("scene.toml", "9.0", "nan"), &["scene.toml", "stars.faintest_magnitude", "8.25"]);
    refused(
        &|f| f.edit("scene.toml", "faintest_magnitude", "faintest"),
        &["scene.toml", "faintest_magnitude"],
    );
    refused(
        &|f| f.edit("poses.csv", &format!("{EPOCH_S}"), "4e9"),
        &["poses.csv", "line 2", "frame 0", "2126", "1900 to 2100"],
    );
    let kind = |f: &Fixture, table: &str| f.edit("scene.toml", "\"poses.csv\"", table);
    refused(
        &|f| kind(f, "{ kind = \"deep-space\", frames = 3, step_s = 2.0 }"),
        &["scene.toml", "trajectory.step_s", "no such key"],
    );
    refused(
        &|f| kind(f, "{ kind = \"deep-space\", frames = 3, planets = [\"vulcan\"] }"),
        &["scene.toml", "trajectory.planets", "`vulcan`", "mercury"],
    );
    refused(
        &|f| kind(f, "{ kind = \"deep-space\", frames = 3, from = \"2300-01-01\", until = \"2301-01-01\" }"),
        &["scene.toml", "trajectory", "1900 to 2100"],
    );
    // A body of a scene with stars has a place.
    let fixture = with_rock(&[star("a", 30.0, 2.5, 1.0)]);
    fixture.write("poses.csv", &format!("{HEADER}\n{EPOCH_S},{AU_M},0,0,1,0,0,0,0,0,0\n"));
    assert_refused(
        &fixture.render("out", &[]),
        &["poses.csv", "where the body `rock` is", "rock_x_m", "barycentre"],
    );
}

#[test]
fn an_unresolved_body_is_shown_as_a_point() {
    // 0.3 px of radius at four sub-pixel places: the sphere's disc at full phase is 2/3 of the normal
    // albedo bright (Lambert), its photocentre its centre.
    let distance_m = FOCAL_PX * RADIUS_M / 0.3;
    let scale = 0.005;
    let fixture = Fixture::new();
    fixture.edit("scene.toml", "\"auto\"", &scale.to_string());
    let mut poses = format!("{HEADER}\n");
    let offsets = [(0.0, 0.0), (0.3, 0.1), (-0.27, 0.44), (7.61, -3.2)];
    for (frame, (x, y)) in offsets.iter().enumerate() {
        let per_px = distance_m / FOCAL_PX;
        poses += &format!("{frame},{},{},{},1,0,0,0,0,0,{}\n", -x * per_px, -y * per_px, -distance_m, -AU_M);
    }
    fixture.write("poses.csv", &poses);
    assert_done(&fixture.render("out", &[]));
    let expected = 0.12 * 2.0 / 3.0 * 1.856 * (RADIUS_M / distance_m).powi(2) * scale / 3.67e-11;
    for (frame, (x, y)) in offsets.iter().enumerate() {
        let path = fixture.path(&format!("out/truth/{frame:06}.json"));
        let truth: Value = serde_json::from_slice(&fs::read(path).unwrap()).unwrap();
        let rock = &truth["bodies"]["rock"];
        let (shown, center) = (pair(&rock["displayed_px"]), pair(&rock["center_px"]));
        assert!((center[0] - 80.0 - x).abs() < 1e-9 && (center[1] - 50.0 - y).abs() < 1e-9);
        assert!((shown[0] - center[0]).hypot(shown[1] - center[1]) < 0.02, "{shown:?} {center:?}");
        let magnitude = rock["displayed_magnitude"].as_f64().unwrap();
        // The mesh of 16 cells lacks some per cent of the sphere's disc.
        assert!((magnitude + 2.5 * expected.log10()).abs() < 0.03, "{magnitude} {}", -2.5 * expected.log10());
        let lit = counts(&fixture.path(&format!("out/frames/{frame:06}.png")));
        assert!(lit.iter().filter(|&&count| count > 0).count() <= 4);
    }
}

/// Magnitude -9 of a screen whose full pixel has -1.44: some 1000 pixels, a disc of 36.
#[test]
fn an_unresolved_body_that_is_too_bright_is_warned_of_as_a_spot() {
    let distance_m = FOCAL_PX * RADIUS_M / 0.3;
    for (scale, is_spot) in [(0.005, false), (10.0, true)] {
        let fixture = Fixture::new();
        fixture.edit("scene.toml", "\"auto\"", &format!("{scale:?}"));
        fixture.write("poses.csv", &format!("{HEADER}\n0,0,0,{},1,0,0,0,0,0,{}\n", -distance_m, -AU_M));
        let made = fixture.render("out", &[]);
        assert_done(&made);
        assert_eq!(
            common::stderr(&made).contains("unresolved body as a spot"),
            is_spot,
            "{}",
            common::stderr(&made)
        );
    }
}

#[test]
fn keys_of_deep_space_are_blamed_by_their_names() {
    for (key, words) in [
        ("distance_au = [5.0, 1.0]", ["trajectory.distance_au", "in order"]),
        ("greatest_latitude_deg = 95.0", ["trajectory.greatest_latitude_deg", "0 to 90 deg"]),
        ("least_sun_angle_deg = 180.0", ["trajectory.least_sun_angle_deg", "0 to 170 deg"]),
        ("from = \"1800-01-01\"", ["trajectory.from", "1900 to 2100"]),
        ("from = \"2040-01-01\"", ["trajectory.until", "after that of `from`"]),
    ] {
        let fixture = fixture(&[]);
        fixture.edit(
            "scene.toml",
            "\"poses.csv\"",
            &format!("{{ kind = \"deep-space\", frames = 3, {key} }}"),
        );
        fixture.edit("scene.toml", "catalogue = \"stars.csv\"\n", "");
        assert_refused(&fixture.render("out", &[]), &words);
    }
}

#[test]
fn a_source_of_any_brightness_is_shown_in_time() {
    let fixture = fixture(&[star("a", 30.0, 2.5, -30.0)]);
    let made = fixture.render("out", &[]);
    assert_done(&made);
    assert!(common::stderr(&made).contains("as a spot"), "{}", common::stderr(&made));
    let shown = truth(&fixture)["stars"][0]["displayed_magnitude"].as_f64().unwrap();
    // At most 160 x 100 full pixels of magnitude -1.44, at least a quarter of 10 000.
    assert!((-12.0..-9.9).contains(&shown), "{shown}");
}
