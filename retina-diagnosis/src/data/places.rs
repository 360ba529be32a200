//! Where spots stand on the sensor, free of their own noise: for phases of the pixel grid.

use glam::DVec2;
use rayon::prelude::*;
use retina_formats::Channel;

use crate::linear::solve_positive;

/// Degree of the polynomial in the place, beside the prediction.
const DEGREE: usize = 5;
/// Terms in the light (of degree 3, odd: coma) and in each of two colours.
const IN_LIGHT: usize = 5;
const IN_COLOUR: usize = 3;
const TERMS: usize = (DEGREE + 1) * (DEGREE + 2) / 2 + IN_LIGHT + 2 * IN_COLOUR;
/// Coefficients come from so many rows at most, evenly taken.
const MOST_ROWS: usize = 20_000;
/// With fewer rows for each term their own noise would be followed.
const ROWS_PER_TERM: usize = 5;
const ROUNDS: usize = 4;
/// Exposures of fewer points keep the common shift of all.
const FEWEST_FOR_SHIFT: usize = 8;

/// What is known of a point before it was measured.
pub(super) struct Known {
    /// The model's place, camera px.
    pub(super) predicted_px: DVec2,
    /// In halves of the sensor's width.
    pub(super) x: f64,
    /// In halves of the sensor's width.
    pub(super) y: f64,
    /// log10 of the irradiance over full light.
    pub(super) l: f64,
    /// r, g, b, w.
    pub(super) channel: Channel,
    /// How the camera stood.
    pub(super) mounting: usize,
    /// Exposure.
    pub(super) group: usize,
}

/// Camera pixels of the spots' true places, as nearly as rows together tell: what the model predicts, and beside it,
/// robustly fitted in each mounting, a polynomial of the place, of light and colour, and each exposure's shift.
///
/// An effect of the pixel grid is a function of where the spot is, not of where noise put its centroid: with noise of
/// 0.05 px in the phase itself, points that a narrow window has pushed away from a pixel's border are mixed with those
/// that noise has carried there, and a sawtooth looks like half a sine (errors in variables). With too few rows the
/// measured places come back.
pub(super) fn true_places_px(known: &[Known], measured_px: &[DVec2]) -> Vec<DVec2> {
    let mut out = measured_px.to_vec();
    let mountings = known.iter().map(|k| k.mounting + 1).max().unwrap_or(0);
    for mounting in 0..mountings {
        let rows: Vec<usize> = (0..known.len()).filter(|&i| known[i].mounting == mounting).collect();
        if rows.len() < ROWS_PER_TERM * TERMS {
            continue;
        }
        for axis in 0..2 {
            let off = |i: usize| measured_px[i][axis] - known[i].predicted_px[axis];
            let Some(smooth) = smoothed(known, &rows, off) else { continue };
            for (&i, value) in rows.iter().zip(smooth) {
                out[i][axis] = known[i].predicted_px[axis] + value;
            }
        }
    }
    out
}

fn terms(known: &Known) -> [f64; TERMS] {
    let (x, y, l) = (known.x, known.y, known.l);
    let r2 = x * x + y * y;
    let mut out = [0.0; TERMS];
    let mut at = 0;
    let mut put = |value: f64| {
        out[at] = value;
        at += 1;
    };
    for i in 0..=DEGREE {
        for j in 0..=DEGREE - i {
            put(x.powi(i as i32) * y.powi(j as i32));
        }
    }
    [l, l * x, l * y, l * x * r2, l * y * r2].into_iter().for_each(&mut put);
    for colour in [Channel::R, Channel::B] {
        let on = f64::from(u8::from(known.channel == colour));
        [on, on * x, on * y].into_iter().for_each(&mut put);
    }
    out
}

