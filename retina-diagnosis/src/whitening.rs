//! Columns made white: V^(-1/2) of the noise's covariance V, and back.

use std::ops::Range;

use glam::{DMat2, DVec2};
use rayon::prelude::*;

use crate::data::Dataset;
use crate::level::Level;
use crate::noise::Weights;
use crate::units::in_time;

/// V^(-1/2) under some weights: roots of the weights times what makes a row's error isotropic, each group's common part
/// weighed down ([`Level`]), and levels of groups that follow each other made independent.
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
    level: Level,
}

impl Whitening<'_> {
    /// A column, followed by the 0 that it is to each part of the calibration's error.
    pub(crate) fn of(&self, column: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; column.len() + self.data.field_len()];
        self.fill(column, &mut out);
        out
    }

    /// The same into memory that is given, of zeros.
    pub(crate) fn fill(&self, column: &[f64], out: &mut [f64]) {
        let own = &mut out[..column.len()];
        own.copy_from_slice(column);
        self.apply(own);
    }

    fn apply(&self, column: &mut [f64]) {
        match self.data.kind.components() {
            1 => self.apply_to::<1>(column),
            _ => self.apply_to::<2>(column),
        }
    }

    /// A group's rows x become root T (x - m): m is M times their sum weighted by w T^2 where groups are independent. Where
    /// groups follow each other, their level becomes (level - rho level before) / root(1 - rho^2), by another m.
    fn apply_to<const N: usize>(&self, column: &mut [f64]) {
        let rho = self.data.wander;
        let turned = self.data.isotropic_from_error.as_deref();
        let apply = |times: &DMat2, v: &[f64; N]| -> [f64; N] {
            let v = *times * both(v);
            std::array::from_fn(|axis| v[axis])
        };
        let sums = |group: &WhitenedGroup| {
            let (rows, _) = column[group.rows.start * N..group.rows.end * N].as_chunks::<N>();
            let mut sums = [0.0; N];
            for (row, value) in group.rows.clone().zip(rows) {
                let value = turned.map_or(*value, |of| apply(&of[row], &apply(&of[row], value)));
                for axis in 0..N {
                    sums[axis] += self.weight[row] * value[axis];
                }
            }
            both(&sums)
        };
        let sums: Vec<DVec2> = self.groups.iter().map(sums).collect();
        let mut taken: Vec<DVec2> =
            self.groups.iter().zip(&sums).map(|(group, sums)| group.level.taken * *sums).collect();
        let mut before: Option<DVec2> = None;
        for &g in &self.in_time {
            let group = &self.groups[g];
            if !group.level.counts() {
                continue;
            }
            let level = group.level.of_sums * sums[g];
            if let Some(before) = before {
                let new = (level - rho * before) / (1.0 - rho * rho).sqrt();
                taken[g] -= group.level.root * (new - level);
            }
            before = Some(level);
        }
        for (group, taken) in self.groups.iter().zip(&taken) {
            let (rows, _) = column[group.rows.start * N..group.rows.end * N].as_chunks_mut::<N>();
            for (row, value) in group.rows.clone().zip(rows) {
                let left: [f64; N] = std::array::from_fn(|axis| value[axis] - taken[axis]);
                let left = turned.map_or(left, |of| apply(&of[row], &left));
                *value = left.map(|left| self.root[row] * left);
            }
        }
    }
}

/// One component or two as two.
fn both<const N: usize>(values: &[f64; N]) -> DVec2 {
    DVec2::new(values[0], if N == 2 { values[N - 1] } else { 0.0 })
}

