//! D at the reference irradiance, so that D and D^-1 undo each other over the calibrated field.

use faer::Mat;
use faer::linalg::solvers::SolveLstsq as _;
use glam::DVec2;
use retina_geometry::{CalibratedField, Distortion, InverseDistortion, MAX_DEGREE, Pinhole};

use super::form::{ModelForm, Scaling, Term};

/// The direct polynomial of eq. "r = D(r_u, beta)", fitted to the inverse of D^-1.
#[derive(Debug, Clone, PartialEq)]
pub struct DirectFit {
    /// Rows (i, j, a, b).
    pub terms: Vec<(u32, u32, f64, f64)>,
    /// Its degree.
    pub degree: u32,
    /// Largest angle between D(D^-1(r)) and r over the calibrated field, arcsec.
    pub worst_arcsec: f64,
    /// Root of the mean square of that angle, arcsec.
    pub rms_arcsec: f64,
}

/// D and D^-1 are inverse to each other to this, arcsec.
const WANTED_ARCSEC: f64 = 0.01;

/// Weights of places beyond the field, where D^-1 is extrapolated: D is to keep its orientation there, no more. The
/// heavier ones are for where it does not.
const BEYOND_WEIGHTS: [f64; 4] = [1e-4, 1e-3, 1e-2, 0.1];

/// Fits D of the lowest degree that undoes `inverse` (D^-1, at its reference irradiance) over its field to 0.01 arcsec, or
/// else the best there is: rings are followed as far as polynomials do. `None` where D^-1 cannot be inverted somewhere on
/// the screen, or every D folds over there.
pub(crate) fn fit(inverse: &InverseDistortion, screen: &Pinhole) -> Option<DirectFit> {
    let field = inverse.field?;
    let reference = inverse.reference_log10_irradiance;
    let size = DVec2::new(f64::from(screen.width_px), f64::from(screen.height_px));
    let whole = [screen.line_of_sight(DVec2::ZERO), screen.line_of_sight(size)];
    let within = |at: &DVec2| field.held(*at) == *at;
    let mut undistorted: Vec<DVec2> = chebyshev(whole).collect();
    let mut sights: Vec<DVec2> =
        undistorted.iter().map(|at| inverse.distort(*at, reference)).collect::<Result<_, _>>().ok()?;
    let mut seen = sights.iter().map(within);
    undistorted.retain(|_| !seen.next().unwrap_or(false));
    sights.retain(|sight| !within(sight));
    let beyond = sights.len();
    sights.extend(chebyshev([field.low, field.high]).filter(within));
    undistorted.extend(sights[beyond..].iter().map(|sight| inverse.undistort(*sight, reference)));
    let scaling = Scaling::of(undistorted.iter().map(|u| (*u, 0.0)));
    let mut best: Option<DirectFit> = None;
    for degree in inverse.degree().max(3)..=MAX_DEGREE {
        let terms = ModelForm::plain(degree).terms();
        for beyond_weight in BEYOND_WEIGHTS {
            let weight = |row: usize| if row < beyond { beyond_weight } else { 1.0 };
            let rows = least_squares(&undistorted, &sights, weight, &terms, &scaling);
            let direct = Distortion::from_terms(&rows);
            if direct.check_over(screen).is_err() {
                continue;
            }
            let (worst_arcsec, rms_arcsec) = errors(&direct, inverse, &field);
            if best.as_ref().is_none_or(|best| worst_arcsec < best.worst_arcsec) {
                best = Some(DirectFit { terms: rows, degree, worst_arcsec, rms_arcsec });
            }
            break;
        }
        if best.as_ref().is_some_and(|best| best.worst_arcsec <= WANTED_ARCSEC) {
            break;
        }
    }
    best
}

/// Rows (i, j, a, b) of the polynomial through these pairs.
fn least_squares(
    undistorted: &[DVec2],
    sights: &[DVec2],
    weight: impl Fn(usize) -> f64,
    terms: &[Term],
    scaling: &Scaling,
) -> Vec<(u32, u32, f64, f64)> {
    let n = terms.len();
    let mut values = vec![0.0; n];
    let mut matrix = Mat::<f64>::zeros(undistorted.len(), n);
    for (row, u) in undistorted.iter().enumerate() {
        scaling.fill(*u, 0.0, terms, &mut values);
        for (column, value) in values.iter().enumerate() {
            matrix[(row, column)] = *value * weight(row);
        }
    }
    let right = Mat::<f64>::from_fn(sights.len(), 2, |row, axis| sights[row][axis] * weight(row));
    let solution = matrix.qr().solve_lstsq(&right);
    let change = scaling.monomials_from_basis(terms);
    let monomial =
        |row: usize, axis: usize| -> f64 { (0..n).map(|c| change[row * n + c] * solution[(c, axis)]).sum() };
    terms.iter().enumerate().map(|(i, t)| (t[0], t[1], monomial(i, 0), monomial(i, 1))).collect()
}

/// Chebyshev's places in a rectangle, denser towards its edges, where the error of a polynomial is largest.
fn chebyshev([low, high]: [DVec2; 2]) -> impl Iterator<Item = DVec2> {
    const SIDE: usize = 40;
    let place = |i: usize| 0.5 - 0.5 * (std::f64::consts::PI * (i as f64 + 0.5) / SIDE as f64).cos();
    (0..SIDE * SIDE).map(move |i| low + DVec2::new(place(i % SIDE), place(i / SIDE)) * (high - low))
}

/// Largest angle between D(D^-1(r)) and r on a regular grid over the field, its border included, and the root of the mean
/// square, arcsec.
fn errors(direct: &Distortion, inverse: &InverseDistortion, field: &CalibratedField) -> (f64, f64) {
    const SIDE: u32 = 60;
    let (mut worst, mut squares, mut count) = (0.0f64, 0.0, 0.0);
    for row in 0..=SIDE {
        for column in 0..=SIDE {
            let share = DVec2::new(f64::from(column), f64::from(row)) / f64::from(SIDE);
            let sight = field.low + share * (field.high - field.low);
            if field.held(sight) != sight {
                continue;
            }
            let back = direct.distort(inverse.undistort(sight, inverse.reference_log10_irradiance));
            let angle = super::errors::angle_arcsec(back, sight);
            worst = worst.max(angle);
            squares += angle * angle;
            count += 1.0;
        }
    }
    (worst, (squares / f64::max(count, 1.0)).sqrt())
}
