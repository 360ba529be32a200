//! Errors of units that a model has not seen.

use std::ops::Range;

use faer::linalg::matmul::matmul;
use faer::linalg::triangular_solve::{solve_lower_triangular_in_place, solve_upper_triangular_in_place};
use faer::{Accum, Mat, Par};
use once_cell::race::OnceBox;
use rand::SeedableRng as _;
use rand::seq::SliceRandom as _;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::Frame;
use crate::linear::{cholesky, dot, matrix, solve_positive};
use crate::units::Units;

/// Units are left out in this many parts.
const FOLDS: usize = 10;
/// What is added to a diagonal, of columns of unit length.
const LITTLE: f64 = 1e-9;

/// A part of the units with what leaving it out needs.
pub(super) struct Fold {
    /// Ranges of rows, each with its unit.
    ranges: Vec<(Range<usize>, usize)>,
    /// The base's normal equations without them: L of A = L L^T, and L^-1 of the right side; `None` where A has no factor.
    normal: Option<(Mat<f64>, Mat<f64>)>,
}

/// Held-out errors of a model.
#[derive(Clone)]
pub(crate) struct HeldOut {
    /// Whitened squares of each unit when it was left out.
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

impl Frame<'_> {
    /// The same frame, of which runs of rows are left out instead of whole groups: for what one group alone can tell.
    pub(crate) fn leaving_out_rows(mut self) -> Self {
        self.units = Units::runs_of_rows(self.data);
        self.folds = OnceBox::new();
        self
    }

    /// Parts of the units with what the base needs for leaving them out.
    fn folds(&self) -> &[Fold] {
        self.folds.get_or_init(|| Box::new(self.made_folds()))
    }

    fn made_folds(&self) -> Vec<Fold> {
        folds(self.units.count)
            .into_par_iter()
            .map(|units| {
                let ranges: Vec<_> = units
                    .iter()
                    .flat_map(|&unit| self.units.of_unit(unit).map(move |range| (range, unit)))
                    .collect();
                let k = self.q.ncols();
                let mut a = Mat::<f64>::zeros(k, k);
                let mut right = Mat::<f64>::from_fn(k, 1, |i, _| dot(&self.basis.q[i], &self.y));
                for span in self.spans(&ranges) {
                    let q = self.q.subrows(span.start, span.len());
                    matmul(a.as_mut(), Accum::Add, q.transpose(), q, -1.0, Par::Seq);
                    for (i, q) in self.basis.q.iter().enumerate() {
                        right[(i, 0)] -= dot(&q[span.clone()], &self.y[span.clone()]);
                    }
                }
                // A direction that these groups alone have is left at 0.
                (0..k).for_each(|i| a[(i, i)] += 1.0 + LITTLE);
                let normal = cholesky(&a).map(|l| {
                    solve_lower_triangular_in_place(l.as_ref(), right.as_mut(), Par::Seq);
                    (l, right)
                });
                Fold { ranges, normal }
            })
            .collect()
    }

    /// Makes the folds, so that tasks side by side do not each make their own.
    pub(crate) fn make_folds(&self) {
        self.folds();
    }

    fn spans(&self, ranges: &[(Range<usize>, usize)]) -> Vec<Range<usize>> {
        let n = self.data.kind.components();
        ranges.iter().map(|(rows, _)| rows.start * n..rows.end * n).collect()
    }

    /// Held-out errors of the base with further columns.
    ///
    /// With q the base's directions, d further ones and those of a fold taken off, the normal equations are
    /// (A, B; B^T, D) (x, w) = (r, s). With A = L L^T, Y = L^-1 B and z = L^-1 r: (D - Y^T Y) w = s - Y^T z, and
    /// x = L^-T (z - Y w).
    pub(crate) fn held_out(&self, columns: &[Vec<f64>]) -> HeldOut {
        let directions = self.directions(columns);
        let (base, further) = (self.q.ncols(), directions.len());
        let d = if further == 0 { Mat::zeros(self.y.len(), 0) } else { matrix(&directions) };
        let mut error = self.y[..self.data.y.len()].to_vec();
        let mut loss = vec![0.0; self.units.count];
        for fold in self.folds() {
            let spans = self.spans(&fold.ranges);
            let mut across = Mat::<f64>::zeros(base, further);
            let mut own = Mat::<f64>::identity(further, further);
            let mut right = Mat::<f64>::from_fn(further, 1, |i, _| dot(&directions[i], &self.y));
            for span in &spans {
                let [q, d] = [&self.q, &d].map(|all| all.subrows(span.start, span.len()));
                matmul(across.as_mut(), Accum::Add, q.transpose(), d, -1.0, Par::Seq);
                matmul(own.as_mut(), Accum::Add, d.transpose(), d, -1.0, Par::Seq);
                for (i, direction) in directions.iter().enumerate() {
                    right[(i, 0)] -= dot(&direction[span.clone()], &self.y[span.clone()]);
                }
            }
            let solved = fold.normal.as_ref().and_then(|(l, z)| {
                solve_lower_triangular_in_place(l.as_ref(), across.as_mut(), Par::Seq);
                let normal = &own - across.transpose() * &across;
                let right = &right - across.transpose() * z;
                let normal: Vec<f64> = (0..further * further)
                    .map(|at| {
                        normal[(at / further, at % further)]
                            + if at / further == at % further { LITTLE } else { 0.0 }
                    })
                    .collect();
                let right: Vec<f64> = (0..further).map(|i| right[(i, 0)]).collect();
                let w = solve_positive(&normal, &right)?;
                let w = Mat::<f64>::from_fn(further, 1, |i, _| w[i]);
                let mut x = z - &across * &w;
                solve_upper_triangular_in_place(l.transpose(), x.as_mut(), Par::Seq);
                Some((x, w))
            });
            for ((_, unit), span) in fold.ranges.iter().zip(&spans) {
                if let Some((x, w)) = &solved {
                    let predicted =
                        self.q.subrows(span.start, span.len()) * x + d.subrows(span.start, span.len()) * w;
                    error[span.clone()].iter_mut().zip(predicted.col_as_slice(0)).for_each(|(e, p)| *e -= p);
                }
                loss[*unit] += dot(&error[span.clone()], &error[span.clone()]);
            }
        }
        let n = self.data.kind.components();
        self.weights.unwhiten(self.data, &mut error);
        HeldOut {
            loss,
            rms: self.weights.rms(n, &error),
            rms_unweighted: self.weights.rms_unweighted(n, &error),
        }
    }
}

/// Units in parts, drawn once and for all.
fn folds(units: usize) -> Vec<Vec<usize>> {
    let mut order: Vec<usize> = (0..units).collect();
    order.shuffle(&mut ChaCha8Rng::seed_from_u64(0));
    let count = FOLDS.min(units).max(1);
    (0..count).map(|k| order[k * units / count..(k + 1) * units / count].to_vec()).collect()
}
