//! Lambert's law.

use crate::{Definition, Geometry, Key, LAW_PARAMETERS, Reflectance};

/// I/F = mu0 (Lambert 1760): a white surface looks alike from everywhere. No keys.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lambert;

impl Definition for Lambert {
    const KEYS: &'static [Key] = &[];

    fn from_values(_: &[f64]) -> Self {
        Self
    }
}

impl Reflectance for Lambert {
    fn radiance_factor(&self, geometry: Geometry) -> f64 {
        geometry.mu0
    }

    fn lambert_and_seeliger(&self, _: f64) -> Option<[f64; 2]> {
        Some([1.0, 0.0])
    }

    fn shader_parameters(&self) -> [f32; LAW_PARAMETERS] {
        [0.0; LAW_PARAMETERS]
    }
}
