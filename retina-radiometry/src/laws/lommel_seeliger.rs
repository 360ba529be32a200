//! Lommel's and Seeliger's law.

use crate::{Definition, Geometry, Key, LAW_PARAMETERS, Reflectance};

/// I/F = 2 mu0 / (mu0 + mu) (Seeliger 1887): single scattering in a dark medium. No keys.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LommelSeeliger;

impl Definition for LommelSeeliger {
    const KEYS: &'static [Key] = &[];

    fn from_values(_: &[f64]) -> Self {
        Self
    }
}

impl Reflectance for LommelSeeliger {
    fn radiance_factor(&self, Geometry { mu0, mu, .. }: Geometry) -> f64 {
        2.0 * mu0 / (mu0 + mu)
    }

    fn lambert_and_seeliger(&self, _: f64) -> Option<[f64; 2]> {
        Some([0.0, 2.0])
    }

    fn shader_parameters(&self) -> [f32; LAW_PARAMETERS] {
        [0.0; LAW_PARAMETERS]
    }
}
