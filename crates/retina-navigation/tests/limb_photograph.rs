//! A real photograph of the Moon by the facility's camera model, where its folder is at hand.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

mod common;

use std::path::Path;

use common::camera;
use retina_image::{CameraImage, ReadOptions};
use retina_navigation::limb::{LimbBody, LimbCamera, LimbOptions, solve_limb};

#[test]
fn a_saturated_limb_is_refused_and_not_measured_wrongly() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/real/moon_25mm");
    if !folder.is_dir() {
        println!("skipped: the photograph is not at {}", folder.display());
        return;
    }
    let image = CameraImage::read(&folder.join("photo.png"), ReadOptions::default()).unwrap();
    let camera = LimbCamera::pinhole(camera(25.0e3 / 3.45, [2048, 1536]));
    // A third of the pixels inside its limb is at full scale: a fit through the rest comes out 3.5 of its own standard
    // deviations off the ephemeris' radius.
    let body = LimbBody::sphere(1_737_400.0);
    let refusal = solve_limb(&image, &camera, &body, &LimbOptions::default()).unwrap_err();
    assert_eq!(refusal.reason(), "saturated", "{refusal}");
}
