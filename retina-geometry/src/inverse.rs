//! D^-1 as it was calibrated: a polynomial on lines of sight whose coefficients depend on the irradiance.

use glam::{DMat2, DVec2};

use crate::distortion::newton;
use crate::{DistortionError, Rings};

/// Powers [i, j, k] of x^i y^j L^k, and the coefficients of the undistorted x and y.
pub type InverseTerm = ([u32; 3], DVec2);

/// What D^-1 does ring by ring, at every irradiance: for what a polynomial of lines of sight does not follow.
#[derive(Debug, Clone, PartialEq)]
pub struct RingField {
    /// The splines.
    pub rings: Rings,
    /// Coefficients of their columns for the undistorted x and y, in the order of [`Rings::fill`].
    pub coefficients: Vec<DVec2>,
}

/// Where lines of sight were calibrated: in a rectangle, and about its middle in a disc.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CalibratedField {
    /// The rectangle's corner of the smallest x and y.
    pub low: DVec2,
    /// That of the largest.
    pub high: DVec2,
    /// The disc's radius, tangent plane.
    pub radius: f64,
}

/// The derivative at the field's edge is taken for this part of its radius beyond it: about what a camera is turned by in
/// a facility. Farther out it would carry its own error far.
const EDGE: f64 = 0.02;

impl CalibratedField {
    /// The smallest that holds these lines of sight; `None` of none.
    pub fn of(lines_of_sight: impl Iterator<Item = DVec2> + Clone) -> Option<Self> {
        let low = lines_of_sight.clone().reduce(DVec2::min)?;
        let high = lines_of_sight.clone().reduce(DVec2::max)?;
        let middle = 0.5 * (low + high);
        let radius = lines_of_sight.map(|sight| (sight - middle).length()).fold(0.0, f64::max);
        Some(Self { low, high, radius })
    }

    /// The part of a way out of the field on which the derivative at its edge holds, and the rest.
    fn parts(&self, outwards: DVec2) -> (DVec2, DVec2) {
        let near = outwards.clamp_length_max(EDGE * self.radius);
        (near, outwards - near)
    }

    fn middle(&self) -> DVec2 {
        0.5 * (self.low + self.high)
    }

    /// The line of sight itself where it is inside, else one on the edge.
    pub fn held(&self, line_of_sight: DVec2) -> DVec2 {
        let middle = self.middle();
        let from_middle = line_of_sight.clamp(self.low, self.high) - middle;
        if from_middle.length() > self.radius {
            return middle + from_middle.clamp_length_max(self.radius);
        }
        line_of_sight.clamp(self.low, self.high)
    }
}

/// r_u = D^-1(r, L) (paper, eq. 15, with its dependence on irradiance): sums of a x^i y^j L^k, where L is log10 of a
/// point's irradiance relative to a white pixel at full count, and where there are some, of rings about a centre.
#[derive(Debug, Clone, PartialEq)]
pub struct InverseDistortion {
    /// The terms.
    pub terms: Vec<InverseTerm>,
    /// The rings.
    pub rings: Option<RingField>,
    /// Beyond this D^-1 goes on straight. `None`: the sums hold everywhere.
    pub field: Option<CalibratedField>,
    /// L at which the calibration's D is given.
    pub reference_log10_irradiance: f64,
    /// Lowest and highest L that were calibrated; L is held within.
    pub range_log10_irradiance: [f64; 2],
}

impl InverseDistortion {
    /// L, held within the calibrated range: a polynomial means nothing beyond its data.
    pub fn held(&self, log10_irradiance: f64) -> f64 {
        let [low, high] = self.range_log10_irradiance;
        log10_irradiance.clamp(low, high)
    }

    /// Highest power of lines of sight among the terms.
    pub fn degree(&self) -> u32 {
        self.terms.iter().map(|([i, j, _], _)| i + j).max().unwrap_or(0)
    }

    /// Number of coefficients an axis: of the terms, then of the rings.
    pub fn columns(&self) -> usize {
        self.terms.len() + self.rings.as_ref().map_or(0, |field| field.coefficients.len())
    }

    /// What each coefficient is multiplied with, into `out`, which holds [`Self::columns`].
    pub fn fill(&self, line_of_sight: DVec2, log10_irradiance: f64, out: &mut [f64]) {
        let (x, y) = (powers(line_of_sight.x), powers(line_of_sight.y));
        let l = powers(log10_irradiance);
        let (terms, rings) = out.split_at_mut(self.terms.len());
        for (value, ([i, j, k], _)) in terms.iter_mut().zip(&self.terms) {
            *value = x[*i as usize] * y[*j as usize] * l[*k as usize];
        }
        if let Some(field) = &self.rings {
            field.rings.fill(line_of_sight, rings);
        }
    }

