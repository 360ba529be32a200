//! Small dense matrices, rows first.

use faer::linalg::solvers::Solve as _;
use faer::{Mat, Side};

/// Position and velocity.
pub type Vector6 = [f64; 6];
/// A covariance or a transition of them.
pub type Matrix6 = [[f64; 6]; 6];

/// A B.
pub fn product<const N: usize, const M: usize, const K: usize>(
    a: &[[f64; M]; N],
    b: &[[f64; K]; M],
) -> [[f64; K]; N] {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..M).map(|k| a[i][k] * b[k][j]).sum()))
}

/// A B^T.
pub fn product_transposed<const N: usize, const M: usize, const K: usize>(
    a: &[[f64; M]; N],
    b: &[[f64; M]; K],
) -> [[f64; K]; N] {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..M).map(|k| a[i][k] * b[j][k]).sum()))
}

/// x^T P^-1 x of a covariance; `None` where it is not positive definite.
pub fn quadratic_form_inverse(covariance: &Matrix6, x: &Vector6) -> Option<f64> {
    // Scaled to unit variances: metres and metres a second differ by many digits.
    let scale: [f64; 6] = std::array::from_fn(|i| covariance[i][i].sqrt());
    let llt = Mat::from_fn(6, 6, |i, j| covariance[i][j] / (scale[i] * scale[j])).llt(Side::Lower).ok()?;
    let scaled = Mat::from_fn(6, 1, |i, _| x[i] / scale[i]);
    let solved = llt.solve(&scaled);
    Some((0..6).map(|i| scaled[(i, 0)] * solved[(i, 0)]).sum())
}

/// The lower Cholesky factor of a covariance, to draw errors from it; `None` where it is not positive definite.
pub fn cholesky(covariance: &Matrix6) -> Option<Matrix6> {
    let llt = Mat::from_fn(6, 6, |i, j| covariance[i][j]).llt(Side::Lower).ok()?;
    Some(std::array::from_fn(|i| std::array::from_fn(|j| if j <= i { llt.L()[(i, j)] } else { 0.0 })))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_covariance_of_metres_and_metres_a_second() {
        let mut p = [[0.0; 6]; 6];
        for i in 0..6 {
            p[i][i] = if i < 3 { 1e16 } else { 1e-4 };
        }
        p[0][3] = 0.5e6;
        p[3][0] = 0.5e6;
        // Correlation 0.5 between two unit deviations: x^T P^-1 x of (1, 1) sigma is 2 / 1.5.
        let found = quadratic_form_inverse(&p, &[1e8, 0.0, 0.0, 1e-2, 0.0, 0.0]).unwrap();
        assert!((found - 2.0 / 1.5).abs() < 1e-12, "{found}");
        let l = cholesky(&p).unwrap();
        assert!((product_transposed(&l, &l)[0][3] - 0.5e6).abs() < 1e-3);
        p[0][3] = 2e6;
        p[3][0] = 2e6;
        assert!(quadratic_form_inverse(&p, &[0.0; 6]).is_none());
    }
}
