//! Spots that are long towards the field's middle at its edge scatter by more along than across.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

mod common;

use common::{Facility, SIMILARITY, normal, wide};
use glam::DVec2;
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use retina_calibration::geometry::{CalibrateOptions, ModelForm, calibrate};

/// What is stated of movements of the field's edge, outwards and around, is what they scatter by. A covariance that takes
/// both axes alike would state too little outwards (squares 1.76 of what it says) and too much around (0.28).
#[test]
fn the_covariance_knows_along_from_across() {
    let setup = wide();
    let facility = Facility { jitter_arcsec: 0.5, ..SIMILARITY };
    let options =
        CalibrateOptions { form: Some(ModelForm::plain(5)), plain: true, ..CalibrateOptions::default() };
    let mut ratio = DVec2::ZERO;
    const CAMPAIGNS: u64 = 120;
    for seed in 0..CAMPAIGNS {
        let mut table = facility.table(&setup, 30, 60, 3000 + seed);
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let camera = setup.camera_pinhole();
        for row in &mut table.rows {
            let sight = camera.line_of_sight(row.camera_px);
            // 0.24 px along the radius at the corners, beside 0.03 to 0.15 px of either axis.
            let along = 0.24 * sight.length_squared() / 0.03 * normal(&mut random);
            row.camera_px += sight.normalize() * along;
        }
        let result = calibrate(&table, &setup, &options).unwrap();
        let (inverse, side) = (&result.inverse, result.inverse.columns());
        // Mean movement of a ring of the field, outwards and around, as a weight of each coefficient.
        let mut along = [vec![0.0; 2 * side], vec![0.0; 2 * side]];
        let mut off = DVec2::ZERO;
        let mut values = vec![0.0; side];
        const PLACES: usize = 48;
        for k in 0..PLACES {
            let out = DVec2::from_angle(std::f64::consts::TAU * k as f64 / PLACES as f64);
            let at = 0.13 * out * DVec2::new(1.0, 0.75);
            let out = at.normalize();
            inverse.fill(at, inverse.reference_log10_irradiance, &mut values);
            let error = inverse.undistort(at, inverse.reference_log10_irradiance) - at;
            for (axis, direction) in [out, out.perp()].into_iter().enumerate() {
                off[axis] += error.dot(direction);
                for (t, value) in values.iter().enumerate() {
                    along[axis][t] += value * direction.x;
                    along[axis][side + t] += value * direction.y;
                }
            }
        }
        for axis in 0..2 {
            let weight = &along[axis];
            let stated: f64 = (0..4 * side * side)
                .map(|k| weight[k / (2 * side)] * result.covariance[k] * weight[k % (2 * side)])
                .sum();
            ratio[axis] += off[axis] * off[axis] / stated / CAMPAIGNS as f64;
        }
    }
    println!("scatter of the edge over what is stated, squared: {ratio}");
    // Squares of 120 normal deviates: 1 with a standard deviation of 0.13.
    assert!((ratio - DVec2::ONE).abs().max_element() < 0.4, "{ratio}");
}
