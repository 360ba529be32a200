//! Photometric functions: how bright a surface element is, seen and lit from given directions.

use std::f64::consts::{FRAC_PI_2, PI};

use crate::Hapke;

/// Directions at a surface element.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Geometry {
    /// Cosine of the incidence angle.
    pub mu0: f64,
    /// Cosine of the emission angle.
    pub mu: f64,
    /// Phase angle, between the directions to the light and to the observer, rad.
    pub phase_rad: f64,
}

/// The law's shape; every law is 1 at incidence = emission = phase = 0, except Hapke's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Law {
    /// mu0.
    Lambert,
    /// 2 mu0 / (mu0 + mu) (Seeliger 1887): single scattering in a dark medium.
    LommelSeeliger,
    /// 2 L mu0 / (mu0 + mu) + (1 - L) mu0 with L = exp(-phase / decay) (McEwen 1991, 1996).
    LunarLambert {
        /// Decay angle of L, rad; 60 deg for the Moon.
        decay_rad: f64,
    },
    /// mu0 (1 + B/A max(0, cos psi) sin a tan b), a the larger and b the smaller of incidence and
    /// emission, psi the azimuth between them; A = 1 - s^2 / (2 (s^2 + 0.33)),
    /// B = 0.45 s^2 / (s^2 + 0.09) (Oren and Nayar 1994, eq. 30, without interreflection).
    OrenNayar {
        /// Standard deviation s of the facets' slope angle, rad.
        roughness_rad: f64,
    },
    /// Hapke (2012).
    Hapke(Hapke),
}

/// A particle phase function f(phase) that multiplies the law, f(0) = 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PhaseFunction {
    /// f = 1.
    Constant,
    /// f = exp(-phase / scale).
    Exponential {
        /// Scale, rad.
        scale_rad: f64,
    },
    /// Henyey-Greenstein, normalised to f(0) = 1: ((1 - g)^2 / (1 - 2 g cos phase + g^2))^(3/2);
    /// g > 0 scatters back towards the light.
    HenyeyGreenstein {
        /// Asymmetry, -1 < g < 1.
        asymmetry: f64,
    },
    /// f = 10^(-0.4 (c1 a + c2 a^2 + c3 a^3 + c4 a^4)), a in degrees: a phase curve in magnitudes.
    Magnitudes {
        /// c1..c4, mag per deg^n.
        coefficients: [f64; 4],
    },
}

impl PhaseFunction {
    /// f(phase).
    pub fn value(&self, phase_rad: f64) -> f64 {
        match *self {
            Self::Constant => 1.0,
            Self::Exponential { scale_rad } => (-phase_rad / scale_rad).exp(),
            Self::HenyeyGreenstein { asymmetry: g } => {
                ((1.0 - g).powi(2) / (1.0 - 2.0 * g * phase_rad.cos() + g * g)).powf(1.5)
            }
            Self::Magnitudes { coefficients: [c1, c2, c3, c4] } => {
                let a = phase_rad.to_degrees();
                10f64.powf(-0.4 * a * (c1 + a * (c2 + a * (c3 + a * c4))))
            }
        }
    }
}

/// The photometric function of a body: radiance factor of a surface element.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Photometry {
    /// The law.
    pub law: Law,
    /// The phase function that multiplies it.
    pub phase_function: PhaseFunction,
    /// Factor in front; chosen by [`Photometry::new`] so that I/F at incidence = emission = 0 is
    /// the normal albedo.
    pub factor: f64,
}

impl Photometry {
    /// A photometric function with this normal albedo: I/F at incidence = emission = phase = 0.
    /// With Hapke's law `normal_albedo` may be `None`: then I/F is what the law itself says.
    pub fn new(law: Law, phase_function: PhaseFunction, normal_albedo: Option<f64>) -> Self {
        let unit = Self { law, phase_function, factor: 1.0 };
        let at_normal = unit.radiance_factor(Geometry { mu0: 1.0, mu: 1.0, phase_rad: 0.0 });
        Self { factor: normal_albedo.map_or(1.0, |albedo| albedo / at_normal), ..unit }
    }