impl Weights {
    /// What makes V^(-1/2) of columns.
    pub(crate) fn whitening<'d>(&'d self, data: &'d Dataset) -> Whitening<'d> {
        let groups = data.groups.iter().map(|group| {
            let rows = group.rows.clone();
            WhitenedGroup { level: self.level(data, rows.clone()), rows }
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

    /// From whitened errors back to errors in the data's unit; 0 of rows that do not count.
    pub(crate) fn unwhiten(&self, data: &Dataset, column: &mut [f64]) {
        let n = data.components();
        let rho = data.wander;
        let levels: Vec<Level> =
            data.groups.iter().map(|group| self.level(data, group.rows.clone())).collect();
        let mut before: Option<DVec2> = None;
        for g in if rho == 0.0 { Vec::new() } else { in_time(data) } {
            if !levels[g].counts() {
                continue;
            }
            let white = levels[g].of(data, self, column);
            let level = before.map_or(white, |before| (1.0 - rho * rho).sqrt() * white + rho * before);
            levels[g].add(data, self, column, level - white);
            before = Some(level);
        }
        levels.iter().for_each(|level| level.give_back(data, self, column));
        for (row, values) in column[..data.len() * n].chunks_exact_mut(n).enumerate() {
            let root = self.weight[row].sqrt();
            let error = DVec2::new(values[0], if n == 2 { values[1] } else { 0.0 });
            let error = if root > 0.0 { data.isotropic(row).inverse() * error / root } else { DVec2::ZERO };
            values.iter_mut().zip(error.to_array()).for_each(|(value, error)| *value = error);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use retina_formats::{Measurements, PointRow, PointsTable};
    use retina_geometry::Setup;

    use super::*;
    use crate::data::{Baseline, Source};

    /// Twenty points in four exposures, with noise that is three times as large along one direction as across.
    fn campaign() -> (Dataset, Weights) {
        let setup = Setup::shipped(Path::new("wide-fov")).unwrap();
        let mut table = PointsTable::default();
        for i in 0..20usize {
            let at = DVec2::new(400.0 + 61.0 * i as f64, 300.0 + 397.0 * (i % 3) as f64);
            let exposure = i / 5;
            table.rows.push(PointRow {
                time_s: Some(60.0 * exposure as f64),
                line: i + 2,
                ..PointRow::new(exposure, at, 100.0, at + DVec2::new(60.0, 170.0))
            });
        }
        table.images = (0..4).map(|exposure| format!("e{exposure}")).collect();
        let mut data = Dataset::new(&Source {
            tables: &Measurements::Points(table),
            setup: &setup,
            calibration: None,
            response: None,
            baseline: Baseline::Polynomial(1),
        })
        .unwrap();
        let turned = |row: usize| {
            let turn = DMat2::from_angle(0.7 * row as f64);
            turn * DMat2::from_diagonal(DVec2::new(0.6, 1.8)) * turn.transpose()
        };
        data.isotropic_from_error = Some((0..data.len()).map(turned).collect());
        let sigma: Vec<f64> = (0..data.len()).map(|row| 0.5 + 0.1 * row as f64).collect();
        let weight = sigma.iter().map(|sigma| sigma.powi(-2)).collect();
        let outlier = vec![false; data.len()];
        (data, Weights { weight, sigma, jitter_variance: 0.3, outlier, field_size: 0.0 })
    }

    /// W V W^T = 1, V with each row's covariance and a common shift of each exposure.
    #[test]
    fn errors_of_this_covariance_become_white() {
        let (data, weights) = campaign();
        let side = data.y.len();
        let whitening = weights.whitening(&data);
        let unit = |k: usize| (0..side).map(|i| f64::from(u8::from(i == k))).collect::<Vec<f64>>();
        let w: Vec<Vec<f64>> = (0..side).map(|k| whitening.of(&unit(k))).collect();
        let v = |i: usize, j: usize| {
            let (row, other) = (i / 2, j / 2);
            let own = data.isotropic(row).inverse() * weights.sigma[row];
            let own = if row == other { (own * own).col(i % 2)[j % 2] } else { 0.0 };
            let together = data.groups.iter().any(|g| g.rows.contains(&row) && g.rows.contains(&other));
            own + if together && i % 2 == j % 2 { weights.jitter_variance } else { 0.0 }
        };
        for a in 0..side {
            for b in 0..side {
                let cell: f64 =
                    (0..side * side).map(|k| w[k / side][a] * v(k / side, k % side) * w[k % side][b]).sum();
                assert!((cell - f64::from(u8::from(a == b))).abs() < 1e-9, "{a} {b}: {cell}");
            }
        }
    }

    /// Also where exposures follow each other.
    #[test]
    fn whitened_errors_come_back() {
        let (mut data, weights) = campaign();
        data.wander = 0.6;
        let errors: Vec<f64> = (0..data.y.len()).map(|i| (1.7 * i as f64).sin()).collect();
        let mut there_and_back = weights.whitened(&data, &errors);
        weights.unwhiten(&data, &mut there_and_back);
        for (found, error) in there_and_back.iter().zip(&errors) {
            assert!((found - error).abs() < 1e-12, "{found} {error}");
        }
    }
}
