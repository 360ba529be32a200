//! Scores of candidate columns beside a fitted base, their p-values by sign-flips of whole groups, held-out errors.
//!
//! The score of columns C beside a base B with whitened errors e is e^T C~ (C~^T C~)^-1 C~^T e, C~ the part of C that
//! is orthogonal to B: under the base it is chi-squared with rank(C~) degrees of freedom if errors are normal. Its
//! p-value asks for less: flipping the signs of whole groups leaves the distribution of the groups' contributions as
//! it is where errors are symmetric and groups independent (J. Hemerik, J. Goeman, L. Finos, Journal of the Royal
//! Statistical Society B 82, 2020, the effective score). Errors of a calibration that is held fixed are the same in all
//! groups and no flip can show them: they are drawn from their normal distribution.

use std::sync::OnceLock;

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, Par};
use rand::seq::SliceRandom as _;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, StandardNormal};
use rayon::prelude::*;

use crate::data::Dataset;
use crate::linear::{Basis, dot, matrix, solve_positive};
use crate::noise::{RobustFit, Weights, robust_fit};
use crate::series::two_sided;

/// Columns that keep less than this of their length beside the base are the base's own.
const IDENTICAL: f64 = 1e-4;
/// Groups are left out in this many parts.
const FOLDS: usize = 10;
/// Columns that are projected together.
const BLOCK: usize = 24;
/// Flips that are counted together.
const FLIP_BLOCK: usize = 256;

/// A base fitted to data: what candidates are scored beside.
pub(crate) struct Frame<'d> {
    pub(crate) data: &'d Dataset,
    pub(crate) weights: Weights,
    /// Orthonormal whitened columns of the base.
    basis: Basis,
    /// The same side by side.
    q: Mat<f64>,
    /// Whitened data, followed by a 0 for each part of the calibration's error.
    y: Vec<f64>,
    /// Whitened errors of the base.
    pub(crate) error: Vec<f64>,
    /// For each part that is left out: Gram matrix of the base over it, and products with the data.
    folds: OnceLock<Vec<Fold>>,
}

struct Fold {
    groups: Vec<usize>,
    gram: Mat<f64>,
    right: Vec<f64>,
}

/// Score of a candidate beside the base.
pub(crate) struct Score {
    /// Contributions along each of its orthonormal directions: a row for each group, then one for each part of the
    /// calibration's error of unit variance.
    contributions: Mat<f64>,
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
    /// The same without weights.
    pub(crate) rms_unweighted: f64,
}

impl HeldOut {
    pub(crate) fn total(&self) -> f64 {
        self.loss.iter().sum()
    }

