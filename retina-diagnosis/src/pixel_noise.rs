//! Noise of pixels, apart from any model.
//!
//! A prediction takes out what it can, second differences what is smooth. What is left in a small window is noise, and
//! structure where there is any. Structure only adds, so the tenth of windows with the least hold noise nearly alone: its
//! variance follows the light as v = a + b s (read noise and photons), fitted to that tenth. It is an upper limit where
//! an image has fine structure everywhere, and too small where neighbours share noise (JPEG, interpolated colour).

use std::collections::HashMap;

use crate::noise::RobustFit;
use crate::scatter::Noise;

/// Second difference along both axes; linear slopes and whatever depends on one axis alone leave it 0 (J. Immerkaer,
/// Computer Vision and Image Understanding 64, 1996).
const MASK: [[f64; 3]; 3] = [[1.0, -2.0, 1.0], [-2.0, 4.0, -2.0], [1.0, -2.0, 1.0]];
/// Root of the sum of its squares.
const MASK_NORM: f64 = 6.0;
/// Side of a window in masks.
const SIDE: i64 = 5;
/// The part of the windows that lies below the fit.
const SHARE: f64 = 0.1;
/// Of white noise of variance 1: this quantile of a window's mean square (2e7 windows drawn, +- 0.0004).
const QUANTILE: f64 = 0.472;
/// Fewest windows that tell the noise.
const FEWEST: usize = 60;
/// Most windows that are fitted.
const MOST: usize = 8000;
const ROUNDS: usize = 40;

/// Noise of each pixel by itself.
#[derive(Debug, Clone)]
pub struct White {
    /// Standard deviations, DN.
    pub sigma_dn: Vec<f64>,
    /// Where the figures come from.
    pub source: String,
}

/// The noise of pixels beside a fit: the harmonic mean of their variances, and never more than the fit leaves.
pub(crate) fn noise(white: Option<&White>, fit: &RobustFit) -> Noise {
    let left = fit.weights.rms(1, &fit.residual);
    let (white, source) = match white {
        Some(White { sigma_dn, source }) => {
            let inverse = sigma_dn.iter().map(|sigma| sigma.powi(-2)).sum::<f64>() / sigma_dn.len() as f64;
            (inverse.powf(-0.5).min(left), source.clone())
        }
        None => (left, "errors of the fit: too few pixels have all their neighbours".to_owned()),
    };
    Noise {
        white,
        group: 0.0,
        structured: 0.0,
        source: vec![source],
        shared_within: false,
        wander: 0.0,
        edge: None,
    }
}

/// A window of masks.
struct Window {
    /// Mean of what was measured, DN.
    level: f64,
    /// Mean square of the masks, DN^2.
    square: f64,
}

/// Pixels that tell their noise.
#[derive(Debug, Clone, Copy)]
pub struct Neighbours<'a> {
    /// Measured, DN.
    pub measured: &'a [f64],
    /// Predicted as well as can be, DN: structure that is left may be taken for noise.
    pub predicted: &'a [f64],
    /// For each pixel: frame (from 0), x and y in the camera's image, px.
    pub place: &'a [[f64; 3]],
    /// Distance of neighbours, px.
    pub pitch_px: f64,
    /// Standard deviation of what the prediction leaves, of pixels of like brightness, DN: noise is no more.
    pub left: Option<&'a [f64]>,
    /// Pixels nearer than this share noise, px: what they share is then not taken off.
    pub shared_within_px: f64,
    /// Smallest standard deviation that a pixel can have, DN: that of its rounding.
    pub least_noise: f64,
}

/// The noise of pixels; `None` where too few have all their neighbours.
pub fn white_noise(pixels: Neighbours<'_>) -> Option<White> {
    let windows = windows(pixels);
    if windows.len() < FEWEST {
        return None;
    }
    let least = pixels.least_noise.powi(2).max(f64::MIN_POSITIVE);
    let [a, b] = lower_tenth(&windows, least);
    let own = pixels.left.filter(|_| pixels.shared_within_px < pixels.pitch_px);
    let unshared = (1.0 - own.map_or(0.0, |left| shared_part(pixels, left))).sqrt();
    let sigma = |(row, level): (usize, f64)| {
        let sigma = ((a + b * level) / QUANTILE).max(least).sqrt();
        pixels.left.map_or(sigma, |left| sigma.min(unshared * left[row]))
    };
    let source = format!("second differences of {} windows, the smoothest tenth", windows.len());
    Some(White { sigma_dn: levels(pixels).into_iter().enumerate().map(sigma).collect(), source })
}

/// Frame, column and row of a pixel.
pub(crate) type Cell = (usize, i64, i64);

/// The cell of each pixel, and the pixel of each cell.
pub(crate) fn cells(place: &[[f64; 3]], pitch_px: f64) -> (Vec<Cell>, HashMap<Cell, usize>) {
    let of = |px: f64| (px / pitch_px).floor() as i64;
    let cells: Vec<Cell> = place.iter().map(|p| (p[0] as usize, of(p[1]), of(p[2]))).collect();
    let rows = cells.iter().enumerate().map(|(row, cell)| (*cell, row)).collect();
    (cells, rows)
}

