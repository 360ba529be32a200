//! Hapke's bidirectional reflectance.

use std::f64::consts::PI;

use crate::registry::padded;
use crate::{Definition, Geometry, Key, LAW_PARAMETERS, Reflectance};

/// Parameters of Hapke's model as in "Theory of Reflectance and Emittance Spectroscopy", 2nd ed.
/// (Hapke 2012): both opposition effects, macroscopic roughness, porosity.
///
/// I/F = pi r with r = K w/(4 pi) mu0e/(mu0e + mue) [p(g) (1 + B_S) + H(mu0e/K) H(mue/K) - 1] (1 + B_C) S (Hapke 2012,
/// eq. 12.55 with 9.47).
///
/// Keys, with [`Hapke::lunar`] by default: `single_scattering_albedo` (1e-6 to 1; else found from the normal albedo),
/// `lobe_width` (0 to 0.999), `lobe_weight` (-1 to 1), `shoe_amplitude` (0 to 100), `shoe_width` (1e-6 to 10),
/// `cboe_amplitude` (0 to 100), `cboe_width` (1e-6 to 10), `roughness_deg` (0 to 60), `porosity` (0.001 to 10).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hapke {
    /// Single-scattering albedo w, 0..1.
    pub single_scattering_albedo: f64,
    /// Lobe width b of the double Henyey-Greenstein phase function, 0 <= b < 1.
    pub lobe_width: f64,
    /// Lobe weight c: 1 all backward, -1 all forward.
    pub lobe_weight: f64,
    /// Amplitude of the shadow-hiding opposition effect B_S0.
    pub shoe_amplitude: f64,
    /// Angular half-width of the shadow-hiding opposition effect h_S.
    pub shoe_width: f64,
    /// Amplitude of the coherent-backscatter opposition effect B_C0; 0 switches it off.
    pub cboe_amplitude: f64,
    /// Angular half-width of the coherent-backscatter opposition effect h_C.
    pub cboe_width: f64,
    /// Mean slope angle of the macroscopic roughness, rad; 0 is smooth.
    pub roughness_rad: f64,
    /// Porosity factor K; 1 for a sparse medium.
    pub porosity: f64,
}

const LUNAR: Hapke = Hapke::lunar();

impl Hapke {
    /// The lunar set that ABRAM uses (b 0.25, c 0.3, B_S0 2.2, h_S 0.07, roughness 0.4129 rad,
    /// no coherent backscatter), with w such that I/F at normal is near 0.12.
    pub const fn lunar() -> Self {
        Self {
            single_scattering_albedo: 0.21,
            lobe_width: 0.25,
            lobe_weight: 0.3,
            shoe_amplitude: 2.2,
            shoe_width: 0.07,
            cboe_amplitude: 0.0,
            cboe_width: 0.1,
            roughness_rad: 0.4129,
            porosity: 1.0,
        }
    }

    /// Chandrasekhar's H function, approximation of Hapke (2002), within 1 %:
    /// 1 / (1 - w x (r0 + (1 - 2 r0 x)/2 ln((1 + x)/x))), r0 = (1 - sqrt(1-w))/(1 + sqrt(1-w)).
    fn h(&self, x: f64) -> f64 {
        let w = self.single_scattering_albedo;
        let gamma = (1.0 - w).sqrt();
        let r0 = (1.0 - gamma) / (1.0 + gamma);
        1.0 / (1.0 - w * x * (r0 + 0.5 * (1.0 - 2.0 * r0 * x) * ((1.0 + x) / x).ln()))
    }