    /// I/F, the radiance over that of a white Lambert surface lit vertically; 0 where the light
    /// or the observer is below the horizon.
    pub fn radiance_factor(&self, geometry: Geometry) -> f64 {
        let Geometry { mu0, mu, phase_rad } = geometry;
        if mu0 <= 0.0 || mu <= 0.0 {
            return 0.0;
        }
        let lommel_seeliger = 2.0 * mu0 / (mu0 + mu);
        let law = match self.law {
            Law::Lambert => mu0,
            Law::LommelSeeliger => lommel_seeliger,
            Law::LunarLambert { decay_rad } => {
                let l = (-phase_rad / decay_rad).exp();
                l * lommel_seeliger + (1.0 - l) * mu0
            }
            Law::OrenNayar { roughness_rad } => {
                let s2 = roughness_rad * roughness_rad;
                let (a, b) = (1.0 - 0.5 * s2 / (s2 + 0.33), 0.45 * s2 / (s2 + 0.09));
                // cos psi sin i sin e = cos phase - mu0 mu; sin a tan b = sin i sin e / max(mu0, mu).
                let excess = (phase_rad.cos() - mu0 * mu).max(0.0) / mu0.max(mu);
                mu0 * (1.0 + b / a * excess)
            }
            Law::Hapke(hapke) => hapke.radiance_factor(geometry),
        };
        self.factor * law * self.phase_function.value(phase_rad)
    }

    /// Directional-hemispherical reflectance at incidence cosine `mu0`: integral of I/F over the
    /// emission hemisphere, divided by pi mu0; at most 1 for a law that conserves energy.
    pub fn hemispherical_reflectance(&self, mu0: f64) -> f64 {
        let (rings, sectors) = (200, 200);
        let sin_i = (1.0 - mu0 * mu0).sqrt();
        let mut sum = 0.0;
        for ring in 0..rings {
            // Midpoints in mu^2: the solid angle times mu is constant a ring.
            let mu = ((f64::from(ring) + 0.5) / f64::from(rings)).sqrt();
            let sin_e = (1.0 - mu * mu).sqrt();
            for sector in 0..sectors {
                let azimuth = PI * (f64::from(sector) + 0.5) / f64::from(sectors);
                let cos_phase = (mu0 * mu + sin_i * sin_e * azimuth.cos()).clamp(-1.0, 1.0);
                sum += self.radiance_factor(Geometry { mu0, mu, phase_rad: cos_phase.acos() });
            }
        }
        sum / f64::from(rings * sectors) / mu0
    }

