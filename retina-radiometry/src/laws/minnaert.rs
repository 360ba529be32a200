//! Minnaert's law.

use crate::registry::padded;
use crate::{Definition, Geometry, Key, LAW_PARAMETERS, Reflectance};

/// I/F = mu0^k mu^(k - 1) (Minnaert 1941, Astrophysical Journal 93, 403). k = 1 is Lambert's law; k = 1/2 is a flat
/// disc at phase 0. If k < 1, I/F grows without bound towards the limb.
///
/// Key `k`: 0 to 2, required.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Minnaert {
    /// Exponent k.
    pub k: f64,
}

impl Definition for Minnaert {
    const KEYS: &'static [Key] = &[Key::required("k", "exponent", [0.0, 2.0])];

    fn from_values(values: &[f64]) -> Self {
        Self { k: values[0] }
    }
}

impl Reflectance for Minnaert {
    fn radiance_factor(&self, Geometry { mu0, mu, .. }: Geometry) -> f64 {
        mu0.powf(self.k) * mu.powf(self.k - 1.0)
    }

    fn shader_parameters(&self) -> [f32; LAW_PARAMETERS] {
        padded([self.k])
    }
}
