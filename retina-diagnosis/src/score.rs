//! Scores of candidate columns beside a fitted base, their p-values by sign-flips of whole units; errors of units left out
//! in `held_out.rs`.
//!
//! The score of columns C beside a base B with whitened errors e is e^T C~ (C~^T C~)^-1 C~^T e, C~ the part of C that
//! is orthogonal to B: under the base it is chi-squared with rank(C~) degrees of freedom if errors are normal. Its
//! p-value asks for less: flipping the signs of whole groups leaves the distribution of the groups' contributions as
//! it is where errors are symmetric and groups independent (J. Hemerik, J. Goeman, L. Finos, Journal of the Royal
//! Statistical Society B 82, 2020, the effective score). Errors of a calibration that is held fixed are the same in all
//! groups and no flip can show them: they are drawn from their normal distribution.

mod held_out;

use std::sync::OnceLock;

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, Par};
use once_cell::race::OnceBox;
use rayon::prelude::*;

use crate::data::Dataset;
use crate::levels_left::{FormScore, LevelsLeft};
use crate::linear::{Basis, dot, independent};
use crate::noise::{RobustFit, Weights, robust_fit};
use crate::units::Units;
use held_out::Fold;
pub(crate) use held_out::HeldOut;

/// Columns that keep less than this of their length beside the base are the base's own.
const IDENTICAL: f64 = 1e-4;
/// Columns that are projected together.
const BLOCK: usize = 24;
/// Candidates whose columns are made together.
const MADE_TOGETHER: usize = 2;

/// A base fitted to data: what candidates are scored beside.
pub(crate) struct Frame<'d> {
    pub(crate) data: &'d Dataset,
    pub(crate) weights: Weights,
    /// What is flipped and left out together.
    pub(crate) units: Units,
    /// Orthonormal whitened columns of the base.
    basis: Basis,
    /// The same side by side.
    q: Mat<f64>,
    /// Whitened data, followed by a 0 for each part of the calibration's error.
    y: Vec<f64>,
    /// Whitened errors of the base.
    pub(crate) error: Vec<f64>,
    /// For each part that is left out: Gram matrix of the base over it, and products with the data.
    folds: OnceBox<Vec<Fold>>,
    /// The levels of the groups as the base leaves them.
    levels: OnceLock<LevelsLeft>,
}

/// Score of a candidate beside the base.
pub(crate) struct Score {
    /// Contributions along each of its orthonormal directions: a row for each range of a unit, then one for each part of the
    /// calibration's error of unit variance.
    pub(crate) contributions: Mat<f64>,
    /// The score.
    pub(crate) statistic: f64,
    /// The score by what units' contributions scatter by about their common amplitudes, where that is more than the
    /// weights say: units may each have a roll or a scale of their own.
    pub(crate) sober: f64,
}

impl<'d> Frame<'d> {
    /// Fits the base robustly, and weighs by its errors.
    pub(crate) fn fitted(data: &'d Dataset, base: &[Vec<f64>]) -> Self {
        let RobustFit { weights, .. } = robust_fit(data, base);
        Self::weighted(data, base, weights)
    }

    /// The base under weights that are given.
    pub(crate) fn weighted(data: &'d Dataset, base: &[Vec<f64>], weights: Weights) -> Self {
        Self::of_values(data, base, weights, &data.y)
    }

    /// The base under the weights of its fit; outliers that have something in common count with errors that are cut.
    pub(crate) fn with_outliers_cut(data: &'d Dataset, base: &[Vec<f64>], fit: &RobustFit) -> Self {
        match fit.outliers_cut(data) {
            Some((weights, y)) => Self::of_values(data, base, weights, &y),
            None => Self::weighted(data, base, fit.weights.clone()),
        }
    }

    /// The base under weights that are given, with other values for the table's.
    pub(crate) fn of_values(data: &'d Dataset, base: &[Vec<f64>], weights: Weights, y: &[f64]) -> Self {
        let mut basis = Basis::spanning(&weights.whitened_field(data));
        let whitening = weights.whitening(data);
        let columns: Vec<Vec<f64>> = base.iter().map(|column| whitening.of(column)).collect();
        let y = whitening.of(y);
        basis.push_all(&basis.side_by_side(y.len()), &columns);
        Self::of(data, weights, basis, y)
    }