    /// D^-1(r, L) with L as it is. Beyond the calibrated field, where a high degree would turn back into it, it goes on from
    /// the nearest line of sight in the field: with the derivative there for 2 % of the field's radius, then with
    /// that of the field's middle.
    pub fn undistort(&self, line_of_sight: DVec2, log10_irradiance: f64) -> DVec2 {
        match self.field.map(|field| (field, field.held(line_of_sight))) {
            Some((field, held)) if held != line_of_sight => {
                let (near, far) = field.parts(line_of_sight - held);
                self.value(held, log10_irradiance)
                    + self.slope(held, log10_irradiance) * near
                    + self.slope(field.middle(), log10_irradiance) * far
            }
            _ => self.value(line_of_sight, log10_irradiance),
        }
    }

    /// The sums.
    fn value(&self, line_of_sight: DVec2, log10_irradiance: f64) -> DVec2 {
        let (x, y) = (powers(line_of_sight.x), powers(line_of_sight.y));
        let l = powers(log10_irradiance);
        let value = |&([i, j, k], c): &InverseTerm| c * (x[i as usize] * y[j as usize] * l[k as usize]);
        let rings = self.rings.as_ref().map(|field| field.rings.value(line_of_sight, &field.coefficients));
        self.terms.iter().map(value).sum::<DVec2>() + rings.unwrap_or_default()
    }

    /// dD^-1/dr at L: columns are the derivatives along x and along y; beyond the field to some per cent, as Newton's method
    /// needs it.
    pub fn jacobian(&self, line_of_sight: DVec2, log10_irradiance: f64) -> DMat2 {
        match self.field.map(|field| (field, field.held(line_of_sight))) {
            Some((field, held)) if held != line_of_sight => {
                let edge = self.slope(held, log10_irradiance);
                let far = field.parts(line_of_sight - held).1 != DVec2::ZERO;
                let outwards = if far { self.slope(field.middle(), log10_irradiance) } else { edge };
                // Along the edge D^-1 changes as on it, nearly.
                let along =
                    |k: usize| if held[k] == line_of_sight[k] { edge.col(k) } else { outwards.col(k) };
                DMat2::from_cols(along(0), along(1))
            }
            _ => self.slope(line_of_sight, log10_irradiance),
        }
    }

    /// Derivative of the sums.
    fn slope(&self, line_of_sight: DVec2, log10_irradiance: f64) -> DMat2 {
        let (x, y) = (powers(line_of_sight.x), powers(line_of_sight.y));
        let l = powers(log10_irradiance);
        let (mut dx, mut dy) = (DVec2::ZERO, DVec2::ZERO);
        for &([i, j, k], c) in &self.terms {
            let (i, j, c) = (i as usize, j as usize, c * l[k as usize]);
            if i > 0 {
                dx += c * (i as f64 * x[i - 1] * y[j]);
            }
            if j > 0 {
                dy += c * (j as f64 * x[i] * y[j - 1]);
            }
        }
        let rings = self.rings.as_ref().map(|field| field.rings.jacobian(line_of_sight, &field.coefficients));
        DMat2::from_cols(dx, dy) + rings.unwrap_or(DMat2::ZERO)
    }

    /// D(r_u, L): the line of sight that D^-1 takes to `undistorted`, to rounding.
    ///
    /// # Errors
    /// Newton's method finds none near `undistorted`.
    pub fn distort(&self, undistorted: DVec2, log10_irradiance: f64) -> Result<DVec2, DistortionError> {
        newton(
            undistorted,
            |sight| self.undistort(sight, log10_irradiance),
            |sight| self.jacobian(sight, log10_irradiance),
        )
    }
}

