//! An exponential phase function.

use crate::registry::padded;
use crate::{Definition, Key, PHASE_PARAMETERS, PhaseCurve};

/// f = exp(-phase / scale).
///
/// Key `scale_deg`: 0.001 to 1e6, required.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Exponential {
    /// Scale, rad.
    pub scale_rad: f64,
}

impl Definition for Exponential {
    const KEYS: &'static [Key] = &[Key::required("scale_deg", "scale", [1e-3, 1e6])];

    fn from_values(values: &[f64]) -> Self {
        Self { scale_rad: values[0].to_radians() }
    }
}

impl PhaseCurve for Exponential {
    fn value(&self, phase_rad: f64) -> f64 {
        (-phase_rad / self.scale_rad).exp()
    }

    fn shader_parameters(&self) -> [f32; PHASE_PARAMETERS] {
        padded([self.scale_rad])
    }
}
