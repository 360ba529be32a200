//! Scores of candidate columns beside a fitted base, their p-values by sign-flips of whole groups, held-out errors.
//!
//! The score of columns C beside a base B with whitened errors e is e^T C~ (C~^T C~)^-1 C~^T e, C~ the part of C that
//! is orthogonal to B: under the base it is chi-squared with rank(C~) degrees of freedom if errors are normal. Its
//! p-value asks for less: flipping the signs of whole groups leaves the distribution of the groups' contributions as
//! it is where errors are symmetric and groups independent (J. Hemerik, J. Goeman, L. Finos, Journal of the Royal
//! Statistical Society B 82, 2020, the effective score).

use rand::seq::SliceRandom as _;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::data::Dataset;
use crate::linear::{Basis, dot, solve_positive};
use crate::noise::{RobustFit, Weights, robust_fit};

/// Columns that keep less than this of their length beside the base are the base's own.
const IDENTICAL: f64 = 1e-4;
/// Groups are left out in this many parts.
const FOLDS: usize = 10;

/// A base fitted to data: what candidates are scored beside.
pub(crate) struct Frame<'d> {
    pub(crate) data: &'d Dataset,
    pub(crate) weights: Weights,
    /// Orthonormal whitened columns of the base.
    pub(crate) basis: Basis,
    /// Whitened data.
    pub(crate) y: Vec<f64>,
    /// Whitened errors of the base.
    pub(crate) error: Vec<f64>,
}

/// Orthonormal directions of a candidate beside the base, with the groups' contributions to its score.
pub(crate) struct Score {
    pub(crate) directions: Vec<Vec<f64>>,
    /// For each group: contribution along each direction.
    contributions: Vec<Vec<f64>>,
    /// The score.
    pub(crate) statistic: f64,
}

/// Held-out errors of a model.
#[derive(Clone)]
pub(crate) struct HeldOut {
    /// Whitened squares of each group when it was left out.
    pub(crate) loss: Vec<f64>,
    /// Weighted rms per component of rows left out, the group's own error included.
    pub(crate) rms: f64,
}

impl HeldOut {
    pub(crate) fn total(&self) -> f64 {
        self.loss.iter().sum()
    }
}

impl<'d> Frame<'d> {
    /// Fits the base robustly, and weighs by its errors.
    pub(crate) fn fitted(data: &'d Dataset, base: &[Vec<f64>]) -> Self {
        let RobustFit { weights, .. } = robust_fit(data, base);
        Self::weighted(data, base, weights)
    }

    /// The base under weights that are given.
    pub(crate) fn weighted(data: &'d Dataset, base: &[Vec<f64>], weights: Weights) -> Self {
        let basis = Basis::of(base.iter().map(|column| {
            let mut column = column.clone();
            weights.whiten(data, &mut column);
            column
        }));
        let mut y = data.y.clone();
        weights.whiten(data, &mut y);
        let error = basis.residual(basis.residual(y.clone()));
        Self { data, weights, basis, y, error }
    }

    /// Components of the rows that count.
    pub(crate) fn components(&self) -> f64 {
        (self.weights.kept() * self.data.kind.components()) as f64
    }

    /// Score of columns.
    pub(crate) fn score(&self, columns: &[Vec<f64>]) -> Score {
        let mut own = Basis::default();
        for column in columns {
            let mut column = column.clone();
            self.weights.whiten(self.data, &mut column);
            let before = dot(&column, &column).sqrt();
            let left = self.basis.residual(self.basis.residual(column));
            let beside = own.residual(left.clone());
            if dot(&beside, &beside).sqrt() > IDENTICAL * before {
                own.push(left);
            }
        }
        let n = self.data.kind.components();
        let contributions: Vec<Vec<f64>> = self
            .data
            .groups
            .iter()
            .map(|group| {
                let span = group.rows.start * n..group.rows.end * n;
                own.q.iter().map(|q| dot(&q[span.clone()], &self.error[span.clone()])).collect()
            })
            .collect();
        let statistic = statistic(&contributions, own.q.len(), None);
        Score { directions: own.q, contributions, statistic }
    }

