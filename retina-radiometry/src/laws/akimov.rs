//! Akimov's disc function.

use std::f64::consts::PI;

use crate::{Definition, Geometry, Key, LAW_PARAMETERS, Reflectance};

/// Below it the disc is flat to the digits of f64.
const LEAST_PHASE_RAD: f64 = 1e-12;

/// I/F = cos(a/2) cos[pi / (pi - a) (g - a/2)] cos(b)^(a / (pi - a)) / cos(g), the parameterless disc function of Akimov
/// (Shkuratov et al. 2011, Planetary and Space Science 59, 1326, eq. 19), with the phase angle a, the photometric
/// latitude b and the photometric longitude g: mu = cos b cos g, mu0 = cos b cos(a - g). The longitude is counted from
/// the observer's meridian and grows towards the Sun. I/F = 1 where a = 0. No keys.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Akimov;

impl Definition for Akimov {
    const KEYS: &'static [Key] = &[];

    fn from_values(_: &[f64]) -> Self {
        Self
    }
}

impl Reflectance for Akimov {
    fn radiance_factor(&self, Geometry { mu0, mu, phase_rad }: Geometry) -> f64 {
        if phase_rad < LEAST_PHASE_RAD {
            return 1.0;
        }
        // h = pi/2 - g, the longitude from the limb, is 0 at the limb and pi - a at the terminator. The cosine over
        // cos g is then sin(stretch h) / sin h, which stays a quotient of small numbers at the limb, not of differences.
        let (x, y) = (mu * phase_rad.sin(), mu0 - mu * phase_rad.cos());
        let h = x.atan2(y).max(f64::MIN_POSITIVE);
        let cos_b = (x.hypot(y) / phase_rad.sin()).min(1.0);
        let rest = PI - phase_rad;
        (0.5 * phase_rad).cos() * (PI / rest * h).sin().max(0.0) / h.sin() * cos_b.powf(phase_rad / rest)
    }

    fn shader_parameters(&self) -> [f32; LAW_PARAMETERS] {
        [0.0; LAW_PARAMETERS]
    }
}
