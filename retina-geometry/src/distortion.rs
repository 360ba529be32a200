//! D, the facility's distortion as a bivariate polynomial on lines of sight.

use glam::{DMat2, DVec2};

use crate::Pinhole;

/// Highest total degree of the polynomial.
pub const MAX_DEGREE: u32 = 13;

/// Number of monomials x^i y^j with i + j <= `degree`.
pub const fn term_count(degree: u32) -> usize {
    ((degree + 1) * (degree + 2) / 2) as usize
}

/// The direct mapping r = D(r_u): undistorted screen line of sight to the line of sight that the
/// camera receives (paper, "Projection model"), each component a polynomial
/// sum over i + j <= degree of c_ij x^i y^j, dimensionless. The inverse is found by Newton's
/// method on D itself, so the two are inverse to each other to rounding.
#[derive(Debug, Clone, PartialEq)]
pub struct Distortion {
    degree: u32,
    /// Coefficients (of r_x, of r_y), ordered by i, then j: index of x^i y^j is [`Self::index`].
    coefficients: Vec<DVec2>,
}

/// Most times that D may spread an area; a lens that is a facility's spreads or shrinks by some per cent.
const MOST_SPREAD: f64 = 5.0;

/// Why D cannot be used or inverted.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum DistortionError {
    /// The Jacobian's determinant is not clearly positive.
    #[error(
        "the distortion folds over at the line of sight ({x:.4}, {y:.4}): its Jacobian is {determinant:.3}, expected above 0.2"
    )]
    Folds {
        /// Line of sight x.
        x: f64,
        /// Line of sight y.
        y: f64,
        /// Determinant of dD/dr_u.
        determinant: f64,
    },
    /// A line of sight is moved farther than the image is wide, or an area is spread beyond measure.
    #[error(
        "the distortion moves the line of sight ({x:.4}, {y:.4}) by {moved:.3e} and spreads areas {determinant:.3e} times, expected at most {most:.3e}, half of the image's diagonal, and 5 times"
    )]
    TooLarge {
        /// Line of sight x.
        x: f64,
        /// Line of sight y.
        y: f64,
        /// |D(r_u) - r_u|, without a turn of the whole image.
        moved: f64,
        /// Determinant of dD/dr_u.
        determinant: f64,
        /// The largest displacement that is taken.
        most: f64,
    },
    /// Newton's method found no undistorted line of sight.
    #[error("no line of sight is mapped to ({x:.4}, {y:.4})")]
    NoInverse {
        /// Line of sight x.
        x: f64,
        /// Line of sight y.
        y: f64,
    },
}

impl Distortion {
    /// No distortion: r = r_u.
    pub fn identity() -> Self {
        Self::from_terms(&[(1, 0, 1.0, 0.0), (0, 1, 0.0, 1.0)])
    }

    /// From rows (i, j, a, b): r_x gains a x^i y^j and r_y gains b x^i y^j. Powers beyond
    /// [`MAX_DEGREE`] are the caller's to refuse; rows of the same powers add up.
    pub fn from_terms(terms: &[(u32, u32, f64, f64)]) -> Self {
        let degree = terms.iter().map(|t| t.0 + t.1).max().unwrap_or(1).max(1);
        let mut out = Self { degree, coefficients: vec![DVec2::ZERO; term_count(degree)] };
        for &(i, j, a, b) in terms {
            let index = out.index(i, j);
            out.coefficients[index] += DVec2::new(a, b);
        }
        out
    }

    /// Brown's model with one radial and two decentring terms, written out as monomials:
    /// r = r_u (1 + k1 r^2) + (p1 (r^2 + 2 x^2) + 2 p2 x y, 2 p1 x y + p2 (r^2 + 2 y^2)).
    pub fn brown(k1: f64, p1: f64, p2: f64) -> Self {
        Self::from_terms(&[
            (1, 0, 1.0, 0.0),
            (0, 1, 0.0, 1.0),
            (3, 0, k1, 0.0),
            (1, 2, k1, 0.0),
            (2, 1, 0.0, k1),
            (0, 3, 0.0, k1),
            (2, 0, 3.0 * p1, p2),
            (0, 2, p1, 3.0 * p2),
            (1, 1, 2.0 * p2, 2.0 * p1),
        ])
    }

