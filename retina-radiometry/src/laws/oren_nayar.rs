//! Oren's and Nayar's law.

use crate::registry::padded;
use crate::{Definition, Geometry, Key, LAW_PARAMETERS, Reflectance};

/// I/F = mu0 (1 + B/A max(0, cos psi) sin a tan b), a the larger and b the smaller of incidence and emission, psi the
/// azimuth between them; A = 1 - s^2 / (2 (s^2 + 0.33)), B = 0.45 s^2 / (s^2 + 0.09) (Oren and Nayar 1994, eq. 30,
/// without interreflection).
///
/// Key `roughness_deg`: s, 0 to 90, required.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OrenNayar {
    /// Standard deviation s of the facets' slope angle, rad.
    pub roughness_rad: f64,
}

impl OrenNayar {
    fn b_over_a(&self) -> f64 {
        let s2 = self.roughness_rad * self.roughness_rad;
        (0.45 * s2 / (s2 + 0.09)) / (1.0 - 0.5 * s2 / (s2 + 0.33))
    }
}

impl Definition for OrenNayar {
    const KEYS: &'static [Key] =
        &[Key::required("roughness_deg", "standard deviation of the slopes", [0.0, 90.0])];

    fn from_values(values: &[f64]) -> Self {
        Self { roughness_rad: values[0].to_radians() }
    }
}

impl Reflectance for OrenNayar {
    fn radiance_factor(&self, Geometry { mu0, mu, phase_rad }: Geometry) -> f64 {
        // cos psi sin i sin e = cos phase - mu0 mu; sin a tan b = sin i sin e / max(mu0, mu).
        let excess = (phase_rad.cos() - mu0 * mu).max(0.0) / mu0.max(mu);
        mu0 * (1.0 + self.b_over_a() * excess)
    }

    fn shader_parameters(&self) -> [f32; LAW_PARAMETERS] {
        padded([self.b_over_a()])
    }
}
