//! How sure a fitted model is of the line of sight, over the rows and over the whole field.

use faer::Mat;

use crate::data::{Baseline, Dataset};
use crate::field::Held;
use crate::linear::{Basis, cholesky};
use crate::screens::legendre;

/// Errors of the model's prediction over the rows, as independent columns of unit variance: those of the fitted
/// coefficients (with P = L L^T their covariance and B their columns: B L), then those of a calibration that is held
/// fixed. `None` where the covariance is none.
pub(crate) fn independent_errors(
    data: &Dataset,
    base: &[Vec<f64>],
    sigma: &[f64],
    correlation: &[Vec<f64>],
) -> Option<Vec<Vec<f64>>> {
    let n = base.len();
    let factor = cholesky(&Mat::from_fn(n, n, |i, j| correlation[i][j]))?;
    let mut out: Vec<Vec<f64>> = (0..n)
        .map(|k| {
            let mut column = vec![0.0; data.y.len()];
            for (j, base) in base.iter().enumerate().skip(k) {
                let weight = sigma[j] * factor[(j, k)];
                column.iter_mut().zip(base).for_each(|(sum, value)| *sum += weight * value);
            }
            column
        })
        .collect();
    out.extend(data.field().into_iter().flat_map(|field| field.known.iter().cloned()));
    Some(out)
}

/// Standard deviations and correlations of a covariance; a variance of 0 is correlated with nothing.
pub(crate) fn correlation_of(covariance: &[Vec<f64>]) -> (Vec<f64>, Vec<Vec<f64>>) {
    let sigma: Vec<f64> = (0..covariance.len()).map(|i| covariance[i][i].sqrt()).collect();
    let entry = |i: usize, j: usize| {
        let scale = sigma[i] * sigma[j];
        if scale > 0.0 { covariance[i][j] / scale } else { f64::from(u8::from(i == j)) }
    };
    let correlation = (0..sigma.len()).map(|i| (0..sigma.len()).map(|j| entry(i, j)).collect()).collect();
    (sigma, correlation)
}

/// Rows over which errors are continued.
const SAMPLE: usize = 1500;
/// Degree to which they are, where no polynomial of the model has a higher one.
const DEGREE: u32 = 7;
/// Rows that each coefficient needs.
const ROWS_PER_TERM: usize = 4;

/// The model's uncertainty at places of the field.
pub(crate) struct Spread {
    /// Standard deviation per axis, arcsec.
    pub(crate) sigma: Vec<f64>,
    /// Share of the error's squares that is no function of the place: that of the other columns.
    pub(crate) elsewhere: f64,
}

/// The model's uncertainty at `places` (x, y of the data) within a box of `half` extents, in the first mounting. Its errors
/// over the rows are continued as polynomials of the place, which most of them are; columns beside the place are at their
/// means. `None` of few points, and beside a calibration that states no covariance.
pub(crate) fn spread(
    data: &Dataset,
    errors: &[Vec<f64>],
    places: &[[f64; 2]],
    half: [f64; 2],
) -> Option<Spread> {
    let first: Vec<usize> = (0..data.len()).filter(|&row| data.mounting[row] == 0).collect();
    let rows: Vec<usize> = first.iter().copied().step_by(first.len().div_ceil(SAMPLE).max(1)).collect();
    let (x, y) = (data.values("x"), data.values("y"));
    let known: Vec<[f64; 2]> = rows.iter().map(|&row| [x[row], y[row]]).collect();
    let of_axis = |error: &Vec<f64>, axis: usize| rows.iter().map(|&row| error[2 * row + axis]).collect();
    let by_axis: Vec<[Vec<f64>; 2]> = errors.iter().map(|e| [of_axis(e, 0), of_axis(e, 1)]).collect();
    let held = match &data.held {
        // Its own error would be missing, which is most of all.
        Some(Held::Geometry(model)) if !model.has_covariance() => return None,
        Some(Held::Geometry(model)) => model.degree(),
        _ => 0,
    };
    let degree = match data.baseline {
        Baseline::Polynomial(degree) => held.max(degree),
        _ => held,
    };
    continued(&known, &by_axis, places, half, degree.max(DEGREE) as usize)
}

