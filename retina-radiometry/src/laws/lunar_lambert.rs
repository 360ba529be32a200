//! McEwen's law.

use crate::registry::padded;
use crate::{Definition, Geometry, Key, LAW_PARAMETERS, Reflectance};

/// I/F = 2 L mu0 / (mu0 + mu) + (1 - L) mu0 with L = exp(-phase / decay) (McEwen 1991, 1996).
///
/// Key `decay_deg`: 0.1 to 1e6, 60 by default, which is McEwen's value for the Moon.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LunarLambert {
    /// Decay angle of L, rad.
    pub decay_rad: f64,
}

impl Definition for LunarLambert {
    const KEYS: &'static [Key] = &[Key::or("decay_deg", "decay angle", [0.1, 1e6], 60.0)];

    fn from_values(values: &[f64]) -> Self {
        Self { decay_rad: values[0].to_radians() }
    }
}

impl Reflectance for LunarLambert {
    fn radiance_factor(&self, Geometry { mu0, mu, phase_rad }: Geometry) -> f64 {
        let l = (-phase_rad / self.decay_rad).exp();
        l * 2.0 * mu0 / (mu0 + mu) + (1.0 - l) * mu0
    }

    fn lambert_and_seeliger(&self, phase_rad: f64) -> Option<[f64; 2]> {
        let l = (-phase_rad / self.decay_rad).exp();
        Some([1.0 - l, 2.0 * l])
    }

    fn shader_parameters(&self) -> [f32; LAW_PARAMETERS] {
        padded([self.decay_rad])
    }
}