    /// Effective cosines and shadowing function of the macroscopic roughness
    /// (Hapke 1984; 2012, eqs. 12.45-12.54): (mu0e, mue, S).
    fn roughness(&self, geometry: Geometry) -> (f64, f64, f64) {
        let Geometry { mu0, mu, phase_rad } = geometry;
        if self.roughness_rad < 1e-6 {
            return (mu0, mu, 1.0);
        }
        let tan_theta = self.roughness_rad.tan();
        let cot_theta = 1.0 / tan_theta;
        let chi = 1.0 / (1.0 + PI * tan_theta * tan_theta).sqrt();
        let sine = |cosine: f64| (1.0 - cosine * cosine).max(1e-14).sqrt();
        let (sin_i, sin_e) = (sine(mu0), sine(mu));
        let cos_psi = ((phase_rad.cos() - mu0 * mu) / (sin_i * sin_e)).clamp(-1.0, 1.0);
        let psi = cos_psi.acos();
        let sin2_half = 0.5 * (1.0 - cos_psi);
        let e1 = |c: f64, s: f64| (-2.0 / PI * cot_theta * c / s).exp();
        let e2 = |c: f64, s: f64| (-(cot_theta * c / s).powi(2) / PI).exp();
        let eta = |c: f64, s: f64| chi * (c + s * tan_theta * e2(c, s) / (2.0 - e1(c, s)));
        let f = (-2.0 * (psi / 2.0).tan()).exp();
        // The formulas for incidence above emission are those below with the roles exchanged:
        // `low` is the smaller angle, `high` the larger.
        let swapped = mu0 < mu;
        let (c_low, s_low, c_high, s_high) =
            if swapped { (mu, sin_e, mu0, sin_i) } else { (mu0, sin_i, mu, sin_e) };
        let denominator = 2.0 - e1(c_high, s_high) - psi / PI * e1(c_low, s_low);
        let low = chi
            * (c_low
                + s_low * tan_theta * (cos_psi * e2(c_high, s_high) + sin2_half * e2(c_low, s_low))
                    / denominator);
        let high = chi
            * (c_high
                + s_high * tan_theta * (e2(c_high, s_high) - sin2_half * e2(c_low, s_low)) / denominator);
        let (mu0e, mue) = if swapped { (high, low) } else { (low, high) };
        let (eta_i, eta_e) = (eta(mu0, sin_i), eta(mu, sin_e));
        let lesser = if swapped { mu / eta_e } else { mu0 / eta_i };
        let shadowing = mue / eta_e * mu0 / eta_i * chi / (1.0 - f + f * chi * lesser);
        (mu0e, mue, shadowing)
    }
}

impl Definition for Hapke {
    const KEYS: &'static [Key] = &[
        Key::from_normal_albedo("single_scattering_albedo", "single-scattering albedo", [1e-6, 1.0]),
        Key::or("lobe_width", "lobe width", [0.0, 0.999], LUNAR.lobe_width),
        Key::or("lobe_weight", "lobe weight", [-1.0, 1.0], LUNAR.lobe_weight),
        Key::or("shoe_amplitude", "amplitude of shadow hiding", [0.0, 100.0], LUNAR.shoe_amplitude),
        Key::or("shoe_width", "width of shadow hiding", [1e-6, 10.0], LUNAR.shoe_width),
        Key::or("cboe_amplitude", "amplitude of coherent backscatter", [0.0, 100.0], LUNAR.cboe_amplitude),
        Key::or("cboe_width", "width of coherent backscatter", [1e-6, 10.0], LUNAR.cboe_width),
        Key::or("roughness_deg", "mean slope angle", [0.0, 60.0], LUNAR.roughness_rad.to_degrees()),
        Key::or("porosity", "porosity factor", [1e-3, 10.0], LUNAR.porosity),
    ];

    fn from_values(values: &[f64]) -> Self {
        Self {
            single_scattering_albedo: values[0],
            lobe_width: values[1],
            lobe_weight: values[2],
            shoe_amplitude: values[3],
            shoe_width: values[4],
            cboe_amplitude: values[5],
            cboe_width: values[6],
            roughness_rad: values[7].to_radians(),
            porosity: values[8],
        }
    }
}

impl Reflectance for Hapke {
    fn radiance_factor(&self, geometry: Geometry) -> f64 {
        let g = geometry.phase_rad;
        let (mu0e, mue, shadowing) = self.roughness(geometry);
        let tan_half = (g / 2.0).tan();
        let w = self.single_scattering_albedo;
        let b = self.lobe_width;
        let lobe = |cosine: f64| (1.0 - b * b) / (1.0 - 2.0 * b * cosine + b * b).powf(1.5);
        let p =
            0.5 * (1.0 + self.lobe_weight) * lobe(g.cos()) + 0.5 * (1.0 - self.lobe_weight) * lobe(-g.cos());
        let shoe = self.shoe_amplitude / (1.0 + tan_half / self.shoe_width);
        let x = tan_half / self.cboe_width;
        // (1 - exp(-x)) / x tends to 1 at opposition.
        let decay = if x > 1e-8 { -(-x).exp_m1() / x } else { 1.0 };
        let cboe = self.cboe_amplitude * 0.5 * (1.0 + decay) / (1.0 + x).powi(2);
        let multiple = self.h(mu0e / self.porosity) * self.h(mue / self.porosity) - 1.0;
        self.porosity * w / 4.0 * mu0e / (mu0e + mue)
            * (p * (1.0 + shoe) + multiple)
            * (1.0 + cboe)
            * shadowing
    }

