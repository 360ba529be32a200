//! A whole group whose level is off: no flip of signs shows it, since its own sign is all that would change. Its level is
//! held against the other groups' (F. E. Grubbs, Annals of Mathematical Statistics 21, 1950): under normal levels the
//! deviate has Student's distribution, and the most deviating of G groups is corrected for their number.

use crate::data::{Dataset, Group};
use crate::noise::RobustFit;

/// Fewest groups: of two that differ none is the one that is off.
const FEWEST: usize = 3;
/// With few groups the others' scatter is hardly known. A meter that is set up anew for each series repeats within some
/// 5 %: that counts as much as this many groups (a scaled inverse chi-squared prior; A. Gelman et al., Bayesian Data
/// Analysis, 3rd ed., sec. 2.6).
const PRIOR_SCATTER: f64 = 0.05;
const PRIOR_GROUPS: f64 = 4.0;
/// With more groups than this their own scatter is known.
const MANY: usize = 8;

/// A group that is off.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Outlying {
    /// Its number.
    pub(crate) group: usize,
    /// p-value, corrected for the number of groups.
    pub(crate) p_value: f64,
    /// By how much its level is off, in the residuals' unit.
    pub(crate) offset: f64,
}

/// The group whose median error deviates most from the others'. `fit` is of one component a row; dim rows, whose noise is
/// larger, count less.
pub(crate) fn outlying(data: &Dataset, fit: &RobustFit) -> Option<Outlying> {
    let level = |group: &Group| {
        let rows = group.rows.clone();
        let weighted = fit.residual[rows.clone()].iter().zip(&fit.weights.sigma[rows]);
        weighted_median(weighted.map(|(error, sigma)| (*error, 1.0 / sigma)).collect())
    };
    let levels: Vec<f64> = data.groups.iter().map(level).collect();
    let count = levels.len();
    if count < FEWEST {
        return None;
    }
    let others = (count - 1) as f64;
    (0..count)
        .map(|group| {
            let rest = || levels.iter().enumerate().filter(|(g, _)| *g != group).map(|(_, level)| *level);
            let mean = rest().sum::<f64>() / others;
            let prior = if count < MANY { PRIOR_GROUPS } else { 0.0 };
            let squares = rest().map(|level| (level - mean).powi(2)).sum::<f64>();
            let free = others - 1.0 + prior;
            let variance = (squares + prior * PRIOR_SCATTER.powi(2)) / free;
            let offset = levels[group] - mean;
            let t = offset.abs() / (variance * (1.0 + 1.0 / others)).sqrt().max(f64::MIN_POSITIVE);
            let p_value = (count as f64 * two_sided(t, free as usize)).min(1.0);
            (t, Outlying { group, p_value, offset })
        })
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, outlying)| outlying)
}

pub(crate) fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let middle = sorted.len() / 2;
    if sorted.len() % 2 == 1 { sorted[middle] } else { 0.5 * (sorted[middle - 1] + sorted[middle]) }
}

/// The value with half of the weights at and below it.
fn weighted_median(mut values: Vec<(f64, f64)>) -> f64 {
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = 0.5 * values.iter().map(|(_, weight)| weight).sum::<f64>();
    let mut below = 0.0;
    let reaches_half = |(_, weight): &&(f64, f64)| {
        below += weight;
        below >= half
    };
    values.iter().find(reaches_half).map_or(0.0, |(value, _)| *value)
}

/// Probability that Student's t with `free` degrees of freedom is further from 0 than `t`.
pub(crate) fn two_sided(t: f64, free: usize) -> f64 {
    ratio_beyond(t * t, 1, free)
}

/// Probability that a ratio of mean squares with `rank` and `free` degrees of freedom (Fisher's F) is larger than `f`:
/// the incomplete beta function (Abramowitz and Stegun, 26.6.2), by integrating sin^(free - 1) cos^(rank - 1) over the
/// angle from 0 to atan(sqrt(free / (rank f))).
pub(crate) fn ratio_beyond(f: f64, rank: usize, free: usize) -> f64 {
    let (up, down) = (free as i32 - 1, rank as i32 - 1);
    let integral = |to: f64| -> f64 {
        const STEPS: usize = 400;
        let step = to / STEPS as f64;
        (0..=STEPS)
            .map(|k| {
                let factor = [2.0, 4.0][k % 2] - f64::from(u8::from(k == 0 || k == STEPS));
                let (sin, cos) = (step * k as f64).sin_cos();
                factor * sin.powi(up) * cos.powi(down)
            })
            .sum::<f64>()
            * step
            / 3.0
    };
    let angle = (free as f64 / rank as f64).sqrt().atan2(f.max(0.0).sqrt());
    (integral(angle) / integral(0.5 * std::f64::consts::PI)).min(1.0)
}

#[cfg(test)]
mod tests {
    /// Two-sided 5 % and 0.1 % points of Student's t (R. A. Fisher, F. Yates, Statistical Tables, table III).
    #[test]
    fn students_distribution() {
        for (t, free, p) in
            [(2.571, 5, 0.05), (2.086, 20, 0.05), (6.869, 5, 0.001), (3.850, 20, 0.001), (12.706, 1, 0.05)]
        {
            let found = super::two_sided(t, free);
            assert!((found / p - 1.0).abs() < 5e-3, "{t} {free} {found}");
        }
    }

    /// Upper 5 % and 1 % points of F (R. A. Fisher, F. Yates, Statistical Tables, table V).
    #[test]
    fn fishers_distribution() {
        for (f, rank, free, p) in
            [(4.10, 2, 10, 0.05), (3.49, 3, 12, 0.0500), (5.85, 2, 20, 0.01), (4.43, 4, 20, 0.01)]
        {
            let found = super::ratio_beyond(f, rank, free);
            assert!((found / p - 1.0).abs() < 1e-2, "{f} {rank} {free} {found}");
        }
    }
}
