//! The law of the Robotic Lunar Observatory (ROLO).

use crate::registry::padded;
use crate::{Definition, Geometry, Key, LAW_PARAMETERS, Reflectance};

/// I/F = mu0 / (mu0 + mu) f(a), f = C0 exp(-C1 a) + A0 + A1 a + A2 a^2 + A3 a^3 + A4 a^4, the phase angle a in degrees
/// (Buratti et al. 2011, Journal of Geophysical Research 116, E00G03). f counts as 0 where the polynomial is negative,
/// outside the phase angles to which it was fitted.
///
/// Keys, all required: `surge_amplitude` (C0, 0 to 10), `surge_decay_per_deg` (C1, 0 to 100) and `polynomial`
/// ([A0, A1, A2, A3, A4], A_n per deg^n). The normal albedo sets the level: (C0 + A0) / 2 is the paper's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rolo {
    /// C0: amplitude of the opposition surge.
    pub surge_amplitude: f64,
    /// C1: decay of the opposition surge, per deg.
    pub surge_decay_per_deg: f64,
    /// A0 to A4, A_n per deg^n.
    pub polynomial: [f64; 5],
}

impl Rolo {
    fn phase_factor(&self, phase_rad: f64) -> f64 {
        let a = phase_rad.to_degrees();
        let polynomial = self.polynomial.iter().rev().fold(0.0, |sum, c| sum * a + c);
        (self.surge_amplitude * (-self.surge_decay_per_deg * a).exp() + polynomial).max(0.0)
    }
}

impl Definition for Rolo {
    const KEYS: &'static [Key] = &[
        Key::required("surge_amplitude", "amplitude of the opposition surge", [0.0, 10.0]),
        Key::required("surge_decay_per_deg", "decay of the opposition surge", [0.0, 100.0]),
        Key::list("polynomial", "coefficients of the phase angle's powers", 5),
    ];

    fn from_values(values: &[f64]) -> Self {
        Self {
            surge_amplitude: values[0],
            surge_decay_per_deg: values[1],
            polynomial: [values[2], values[3], values[4], values[5], values[6]],
        }
    }
}

impl Reflectance for Rolo {
    fn radiance_factor(&self, Geometry { mu0, mu, phase_rad }: Geometry) -> f64 {
        mu0 / (mu0 + mu) * self.phase_factor(phase_rad)
    }

    fn lambert_and_seeliger(&self, phase_rad: f64) -> Option<[f64; 2]> {
        Some([0.0, self.phase_factor(phase_rad)])
    }

    fn shader_parameters(&self) -> [f32; LAW_PARAMETERS] {
        let [a0, a1, a2, a3, a4] = self.polynomial;
        padded([self.surge_amplitude, self.surge_decay_per_deg, 0.0, a0, a1, a2, a3, a4])
    }
}
