//! What is smooth in a limb's residuals: a body's outline leaves none, but for its relief.
//!
//! A circle that is fitted to half of an ellipse, or to a smeared disc, takes most of the difference into its radius and
//! its centre. What it leaves is a wave along the arc: small beside the error of the centre, and large beside the noise.

use glam::DVec2;
use retina_geometry::LimbEllipse;

use super::LimbWave;
use super::fit::{Fit, Measured, NORMAL_MEDIAN};
use super::judge::correlation_factor;

/// Radius, centre, and the second and third harmonics of the position angle.
const TERMS: usize = 7;
/// Of these, what a fit of the body has free.
const FITTED: usize = 3;

/// Fits the harmonics to the residuals of the points in use.
pub(super) fn wave(points: &[Measured], fit: &Fit, outline: &LimbEllipse) -> LimbWave {
    let axes = DVec2::from_array(outline.semi_axes_px);
    let used: Vec<usize> = (0..points.len()).filter(|&k| fit.used[k]).collect();
    let rows: Vec<[f64; TERMS]> = used
        .iter()
        .map(|&k| {
            let point = &points[k];
            let local = DVec2::from_angle(-outline.angle_rad).rotate(point.pixel - outline.center_px) / axes;
            let (s2, c2) = (2.0 * local.to_angle()).sin_cos();
            let (s3, c3) = (3.0 * local.to_angle()).sin_cos();
            [1.0, point.normal.x, point.normal.y, c2, s2, c3, s3]
        })
        .collect();
    let residuals: Vec<f64> = used.iter().map(|&k| fit.residuals_px[k]).collect();
    let without = left(&rows, &residuals, FITTED);
    let with = left(&rows, &residuals, TERMS);
    let sum = |values: &[f64]| values.iter().map(|value| value * value).sum::<f64>();
    let taken_px2 = (sum(&without) - sum(&with)).max(0.0);
    let mut sizes: Vec<f64> = with.iter().map(|value| value.abs()).collect();
    let middle = sizes.len() / 2;
    let noise_px = *sizes.select_nth_unstable_by(middle, f64::total_cmp).1 / NORMAL_MEDIAN;
    let scaled: Vec<(usize, f64)> =
        used.iter().zip(&with).map(|(&k, value)| (points[k].index, *value)).collect();
    let gain = taken_px2 / (noise_px * noise_px * correlation_factor(&scaled)).max(1e-12);
    LimbWave { rms_px: (taken_px2 / used.len() as f64).sqrt(), gain }
}

/// What the first `terms` columns leave of the values: Gram and Schmidt, twice for the digits.
fn left(rows: &[[f64; TERMS]], values: &[f64], terms: usize) -> Vec<f64> {
    let mut basis: Vec<Vec<f64>> = Vec::new();
    let mut rest = values.to_vec();
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    for term in 0..terms {
        let mut column: Vec<f64> = rows.iter().map(|row| row[term]).collect();
        let before = dot(&column, &column).sqrt();
        for _ in 0..2 {
            for other in &basis {
                let part = dot(&column, other);
                column.iter_mut().zip(other).for_each(|(value, other)| *value -= part * other);
            }
        }
        let length = dot(&column, &column).sqrt();
        // Over a short arc the harmonics are all but sums of the others.
        if length < 1e-6 * before.max(1e-300) {
            continue;
        }
        column.iter_mut().for_each(|value| *value /= length);
        let part = dot(&rest, &column);
        rest.iter_mut().zip(&column).for_each(|(value, column)| *value -= part * column);
        basis.push(column);
    }
    rest
}