    fn shader_parameters(&self) -> [f32; LAW_PARAMETERS] {
        padded([
            self.single_scattering_albedo,
            self.lobe_width,
            self.lobe_weight,
            self.shoe_amplitude,
            self.shoe_width,
            self.cboe_amplitude,
            self.cboe_width,
            self.roughness_rad,
            self.porosity,
        ])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{PhaseFunction, Photometry};

    /// Isotropic scatterers without opposition effects or roughness.
    fn isotropic(w: f64) -> Hapke {
        Hapke {
            single_scattering_albedo: w,
            lobe_width: 0.0,
            lobe_weight: 0.0,
            shoe_amplitude: 0.0,
            roughness_rad: 0.0,
            ..Hapke::lunar()
        }
    }

    #[test]
    fn conservative_scatterers_return_all_the_light() {
        // w = 1: the hemispherical reflectance is exactly 1; two approximate H of 1 % each enter it.
        let white = Photometry::new(isotropic(1.0), PhaseFunction::CONSTANT, None);
        for mu0 in [0.2, 0.6, 1.0] {
            assert!((white.hemispherical_reflectance(mu0) - 1.0).abs() < 0.02);
        }
    }

    #[test]
    fn hemispherical_reflectance_is_one_minus_gamma_h() {
        // Chandrasekhar: r_h = 1 - gamma H(mu0) for exact H; the approximate one is good to 1 %, and
        // the difference 1 - gamma H magnifies it.
        for w in [0.1, 0.5, 0.9] {
            let hapke = isotropic(w);
            let photometry = Photometry::new(hapke, PhaseFunction::CONSTANT, None);
            for mu0 in [0.3, 0.8] {
                let closed = 1.0 - (1.0 - w).sqrt() * hapke.h(mu0);
                let integral = photometry.hemispherical_reflectance(mu0);
                assert!((integral / closed - 1.0).abs() < 0.03, "{w} {mu0}: {integral} {closed}");
            }
        }
    }

    #[test]
    fn chandrasekhars_table_of_h() {
        // Chandrasekhar (1960), table XI: H(1) for w = 0.5 and 1.
        assert!((isotropic(0.5).h(1.0) / 1.2509 - 1.0).abs() < 0.01);
        assert!((isotropic(1.0).h(1.0) / 2.9078 - 1.0).abs() < 0.01);
    }

    #[test]
    fn dark_smooth_isotropic_is_lommel_seeliger() {
        // First order in w: w/4 mu0/(mu0 + mu).
        let geometry = Geometry { mu0: 0.7, mu: 0.4, phase_rad: 1.0 };
        let w = 1e-6;
        assert!((isotropic(w).radiance_factor(geometry) / (w / 4.0 * 0.7 / 1.1) - 1.0).abs() < 1e-5);
    }

    #[test]
    fn opposition_effects_raise_the_brightness_at_zero_phase_by_their_amplitude() {
        let normal = Geometry { mu0: 1.0, mu: 1.0, phase_rad: 0.0 };
        let w = 1e-6;
        let plain = isotropic(w).radiance_factor(normal);
        let shoe = Hapke { shoe_amplitude: 1.5, ..isotropic(w) }.radiance_factor(normal);
        let cboe = Hapke { cboe_amplitude: 0.5, ..isotropic(w) }.radiance_factor(normal);
        assert!((shoe / plain - 2.5).abs() < 1e-5 && (cboe / plain - 1.5).abs() < 1e-9);
    }

    #[test]
    fn roughness_at_normal_view_and_light_only_dims() {
        // i = e = 0: E1 = E2 = 0, so mu_e = chi and S = 1 / chi * ... = 1 exactly: r unchanged in LS form.
        let hapke = Hapke { roughness_rad: 0.4, ..isotropic(1e-6) };
        let (mu0e, mue, s) = hapke.roughness(Geometry { mu0: 1.0, mu: 1.0, phase_rad: 0.0 });
        let chi = 1.0 / (1.0 + PI * 0.4f64.tan().powi(2)).sqrt();
        assert!((mu0e - chi).abs() < 1e-6 && (mue - chi).abs() < 1e-6 && (s - 1.0).abs() < 1e-6);
    }
}
