//! The level of a group in whitened errors: what its rows have in common, as a number of unit variance for each component.

use std::ops::Range;

use glam::{DMat2, DVec2};

use crate::data::Dataset;
use crate::noise::Weights;

/// A group's rows as measurements of what they share. With T what makes a row's error isotropic and w its weight, the rows
/// of U are root(w) T; A = U^T U is what they know of the level. Of one component only the first counts.
pub(crate) struct Level {
    rows: Range<usize>,
    /// A^(-1/2); 0 where no row counts.
    pub(crate) root: DMat2,
    /// M, with which (I + v A)^(-1/2) = I - A M for a level of variance v: I - U M U^T whitens the rows.
    pub(crate) taken: DMat2,
    /// M (I - A M)^(-1), which undoes it.
    given: DMat2,
    /// A^(-1/2) (I - A M): from sums over the rows, U^T y, to the level of whitened rows.
    pub(crate) of_sums: DMat2,
}

/// f of a symmetric matrix.
fn of_symmetric(a: DMat2, f: impl Fn(f64) -> f64) -> DMat2 {
    let middle = 0.5 * (a.x_axis.x + a.y_axis.y);
    let (half, across) = (0.5 * (a.x_axis.x - a.y_axis.y), a.x_axis.y);
    let off = half.hypot(across);
    if off <= 1e-14 * middle.abs() {
        return DMat2::from_diagonal(DVec2::splat(f(middle)));
    }
    let (high, low) = (f(middle + off), f(middle - off));
    let turned = DMat2::from_cols(DVec2::new(half, across), DVec2::new(across, -half)) * (1.0 / off);
    DMat2::from_diagonal(DVec2::splat(0.5 * (high + low))) + turned * (0.5 * (high - low))
}

impl Weights {
    /// Of a group's rows.
    pub(crate) fn level(&self, data: &Dataset, rows: Range<usize>) -> Level {
        let sum: f64 = self.weight[rows.clone()].iter().sum();
        let information = match &data.isotropic_from_error {
            None => DMat2::from_diagonal(DVec2::splat(sum)),
            Some(of) => rows.clone().map(|row| of[row] * of[row] * self.weight[row]).sum(),
        };
        let kappa = |a: f64| 1.0 - 1.0 / (1.0 + self.jitter_variance * a).sqrt();
        let of = |f: &dyn Fn(f64) -> f64| if sum > 0.0 { of_symmetric(information, f) } else { DMat2::ZERO };
        Level {
            rows,
            root: of(&|a| 1.0 / a.sqrt()),
            taken: of(&|a| kappa(a) / a),
            given: of(&|a| kappa(a) / (1.0 - kappa(a)) / a),
            of_sums: of(&|a| (1.0 - kappa(a)) / a.sqrt()),
        }
    }
}

impl Level {
    /// Whether any row counts.
    pub(crate) fn counts(&self) -> bool {
        self.root != DMat2::ZERO
    }

    /// Variance of the whitened level, summed over the components, if groups did not scatter: the trace of (I + v A)^-1.
    pub(crate) fn variance_of_rows(&self, components: usize) -> f64 {
        let of_rows = self.of_sums * self.root.inverse();
        let along = |axis: DVec2| axis.length_squared();
        along(of_rows.x_axis) + if components == 2 { along(of_rows.y_axis) } else { 0.0 }
    }

    /// U^T y of whitened rows.
    fn sums(&self, data: &Dataset, weights: &Weights, white: &[f64]) -> DVec2 {
        let n = data.components();
        self.rows
            .clone()
            .map(|row| {
                let value = DVec2::new(white[row * n], if n == 2 { white[row * n + 1] } else { 0.0 });
                data.isotropic(row) * value * weights.weight[row].sqrt()
            })
            .sum()
    }

    /// The level of whitened rows.
    pub(crate) fn of(&self, data: &Dataset, weights: &Weights, white: &[f64]) -> DVec2 {
        self.root * self.sums(data, weights, white)
    }

    /// Changes the level of whitened rows.
    pub(crate) fn add(&self, data: &Dataset, weights: &Weights, white: &mut [f64], change: DVec2) {
        self.add_along(data, weights, white, self.root * change);
    }

    /// Undoes the whitening of rows for a level.
    pub(crate) fn give_back(&self, data: &Dataset, weights: &Weights, white: &mut [f64]) {
        let change = self.given * self.sums(data, weights, white);
        self.add_along(data, weights, white, change);
    }

    /// White rows plus U c.
    fn add_along(&self, data: &Dataset, weights: &Weights, white: &mut [f64], c: DVec2) {
        let n = data.components();
        for row in self.rows.clone() {
            let along = (data.isotropic(row) * c * weights.weight[row].sqrt()).to_array();
            white[row * n..(row + 1) * n].iter_mut().zip(along).for_each(|(value, along)| *value += along);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A turned matrix of eigenvalues 4 and 9 has the root of eigenvalues 2 and 3 along the same axes.
    #[test]
    fn functions_of_matrices_keep_their_axes() {
        let turn = DMat2::from_angle(0.7);
        let of = |x: f64, y: f64| turn * DMat2::from_diagonal(DVec2::new(x, y)) * turn.transpose();
        assert!(of_symmetric(of(4.0, 9.0), f64::sqrt).abs_diff_eq(of(2.0, 3.0), 1e-12));
        assert!(of_symmetric(of(4.0, 4.0), f64::sqrt).abs_diff_eq(of(2.0, 2.0), 1e-12));
    }
}
