//! Outliers that lie together in the field and point the same way.
//!
//! A robust fit leaves out what a model cannot follow: a strong structure in a small part of the field is then seen by no
//! test of what is left. Accidents (a neighbour's light, a cosmic ray) have no common direction; a dent has.

use std::collections::HashMap;

use glam::DVec2;

use crate::data::Dataset;
use crate::noise::Weights;

/// Fewest pairs of neighbouring outliers.
const FEWEST_PAIRS: usize = 5;
/// Mean cosine between neighbours from which on their directions agree, and its standard errors for chance (four are one
/// in thirty thousand).
const AGREE: f64 = 0.4;
const SURE: f64 = 4.0;

/// Such outliers.
#[derive(Debug, Clone)]
pub(crate) struct Together {
    /// Those that have a neighbour which is one, too.
    pub(crate) rows: Vec<usize>,
    /// Their middle, camera px.
    middle_px: [f64; 2],
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
            let others = around.filter_map(|cell| grid.get(&cell)).flatten().filter(|other| other.1 != group);
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
        // The cosine between independent directions has variance 1/2.
        let count = pairs.len() as f64;
        if sum < AGREE * count || sum < SURE * (0.5 * count).sqrt() {
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
