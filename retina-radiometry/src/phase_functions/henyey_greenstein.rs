//! Henyey's and Greenstein's phase function.

use crate::registry::padded;
use crate::{Definition, Key, PHASE_PARAMETERS, PhaseCurve};

/// f = ((1 + g)^2 / (1 + 2 g cos phase + g^2))^(3/2) (Henyey and Greenstein 1941, Astrophysical Journal 93, 70),
/// normalised to f(0) = 1. g is the mean cosine of the angle by which light is scattered, 180 deg less the phase angle:
/// g < 0 scatters back towards the light, as regoliths do.
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
        ((1.0 + g).powi(2) / (1.0 + 2.0 * g * phase_rad.cos() + g * g)).powf(1.5)
    }

    fn shader_parameters(&self) -> [f32; PHASE_PARAMETERS] {
        padded([self.asymmetry])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The mean cosine of the scattering angle over the sphere is g itself, by the trapezoidal rule.
    #[test]
    fn the_asymmetry_is_the_mean_cosine_of_scattering() {
        for g in [-0.4, -0.1, 0.25] {
            let curve = HenyeyGreenstein { asymmetry: g };
            let (mut all, mut along) = (0.0, 0.0);
            for i in 0..20_000 {
                let cos_scattering = -1.0 + (f64::from(i) + 0.5) / 1e4;
                let value = curve.value((-cos_scattering).acos());
                all += value;
                along += value * cos_scattering;
            }
            assert!((along / all - g).abs() < 1e-6, "{g}: {}", along / all);
        }
    }
}
