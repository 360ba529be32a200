//! Henyey's and Greenstein's phase function.

use crate::registry::padded;
use crate::{Definition, Key, PHASE_PARAMETERS, PhaseCurve};

/// f = ((1 - g)^2 / (1 - 2 g cos phase + g^2))^(3/2) (Henyey and Greenstein 1941, Astrophysical Journal 93, 70),
/// normalised to f(0) = 1; g > 0 scatters back towards the light.
///
/// Key `asymmetry`: g, -0.999 to 0.999, required.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HenyeyGreenstein {
    /// Asymmetry g, -1 < g < 1.
    pub asymmetry: f64,
}

impl Definition for HenyeyGreenstein {
    const KEYS: &'static [Key] = &[Key::required("asymmetry", "asymmetry", [-0.999, 0.999])];

    fn from_values(values: &[f64]) -> Self {
        Self { asymmetry: values[0] }
    }
}

impl PhaseCurve for HenyeyGreenstein {
    fn value(&self, phase_rad: f64) -> f64 {
        let g = self.asymmetry;
        ((1.0 - g).powi(2) / (1.0 - 2.0 * g * phase_rad.cos() + g * g)).powf(1.5)
    }

    fn shader_parameters(&self) -> [f32; PHASE_PARAMETERS] {
        padded([self.asymmetry])
    }
}
