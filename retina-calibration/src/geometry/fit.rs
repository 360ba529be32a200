//! Linear least squares of eq. 15 with weights and with common shifts of exposures as a variance component.

use faer::linalg::matmul::triangular::{BlockStructure, matmul};
use faer::linalg::solvers::Solve as _;
use faer::{Accum, Mat, Par, Side};
use glam::DVec2;
use rayon::prelude::*;

use super::form::Basis;
use super::noise::{Robust, Weights};
use super::observations::Observations;

/// What the normal equations of a group of exposures hold: [X | y]^T V^-1 [X | y], the two axes' y last.
#[derive(Debug, Clone)]
pub(crate) struct Gram {
    pub(crate) matrix: Mat<f64>,
    /// Sum of the weights of its points.
    pub(crate) weight: f64,
}

/// A fitted form in scaled coordinates.
#[derive(Debug, Clone)]
pub(crate) struct Fit {
    pub(crate) basis: Basis,
    /// Coefficients (of x, of y) of the basis functions.
    pub(crate) coefficients: Vec<DVec2>,
    /// (X^T V^-1 X)^-1 of either axis, rad^2: the coefficients' covariance if V, which is the same along both axes, held.
    pub(crate) inverse_normal: Mat<f64>,
}

/// Rows V^(-1/2) [X | y] of one exposure.
fn whitened_block(
    observations: &Observations,
    exposure: usize,
    basis: &Basis,
    target: &[DVec2],
    weights: &Weights,
) -> Mat<f64> {
    let range = observations.exposures[exposure].1.clone();
    let n = basis.len();
    let mut block = Mat::<f64>::zeros(range.len(), n + 2);
    let mut values = vec![0.0; n + 2];
    let roots: Vec<f64> = weights.inverse_variance[range.clone()].iter().map(|w| w.sqrt()).collect();
    for (row, i) in range.enumerate() {
        basis.fill(observations.sight[i], observations.l[i], &mut values[..n]);
        values[n] = target[i].x;
        values[n + 1] = target[i].y;
        for (column, value) in values.iter().enumerate() {
            block[(row, column)] = roots[row] * value;
        }
    }
    let sum: f64 = roots.iter().map(|root| root * root).sum();
    let kappa = weights.whitening(sum);
    if kappa > 0.0 {
        for column in 0..n + 2 {
            let column = block.col_as_slice_mut(column);
            let along: f64 = column.iter().zip(&roots).map(|(value, root)| value * root).sum::<f64>() / sum;
            for (value, root) in column.iter_mut().zip(&roots) {
                *value -= kappa * along * root;
            }
        }
    }
    block
}

/// The normal equations of each group of exposures, in the groups' order.
pub(crate) fn grams(
    observations: &Observations,
    groups: &[Vec<usize>],
    basis: &Basis,
    target: &[DVec2],
    weights: &Weights,
) -> Vec<Gram> {
    let n = basis.len();
    groups
        .par_iter()
        .map(|group| {
            let mut matrix = Mat::<f64>::zeros(n + 2, n + 2);
            let mut weight = 0.0;
            for &exposure in group {
                let block = whitened_block(observations, exposure, basis, target, weights);
                let (lower, full) = (BlockStructure::TriangularLower, BlockStructure::Rectangular);
                matmul(&mut matrix, lower, Accum::Add, block.transpose(), full, &block, full, 1.0, Par::Seq);
                let range = observations.exposures[exposure].1.clone();
                weight += weights.inverse_variance[range].iter().sum::<f64>();
            }
            for i in 0..n + 2 {
                for j in i + 1..n + 2 {
                    matrix[(i, j)] = matrix[(j, i)];
                }
            }
            Gram { matrix, weight }
        })
        .collect()
}

impl Gram {
    pub(crate) fn sum<'a>(grams: impl Iterator<Item = &'a Self>) -> Option<Self> {
        let mut total: Option<Self> = None;
        for gram in grams {
            match &mut total {
                None => total = Some(gram.clone()),
                Some(sum) => {
                    sum.matrix += &gram.matrix;
                    sum.weight += gram.weight;
                }
            }
        }
        total
    }

    /// What is left when a part is taken out.
    pub(crate) fn without(&self, part: &Self) -> Self {
        Self { matrix: &self.matrix - &part.matrix, weight: self.weight - part.weight }
    }

    /// Solves for the coefficients of some of the columns of a basis; `None` where they are not independent.
    pub(crate) fn solve(&self, basis: &Basis, columns: &[usize]) -> Option<Vec<DVec2>> {
        let (n, all) = (columns.len(), self.matrix.nrows() - 2);
        let normal = Mat::<f64>::from_fn(n, n, |i, j| {
            let prior = if i == j { basis.prior(columns[i]) } else { 0.0 };
            self.matrix[(columns[i], columns[j])] + prior
        });
        let right = Mat::<f64>::from_fn(n, 2, |i, axis| self.matrix[(columns[i], all + axis)]);
        let solution = normal.llt(Side::Lower).ok()?.solve(&right);
        let out: Vec<DVec2> = (0..n).map(|i| DVec2::new(solution[(i, 0)], solution[(i, 1)])).collect();
        out.iter().all(|c| c.is_finite()).then_some(out)
    }

    /// Sum over both axes of the whitened squared residuals of coefficients of some of the columns.
    pub(crate) fn squares(&self, columns: &[usize], coefficients: &[DVec2]) -> f64 {
        let all = self.matrix.nrows() - 2;
        let mut total = self.matrix[(all, all)] + self.matrix[(all + 1, all + 1)];
        for (i, &row) in columns.iter().enumerate() {
            let right = DVec2::new(self.matrix[(row, all)], self.matrix[(row, all + 1)]);
            let mut product = DVec2::ZERO;
            for (j, &column) in columns.iter().enumerate() {
                product += coefficients[j] * self.matrix[(row, column)];
            }
            total += coefficients[i].dot(product - 2.0 * right);
        }
        total
    }
}

