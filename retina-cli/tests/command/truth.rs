//! Ground truth, radiance and screen counts of a frame against closed forms.

use std::fs;
use std::path::Path;

use crate::common::{self, AU_M, DISTANCE_M, FOCAL_PX, Fixture, HEADER, RADIUS_M, assert_done, counts};
use exr::prelude::*;
use serde_json::Value;

fn truth(fixture: &Fixture, index: usize) -> Value {
    serde_json::from_slice(&fs::read(fixture.path(&format!("out/truth/{index:06}.json"))).unwrap()).unwrap()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

fn near(found: &[f64], expected: &[f64], tolerance: f64) {
    assert_eq!(found.len(), expected.len());
    assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() <= tolerance), "{found:?} {expected:?}");
}

#[test]
fn truth_of_a_sphere_on_the_boresight() {
    let fixture = Fixture::new();
    assert_done(&fixture.render("out", &["--frames", "2..3"]));
    let truth = truth(&fixture, 2);
    assert_eq!(truth["schema"], "retina.truth/1");
    assert_eq!(truth["time_s"], 120.0);
    assert!(truth["stars"].as_array().unwrap().is_empty());
    let rock = &truth["bodies"]["rock"];
    near(&numbers(&rock["position_camera_m"]), &[0.0, 0.0, DISTANCE_M], 1e-9);
    near(&numbers(&rock["sun_direction_body"]), &[0.5, 0.0, -0.75f64.sqrt()], 1e-12);
    near(&[rock["phase_deg"].as_f64().unwrap()], &[30.0], 1e-10);
    // A mesh of 16 cells a face is inside its sphere: volume-equivalent radius a little smaller.
    let radius_m = rock["reference_radius_m"].as_f64().unwrap();
    assert!((990.0..1000.0).contains(&radius_m), "{radius_m}");
    let limb_px = FOCAL_PX * (radius_m / DISTANCE_M).asin().tan();
    near(&numbers(&rock["limb_ellipse_px"]["center_px"]), &[80.0, 50.0], 1e-9);
    near(&numbers(&rock["limb_ellipse_px"]["semi_axes_px"]), &[limb_px, limb_px], 1e-9);
}

#[test]
fn truth_of_a_turned_ellipsoid_beside_the_boresight() {
    let fixture = Fixture::new();
    fixture.edit("scene.toml", "shading", "reference_semi_axes_m = [1000.0, 1000.0, 500.0]\nshading");
    fixture.edit("scene.toml", "\"auto\"", "0.05");
    // Body turned by 90 deg about x: its z axis, the short one, lies along -y or +y of the image.
    let half = 0.5f64.sqrt();
    let body = "rock_x_m,rock_y_m,rock_z_m,rock_from_inertial_w,rock_from_inertial_x,rock_from_inertial_y,rock_from_inertial_z";
    fixture.write(
        "poses.csv",
        &format!("{HEADER},{body}\n7,1,2,3,{half},0,0,{half},{AU_M},0,0,501,2,22503,{half},{half},0,0\n"),
    );
    assert_done(&fixture.render("out", &[]));
    let truth = truth(&fixture, 0);
    let rock = &truth["bodies"]["rock"];
    // Camera turned by 90 deg about z: v_camera = q v q*, so +x of the inertial frame is +y of the camera's.
    near(&numbers(&rock["position_camera_m"]), &[0.0, 500.0, 22_500.0], 1e-9);
    // camera_from_body = q_z(90) q_x(-90), from the product rule of quaternions, by hand.
    let q = numbers(&rock["camera_from_body"]);
    let sign = q[0].signum();
    near(&q.iter().map(|v| v * sign).collect::<Vec<_>>(), &[0.5, -0.5, -0.5, 0.5], 1e-12);
    // Inertial -> body turns +y into +z and +z into -y; the Sun is along +x but for the body's place.
    near(&numbers(&rock["sun_direction_body"]), &[1.0, 0.0, 0.0], 1e-6);
    near(&[rock["reference_radius_m"].as_f64().unwrap()], &[(1e6 * 500f64).cbrt()], 1e-9);
    // The body's z is +y inertial or -y, so -+x of the image: minor axis along x, 20 px, major 40 px.
    let limb = &rock["limb_ellipse_px"];
    near(&numbers(&limb["semi_axes_px"]), &[40.0, 20.0], 0.1);
    near(&numbers(&limb["center_px"]), &[80.0, 50.0 + 20.0], 0.1);
    near(&[limb["angle_deg"].as_f64().unwrap().abs()], &[90.0], 1e-6);
}