    /// By how many standard errors the other is better, group by group; negative where it is worse.
    pub(crate) fn beaten_by(&self, other: &Self) -> f64 {
        let n = self.loss.len() as f64;
        let gains: Vec<f64> = self.loss.iter().zip(&other.loss).map(|(own, other)| own - other).collect();
        let mean = gains.iter().sum::<f64>() / n;
        let variance = gains.iter().map(|gain| (gain - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
        if mean == 0.0 { 0.0 } else { mean / (variance / n).sqrt().max(f64::MIN_POSITIVE) }
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
        let mut basis = Basis::spanning(&weights.whitened_field(data));
        for column in base {
            basis.push(weights.whitened(data, column));
        }
        let y = weights.whitened(data, &data.y);
        Self::of(data, weights, basis, y)
    }

    /// The base with further columns.
    pub(crate) fn with(&self, columns: &[Vec<f64>]) -> Self {
        let mut basis = self.basis.clone();
        for column in columns {
            basis.push(self.weights.whitened(self.data, column));
        }
        Self::of(self.data, self.weights.clone(), basis, self.y.clone())
    }

    fn of(data: &'d Dataset, weights: Weights, basis: Basis, y: Vec<f64>) -> Self {
        let error = basis.residual(basis.residual(y.clone()));
        let mut q = matrix(&basis.q);
        if basis.q.is_empty() {
            q = Mat::zeros(y.len(), 0);
        }
        Self { data, weights, basis, q, y, error, folds: OnceLock::new() }
    }

    /// Components of the rows that count.
    pub(crate) fn components(&self) -> f64 {
        (self.weights.kept() * self.data.kind.components()) as f64
    }

    /// What the base leaves of a column, whitened.
    pub(crate) fn residual(&self, column: &[f64]) -> Vec<f64> {
        self.basis.residual(self.basis.residual(self.weights.whitened(self.data, column)))
    }

    /// Score of columns.
    pub(crate) fn score(&self, columns: &[Vec<f64>]) -> Score {
        self.scores(&[columns]).swap_remove(0)
    }

    /// Scores of many candidates.
    pub(crate) fn scores<C: AsRef<[Vec<f64>]> + Sync>(&self, candidates: &[C]) -> Vec<Score> {
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
        let scored: Vec<Vec<Score>> = blocks.into_par_iter().map(|b| self.block(&candidates[b])).collect();
        scored.into_iter().flatten().collect()
    }

    fn block<C: AsRef<[Vec<f64>]>>(&self, candidates: &[C]) -> Vec<Score> {
        let (beside, before) = self.beside(candidates.iter().flat_map(|c| c.as_ref()));
        let mut first = 0;
        candidates
            .iter()
            .map(|candidate| {
                let own = first..first + candidate.as_ref().len();
                first = own.end;
                let c = beside.subcols(own.start, own.len());
                let (kept, inverse) = independent(&(c.transpose() * c), &before[own]);
                self.of_directions(c, &kept, &inverse)
            })
            .collect()
    }

    /// Whitened columns without their part along the base, and their squares before.
    fn beside<'c>(&self, columns: impl Iterator<Item = &'c Vec<f64>>) -> (Mat<f64>, Vec<f64>) {
        let whitened: Vec<Vec<f64>> = columns.map(|c| self.weights.whitened(self.data, c)).collect();
        let before = whitened.iter().map(|c| dot(c, c)).collect();
        let mut c = matrix(&whitened);
        let along = self.q.transpose() * &c;
        matmul(c.as_mut(), Accum::Add, &self.q, &along, -1.0, Par::Seq);
        (c, before)
    }

    /// Score along C~ L^-T, of columns that are beside the base already.
    fn of_directions(&self, c: faer::MatRef<'_, f64>, kept: &[usize], inverse: &Mat<f64>) -> Score {
        let n = self.data.kind.components();
        let (groups, length) = (self.data.groups.len(), self.data.y.len());
        let field = self.y.len() - length;
        let mut raw = Mat::<f64>::zeros(groups + field, kept.len());
        let mut sums = vec![0.0; kept.len()];
        for (k, &column) in kept.iter().enumerate() {
            let values = c.col(column).try_as_col_major().map_or(&[][..], |column| column.as_slice());
            for (g, group) in self.data.groups.iter().enumerate() {
                let span = group.rows.start * n..group.rows.end * n;
                raw[(g, k)] = dot(&values[span.clone()], &self.error[span]);
                sums[k] += raw[(g, k)];
            }
            for j in 0..field {
                raw[(groups + j, k)] = values[length + j];
                sums[k] += values[length + j] * self.error[length + j];
            }
        }
        let contributions = &raw * inverse.transpose();
        let statistic = (0..kept.len())
            .map(|i| (0..=i).map(|k| inverse[(i, k)] * sums[k]).sum::<f64>())
            .map(|along| along * along)
            .sum();
        Score { contributions, statistic }
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

    /// Parts of the groups with what the base needs for leaving them out.
    fn folds(&self) -> &[Fold] {
        self.folds.get_or_init(|| {
            folds(self.data.groups.len())
                .into_par_iter()
                .map(|groups| {
                    let k = self.q.ncols();
                    let (mut gram, mut right) = (Mat::<f64>::zeros(k, k), vec![0.0; k]);
                    for span in self.spans(&groups) {
                        let q = self.q.subrows(span.start, span.len());
                        matmul(gram.as_mut(), Accum::Add, q.transpose(), q, 1.0, Par::Seq);
                        for (r, q) in right.iter_mut().zip(&self.basis.q) {
                            *r += dot(&q[span.clone()], &self.y[span.clone()]);
                        }
                    }
                    Fold { groups, gram, right }
                })
                .collect()
        })
    }

    fn spans(&self, groups: &[usize]) -> Vec<std::ops::Range<usize>> {
        let n = self.data.kind.components();
        groups.iter().map(|&g| self.data.groups[g].rows.start * n..self.data.groups[g].rows.end * n).collect()
    }

    /// Held-out errors of the base with further columns.
    pub(crate) fn held_out(&self, columns: &[Vec<f64>]) -> HeldOut {
        let directions = self.directions(columns);
        let base = self.basis.q.len();
        let all: Vec<&Vec<f64>> = self.basis.q.iter().chain(&directions).collect();
        let k = all.len();
        let projections: Vec<f64> = all.iter().map(|q| dot(q, &self.y)).collect();
        let mut error = self.y[..self.data.y.len()].to_vec();
        let mut loss = vec![0.0; self.data.groups.len()];
        for fold in self.folds() {
            let spans = self.spans(&fold.groups);
            let over = |a: &[f64], b: &[f64]| -> f64 {
                spans.iter().map(|span| dot(&a[span.clone()], &b[span.clone()])).sum()
            };
            let mut normal = vec![0.0; k * k];
            for i in 0..k {
                for j in 0..=i {
                    let left_out = if i < base { fold.gram[(i, j)] } else { over(all[i], all[j]) };
                    let value = f64::from(u8::from(i == j)) - left_out;
                    normal[i * k + j] = value;
                    normal[j * k + i] = value;
                }
                // A direction that these groups alone have is left at 0.
                normal[i * k + i] += 1e-9;
            }
            let right: Vec<f64> = (0..k)
                .map(|i| projections[i] - if i < base { fold.right[i] } else { over(all[i], &self.y) })
                .collect();
            // The matrix is a Gram matrix plus a small positive diagonal.
            let coefficients = solve_positive(&normal, &right).unwrap_or_else(|| vec![0.0; k]);
            for (&g, span) in fold.groups.iter().zip(&spans) {
                for (q, c) in all.iter().zip(&coefficients) {
                    error[span.clone()].iter_mut().zip(&q[span.clone()]).for_each(|(e, q)| *e -= c * q);
                }
                loss[g] += dot(&error[span.clone()], &error[span.clone()]);
            }
        }
        let n = self.data.kind.components();
        self.weights.unwhiten(self.data, &mut error);
        for (row, values) in error.chunks_exact_mut(n).enumerate() {
            let weight = self.weights.weight[row];
            let root = if weight > 0.0 { weight.sqrt() } else { f64::INFINITY };
            values.iter_mut().for_each(|value| *value /= root);
        }
        HeldOut {
            loss,
            rms: self.weights.rms(n, &error),
            rms_unweighted: self.weights.rms_unweighted(n, &error),
        }
    }
}

/// Which columns of a Gram matrix are independent of those before them, and L^-1 of these, L L^T their Gram matrix.
/// `before` are the squares of the columns before a base was taken out of them.
fn independent(gram: &Mat<f64>, before: &[f64]) -> (Vec<usize>, Mat<f64>) {
    let mut kept: Vec<usize> = Vec::new();
    let mut rows: Vec<Vec<f64>> = Vec::new();
    for column in 0..gram.ncols() {
        let mut row = Vec::with_capacity(kept.len() + 1);
        for (other, &k) in rows.iter().zip(&kept) {
            let known = dot(&row, &other[..row.len()]);
            row.push((gram[(column, k)] - known) / other[row.len()]);
        }
        let left = gram[(column, column)] - dot(&row, &row);
        if left > IDENTICAL * IDENTICAL * before[column] && left.is_finite() {
            row.push(left.sqrt());
            rows.push(row);
            kept.push(column);
        }
    }
    // Rows of the inverse by forward substitution.
    let n = kept.len();
    let mut inverse = Mat::<f64>::zeros(n, n);
    for column in 0..n {
        for i in column..n {
            let known: f64 = (column..i).map(|k| rows[i][k] * inverse[(k, column)]).sum();
            inverse[(i, column)] = (f64::from(u8::from(i == column)) - known) / rows[i][i];
        }
    }
    (kept, inverse)
}

/// Groups in parts, drawn once and for all.
fn folds(groups: usize) -> Vec<Vec<usize>> {
    let mut order: Vec<usize> = (0..groups).collect();
    order.shuffle(&mut ChaCha8Rng::seed_from_u64(0));
    let count = FOLDS.min(groups).max(1);
    (0..count).map(|k| order[k * groups / count..(k + 1) * groups / count].to_vec()).collect()
}

impl Score {
    pub(crate) fn rank(&self) -> usize {
        self.contributions.ncols()
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

/// Draws from the null: a row for each, +-1 for each group, then a normal deviate for each part of the calibration's
/// error.
pub(crate) struct Flips {
    draws: Mat<f64>,
    groups: usize,
}

impl Flips {
    pub(crate) fn draw(data: &Dataset, count: usize, seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let (groups, field) = (data.groups.len(), data.field_len());
        let mut out = Mat::<f64>::zeros(count, groups + field);
        for draw in 0..count {
            for g in 0..groups {
                out[(draw, g)] = if random.random::<bool>() { -1.0 } else { 1.0 };
            }
        }
        for draw in 0..count {
            for k in 0..field {
                out[(draw, groups + k)] = StandardNormal.sample(&mut random);
            }
        }
        Self { draws: out, groups }
    }

    fn count(&self) -> usize {
        self.draws.nrows()
    }
}

/// Share of flips beyond which a candidate's own scale is told.
const TAIL: f64 = 0.01;
/// The distribution of normal errors counts for this many tests: it finds what is far beyond noise, and else leaves the
/// levels to the flips.
const PARAMETRIC: f64 = 10.0;

/// For each candidate (each a list of variants' scores) its p-value, corrected for all that are given.
///
/// By flips: each candidate's best form is measured on the scale of its own flips, so that a form which is searched over
/// many shapes does not set the others' threshold, and the share of flips counts in which any candidate reaches as far
/// (P. H. Westfall, S. S. Young, Resampling-Based Multiple Testing, 1993, sec. 2.5). An effect that few groups carry,
/// a step near the end, can be flipped in few ways only; of such the p-value of normal errors with as many degrees of
/// freedom as groups is taken, times the number of forms and [`PARAMETRIC`], where that is less.
pub(crate) fn p_values(candidates: &[Vec<&Score>], flips: &Flips) -> Vec<f64> {
    let scores: Vec<&Score> = candidates.iter().flatten().copied().collect();
    let rank: usize = scores.iter().map(|score| score.rank()).sum();
    let mut contributions = Mat::<f64>::zeros(flips.draws.ncols(), rank);
    let mut first = 0;
    for score in &scores {
        contributions.as_mut().subcols_mut(first, score.rank()).copy_from(&score.contributions);
        first += score.rank();
    }
    let starts: Vec<usize> = (0..flips.count()).step_by(FLIP_BLOCK).collect();
    // For each draw: each candidate's best form.
    let best: Vec<Vec<f64>> = starts
        .par_iter()
        .flat_map_iter(|&start| {
            let count = FLIP_BLOCK.min(flips.count() - start);
            let along = flips.draws.subrows(start, count) * &contributions;
            let mut first = 0;
            let mut best = vec![vec![f64::NEG_INFINITY; candidates.len()]; count];
            for (c, variants) in candidates.iter().enumerate() {
                // Of forms of one rank the largest sum is the largest deviate.
                let mut largest: Vec<(usize, Vec<f64>)> = Vec::new();
                for score in variants {
                    let mut sums = vec![0.0; count];
                    for k in first..first + score.rank() {
                        sums.iter_mut().zip(along.col_as_slice(k)).for_each(|(sum, v)| *sum += v * v);
                    }
                    first += score.rank();
                    match largest.iter_mut().find(|(rank, _)| *rank == score.rank()) {
                        Some((_, most)) => most.iter_mut().zip(&sums).for_each(|(m, s)| *m = m.max(*s)),
                        None => largest.push((score.rank(), sums)),
                    }
                }
                for (rank, most) in &largest {
                    for (draw, sum) in best.iter_mut().zip(most) {
                        draw[c] = draw[c].max(deviate(*sum, *rank));
                    }
                }
            }
            best
        })
        .collect();
    let own: Vec<f64> = candidates
        .iter()
        .map(|variants| variants.iter().map(|score| score.deviate()).fold(f64::NEG_INFINITY, f64::max))
        .collect();
    // Middle and tail of each candidate's draws, the data themselves being one of them.
    let scales: Vec<(f64, f64)> = (0..candidates.len())
        .map(|c| {
            let mut draws: Vec<f64> = best.iter().map(|draw| draw[c]).collect();
            draws.push(own[c]);
            draws.sort_by(f64::total_cmp);
            let at = |share: f64| draws[((draws.len() - 1) as f64 * share).round() as usize];
            (at(0.5), (at(1.0 - TAIL) - at(0.5)).max(1e-9))
        })
        .collect();
    let scaled = |c: usize, value: f64| {
        if value == f64::NEG_INFINITY { value } else { (value - scales[c].0) / scales[c].1 }
    };
    let highest: Vec<f64> = best
        .iter()
        .map(|draw| draw.iter().enumerate().map(|(c, v)| scaled(c, *v)).fold(f64::NEG_INFINITY, f64::max))
        .collect();
    own.iter()
        .enumerate()
        .map(|(c, &own)| {
            if own == f64::NEG_INFINITY {
                return 1.0;
            }
            // Sums of flipped and unflipped order differ by rounding.
            let height = scaled(c, own);
            let reached = highest.iter().filter(|h| **h >= height - 1e-9 * height.abs()).count();
            let by_flips = (1 + reached) as f64 / (1 + flips.count()) as f64;
            let least = 1.0 / (1 + flips.count()) as f64;
            let normal = if flips.groups > 2 && own > 0.0 {
                PARAMETRIC * scores.len() as f64 * two_sided(own, flips.groups - 2)
            } else {
                1.0
            };
            by_flips.min(normal.max(least))
        })
        .collect()
}