impl Fit {
    /// Weighted least squares by QR: each group's rows to a triangle, the triangles stacked to one, and the prior's rows
    /// under them. `None` where the data do not determine the form.
    pub(crate) fn by_qr(
        observations: &Observations,
        groups: &[Vec<usize>],
        basis: &Basis,
        weights: &Weights,
    ) -> Option<Self> {
        let n = basis.len();
        let mut triangles: Vec<Mat<f64>> = groups
            .par_iter()
            .map(|group| {
                let blocks: Vec<Mat<f64>> = group
                    .iter()
                    .map(|&e| whitened_block(observations, e, basis, &observations.undistorted, weights))
                    .collect();
                triangle(&blocks, n + 2)
            })
            .collect();
        triangles.push(prior_block(basis));
        let r = triangle(&triangles, n + 2);
        if !coefficients_are_determined(&r, n) {
            return None;
        }
        let mut coefficients = vec![DVec2::ZERO; n];
        for i in (0..n).rev() {
            let mut sum = DVec2::new(r[(i, n)], r[(i, n + 1)]);
            for j in i + 1..n {
                sum -= coefficients[j] * r[(i, j)];
            }
            coefficients[i] = sum / r[(i, i)];
        }
        // R^-1, column by column; the normal matrix's inverse is R^-1 R^-T.
        let mut inverse = Mat::<f64>::zeros(n, n);
        for column in 0..n {
            inverse[(column, column)] = 1.0 / r[(column, column)];
            for i in (0..column).rev() {
                let sum: f64 = (i + 1..=column).map(|j| r[(i, j)] * inverse[(j, column)]).sum();
                inverse[(i, column)] = -sum / r[(i, i)];
            }
        }
        let inverse_normal = &inverse * inverse.transpose();
        Some(Self { basis: basis.clone(), coefficients, inverse_normal })
    }

    /// D^-1(r) at L for every observation.
    pub(crate) fn predict(&self, observations: &Observations) -> Vec<DVec2> {
        predict(observations, &self.basis, &self.coefficients)
    }
}

/// What the coefficients are before any data, as rows.
fn prior_block(basis: &Basis) -> Mat<f64> {
    let n = basis.len();
    let first = basis.terms.len();
    Mat::from_fn(
        n - first,
        n + 2,
        |row, column| {
            if column == first + row { basis.prior(column).sqrt() } else { 0.0 }
        },
    )
}

/// Whether no column of a triangle is, to rounding, made up of those before it.
fn coefficients_are_determined(r: &Mat<f64>, columns: usize) -> bool {
    let largest = (0..columns).map(|i| r[(i, i)].abs()).fold(0.0, f64::max);
    (0..columns).all(|i| r[(i, i)].abs() > 1e-11 * largest)
}

/// The upper triangle of a QR decomposition of stacked blocks, `columns` wide.
fn triangle(blocks: &[Mat<f64>], columns: usize) -> Mat<f64> {
    let rows: usize = blocks.iter().map(Mat::nrows).sum();
    // At least as many rows as columns, so that the triangle is square.
    let mut stacked = Mat::<f64>::zeros(rows.max(columns), columns);
    let mut top = 0;
    for block in blocks {
        stacked.as_mut().subrows_mut(top, block.nrows()).copy_from(block);
        top += block.nrows();
    }
    let qr = stacked.qr();
    let mut r = qr.thin_R().to_owned();
    for i in 0..columns {
        for j in 0..i {
            r[(i, j)] = 0.0;
        }
    }
    r
}

/// Values of a form at every observation.
pub(crate) fn predict(observations: &Observations, basis: &Basis, coefficients: &[DVec2]) -> Vec<DVec2> {
    let indices: Vec<usize> = (0..observations.len()).collect();
    indices
        .par_chunks(1024)
        .flat_map_iter(|chunk| {
            let mut values = vec![0.0; basis.len()];
            chunk
                .iter()
                .map(|&i| {
                    basis.fill(observations.sight[i], observations.l[i], &mut values);
                    values.iter().zip(coefficients).map(|(value, c)| *c * *value).sum::<DVec2>()
                })
                .collect::<Vec<_>>()
        })
        .collect()
}

/// Weights and outliers by iterated re-weighting with a form that can follow the data; `None` where it is not determined.
pub(crate) fn robust_weights(
    observations: &Observations,
    groups: &[Vec<usize>],
    basis: &Basis,
    rounds: &[Robust],
    mut weights: Weights,
) -> Option<(Weights, Vec<DVec2>)> {
    let columns: Vec<usize> = (0..basis.len()).collect();
    let mut coefficients = Vec::new();
    for &robust in rounds {
        let grams = grams(observations, groups, basis, &observations.undistorted, &weights);
        coefficients = Gram::sum(grams.iter())?.solve(basis, &columns)?;
        let fitted = predict(observations, basis, &coefficients);
        let residuals: Vec<DVec2> =
            observations.undistorted.iter().zip(&fitted).map(|(u, f)| *u - *f).collect();
        weights.update(observations, &residuals, columns.len(), basis.form.irradiance_power as usize, robust);
    }
    Some((weights, coefficients))
}