type ExrFile = Vec<(String, Vec<f32>)>;

fn read_exr(path: &Path) -> (ExrFile, String) {
    let layer = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .from_file(path)
        .unwrap()
        .layer_data;
    let metadata = layer.attributes.other[&Text::from("retina")].to_text().unwrap().to_string();
    let list = layer.channel_data.list.iter();
    (list.map(|c| (c.name.to_string(), c.sample_data.values_as_f32().collect())).collect(), metadata)
}

#[test]
fn exr_and_counts_follow_lamberts_law() {
    let fixture = Fixture::new();
    let layers = "[output]\nradiance_exr = true\nlayers = [\"depth\", \"mask\", \"normal\", \"incidence\", \"emission\", \"phase\", \"shadow\"]\n";
    fixture.write("scene.toml", &format!("{}{layers}", common::SCENE));
    fixture.edit("scene.toml", "\"auto\"", "0.001");
    fs::write(fixture.path("rock.glb"), common::sphere(64)).unwrap();
    assert_done(&fixture.render("out", &["--frames", "2..3"]));
    let (channels, metadata) = read_exr(&fixture.path("out/frames/000002.exr"));
    assert!(metadata.contains("retina.radiance/1"), "{metadata}");
    let names: Vec<_> = channels.iter().map(|(name, _)| name.as_str()).collect();
    let wanted = [
        "IF",
        "Y",
        "depth",
        "emission_deg",
        "incidence_deg",
        "mask",
        "normal.x",
        "normal.y",
        "normal.z",
        "phase_deg",
        "shadow",
    ];
    assert_eq!(names, wanted);
    let at = |name: &str, x: usize, y: usize| {
        f64::from(channels.iter().find(|(n, _)| n == name).unwrap().1[y * 160 + x])
    };
    let png = counts(&fixture.path("out/frames/000002.png"));
    let sun = [0.5, 0.0, -0.75f64.sqrt()];
    for (x, y) in [(80, 50), (95, 40), (70, 60), (100, 50)] {
        // Where the line of sight of the pixel's centre meets the sphere.
        let sight = [(x as f64 + 0.5 - 80.0) / FOCAL_PX, (y as f64 + 0.5 - 50.0) / FOCAL_PX, 1.0];
        let aa: f64 = sight.iter().map(|s| s * s).sum();
        let depth_m =
            (DISTANCE_M - (DISTANCE_M.powi(2) - aa * (DISTANCE_M.powi(2) - RADIUS_M.powi(2))).sqrt()) / aa;
        let normal = [0, 1, 2].map(|k| (sight[k] * depth_m - [0.0, 0.0, DISTANCE_M][k]) / RADIUS_M);
        let mu0: f64 = (0..3).map(|k| normal[k] * sun[k]).sum();
        let factor = 0.12 * mu0;
        // The mesh is up to R (1 - cos(0.5 deg)) = 0.2 m inside the sphere; its interpolated normals
        // and the mean over a pixel are good to 0.3 % here.
        assert!((at("depth", x, y) - depth_m).abs() < 1.0, "{} {depth_m}", at("depth", x, y));
        assert!((at("IF", x, y) / factor - 1.0).abs() < 3e-3, "{x} {y}: {} {factor}", at("IF", x, y));
        let radiance = factor * 1.856 / std::f64::consts::PI;
        assert!((at("Y", x, y) / radiance - 1.0).abs() < 3e-3);
        assert!((at("incidence_deg", x, y) - mu0.acos().to_degrees()).abs() < 0.2);
        for (k, name) in ["normal.x", "normal.y", "normal.z"].iter().enumerate() {
            assert!((at(name, x, y) - normal[k]).abs() < 2e-3);
        }
        assert!(
            (at("phase_deg", x, y) - 30.0).abs() < 2.6
                && at("mask", x, y) == 1.0
                && at("shadow", x, y) == 0.0
        );
        // (B / 255)^2.2 of magnitude -1.44, one pixel of 1 / f^2 sr.
        let irradiance = radiance * 0.001 / (FOCAL_PX * FOCAL_PX);
        let count = 255.0 * (irradiance / (3.67e-11 * 10f64.powf(1.44 / 2.5))).powf(1.0 / 2.2);
        assert!((f64::from(png[y * 160 + x]) - count).abs() < 1.0, "{} {count}", png[y * 160 + x]);
    }
    assert_eq!(at("depth", 2, 2), f64::INFINITY);
    assert_eq!((at("Y", 2, 2), at("mask", 2, 2), png[2 * 160 + 2]), (0.0, 0.0, 0));
}