/// `off` at the rows by the fit; `None` where it cannot be made.
fn smoothed(known: &[Known], rows: &[usize], off: impl Fn(usize) -> f64 + Sync) -> Option<Vec<f64>> {
    let groups = known.iter().map(|k| k.group + 1).max().unwrap_or(0);
    let mut shift = vec![0.0; groups];
    let mut found: Vec<f64> = Vec::new();
    let mut scale = f64::INFINITY;
    let chosen: Vec<usize> = rows.iter().copied().step_by(rows.len().div_ceil(MOST_ROWS)).collect();
    for _ in 0..ROUNDS {
        let residual = |i: usize, found: &[f64]| {
            let fitted: f64 = terms(&known[i]).iter().zip(found).map(|(t, c)| t * c).sum();
            off(i) - fitted
        };
        let (mut normal, mut right) = (vec![0.0; TERMS * TERMS], vec![0.0; TERMS]);
        for &i in &chosen {
            let z =
                if found.is_empty() { 0.0 } else { (residual(i, &found) - shift[known[i].group]) / scale };
            let weight = 1.0 / (1.0 + z * z);
            let row = terms(&known[i]);
            for a in 0..TERMS {
                right[a] += weight * row[a] * (off(i) - shift[known[i].group]);
                for b in 0..TERMS {
                    normal[a * TERMS + b] += weight * row[a] * row[b];
                }
            }
        }
        // A term that the rows do not have (one colour, one brightness) stays 0.
        let size = normal[0];
        (0..TERMS).for_each(|a| normal[a * TERMS + a] += 1e-9 * size);
        found = solve_positive(&normal, &right)?;
        let left: Vec<f64> = rows.par_iter().map(|&i| residual(i, &found)).collect();
        let mut spread: Vec<f64> =
            rows.iter().zip(&left).map(|(&i, r)| (r - shift[known[i].group]).abs()).collect();
        let middle = spread.len() / 2;
        // Two standard deviations.
        scale = 2.0 * 1.4826 * spread.select_nth_unstable_by(middle, f64::total_cmp).1.max(1e-6);
        shift = shifts(known, rows, &left, &shift, scale);
    }
    let value = |&i: &usize| {
        terms(&known[i]).iter().zip(&found).map(|(t, c)| t * c).sum::<f64>() + shift[known[i].group]
    };
    Some(rows.par_iter().map(value).collect())
}

/// Each exposure's shift: its mean residual, drawn towards 0 as far as its own uncertainty exceeds what exposures differ
/// by (a random effect's best linear prediction; the variance between them by moments).
fn shifts(known: &[Known], rows: &[usize], left: &[f64], before: &[f64], scale: f64) -> Vec<f64> {
    let weight = |i: usize, r: f64| 1.0 / (1.0 + ((r - before[known[i].group]) / scale).powi(2));
    let mut sums = vec![(0.0, 0.0, 0usize); before.len()];
    for (&i, &r) in rows.iter().zip(left) {
        let (weight, sum) = (weight(i, r), &mut sums[known[i].group]);
        *sum = (sum.0 + weight * r, sum.1 + weight, sum.2 + 1);
    }
    let mean = |group: usize| sums[group].0 / sums[group].1;
    let mut own = vec![0.0; before.len()];
    for (&i, &r) in rows.iter().zip(left) {
        let group = known[i].group;
        own[group] += (weight(i, r) * (r - mean(group)) / sums[group].1).powi(2);
    }
    let told: Vec<usize> = (0..before.len()).filter(|&g| sums[g].2 >= FEWEST_FOR_SHIFT).collect();
    let count = told.len().max(1) as f64;
    let middle = told.iter().map(|&g| mean(g)).sum::<f64>() / count;
    let between = told.iter().map(|&g| (mean(g) - middle).powi(2) - own[g]).sum::<f64>() / count;
    let mut out = vec![0.0; before.len()];
    for group in told {
        let between = between.max(0.0);
        out[group] = mean(group) * between / (between + own[group]).max(f64::MIN_POSITIVE);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Places by hand: a distortion, a shift of each exposure, uniform noise of 0.05 px, a wrong match in twenty.
    #[test]
    fn noise_and_wrong_matches_are_taken_off_places() {
        let noise = |i: usize, k: f64| 0.17 * (((i as f64 + 0.5) * k).fract() - 0.5);
        let mut known = Vec::new();
        let (mut truth, mut measured) = (Vec::new(), Vec::new());
        for i in 0..2000 {
            let (x, y) = (
                2.0 * (i as f64 * 0.754_877_666_2).fract() - 1.0,
                1.5 * (i as f64 * 0.569_840_291).fract() - 0.75,
            );
            let group = i / 50;
            let predicted_px = DVec2::new(1024.0 * (1.0 + x), 768.0 + 1024.0 * y);
            let r2 = x * x + y * y;
            let shift = 0.1 * (group as f64).sin();
            let at = predicted_px + DVec2::new(x, y) * r2 * (3.0 - r2) + DVec2::splat(shift);
            let wrong = if i % 20 == 3 { 4.0 } else { 0.0 };
            measured.push(at + DVec2::new(noise(i, 0.618_034) + wrong, noise(i, 0.414_214)));
            truth.push(at);
            known.push(Known { predicted_px, x, y, l: 0.0, channel: Channel::G, mounting: 0, group });
        }
        let rms = |places: &[DVec2]| {
            let rows = (0..2000).filter(|i| i % 20 != 3);
            (rows.map(|i| places[i].distance_squared(truth[i])).sum::<f64>() / 3800.0).sqrt()
        };
        let found = true_places_px(&known, &measured);
        assert!((rms(&measured) - 0.049).abs() < 0.002 && rms(&found) < 0.012, "{}", rms(&found));
        // Of a few rows nothing is fitted.
        assert_eq!(true_places_px(&known[..100], &measured[..100]), measured[..100]);
    }
}
