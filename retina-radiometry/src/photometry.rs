//! Photometric functions: how bright a surface element is, seen and lit from given directions.

use std::f64::consts::{FRAC_PI_2, PI};

use crate::{Law, PhaseFunction};

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
    /// If it is `None`, I/F is what the law itself says.
    pub fn new(
        law: impl Into<Law>,
        phase_function: impl Into<PhaseFunction>,
        normal_albedo: Option<f64>,
    ) -> Self {
        let unit = Self { law: law.into(), phase_function: phase_function.into(), factor: 1.0 };
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
        self.factor * self.law.radiance_factor(geometry) * self.phase_function.value(phase_rad)
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
    use crate::{
        Akimov, Hapke, Lambert, LommelSeeliger, LunarLambert, Minnaert, OrenNayar, Registered, Rolo,
    };
    use proptest::prelude::*;

    fn with(law: impl Into<Law>) -> Photometry {
        Photometry::new(law, PhaseFunction::CONSTANT, Some(0.3))
    }

    fn laws() -> [Photometry; 8] {
        let hapke = Hapke { single_scattering_albedo: 0.33, ..Hapke::lunar() };
        [
            with(Lambert),
            with(LommelSeeliger),
            with(LunarLambert { decay_rad: 60f64.to_radians() }),
            with(OrenNayar { roughness_rad: 0.35 }),
            with(Minnaert { k: 0.7 }),
            with(Akimov),
            with(rolo()),
            Photometry::new(hapke, PhaseFunction::CONSTANT, None),
        ]
    }

    fn rolo() -> Rolo {
        Rolo {
            surge_amplitude: 0.05,
            surge_decay_per_deg: 0.2,
            polynomial: [0.2, -3e-3, 2.5e-5, -1.5e-7, 4e-10],
        }
    }

    #[test]
    fn a_mixture_of_lambert_and_seeliger_is_the_law() {
        let mut mixtures = 0;
        for photometry in laws() {
            for (mu0, mu, phase_rad) in [(0.9, 0.3, 0.2), (0.1, 0.8, 1.4), (0.5, 0.02, 2.5)] {
                if let Some([a, b]) = photometry.law.lambert_and_seeliger(phase_rad) {
                    let whole = photometry.law.radiance_factor(Geometry { mu0, mu, phase_rad });
                    assert!(
                        (a * mu0 + b * mu0 / (mu0 + mu) - whole).abs() < 1e-12,
                        "{}",
                        photometry.law.name()
                    );
                    mixtures += 1;
                }
            }
        }
        assert_eq!(mixtures, 4 * 3);
    }

    #[test]
    fn normal_albedo_is_the_radiance_factor_at_normal() {
        for photometry in &laws()[..7] {
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
            let integral = with(Lambert).sphere_disc_integral(a, 600);
            assert!((integral / closed - 1.0).abs() < 2e-5, "{phase_deg}: {integral} {closed}");
        }
    }

    #[test]
    fn lommel_seeliger_sphere_is_the_closed_phase_curve() {
        // Geometric albedo A (uniform disc); 1 - sin(a/2) tan(a/2) ln cot(a/4).
        for phase_deg in [1.0, 30.0, 60.0, 90.0, 140.0f64] {
            let a = phase_deg.to_radians();
            let closed = 0.3 * (1.0 - (a / 2.0).sin() * (a / 2.0).tan() * (1.0 / (a / 4.0).tan()).ln());
            let integral = with(LommelSeeliger).sphere_disc_integral(a, 1200);
            assert!((integral / closed - 1.0).abs() < 5e-4, "{phase_deg}: {integral} {closed}");
        }
    }

    #[test]
    fn rough_without_roughness_is_lambert() {
        let smooth = with(OrenNayar { roughness_rad: 0.0 });
        let geometry = Geometry { mu0: 0.4, mu: 0.7, phase_rad: 0.9 };
        assert!((smooth.radiance_factor(geometry) - 0.3 * 0.4).abs() < 1e-15);
    }

    #[test]
    fn energy_is_conserved() {
        fn white(law: impl Into<Law>) -> Photometry {
            Photometry::new(law, PhaseFunction::CONSTANT, Some(1.0))
        }
        for mu0 in [0.1, 0.5, 1.0] {
            assert!((white(Lambert).hemispherical_reflectance(mu0) - 1.0).abs() < 1e-9);
            assert!(laws().iter().all(|law| law.hemispherical_reflectance(mu0) < 1.0));
            // Lommel-Seeliger in closed form: 4 integral of mu / (mu0 + mu) = 4 (1 - mu0 ln(1 + 1/mu0)).
            let closed = 4.0 * (1.0 - mu0 * (1.0 + 1.0 / mu0).ln());
            let integral = white(LommelSeeliger).hemispherical_reflectance(mu0);
            assert!((integral / closed - 1.0).abs() < 1e-3, "{integral} {closed}");
        }
    }

    #[test]
    fn minnaert_with_exponent_one_is_lambert() {
        for phase_rad in [0.0, 0.6, 1.7, 2.6] {
            let lambert = with(Lambert).sphere_disc_integral(phase_rad, 60);
            let minnaert = with(Minnaert { k: 1.0 }).sphere_disc_integral(phase_rad, 60);
            assert!((minnaert / lambert - 1.0).abs() < 1e-12, "{phase_rad}: {minnaert} {lambert}");
        }
    }

    #[test]
    fn minnaerts_sphere_at_full_phase_is_the_closed_form() {
        // At phase 0, I/F = A mu^(2k - 1) and the disc's mean is the integral of 2 mu^(2k) = 2 A / (2k + 1).
        for k in [0.5, 0.7, 1.0, 1.4] {
            let closed = 0.3 * 2.0 / (2.0 * k + 1.0);
            let integral = with(Minnaert { k }).sphere_disc_integral(0.0, 600);
            assert!((integral / closed - 1.0).abs() < 1e-4, "{k}: {integral} {closed}");
        }
    }

    /// Shkuratov et al. (2011), eq. 19, by photometric latitude and longitude from the mirror meridian, where the disc
    /// function is cos(a/2) cos(pi l / (pi - a)) / cos(l + a/2) cos(b)^(a / (pi - a)).
    fn akimov_of_coordinates(latitude_rad: f64, from_mirror_rad: f64, phase_rad: f64) -> f64 {
        let rest = PI - phase_rad;
        (phase_rad / 2.0).cos() * (PI * from_mirror_rad / rest).cos()
            / (from_mirror_rad + phase_rad / 2.0).cos()
            * latitude_rad.cos().powf(phase_rad / rest)
    }

    #[test]
    fn akimov_is_its_formula_in_photometric_coordinates() {
        for phase_rad in [1e-6, 1e-3, 0.1, 0.8, 1.9, 2.9f64] {
            for latitude in [-1.4, -0.5, 0.0, 0.9f64] {
                for part in [-0.98, -0.4, 0.0, 0.3, 0.9] {
                    let from_mirror = part * (PI - phase_rad) / 2.0;
                    let longitude = from_mirror + phase_rad / 2.0;
                    let mu = latitude.cos() * longitude.cos();
                    let mu0 = latitude.cos() * (phase_rad - longitude).cos();
                    let law = Law::from(Akimov).radiance_factor(Geometry { mu0, mu, phase_rad });
                    let expected = akimov_of_coordinates(latitude, from_mirror, phase_rad);
                    // Rounding of mu0 - mu cos(phase), over the sine of the distance from the limb.
                    let tolerance = 1e-12 / mu.min(mu0);
                    assert!(
                        (law / expected - 1.0).abs() < tolerance,
                        "{phase_rad} {latitude} {part}: {law} {expected}"
                    );
                }
            }
        }
    }

    #[test]
    fn akimovs_full_disc_is_flat_and_its_limb_finite() {
        let law = Law::from(Akimov);
        for mu in [1e-9, 1e-3, 0.3, 1.0] {
            assert_eq!(law.radiance_factor(Geometry { mu0: mu, mu, phase_rad: 0.0 }), 1.0);
            // The exponent a / (pi - a) and the slope over longitude are of the order of the phase angle.
            let near = law.radiance_factor(Geometry { mu0: mu, mu, phase_rad: 1e-7 });
            assert!((near - 1.0).abs() < 1e-5, "{mu}: {near}");
        }
        // At the limb on the equator: cos(a/2) pi / (pi - a), the limit of cosine over cosine.
        let a = 1.0f64;
        let limb = law.radiance_factor(Geometry { mu0: a.sin(), mu: 1e-14, phase_rad: a });
        assert!((limb / ((a / 2.0).cos() * PI / (PI - a)) - 1.0).abs() < 1e-9, "{limb}");
        let terminator = law.radiance_factor(Geometry { mu0: 1e-14, mu: a.sin(), phase_rad: a });
        assert!((0.0..1e-12).contains(&terminator), "{terminator}");
    }

    #[test]
    fn rolos_phase_curve_is_its_formula() {
        // By hand, a = 50 deg: 0.05 exp(-10) + 0.2 - 0.15 + 0.0625 - 0.01875 + 0.0025 = 0.09625227 (+ 5 digits).
        let at = |mu0: f64, mu: f64, deg: f64| {
            Law::from(rolo()).radiance_factor(Geometry { mu0, mu, phase_rad: deg.to_radians() })
        };
        assert!((at(0.5, 0.5, 50.0) - 0.5 * 0.096_252_27).abs() < 1e-10, "{}", at(0.5, 0.5, 50.0));
        assert!((at(0.6, 0.2, 50.0) - 0.75 * 0.096_252_27).abs() < 1e-10);
        assert!((at(1.0, 1.0, 0.0) - 0.125).abs() < 1e-15);
        // A polynomial that turns negative gives no light.
        let falling = Rolo { polynomial: [0.1, -0.01, 0.0, 0.0, 0.0], ..rolo() };
        let dark = Geometry { mu0: 0.5, mu: 0.5, phase_rad: 1.0 };
        assert_eq!(Law::from(falling).radiance_factor(dark), 0.0);
    }

    /// What the scene's reader builds from default keys, and what the shader is told.
    #[test]
    fn registers_have_names_keys_and_indices_of_their_own() {
        fn check<T: Registered>(index: impl Fn(&T) -> u32, of_one_name: &mut Vec<(&'static str, usize)>) {
            for (place, kind) in T::ALL.iter().enumerate() {
                assert_eq!(index(&(kind.from_values)(&vec![0.5; kind.value_count()])) as usize, place);
                assert!(kind.wgsl.contains(&format!("fn {}(", kind.function)), "{}", kind.name);
                assert_eq!(T::ALL.iter().filter(|other| other.name == kind.name).count(), 1);
                for key in kind.keys {
                    assert!(key.range[0] < key.range[1] && key.length > 0, "{}", key.name);
                    of_one_name.push((key.name, key.length));
                }
            }
        }
        let mut keys = Vec::new();
        check::<Law>(Law::index, &mut keys);
        check::<PhaseFunction>(PhaseFunction::index, &mut keys);
        // Laws may share a key's name; it is then a number in all of them, or a list of the same length.
        for (name, length) in &keys {
            assert!(keys.iter().all(|(other, n)| other != name || n == length), "{name}");
        }
        let defaults: Vec<f64> = Law::ALL[4]
            .keys
            .iter()
            .map(|key| if let crate::KeyDefault::Value(value) = key.default { value } else { 0.21 })
            .collect();
        let Law::Hapke(hapke) = (Law::ALL[4].from_values)(&defaults) else { panic!("not Hapke's") };
        assert!((hapke.roughness_rad - Hapke::lunar().roughness_rad).abs() < 1e-15);
        assert_eq!(Hapke { roughness_rad: 0.4129, ..hapke }, Hapke::lunar());
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