    /// Integral phase function of a smooth sphere: disc-integrated I/F over the disc's area, at a
    /// phase angle; its value at 0 is the geometric albedo.
    pub fn sphere_disc_integral(&self, phase_rad: f64, steps: u32) -> f64 {
        // Photometric latitude and longitude: mu = cos b cos l, mu0 = cos b cos(phase - l).
        let n = f64::from(steps);
        let (from, to) = (phase_rad - FRAC_PI_2, FRAC_PI_2);
        let mut sum = 0.0;
        for row in 0..steps {
            let latitude = PI * ((f64::from(row) + 0.5) / n - 0.5);
            for column in 0..steps {
                let longitude = from + (to - from) * (f64::from(column) + 0.5) / n;
                let mu = latitude.cos() * longitude.cos();
                let mu0 = latitude.cos() * (phase_rad - longitude).cos();
                sum += self.radiance_factor(Geometry { mu0, mu, phase_rad }) * mu * latitude.cos();
            }
        }
        sum * (PI / n) * ((to - from) / n) / PI
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn with(law: Law) -> Photometry {
        Photometry::new(law, PhaseFunction::Constant, Some(0.3))
    }

    fn laws() -> [Photometry; 5] {
        let hapke = Hapke { single_scattering_albedo: 0.33, ..Hapke::lunar() };
        [
            with(Law::Lambert),
            with(Law::LommelSeeliger),
            with(Law::LunarLambert { decay_rad: 60f64.to_radians() }),
            with(Law::OrenNayar { roughness_rad: 0.35 }),
            Photometry::new(Law::Hapke(hapke), PhaseFunction::Constant, None),
        ]
    }

    #[test]
    fn normal_albedo_is_the_radiance_factor_at_normal() {
        for photometry in &laws()[..4] {
            let at = photometry.radiance_factor(Geometry { mu0: 1.0, mu: 1.0, phase_rad: 0.0 });
            assert!((at - 0.3).abs() < 1e-15);
        }
    }

    #[test]
    fn lambert_sphere_is_two_thirds_and_the_closed_phase_curve() {
        // Geometric albedo 2/3 A; phase curve (sin a + (pi - a) cos a) / pi.
        for phase_deg in [0.0, 20.0, 60.0, 90.0, 140.0f64] {
            let a = phase_deg.to_radians();
            let closed = 0.3 * 2.0 / 3.0 * (a.sin() + (PI - a) * a.cos()) / PI;
            let integral = with(Law::Lambert).sphere_disc_integral(a, 600);
            assert!((integral / closed - 1.0).abs() < 2e-5, "{phase_deg}: {integral} {closed}");
        }
    }

    #[test]
    fn lommel_seeliger_sphere_is_the_closed_phase_curve() {
        // Geometric albedo A (uniform disc); 1 - sin(a/2) tan(a/2) ln cot(a/4).
        for phase_deg in [1.0, 30.0, 60.0, 90.0, 140.0f64] {
            let a = phase_deg.to_radians();
            let closed = 0.3 * (1.0 - (a / 2.0).sin() * (a / 2.0).tan() * (1.0 / (a / 4.0).tan()).ln());
            let integral = with(Law::LommelSeeliger).sphere_disc_integral(a, 1200);
            assert!((integral / closed - 1.0).abs() < 5e-4, "{phase_deg}: {integral} {closed}");
        }
    }

    #[test]
    fn rough_without_roughness_is_lambert() {
        let smooth = with(Law::OrenNayar { roughness_rad: 0.0 });
        let geometry = Geometry { mu0: 0.4, mu: 0.7, phase_rad: 0.9 };
        assert!((smooth.radiance_factor(geometry) - 0.3 * 0.4).abs() < 1e-15);
    }

    #[test]
    fn energy_is_conserved() {
        let white = |law| Photometry::new(law, PhaseFunction::Constant, Some(1.0));
        for mu0 in [0.1, 0.5, 1.0] {
            assert!((white(Law::Lambert).hemispherical_reflectance(mu0) - 1.0).abs() < 1e-9);
            assert!(laws().iter().all(|law| law.hemispherical_reflectance(mu0) < 1.0));
            // Lommel-Seeliger in closed form: 4 integral of mu / (mu0 + mu) = 4 (1 - mu0 ln(1 + 1/mu0)).
            let closed = 4.0 * (1.0 - mu0 * (1.0 + 1.0 / mu0).ln());
            let integral = white(Law::LommelSeeliger).hemispherical_reflectance(mu0);
            assert!((integral / closed - 1.0).abs() < 1e-3, "{integral} {closed}");
        }
    }

    proptest! {
        /// Helmholtz: I/F over mu0 is unchanged when light and observer change places.
        #[test]
        fn reciprocity_holds(mu0 in 0.02..1.0f64, mu in 0.02..1.0f64, azimuth in 0.0..PI) {
            let sines = ((1.0 - mu0 * mu0) * (1.0 - mu * mu)).sqrt();
            let phase_rad = (mu0 * mu + sines * azimuth.cos()).clamp(-1.0, 1.0).acos();
            for law in laws() {
                let forth = law.radiance_factor(Geometry { mu0, mu, phase_rad }) / mu0;
                let back = law.radiance_factor(Geometry { mu0: mu, mu: mu0, phase_rad }) / mu;
                prop_assert!((forth / back - 1.0).abs() < 1e-9, "{law:?}: {forth} {back}");
            }
        }
    }
}