    /// Held-out errors of the base with further directions.
    pub(crate) fn held_out(&self, directions: &[Vec<f64>]) -> HeldOut {
        let n = self.data.kind.components();
        let columns: Vec<&Vec<f64>> = self.basis.q.iter().chain(directions).collect();
        let k = columns.len();
        let projections: Vec<f64> = columns.iter().map(|q| dot(q, &self.y)).collect();
        let mut error = vec![0.0; self.y.len()];
        let mut loss = vec![0.0; self.data.groups.len()];
        for fold in folds(self.data.groups.len()) {
            let spans: Vec<_> = fold
                .iter()
                .map(|&g| self.data.groups[g].rows.start * n..self.data.groups[g].rows.end * n)
                .collect();
            let over = |a: &[f64], b: &[f64]| -> f64 {
                spans.iter().map(|span| dot(&a[span.clone()], &b[span.clone()])).sum()
            };
            let mut normal = vec![0.0; k * k];
            for i in 0..k {
                for j in 0..=i {
                    let value = f64::from(u8::from(i == j)) - over(columns[i], columns[j]);
                    normal[i * k + j] = value;
                    normal[j * k + i] = value;
                }
                // A direction that these groups alone have is left at 0.
                normal[i * k + i] += 1e-9;
            }
            let right: Vec<f64> = (0..k).map(|i| projections[i] - over(columns[i], &self.y)).collect();
            // The matrix is a Gram matrix plus a small positive diagonal.
            let coefficients = solve_positive(&normal, &right).unwrap_or_else(|| vec![0.0; k]);
            for (&g, span) in fold.iter().zip(&spans) {
                for at in span.clone() {
                    let model: f64 = columns.iter().zip(&coefficients).map(|(q, c)| q[at] * c).sum();
                    error[at] = self.y[at] - model;
                    loss[g] += error[at] * error[at];
                }
            }
        }
        self.weights.unwhiten(self.data, &mut error);
        for (row, values) in error.chunks_exact_mut(n).enumerate() {
            let weight = self.weights.weight[row];
            let root = if weight > 0.0 { weight.sqrt() } else { f64::INFINITY };
            values.iter_mut().for_each(|value| *value /= root);
        }
        HeldOut { loss, rms: self.weights.rms(n, &error) }
    }
}

/// Groups in parts, drawn once and for all.
fn folds(groups: usize) -> Vec<Vec<usize>> {
    let mut order: Vec<usize> = (0..groups).collect();
    order.shuffle(&mut ChaCha8Rng::seed_from_u64(0));
    let count = FOLDS.min(groups).max(1);
    (0..count).map(|k| order[k * groups / count..(k + 1) * groups / count].to_vec()).collect()
}

fn statistic(contributions: &[Vec<f64>], rank: usize, signs: Option<&[bool]>) -> f64 {
    let mut sums = vec![0.0; rank];
    for (g, values) in contributions.iter().enumerate() {
        let sign = if signs.is_some_and(|signs| signs[g]) { -1.0 } else { 1.0 };
        for (sum, value) in sums.iter_mut().zip(values) {
            *sum += sign * value;
        }
    }
    dot(&sums, &sums)
}

impl Score {
    pub(crate) fn rank(&self) -> usize {
        self.directions.len()
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

fn deviate(statistic: f64, rank: usize) -> f64 {
    if rank == 0 {
        return f64::NEG_INFINITY;
    }
    let ninth = 2.0 / (9.0 * rank as f64);
    ((statistic / rank as f64).cbrt() - (1.0 - ninth)) / ninth.sqrt()
}

/// Signs by which groups are flipped, for each of `count` draws.
pub(crate) fn flips(groups: usize, count: usize, seed: u64) -> Vec<Vec<bool>> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    (0..count).map(|_| (0..groups).map(|_| random.random::<bool>()).collect()).collect()
}

/// For each candidate (each a list of variants' scores) the p-value of its best variant, corrected for all that are
/// given: the share of flips in which any of them reaches as far.
pub(crate) fn p_values(candidates: &[Vec<&Score>], flips: &[Vec<bool>]) -> Vec<f64> {
    let best = |signs: Option<&[bool]>| -> f64 {
        candidates
            .iter()
            .flatten()
            .map(|score| deviate(statistic(&score.contributions, score.rank(), signs), score.rank()))
            .fold(f64::NEG_INFINITY, f64::max)
    };
    let highest: Vec<f64> = flips.par_iter().map(|signs| best(Some(signs))).collect();
    candidates
        .iter()
        .map(|variants| {
            let own = variants.iter().map(|score| score.deviate()).fold(f64::NEG_INFINITY, f64::max);
            if own == f64::NEG_INFINITY {
                return 1.0;
            }
            // Sums of flipped and unflipped order differ by rounding.
            let reached = highest.iter().filter(|h| **h >= own - 1e-9 * own.abs()).count();
            (1 + reached) as f64 / (1 + flips.len()) as f64
        })
        .collect()
}