/// Errors at known places as polynomials of at most a degree, and their sum in squares at others.
fn continued(
    known: &[[f64; 2]],
    errors: &[[Vec<f64>; 2]],
    places: &[[f64; 2]],
    half: [f64; 2],
    most: usize,
) -> Option<Spread> {
    let terms_of = |degree: usize| (degree + 1) * (degree + 2) / 2;
    let degree = (0..=most).rev().find(|&degree| ROWS_PER_TERM * terms_of(degree) <= known.len())?;
    let terms = |at: &[f64]| -> Vec<f64> {
        let along = |axis: usize| -> Vec<f64> {
            let t = at[axis] / half[axis];
            std::iter::once(1.0).chain(legendre(t, degree.max(1))).collect()
        };
        let (px, py) = (along(0), along(1));
        (0..=degree).flat_map(|i| (0..=degree - i).map(move |j| (i, j))).map(|(i, j)| px[i] * py[j]).collect()
    };
    let at_known: Vec<Vec<f64>> = known.iter().map(|at| terms(at)).collect();
    let basis = Basis::of((0..terms_of(degree)).map(|k| at_known.iter().map(|t| t[k]).collect()));
    let at_places: Vec<Vec<f64>> = places.iter().map(|at| terms(at)).collect();
    let mut variance = vec![0.0; places.len()];
    let (mut all, mut left) = (0.0, 0.0);
    for error in errors.iter().flatten() {
        let coefficients = basis.coefficients(error);
        for (sum, terms) in variance.iter_mut().zip(&at_places) {
            *sum += terms.iter().zip(&coefficients).map(|(t, c)| t * c).sum::<f64>().powi(2) / 2.0;
        }
        all += error.iter().map(|e| e * e).sum::<f64>();
        left += basis.residual(error.clone()).iter().map(|e| e * e).sum::<f64>();
    }
    let elsewhere = if all > 0.0 { left / all } else { 0.0 };
    Some(Spread { sigma: variance.into_iter().map(f64::sqrt).collect(), elsewhere })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A straight line a + b x along x and c + d x y along y, of known variances: sigma per axis is the root of
    /// (a^2 + b^2 x^2 + c^2 + d^2 x^2 y^2) / 2, at measured places and beyond them alike. What alternates from row to row
    /// is no function of the place.
    #[test]
    fn sigma_is_that_of_the_closed_form_beyond_the_points_too() {
        let known: Vec<[f64; 2]> = (0..400)
            .map(|i| {
                let t = f64::from(i);
                [(t * 0.754_877_67).fract() - 0.5, (t * 0.569_840_29).fract() - 0.5]
            })
            .collect();
        let of = |f: &dyn Fn(usize, &[f64; 2]) -> f64| -> Vec<f64> {
            known.iter().enumerate().map(|(i, at)| f(i, at)).collect()
        };
        let zero = || of(&|_, _| 0.0);
        let (a, b, c, d) = (0.3, 0.8, 0.1, 2.0);
        let errors = vec![
            [of(&|_, _| a), zero()],
            [of(&|_, at| b * at[0]), zero()],
            [zero(), of(&|_, _| c)],
            [zero(), of(&|_, at| d * at[0] * at[1])],
        ];
        let places = [[0.0, 0.0], [0.4, -0.3], [1.0, 0.9]];
        let found = continued(&known, &errors, &places, [1.0, 1.0], 7).unwrap();
        for ([x, y], sigma) in places.into_iter().zip(found.sigma) {
            let truth = ((a * a + b * b * x * x + c * c + d * d * x * x * y * y) / 2.0).sqrt();
            assert!((sigma / truth - 1.0).abs() < 1e-6, "{x} {y}: {sigma} {truth}");
        }
        assert!(found.elsewhere < 1e-12);
        let other = [[of(&|i, _| if i % 2 == 0 { 1.0 } else { -1.0 }), zero()]];
        assert!(continued(&known, &other, &places, [1.0, 1.0], 7).unwrap().elsewhere > 0.8);
        assert!(continued(&known[..3], &other, &places, [1.0, 1.0], 7).is_none());
    }
}
