//! D^-1 as it was calibrated: a polynomial on lines of sight whose coefficients depend on the irradiance.

use glam::{DMat2, DVec2};

use crate::Distortion;

/// Powers [i, j, k] of x^i y^j L^k, and the coefficients of the undistorted x and y.
pub type InverseTerm = ([u32; 3], DVec2);

/// r_u = D^-1(r, L) (paper, eq. 15, with its dependence on irradiance): sums of a x^i y^j L^k, where L is log10 of a
/// point's irradiance relative to a white pixel at full count.
#[derive(Debug, Clone, PartialEq)]
pub struct InverseDistortion {
    /// The terms.
    pub terms: Vec<InverseTerm>,
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

    /// D^-1(r, L) with L as it is.
    pub fn undistort(&self, line_of_sight: DVec2, log10_irradiance: f64) -> DVec2 {
        let (x, y) = (powers(line_of_sight.x), powers(line_of_sight.y));
        let l = powers(log10_irradiance);
        let value = |&([i, j, k], c): &InverseTerm| c * (x[i as usize] * y[j as usize] * l[k as usize]);
        self.terms.iter().map(value).sum()
    }

    /// dD^-1/dr at L: columns are the derivatives along x and along y.
    pub fn jacobian(&self, line_of_sight: DVec2, log10_irradiance: f64) -> DMat2 {
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
        DMat2::from_cols(dx, dy)
    }

    /// The polynomial r_u(r) at one L; its `distort` is D^-1 there and its `undistort` D.
    pub fn at(&self, log10_irradiance: f64) -> Distortion {
        let l = powers(log10_irradiance);
        let rows: Vec<(u32, u32, f64, f64)> = self
            .terms
            .iter()
            .map(|&([i, j, k], c)| (i, j, c.x * l[k as usize], c.y * l[k as usize]))
            .collect();
        Distortion::from_terms(&rows)
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
            reference_log10_irradiance: -1.0,
            range_log10_irradiance: [-3.0, 0.0],
        };
        let r = DVec2::new(0.2, -0.1);
        // By hand: x + 0.5 x^3 L, y + 0.01 L^2 at L = -2.
        let expected = DVec2::new(0.2 - 0.008, -0.1 + 0.04);
        assert!((inverse.undistort(r, -2.0) - expected).length() < 1e-16);
        assert!((inverse.at(-2.0).distort(r) - expected).length() < 1e-16);
        let slope = (inverse.undistort(r + DVec2::X * 1e-6, -2.0) - expected) / 1e-6;
        assert!((inverse.jacobian(r, -2.0).x_axis - slope).length() < 1e-6);
        assert_eq!(inverse.held(-7.0), -3.0);
    }
}
