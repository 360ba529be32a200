//! Whether the readings themselves rise with the count.

use crate::fit::Fit;
use crate::readings::Reading;

/// A higher count that is darker.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Fall {
    /// The lower and the higher count.
    pub(crate) counts: (usize, usize),
    /// A pixel's irradiance at each, W m^-2.
    pub(crate) light: (f64, f64),
    /// How far the second is below the first, in sigmas of the difference.
    pub(crate) sigmas: f64,
}

/// A fall by fewer sigmas is noise: by chance one in three million pairs.
const FALL_SIGMAS: f64 = 5.0;

/// Mean light of a count.
struct Level {
    count: usize,
    light: f64,
    variance: f64,
    /// Mean of 1 / N^2: how much of the zero's error is in it.
    zero: f64,
}

/// The worst fall among the counts' mean readings. A single reading that is far from the response counts as
/// an outlier where its repeats or, without repeats, its neighbouring counts are not far on the same side.
pub(crate) fn falls(readings: &[Reading], fit: &Fit, sigma: &[f64]) -> Option<Fall> {
    let mut order: Vec<usize> = (0..readings.len()).filter(|&i| readings[i].is_lit()).collect();
    order.sort_by_key(|&i| readings[i].count);
    let groups: Vec<&[usize]> = order.chunk_by(|&a, &b| readings[a].count == readings[b].count).collect();
    let side = |i: usize| (readings[i].irradiance_w_m2 - fit.predicted(&readings[i])).signum();
    // A group's side, where more than half of it is far from the response.
    let far = |group: &[usize]| {
        let sum: f64 = group.iter().filter(|&&i| !fit.used[i]).map(|&i| side(i)).sum();
        if 2.0 * sum.abs() > group.len() as f64 { sum.signum() } else { 0.0 }
    };
    let sides: Vec<f64> = groups.iter().map(|group| far(group)).collect();
    let mut levels = Vec::new();
    for (g, group) in groups.iter().enumerate() {
        let neighbour = |at: Option<usize>| at.and_then(|at| sides.get(at)) == Some(&sides[g]);
        let together = group.len() > 1 || neighbour(g.checked_sub(1)) || neighbour(Some(g + 1));
        let systematic = sides[g] != 0.0 && together;
        let kept = group.iter().copied().filter(|&i| fit.used[i] || systematic);
        let (mut weights, mut light, mut zero) = (0.0, 0.0, 0.0);
        for i in kept {
            let pixels = fit.area(&readings[i]);
            let weight = (pixels / sigma[i]).powi(2);
            weights += weight;
            light += weight * (readings[i].irradiance_w_m2 - fit.zero) / pixels;
            zero += weight / pixels;
        }
        if weights > 0.0 {
            let count = readings[group[0]].count;
            levels.push(Level {
                count,
                light: light / weights,
                variance: 1.0 / weights,
                zero: zero / weights,
            });
        }
    }
    let zero_variance = fit.zero_index().map_or(0.0, |i| fit.covariance[i][i]);
    let mut worst: Option<Fall> = None;
    for (i, low) in levels.iter().enumerate() {
        for high in &levels[i + 1..] {
            let variance = low.variance + high.variance + (low.zero - high.zero).powi(2) * zero_variance;
            let sigmas = (low.light - high.light) / variance.sqrt();
            if sigmas > worst.as_ref().map_or(FALL_SIGMAS, |fall| fall.sigmas) {
                let (counts, light) = ((low.count, high.count), (low.light, high.light));
                worst = Some(Fall { counts, light, sigmas });
            }
        }
    }
    worst
}
