//! A phase curve in magnitudes.

use crate::registry::padded;
use crate::{Definition, Key, PHASE_PARAMETERS, PhaseCurve};

/// f = 10^(-0.4 (c1 a + c2 a^2 + c3 a^3 + c4 a^4)), the phase angle a in degrees.
///
/// Key `coefficients`: [c1, c2, c3, c4], mag per deg^n, required.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Magnitudes {
    /// c1 to c4, mag per deg^n.
    pub coefficients: [f64; 4],
}

impl Definition for Magnitudes {
    const KEYS: &'static [Key] = &[Key::list("coefficients", "coefficients of the phase angle's powers", 4)];

    fn from_values(values: &[f64]) -> Self {
        Self { coefficients: [values[0], values[1], values[2], values[3]] }
    }
}

impl PhaseCurve for Magnitudes {
    fn value(&self, phase_rad: f64) -> f64 {
        let [c1, c2, c3, c4] = self.coefficients;
        let a = phase_rad.to_degrees();
        10f64.powf(-0.4 * a * (c1 + a * (c2 + a * (c3 + a * c4))))
    }

    fn shader_parameters(&self) -> [f32; PHASE_PARAMETERS] {
        padded(self.coefficients)
    }
}