    /// The base with further columns.
    pub(crate) fn with(&self, columns: &[Vec<f64>]) -> Self {
        let mut basis = self.basis.clone();
        let whitening = self.weights.whitening(self.data);
        let whitened: Vec<Vec<f64>> = columns.iter().map(|column| whitening.of(column)).collect();
        basis.push_all(&self.q, &whitened);
        Self::of(self.data, self.weights.clone(), basis, self.y.clone())
    }

    fn of(data: &'d Dataset, weights: Weights, basis: Basis, y: Vec<f64>) -> Self {
        let error = basis.residual(basis.residual(y.clone()));
        let q = basis.side_by_side(y.len());
        let (units, folds, levels) = (Units::of(data), OnceBox::new(), OnceLock::new());
        Self { data, weights, units, basis, q, y, error, folds, levels }
    }

    /// Components of the rows that count.
    pub(crate) fn components(&self) -> f64 {
        (self.weights.kept() * self.data.kind.components()) as f64
    }

    /// What the base leaves of a column, whitened.
    pub(crate) fn residual(&self, column: &[f64]) -> Vec<f64> {
        self.basis.residual(self.basis.residual(self.weights.whitened(self.data, column)))
    }

    /// Whitened data, and further columns, without anything that a held calibration's error could be: as if that error's
    /// columns were fitted freely. What all groups share because the calibration is a little wrong is then no structure.
    pub(crate) fn free_of_field(&self, columns: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let length = self.data.y.len();
        let top = |column: &Vec<f64>| column[..length].to_vec();
        let free = (self.data.field_len() > 0)
            .then(|| Basis::spanning(&self.basis.q.iter().map(top).collect::<Vec<Vec<f64>>>()));
        std::iter::once(self.y.clone())
            .chain(columns.iter().map(|column| self.weights.whitened(self.data, column)))
            .map(|column| match &free {
                Some(free) => free.residual(free.residual(top(&column))),
                None => self.basis.residual(self.basis.residual(column)),
            })
            .collect()
    }

    /// Score of columns.
    pub(crate) fn score(&self, columns: &[Vec<f64>]) -> Score {
        self.scores(&[columns]).swap_remove(0)
    }

    /// Scores of many candidates.
    pub(crate) fn scores<C: AsRef<[Vec<f64>]> + Sync>(&self, candidates: &[C]) -> Vec<Score> {
        self.in_blocks(candidates, |c, kept, inverse| self.of_directions(c, kept, inverse))
    }

    /// The same of candidates whose columns are made when they are needed: all at once would fill the memory.
    pub(crate) fn scores_of<K: Sync>(
        &self,
        candidates: &[K],
        columns: impl Fn(&K) -> Vec<Vec<f64>> + Sync,
    ) -> Vec<Score> {
        let of_some = |candidates: &[K]| {
            let made: Vec<Vec<Vec<f64>>> = candidates.iter().map(&columns).collect();
            self.block(&made, &|c, kept, inverse| self.of_directions(c, kept, inverse))
        };
        candidates.par_chunks(MADE_TOGETHER).flat_map_iter(of_some).collect()
    }

    /// What many candidates gain where the scatter of groups is found anew.
    pub(crate) fn form_scores<C: AsRef<[Vec<f64>]> + Sync>(&self, candidates: &[C]) -> Vec<FormScore> {
        let levels = self.levels.get_or_init(|| LevelsLeft::of(self));
        self.in_blocks(candidates, |c, kept, inverse| levels.score(self, c, kept, inverse))
    }

