//! How uncertain the coefficients are, when points scatter otherwise towards the field's middle than across.

use faer::Mat;
use rayon::prelude::*;

use super::fit::Fit;
use super::noise::Weights;
use super::observations::Observations;

/// Covariance of the coefficients of x, then of those of y, after `change` of their basis; rad^2, row by row.
///
/// The fit weighs both axes of a point alike, so its coefficients are B = A X^T V^-1 u with A = (X^T V^-1 X)^-1 for either
/// axis. Their covariance is A X^T V^-1 S V^-1 X A (H. White, Econometrica 48, 1980) where S is the errors' own covariance:
/// of each point one of x and y, which long spots make correlated, and the exposures' common shifts. `reduced` is what the
/// fit's own weights were too large by. What the rings' coefficients are before any data counts as data.
pub(crate) fn covariance(
    observations: &Observations,
    fit: &Fit,
    weights: &Weights,
    reduced: f64,
    change: &Mat<f64>,
) -> Mat<f64> {
    let n = fit.basis.len();
    let of_exposure = |(_, range): &(usize, std::ops::Range<usize>)| {
        let mut rows = Mat::<f64>::zeros(range.len(), n);
        let mut values = vec![0.0; n];
        let mut total = 0.0;
        for (row, i) in range.clone().enumerate() {
            fit.basis.fill(observations.sight[i], observations.l[i], &mut values);
            let weight = weights.inverse_variance[i];
            total += weight;
            (0..n).for_each(|column| rows[(row, column)] = weight * values[column]);
        }
        // V^-1 = W - c w w^T, w the weights and c = t / (1 + t sum(w)) for a shift of variance t.
        let shared = weights.jitter_variance / (1.0 + weights.jitter_variance * total);
        let sums: Vec<f64> = (0..n).map(|column| rows.col(column).iter().sum()).collect();
        for (row, i) in range.clone().enumerate() {
            let part = shared * weights.inverse_variance[i];
            (0..n).for_each(|column| rows[(row, column)] -= part * sums[column]);
        }
        // The shift's own part is along what the rows sum up to.
        let shift = 1.0 - shared * total;
        let mut meat = Mat::<f64>::zeros(2 * n, 2 * n);
        let mut scaled = Mat::<f64>::zeros(range.len(), n);
        for (a, b) in [(0, 0), (0, 1), (1, 1)] {
            for (row, i) in range.clone().enumerate() {
                let own = weights.covariance(observations, i).col(b)[a];
                (0..n).for_each(|column| scaled[(row, column)] = own * rows[(row, column)]);
            }
            let block = rows.transpose() * &scaled;
            let common = if a == b { weights.jitter_variance * shift * shift } else { 0.0 };
            for i in 0..n {
                for j in 0..n {
                    let value = block[(i, j)] + common * sums[i] * sums[j];
                    meat[(a * n + i, b * n + j)] = value;
                    meat[(b * n + j, a * n + i)] = value;
                }
            }
        }
        meat
    };
    // In the exposures' order, so that the same points give the same bytes.
    let parts: Vec<Mat<f64>> = observations.exposures.par_iter().map(of_exposure).collect();
    let mut meat = Mat::<f64>::zeros(2 * n, 2 * n);
    parts.iter().for_each(|part| meat += part);
    for column in 0..n {
        let prior = fit.basis.prior(column) / reduced;
        meat[(column, column)] += prior;
        meat[(n + column, n + column)] += prior;
    }
    let half = reduced * change * &fit.inverse_normal;
    let mut out = Mat::<f64>::zeros(2 * n, 2 * n);
    for (a, b) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
        let block = &half * meat.submatrix(a * n, b * n, n, n) * half.transpose();
        out.submatrix_mut(a * n, b * n, n, n).copy_from(&block);
    }
    out
}