fn windows(pixels: Neighbours<'_>) -> Vec<Window> {
    let (cells, rows) = cells(pixels.place, pixels.pitch_px);
    let error: Vec<f64> = pixels.measured.iter().zip(pixels.predicted).map(|(m, p)| m - p).collect();
    let mask = |row: usize| -> Option<f64> {
        let (frame, x, y) = cells[row];
        let mut sum = 0.0;
        for (j, weights) in MASK.iter().enumerate() {
            for (i, weight) in weights.iter().enumerate() {
                sum += weight * error[*rows.get(&(frame, x + i as i64 - 1, y + j as i64 - 1))?];
            }
        }
        Some((sum / MASK_NORM).powi(2))
    };
    let masks: Vec<Option<f64>> = (0..cells.len()).map(mask).collect();
    let half = SIDE / 2;
    let window = |row: usize| -> Option<Window> {
        let (frame, x, y) = cells[row];
        let (mut square, mut level) = (0.0, 0.0);
        for j in -half..=half {
            for i in -half..=half {
                let other = *rows.get(&(frame, x + i, y + j))?;
                square += masks[other]?;
                level += pixels.measured[other];
            }
        }
        let count = (SIDE * SIDE) as f64;
        Some(Window { level: level / count, square: square / count })
    };
    let all: Vec<Window> = (0..cells.len()).filter_map(window).collect();
    let stride = all.len().div_ceil(MOST).max(1);
    all.into_iter().step_by(stride).collect()
}

/// Standard errors by which neighbours' products have to differ from 0 to count.
const CLEARLY: f64 = 3.0;

/// The part of the errors' squares that pixels beside each other share: it is not the noise of one pixel.
fn shared_part(pixels: Neighbours<'_>, left: &[f64]) -> f64 {
    let (cells, rows) = cells(pixels.place, pixels.pitch_px);
    let error: Vec<f64> =
        (0..cells.len()).map(|row| (pixels.measured[row] - pixels.predicted[row]) / left[row]).collect();
    let (mut total, mut squares, mut pairs) = (0.0, 0.0, 0.0);
    for (row, (frame, x, y)) in cells.iter().enumerate() {
        for other in [(*frame, x + 1, *y), (*frame, *x, y + 1)] {
            if let Some(&other) = rows.get(&other) {
                let product = error[row] * error[other];
                total += product;
                squares += product * product;
                pairs += 1.0;
            }
        }
    }
    let mean_square = error.iter().map(|e| e * e).sum::<f64>() / error.len() as f64;
    if total > CLEARLY * f64::sqrt(squares) { (total / (pairs * mean_square)).min(0.99) } else { 0.0 }
}

/// Means of what was measured over the neighbours, DN.
fn levels(pixels: Neighbours<'_>) -> Vec<f64> {
    let (cells, rows) = cells(pixels.place, pixels.pitch_px);
    let mean = |(frame, x, y): &Cell| {
        let around = (0..9).filter_map(|k| rows.get(&(*frame, x + k % 3 - 1, y + k / 3 - 1)));
        let (sum, count) = around.fold((0.0, 0.0), |(s, n), &row| (s + pixels.measured[row], n + 1.0));
        sum / count
    };
    cells.iter().map(mean).collect()
}

/// a and b of the variances a + b s that a tenth of the windows lie below, at every level s: quantile regression (R.
/// Koenker and G. Bassett, Econometrica 46, 1978) of relative differences by weights made anew in each round.
fn lower_tenth(windows: &[Window], least: f64) -> [f64; 2] {
    let mut squares: Vec<f64> = windows.iter().map(|w| w.square).collect();
    let at = ((squares.len() - 1) as f64 * SHARE) as usize;
    let first = (*squares.select_nth_unstable_by(at, f64::total_cmp).1).max(least);
    let middle = windows.iter().map(|w| w.level).sum::<f64>() / windows.len() as f64;
    // Variance at the mean level, and its slope.
    let (mut at_middle, mut slope) = (first, 0.0);
    for _ in 0..ROUNDS {
        let (mut s0, mut s1, mut s2, mut t0, mut t1) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for w in windows {
            let level = w.level - middle;
            let there = (at_middle + slope * level).max(least).max(0.05 * at_middle);
            let off = w.square / there - 1.0;
            let share = if off > 0.0 { SHARE } else { 1.0 - SHARE };
            let weight = share / off.abs().max(1e-3) / (there * there);
            s0 += weight;
            s1 += weight * level;
            s2 += weight * level * level;
            t0 += weight * w.square;
            t1 += weight * w.square * level;
        }
        let determinant = s0 * s2 - s1 * s1;
        // Without any spread of levels there is no slope.
        if determinant > 1e-9 * s0 * s2 {
            at_middle = (t0 * s2 - t1 * s1) / determinant;
            slope = (s0 * t1 - s1 * t0) / determinant;
        } else {
            (at_middle, slope) = (t0 / s0, 0.0);
        }
        at_middle = at_middle.max(least);
    }
    [at_middle - slope * middle, slope]
}