/// t^0 to t^MAX_DEGREE.
fn powers(t: f64) -> [f64; crate::MAX_DEGREE as usize + 1] {
    let mut out = [1.0; crate::MAX_DEGREE as usize + 1];
    for i in 1..out.len() {
        out[i] = out[i - 1] * t;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coefficients_depend_on_the_irradiance_as_written() {
        let inverse = InverseDistortion {
            terms: vec![
                ([1, 0, 0], DVec2::new(1.0, 0.0)),
                ([0, 1, 0], DVec2::new(0.0, 1.0)),
                ([3, 0, 1], DVec2::new(0.5, 0.0)),
                ([0, 0, 2], DVec2::new(0.0, 0.01)),
            ],
            rings: None,
            field: None,
            reference_log10_irradiance: -1.0,
            range_log10_irradiance: [-3.0, 0.0],
        };
        let r = DVec2::new(0.2, -0.1);
        // By hand: x + 0.5 x^3 L, y + 0.01 L^2 at L = -2.
        let expected = DVec2::new(0.2 - 0.008, -0.1 + 0.04);
        assert!((inverse.undistort(r, -2.0) - expected).length() < 1e-16);
        assert!((inverse.distort(expected, -2.0).unwrap() - r).length() < 1e-13);
        let slope = (inverse.undistort(r + DVec2::X * 1e-6, -2.0) - expected) / 1e-6;
        assert!((inverse.jacobian(r, -2.0).x_axis - slope).length() < 1e-6);
        assert_eq!(inverse.held(-7.0), -3.0);
    }
    #[test]
    fn rings_add_to_the_terms_and_are_inverted_with_them() {
        let rings = Rings { center: DVec2::new(0.002, 0.001), radius: 0.2, intervals: 10 };
        // A step of 3e-4 rad outwards from the seventh ring on.
        let coefficients = (0..rings.columns())
            .map(|i| if i / 2 < 5 { DVec2::ZERO } else { [DVec2::X, DVec2::Y][i % 2] * 3e-4 })
            .collect();
        let inverse = InverseDistortion {
            terms: vec![([1, 0, 0], DVec2::X), ([0, 1, 0], DVec2::Y), ([3, 0, 0], DVec2::new(0.4, 0.0))],
            rings: Some(RingField { rings, coefficients }),
            field: None,
            reference_log10_irradiance: 0.0,
            range_log10_irradiance: [0.0, 0.0],
        };
        let inside = DVec2::new(0.05, 0.04);
        assert!(
            (inverse.undistort(inside, 0.0) - inside - DVec2::X * 0.4 * 0.05f64.powi(3)).length() < 1e-16
        );
        let mut columns = vec![0.0; inverse.columns()];
        for sight in [inside, DVec2::new(0.11, -0.07), DVec2::new(-0.19, 0.12)] {
            let undistorted = inverse.undistort(sight, 0.0);
            assert!((inverse.distort(undistorted, 0.0).unwrap() - sight).length() < 1e-13);
            inverse.fill(sight, 0.0, &mut columns);
            let field = inverse.rings.as_ref().unwrap();
            let all = inverse.terms.iter().map(|term| term.1).chain(field.coefficients.iter().copied());
            let by_columns: DVec2 = columns.iter().zip(all).map(|(v, c)| c * *v).sum();
            assert!((by_columns - undistorted).length() < 1e-15);
        }
    }
    #[test]
    fn beyond_the_field_it_goes_on_straight() {
        let inverse = InverseDistortion {
            // Beyond x = 0.2 the fifth power turns back.
            terms: vec![([1, 0, 0], DVec2::X), ([0, 1, 0], DVec2::Y), ([5, 0, 0], DVec2::new(-125.0, 0.0))],
            rings: None,
            field: Some(CalibratedField {
                low: DVec2::new(-0.15, -0.1),
                high: DVec2::new(0.15, 0.1),
                radius: 0.16,
            }),
            reference_log10_irradiance: 0.0,
            range_log10_irradiance: [0.0, 0.0],
        };
        let (edge, beyond) = (DVec2::new(0.15, 0.05), DVec2::new(0.25, 0.05));
        // First with the edge's slope, then with the middle's, which is 1.
        let (slope, near) = (1.0 - 5.0 * 125.0 * 0.15f64.powi(4), EDGE * 0.16);
        let expected = inverse.undistort(edge, 0.0) + DVec2::X * (slope * near + 0.1 - near);
        assert!((inverse.undistort(beyond, 0.0) - expected).length() < 1e-15);
        assert!((inverse.distort(expected, 0.0).unwrap() - beyond).length() < 1e-13);
        // The rectangle's corner is outside of the disc.
        let held = inverse.field.unwrap().held(DVec2::new(0.3, 0.2));
        assert!(
            (held.length() - 0.16).abs() < 1e-15 && (held.y / held.x - 2.0 / 3.0).abs() < 1e-12,
            "{held}"
        );
        assert!(InverseDistortion { field: None, ..inverse }.undistort(beyond, 0.0).x < edge.x);
    }
}
