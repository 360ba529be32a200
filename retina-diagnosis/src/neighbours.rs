//! Noise of pixels, from neighbours: what a model misses is smooth there, noise is not.

use std::collections::HashMap;

use retina_calibration::NoiseGroups;

use crate::data::Dataset;
use crate::noise::RobustFit;
use crate::scatter::Noise;

/// Second difference along both axes; linear slopes and whatever depends on one axis alone leave it 0 (J. Immerkaer,
/// Computer Vision and Image Understanding 64, 1996).
const MASK: [[f64; 3]; 3] = [[1.0, -2.0, 1.0], [-2.0, 4.0, -2.0], [1.0, -2.0, 1.0]];
/// Root of the sum of its squares.
const MASK_NORM: f64 = 6.0;
/// Median of a normal error in sigmas.
const MEDIAN_OF_NORMAL: f64 = 0.674_49;
/// Pixels in a group: neighbours' differences overlap, and count for a quarter.
const ROWS: usize = 300;
/// Fewest pixels with all neighbours.
const FEWEST: usize = 60;

/// The noise of pixels under a fit.
pub(crate) fn noise(data: &Dataset, fit: &RobustFit) -> Noise {
    let (white, source) = match floor(data, fit) {
        Some(floor) => (floor, "differences of neighbouring pixels' errors"),
        None => (fit.weights.floor(), "errors of the fit: too few pixels have all their neighbours"),
    };
    Noise {
        white,
        group: 0.0,
        structured: 0.0,
        source: vec![source.to_owned()],
        shared_within: false,
        wander: 0.0,
    }
}

/// Root of the mean variance of the pixels' noise, weighted by that variance's inverse, from the errors' differences in
/// groups of like brightness. It hardly depends on the model. `None` of other tables, and where too few pixels have
/// all their neighbours.
fn floor(data: &Dataset, fit: &RobustFit) -> Option<f64> {
    let pixels = data.pixels()?;
    let cell = |place: &[f64; 3]| {
        let of = |px: f64| (px / pixels.pitch_px).floor() as i64;
        (place[0] as usize, of(place[1]), of(place[2]))
    };
    let rows: HashMap<(usize, i64, i64), usize> =
        pixels.place.iter().enumerate().map(|(row, place)| (cell(place), row)).collect();
    let difference = |row: usize| -> Option<f64> {
        let (frame, x, y) = cell(&pixels.place[row]);
        let mut sum = 0.0;
        for (j, weights) in MASK.iter().enumerate() {
            for (i, weight) in weights.iter().enumerate() {
                sum += weight * fit.residual[*rows.get(&(frame, x + i as i64 - 1, y + j as i64 - 1))?];
            }
        }
        Some(sum.abs() / MASK_NORM)
    };
    let (mut key, mut length) = (Vec::new(), Vec::new());
    for row in 0..data.len() {
        if let Some(found) = difference(row) {
            key.push(data.noise_key[row]);
            length.push(found);
        }
    }
    if key.len() < FEWEST {
        return None;
    }
    let groups = NoiseGroups {
        rows: ROWS,
        fitted: 0.0,
        median_of_normal: MEDIAN_OF_NORMAL,
        least: data.least_noise(),
    };
    let sigma = groups.clipped_at(&data.noise_key, &key, &length);
    let weight = |row: usize| sigma[row].powi(-2);
    let kept = |row: &usize| !fit.weights.outlier[*row];
    let mean = |squares: &dyn Fn(usize) -> f64, rows: &[usize]| {
        rows.iter().map(|&row| weight(row) * squares(row)).sum::<f64>()
            / rows.iter().map(|&row| weight(row)).sum::<f64>()
    };
    let all: Vec<usize> = (0..data.len()).collect();
    let good: Vec<usize> = all.iter().copied().filter(kept).collect();
    let found = mean(&|row| sigma[row].powi(2), &all);
    // Where noise alternates from pixel to pixel, or edges are many, differences say too much: noise is no more than the
    // errors themselves.
    Some(found.min(mean(&|row| fit.residual[row].powi(2), &good)).sqrt())
}
