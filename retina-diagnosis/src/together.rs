//! Outliers that lie together in the field and point the same way.
//!
//! A robust fit leaves out what a model cannot follow: a strong structure in a small part of the field is then seen by no
//! test of what is left. Accidents (a neighbour's light, a cosmic ray) have no common direction; a dent has.

use std::collections::HashMap;

use glam::DVec2;

use crate::data::Dataset;
use crate::noise::Weights;

/// Fewest pairs of neighbouring outliers.
const FEWEST_PAIRS: usize = 4;
/// Mean cosine between neighbours from which on their directions agree.
const AGREE: f64 = 0.4;
/// Largest probability that independent directions agree as well, and that with the probability of as many neighbours
/// among outliers that lie anywhere.
const CHANCE_OF_DIRECTION: f64 = 0.02;
const CHANCE: f64 = 3e-5;

/// Such outliers.
#[derive(Debug, Clone)]
pub(crate) struct Together {
    /// Those that have a neighbour which is one, too.
    pub(crate) rows: Vec<usize>,
    /// Their middle, camera px.
    middle_px: [f64; 2],
}

/// Largest probability that the mean of `count` cosines between independent directions is this or more: Chernoff's bound,
/// the least over t of (I_0(t) exp(-t mean))^count.
fn chance_of_direction(mean: f64, count: f64) -> f64 {
    // I_0(t): the mean of exp(t cos) over the circle, by the trapezoidal rule.
    let bessel = |t: f64| -> f64 {
        const PARTS: usize = 64;
        let value = |k: usize| (t * (std::f64::consts::TAU * k as f64 / PARTS as f64).cos()).exp();
        (0..PARTS).map(value).sum::<f64>() / PARTS as f64
    };
    let steps = (0..=120).map(|k| 0.25 * f64::from(k));
    steps.map(|t| (count * (bessel(t).ln() - t * mean)).exp()).fold(1.0, f64::min)
}

/// Probability of `count` or more where `mean` are expected, by Poisson's distribution.
fn beyond_poisson(count: usize, mean: f64) -> f64 {
    let mut term = (-mean).exp();
    let mut below = 0.0;
    for k in 0..count {
        below += term;
        term *= mean / (k as f64 + 1.0);
    }
    // What is left of 1 has lost its digits where it is small: its first terms then.
    let rest: f64 = std::iter::successors(Some((count, term)), |(k, term)| {
        Some((k + 1, term * mean / (*k as f64 + 1.0)))
    })
    .take(60)
    .map(|(_, term)| term)
    .sum();
    if below > 0.5 { rest } else { 1.0 - below }
}

impl Together {
    /// Of outliers (not those of exposures that are left out as a whole) and the nearest row of another exposure.
    pub(crate) fn of(data: &Dataset, residual: &[f64], weights: &Weights) -> Option<Self> {
        if data.components() != 2 || data.pixels().is_some() {
            return None;
        }
        let (x, y) = (data.values("x"), data.values("y"));
        let lost = |rows: std::ops::Range<usize>| weights.outlier[rows].iter().all(|out| *out);
        let kept: Vec<(usize, usize)> = data
            .groups
            .iter()
            .enumerate()
            .filter(|(_, group)| !lost(group.rows.clone()))
            .flat_map(|(g, group)| group.rows.clone().map(move |row| (row, g)))
            .collect();
        // Cells of about two rows.
        let width = (8.0 / kept.len().max(1) as f64).sqrt();
        let cell = |row: usize| [x[row], y[row]].map(|v| (v / width).floor() as i64);
        let mut grid: HashMap<[i64; 2], Vec<(usize, usize)>> = HashMap::new();
        for &(row, group) in &kept {
            grid.entry(cell(row)).or_default().push((row, group));
        }
        let nearest = |row: usize, group: usize| {
            let [i, j] = cell(row);
            let around = (i - 1..=i + 1).flat_map(|i| (j - 1..=j + 1).map(move |j| [i, j]));
            // What is wrong with one exposure at one place may be an accident; a single exposure has no other.
            let counts =
                |other: &&(usize, usize)| other.0 != row && (other.1 != group || data.groups.len() == 1);
            let others = around.filter_map(|cell| grid.get(&cell)).flatten().filter(counts);
            let distance = |other: usize| (x[row] - x[other]).hypot(y[row] - y[other]);
            others.map(|&(other, _)| other).min_by(|&a, &b| distance(a).total_cmp(&distance(b)))
        };
        let mut pairs: Vec<(usize, usize)> = kept
            .iter()
            .filter(|(row, _)| weights.outlier[*row])
            .filter_map(|&(row, group)| {
                let other = nearest(row, group).filter(|other| weights.outlier[*other])?;
                Some((row.min(other), row.max(other)))
            })
            .collect();
        pairs.sort_unstable();
        pairs.dedup();
        if pairs.len() < FEWEST_PAIRS {
            return None;
        }
        let error = |row: usize| DVec2::new(residual[2 * row], residual[2 * row + 1]).normalize_or_zero();
        let sum: f64 = pairs.iter().map(|&(i, j)| error(i).dot(error(j))).sum();
        let count = pairs.len() as f64;
        let by_direction = chance_of_direction(sum / count, count);
        let outliers = kept.iter().filter(|(row, _)| weights.outlier[*row]).count() as f64;
        let by_place = beyond_poisson(pairs.len(), outliers * outliers / kept.len() as f64);
        if sum < AGREE * count || by_direction > CHANCE_OF_DIRECTION || by_direction * by_place > CHANCE {
            return None;
        }
        let mut rows: Vec<usize> = pairs.iter().flat_map(|&(i, j)| [i, j]).collect();
        rows.sort_unstable();
        rows.dedup();
        let middle = |axis: usize| {
            let mut places: Vec<f64> = rows.iter().map(|&row| data.frame[row].measured[axis]).collect();
            places.sort_by(f64::total_cmp);
            places[places.len() / 2]
        };
        Some(Self { middle_px: [middle(0), middle(1)], rows })
    }

    /// What to tell.
    pub(crate) fn note(&self) -> String {
        format!(
            "{} outliers lie together, about ({:.0}, {:.0}) px of the camera in the median, and point the same way: they are what the model lacks there, and no accidents",
            self.rows.len(),
            self.middle_px[0],
            self.middle_px[1]
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Poisson: 1 - e^-1 (1 + 1 + 1/2) of three or more where one is expected. Directions: of one pair the probability of a
    /// cosine above 0.9 is acos(0.9) / pi, below Chernoff's bound.
    #[test]
    fn chances_are_those_of_their_distributions() {
        assert!((beyond_poisson(3, 1.0) - (1.0 - 2.5 * (-1f64).exp())).abs() < 1e-12);
        assert!((beyond_poisson(4, 0.1) - 3.847e-6).abs() < 1e-9);
        let exact = 0.9f64.acos() / std::f64::consts::PI;
        assert!(chance_of_direction(0.9, 1.0) > exact && chance_of_direction(0.9, 8.0) < exact.powi(4));
        assert_eq!(chance_of_direction(-0.2, 5.0), 1.0);
    }
}