    /// What is made of each candidate: its columns beside the base, those that are independent, and L^-1 of C~^T C~ = L L^T.
    fn in_blocks<C: AsRef<[Vec<f64>]> + Sync, T: Send>(
        &self,
        candidates: &[C],
        of: impl Fn(faer::MatRef<'_, f64>, &[usize], &Mat<f64>) -> T + Sync,
    ) -> Vec<T> {
        let mut blocks: Vec<std::ops::Range<usize>> = Vec::new();
        let mut columns = BLOCK;
        for (k, candidate) in candidates.iter().enumerate() {
            match blocks.last_mut() {
                Some(block) if columns + candidate.as_ref().len() <= BLOCK => block.end = k + 1,
                _ => {
                    blocks.push(k..k + 1);
                    columns = 0;
                }
            }
            columns += candidate.as_ref().len();
        }
        let made: Vec<Vec<T>> = blocks.into_par_iter().map(|b| self.block(&candidates[b], &of)).collect();
        made.into_iter().flatten().collect()
    }

    fn block<C: AsRef<[Vec<f64>]>, T>(
        &self,
        candidates: &[C],
        of: &impl Fn(faer::MatRef<'_, f64>, &[usize], &Mat<f64>) -> T,
    ) -> Vec<T> {
        let (beside, before) = self.beside(candidates.iter().flat_map(|c| c.as_ref()));
        let mut first = 0;
        candidates
            .iter()
            .map(|candidate| {
                let own = first..first + candidate.as_ref().len();
                first = own.end;
                let c = beside.subcols(own.start, own.len());
                let (kept, inverse) = independent(&(c.transpose() * c), &before[own], IDENTICAL);
                of(c, &kept, &inverse)
            })
            .collect()
    }

    /// Whitened columns without their part along the base, and their squares before.
    fn beside<'c>(&self, columns: impl Iterator<Item = &'c Vec<f64>>) -> (Mat<f64>, Vec<f64>) {
        let whitening = self.weights.whitening(self.data);
        let columns: Vec<&Vec<f64>> = columns.collect();
        let mut c = Mat::<f64>::zeros(self.y.len(), columns.len());
        let whitened = |(k, column): (usize, &&Vec<f64>)| {
            let own = c.col_as_slice_mut(k);
            whitening.fill(column, own);
            dot(own, own)
        };
        let before = columns.iter().enumerate().map(whitened).collect();
        let along = self.q.transpose() * &c;
        matmul(c.as_mut(), Accum::Add, &self.q, &along, -1.0, Par::Seq);
        (c, before)
    }

    /// Score along C~ L^-T, of columns that are beside the base already.
    fn of_directions(&self, c: faer::MatRef<'_, f64>, kept: &[usize], inverse: &Mat<f64>) -> Score {
        let n = self.data.kind.components();
        let (ranges, length) = (self.units.ranges.len(), self.data.y.len());
        let field = self.y.len() - length;
        let mut raw = Mat::<f64>::zeros(ranges + field, kept.len());
        let mut sums = vec![0.0; kept.len()];
        for (k, &column) in kept.iter().enumerate() {
            let values = c.col(column).try_as_col_major().map_or(&[][..], |column| column.as_slice());
            for (g, rows) in self.units.ranges.iter().enumerate() {
                let span = rows.start * n..rows.end * n;
                raw[(g, k)] = dot(&values[span.clone()], &self.error[span]);
                sums[k] += raw[(g, k)];
            }
            for j in 0..field {
                raw[(ranges + j, k)] = values[length + j];
                sums[k] += values[length + j] * self.error[length + j];
            }
        }
        let contributions = &raw * inverse.transpose();
        let along: Vec<f64> =
            (0..kept.len()).map(|i| (0..=i).map(|k| inverse[(i, k)] * sums[k]).sum()).collect();
        let statistic = along.iter().map(|along| along * along).sum();
        let dispersion = self.dispersion(c, kept, inverse, &along);
        let sober = along.iter().zip(dispersion).map(|(along, by)| along * along / by).sum();
        Score { contributions, statistic, sober }
    }

    /// Along each direction the units' scatter about the common amplitude over what the weights say, 1 or more.
    ///
    /// With D = C~ L^-T and a the amplitudes along its columns, a unit u has r = D_u^T (e - D a) left. Where its errors are as
    /// the weights say, the square of r has the mean s - s^2, s the squares of D_u. Units count alike, however little of the
    /// form is theirs: those before a step say what roll an exposure has by itself as well as the few behind it.
    fn dispersion(
        &self,
        c: faer::MatRef<'_, f64>,
        kept: &[usize],
        inverse: &Mat<f64>,
        along: &[f64],
    ) -> Vec<f64> {
        /// A part of a form that is rounding, and the least that is left of a unit that has all of it.
        const LEAST: f64 = 1e-9;
        const LEAST_LEFT: f64 = 1e-3;
        let (n, length) = (self.data.kind.components(), self.data.y.len());
        let mut chosen = Mat::<f64>::zeros(length, kept.len());
        for (k, &column) in kept.iter().enumerate() {
            chosen.col_mut(k).copy_from(c.col(column).subrows(0, length));
        }
        let directions = &chosen * inverse.transpose();
        let mut rest = self.error[..length].to_vec();
        for (k, along) in along.iter().enumerate() {
            rest.iter_mut().zip(directions.col_as_slice(k)).for_each(|(rest, value)| *rest -= along * value);
        }
        let of_direction = |k: usize| {
            let direction = directions.col_as_slice(k);
            let mut units = vec![(0.0, 0.0); self.units.count];
            for (rows, &unit) in self.units.ranges.iter().zip(&self.units.unit) {
                let span = rows.start * n..rows.end * n;
                units[unit].0 += dot(&direction[span.clone()], &rest[span.clone()]);
                units[unit].1 += dot(&direction[span.clone()], &direction[span]);
            }
            let ratios: Vec<f64> = units
                .iter()
                .filter(|(_, own)| *own > LEAST)
                .map(|(left, own)| left * left / (own * (1.0 - own).max(LEAST_LEFT)))
                .collect();
            (ratios.iter().sum::<f64>() / ratios.len().max(1) as f64).max(1.0)
        };
        (0..kept.len()).map(of_direction).collect()
    }

    /// Amplitudes of columns beside the base, with standard deviations; infinite where they depend on each other.
    pub(crate) fn amplitudes(&self, columns: &[Vec<f64>]) -> Vec<(f64, f64)> {
        let beside: Vec<Vec<f64>> = columns.iter().map(|column| self.residual(column)).collect();
        let basis = Basis::of(beside);
        let values = basis.coefficients(&self.error);
        let covariance = basis.covariance();
        let of = |k: usize| {
            let variance = covariance[k][k];
            (values[k], if variance > 0.0 { variance.sqrt() } else { f64::INFINITY })
        };
        (0..columns.len()).map(of).collect()
    }

    /// Orthonormal directions of columns beside the base.
    pub(crate) fn directions(&self, columns: &[Vec<f64>]) -> Vec<Vec<f64>> {
        if columns.is_empty() {
            return Vec::new();
        }
        let (c, before) = self.beside(columns.iter());
        let mut own = Basis::default();
        for (k, before) in before.iter().enumerate() {
            let column = c.col_as_slice(k).to_vec();
            let beside = own.residual(column.clone());
            if dot(&beside, &beside).sqrt() > IDENTICAL * before.sqrt() {
                own.push(column);
            }
        }
        own.q
    }
}

impl Score {
    pub(crate) fn rank(&self) -> usize {
        self.contributions.ncols()
    }

    /// The same by errors that scatter from unit to unit as these do.
    pub(crate) fn sober_deviate(&self) -> f64 {
        deviate(self.sober, self.rank())
    }

    /// The score as a normal deviate, so that ranks can be compared (E. B. Wilson, M. M. Hilferty, PNAS 17, 1931).
    pub(crate) fn deviate(&self) -> f64 {
        deviate(self.statistic, self.rank())
    }

    /// Rms of what it explains, in units of the noise.
    pub(crate) fn strength(&self, components: f64) -> f64 {
        ((self.statistic - self.rank() as f64).max(0.0) / components).sqrt()
    }
}

pub(crate) fn deviate(statistic: f64, rank: usize) -> f64 {
    if rank == 0 {
        return f64::NEG_INFINITY;
    }
    let ninth = 2.0 / (9.0 * rank as f64);
    ((statistic / rank as f64).cbrt() - (1.0 - ninth)) / ninth.sqrt()
}
