//! Columns made white: V^(-1/2) of the noise's covariance V, and back.

use std::ops::Range;

use rayon::prelude::*;

use crate::data::Dataset;
use crate::noise::Weights;
use crate::units::in_time;

/// V^(-1/2) under some weights: roots of the weights, each group's common part weighed down by
/// 1 - (1 + variance * sum of weights)^(-1/2), and levels of groups that follow each other made independent.
pub(crate) struct Whitening<'d> {
    data: &'d Dataset,
    weight: &'d [f64],
    root: Vec<f64>,
    groups: Vec<WhitenedGroup>,
    /// Groups in the order of time; empty where they do not follow each other.
    in_time: Vec<usize>,
}

struct WhitenedGroup {
    rows: Range<usize>,
    /// Of the weights.
    sum: f64,
    kappa: f64,
}

impl Whitening<'_> {
    /// A column, followed by the 0 that it is to each part of the calibration's error.
    pub(crate) fn of(&self, column: &[f64]) -> Vec<f64> {
        let mut out = Vec::with_capacity(column.len() + self.data.field_len());
        out.extend_from_slice(column);
        self.apply(&mut out);
        out.resize(column.len() + self.data.field_len(), 0.0);
        out
    }

    fn apply(&self, column: &mut [f64]) {
        match self.data.kind.components() {
            1 => self.apply_to::<1>(column),
            _ => self.apply_to::<2>(column),
        }
    }

    /// A group's rows become root (x - m): m is kappa times their weighted mean where groups are independent. A group's
    /// level is the part of its rows along the roots of their weights, (1 - kappa) sum(weight x) / root(sum); where
    /// groups follow each other it becomes (level - rho level before) / root(1 - rho^2), by another m.
    fn apply_to<const N: usize>(&self, column: &mut [f64]) {
        let rho = self.data.wander;
        let sums = |group: &WhitenedGroup| {
            let (rows, _) = column[group.rows.start * N..group.rows.end * N].as_chunks::<N>();
            let mut sums = [0.0; N];
            for (weight, row) in self.weight[group.rows.clone()].iter().zip(rows) {
                for axis in 0..N {
                    sums[axis] += weight * row[axis];
                }
            }
            sums
        };
        let sums: Vec<[f64; N]> = self.groups.iter().map(sums).collect();
        let mut taken: Vec<[f64; N]> = self
            .groups
            .iter()
            .zip(&sums)
            .map(|(group, sums)| {
                sums.map(|sum| if group.sum > 0.0 { sum * group.kappa / group.sum } else { 0.0 })
            })
            .collect();
        let mut before: Option<[f64; N]> = None;
        for &g in &self.in_time {
            let group = &self.groups[g];
            if group.sum <= 0.0 {
                continue;
            }
            let level = sums[g].map(|sum| sum * (1.0 - group.kappa) / group.sum.sqrt());
            if let Some(before) = before {
                for axis in 0..N {
                    let new = (level[axis] - rho * before[axis]) / (1.0 - rho * rho).sqrt();
                    taken[g][axis] -= (new - level[axis]) / group.sum.sqrt();
                }
            }
            before = Some(level);
        }
        for (group, taken) in self.groups.iter().zip(&taken) {
            let (rows, _) = column[group.rows.start * N..group.rows.end * N].as_chunks_mut::<N>();
            for (root, row) in self.root[group.rows.clone()].iter().zip(rows) {
                for axis in 0..N {
                    row[axis] = root * (row[axis] - taken[axis]);
                }
            }
        }
    }
}

impl Weights {
    /// What makes V^(-1/2) of columns.
    pub(crate) fn whitening<'d>(&'d self, data: &'d Dataset) -> Whitening<'d> {
        let groups = data.groups.iter().map(|group| {
            let sum: f64 = self.weight[group.rows.clone()].iter().sum();
            let kappa = if sum > 0.0 { self.kappa(sum) } else { 0.0 };
            WhitenedGroup { rows: group.rows.clone(), sum, kappa }
        });
        Whitening {
            data,
            weight: &self.weight,
            root: self.weight.iter().map(|weight| weight.sqrt()).collect(),
            groups: groups.collect(),
            in_time: if data.wander == 0.0 { Vec::new() } else { in_time(data) },
        }
    }

    /// V^(-1/2) of a column, followed by the 0 that it is to each part of the calibration's error.
    pub(crate) fn whitened(&self, data: &Dataset, column: &[f64]) -> Vec<f64> {
        self.whitening(data).of(column)
    }

    /// The same before groups follow each other, in place.
    pub(crate) fn whiten_rows_of(&self, data: &Dataset, column: &mut [f64]) {
        let mut whitening = self.whitening(data);
        whitening.in_time.clear();
        whitening.apply(column);
    }

    /// Whitened columns of the calibration's error, each with a row that holds it to its own size: least squares over
    /// both is the mixed model's (C. R. Henderson, Biometrics 31, 1975).
    pub(crate) fn whitened_field(&self, data: &Dataset) -> Vec<Vec<f64>> {
        let columns = data.field().map_or_else(Vec::new, |f| f.columns(self.field_size).collect());
        let whitening = self.whitening(data);
        columns
            .par_iter()
            .enumerate()
            .map(|(k, (column, size))| {
                let mut out = whitening.of(column);
                out[..column.len()].iter_mut().for_each(|value| *value *= size);
                out[column.len() + k] = 1.0;
                out
            })
            .collect()
    }

    /// From whitened errors back to errors times the root of the weights alone.
    pub(crate) fn unwhiten(&self, data: &Dataset, column: &mut [f64]) {
        let n = data.kind.components();
        let rho = data.wander;
        let order = if rho == 0.0 { Vec::new() } else { in_time(data) };
        let mut before: Option<[f64; 2]> = None;
        for g in order {
            let rows = data.groups[g].rows.clone();
            let sum: f64 = self.weight[rows.clone()].iter().sum();
            if sum <= 0.0 {
                continue;
            }
            let mut level = [0.0; 2];
            for axis in 0..n {
                let along: f64 =
                    rows.clone().map(|row| self.weight[row].sqrt() * column[row * n + axis]).sum();
                let white = along / sum.sqrt();
                level[axis] =
                    before.map_or(white, |before| (1.0 - rho * rho).sqrt() * white + rho * before[axis]);
                for row in rows.clone() {
                    column[row * n + axis] += (level[axis] - white) / sum.sqrt() * self.weight[row].sqrt();
                }
            }
            before = Some(level);
        }
        for group in &data.groups {
            let sum: f64 = self.weight[group.rows.clone()].iter().sum();
            if sum <= 0.0 {
                continue;
            }
            let kappa = self.kappa(sum);
            for axis in 0..n {
                let along: f64 = group
                    .rows
                    .clone()
                    .map(|row| self.weight[row].sqrt() * column[row * n + axis])
                    .sum::<f64>()
                    / sum;
                for row in group.rows.clone() {
                    column[row * n + axis] += kappa / (1.0 - kappa) * along * self.weight[row].sqrt();
                }
            }
        }
    }
}