    /// Total degree of the polynomial.
    pub fn degree(&self) -> u32 {
        self.degree
    }

    /// Coefficients (of r_x, of r_y), all x^0 y^j first, then x^1 y^j, ...; [`term_count`] of them.
    pub fn coefficients(&self) -> &[DVec2] {
        &self.coefficients
    }

    /// Where x^i y^j stands: rows i have degree + 1 - i entries.
    fn index(&self, i: u32, j: u32) -> usize {
        (i * (self.degree + 1) - i * i.saturating_sub(1) / 2 + j) as usize
    }

    /// D(r_u).
    pub fn distort(&self, undistorted: DVec2) -> DVec2 {
        // Horner in x of Horner in y, highest power of x first.
        let mut sum = DVec2::ZERO;
        for i in (0..=self.degree).rev() {
            let mut row = DVec2::ZERO;
            for j in (0..=self.degree - i).rev() {
                row = row * undistorted.y + self.coefficients[self.index(i, j)];
            }
            sum = sum * undistorted.x + row;
        }
        sum
    }

    /// dD/dr_u: columns are the derivatives along x and along y.
    pub fn jacobian(&self, undistorted: DVec2) -> DMat2 {
        let (mut dx, mut dy) = (DVec2::ZERO, DVec2::ZERO);
        for i in 0..=self.degree {
            for j in 0..=self.degree - i {
                let c = self.coefficients[self.index(i, j)];
                let (fi, fj) = (f64::from(i), f64::from(j));
                if i > 0 {
                    dx += c * fi * undistorted.x.powi(i as i32 - 1) * undistorted.y.powi(j as i32);
                }
                if j > 0 {
                    dy += c * fj * undistorted.x.powi(i as i32) * undistorted.y.powi(j as i32 - 1);
                }
            }
        }
        DMat2::from_cols(dx, dy)
    }

    /// D^-1(r), to rounding.
    ///
    /// # Errors
    /// No undistorted line of sight near `distorted` maps to it.
    pub fn undistort(&self, distorted: DVec2) -> Result<DVec2, DistortionError> {
        newton(distorted, |guess| self.distort(guess), |guess| self.jacobian(guess))
    }

    /// Checks over a grid covering the image and a margin of 10 % that D keeps its orientation:
    /// then it is one-to-one there. A camera may be rolled by any angle: places are compared after D's own turn at the
    /// middle is taken off.
    ///
    /// # Errors
    /// [`DistortionError::Folds`] at the first place where it is not, [`DistortionError::TooLarge`] where it moves or
    /// spreads more than a facility can.
    pub fn check_over(&self, image: &Pinhole) -> Result<(), DistortionError> {
        let (w, h) = (f64::from(image.width_px), f64::from(image.height_px));
        let most = 0.5 * DVec2::new(w / image.fx_px, h / image.fy_px).length();
        let turned = self.turn_at_the_middle();
        for row in 0..=24 {
            for column in 0..=24 {
                let fraction = DVec2::new(f64::from(column), f64::from(row)) / 24.0 * 1.2 - 0.1;
                let at = image.line_of_sight(fraction * DVec2::new(w, h));
                let determinant = self.jacobian(at).determinant();
                if !(determinant.is_finite() && determinant > 0.2) {
                    return Err(DistortionError::Folds { x: at.x, y: at.y, determinant });
                }
                let moved = (self.distort(at) - turned.rotate(at)).length();
                if !(moved <= most && determinant <= MOST_SPREAD) {
                    return Err(DistortionError::TooLarge { x: at.x, y: at.y, moved, determinant, most });
                }
            }
        }
        Ok(())
    }

    /// The turn in D's Jacobian on the axis, as (cos, sin) of its angle: the rotation of the polar decomposition.
    fn turn_at_the_middle(&self) -> DVec2 {
        let DMat2 { x_axis, y_axis } = self.jacobian(DVec2::ZERO);
        DVec2::new(x_axis.x + y_axis.y, x_axis.y - y_axis.x).try_normalize().unwrap_or(DVec2::X)
    }
}

/// Newton's method ends where it comes this near, tangent plane ...
const NEAR_ENOUGH: f64 = 1e-14;
/// ... or after its rounds within this, which is what rounding leaves of a mapping with large coefficients.
const ROUNDING: f64 = 1e-11;

/// The line of sight near `wanted` that a mapping takes there, to rounding.
pub(crate) fn newton(
    wanted: DVec2,
    map: impl Fn(DVec2) -> DVec2,
    jacobian: impl Fn(DVec2) -> DMat2,
) -> Result<DVec2, DistortionError> {
    let mut guess = wanted;
    for _ in 0..50 {
        let residual = map(guess) - wanted;
        if residual.length() < NEAR_ENOUGH * (1.0 + wanted.length()) {
            return Ok(guess);
        }
        let jacobian = jacobian(guess);
        if jacobian.determinant().abs() < 1e-6 {
            break;
        }
        guess -= jacobian.inverse() * residual;
    }
    if (map(guess) - wanted).length() < ROUNDING {
        return Ok(guess);
    }
    Err(DistortionError::NoInverse { x: wanted.x, y: wanted.y })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const IMAGE: Pinhole =
        Pinhole { fx_px: 5000.0, fy_px: 5000.0, cx_px: 960.0, cy_px: 600.0, width_px: 1920, height_px: 1200 };

    proptest! {
        #[test]
        fn polynomial_is_browns_model(x in -0.2..0.2f64, y in -0.2..0.2f64) {
            let (k1, p1, p2) = (0.4, 2e-3, -1e-3);
            let r2 = x * x + y * y;
            let expected = DVec2::new(
                x * (1.0 + k1 * r2) + p1 * (r2 + 2.0 * x * x) + 2.0 * p2 * x * y,
                y * (1.0 + k1 * r2) + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * y * y),
            );
            let at = Distortion::brown(k1, p1, p2).distort(DVec2::new(x, y));
            prop_assert!((at - expected).length() < 1e-15);
        }

        #[test]
        fn inverse_undoes_it(x in -0.25..0.25f64, y in -0.25..0.25f64) {
            let d = Distortion::brown(0.4, 2e-3, -1e-3);
            let there_and_back = d.undistort(d.distort(DVec2::new(x, y))).unwrap();
            // 0.01 arcsec is 4.8e-8 rad.
            prop_assert!((there_and_back - DVec2::new(x, y)).length() < 1e-13);
        }
    }

    /// A camera that is rolled: the polynomial turns the whole image. Corners move by more than half the diagonal then.
    #[test]
    fn a_roll_by_any_angle_is_a_mapping() {
        for degrees in [-180.0f64, -120.0, -90.0, -50.0, 30.0, 60.0, 90.0, 150.0, 179.0] {
            let (sin, cos) = degrees.to_radians().sin_cos();
            let turned = |x: f64, y: f64| (cos * x - sin * y, sin * x + cos * y);
            let terms = [(1, 0, 1.0, 0.0), (0, 1, 0.0, 1.0), (3, 0, 0.4, 0.0), (1, 2, 0.4, 0.0)];
            let rolled = terms.map(|(i, j, x, y)| (i, j, turned(x, y).0, turned(x, y).1));
            let d = Distortion::from_terms(&rolled);
            assert!(d.check_over(&IMAGE).is_ok(), "{degrees} deg");
            let at = DVec2::new(0.15, -0.1);
            assert!((d.undistort(d.distort(at)).unwrap() - at).length() < 1e-13, "{degrees} deg");
        }
        let mirrored = Distortion::from_terms(&[(1, 0, -1.0, 0.0), (0, 1, 0.0, 1.0)]);
        assert!(mirrored.check_over(&IMAGE).is_err());
    }

    #[test]
    fn a_fold_is_found() {
        assert!(Distortion::brown(0.4, 0.0, 0.0).check_over(&IMAGE).is_ok());
        assert!(Distortion::brown(-20.0, 0.0, 0.0).check_over(&IMAGE).is_err());
        // Terms that do not fold: a shift, a shear, a magnification, and a cubic one, all beyond measure.
        for term in [(0, 0, 1e7, 0.0), (0, 1, 1e20, 0.0), (1, 0, 1e7, 0.0), (3, 0, 1e7, 0.0)] {
            let d = Distortion::from_terms(&[(1, 0, 1.0, 0.0), (0, 1, 0.0, 1.0), term]);
            let said = d.check_over(&IMAGE).unwrap_err().to_string();
            assert!(said.contains("half of the image's diagonal, and 5 times"), "{said}");
        }
    }
}
