//! Eq. 8 in full beside eq. 10: the display's lines have a width, and stars a colour.

use retina_formats::{RadiometricCalibration, quantum_efficiency, wavelengths_nm};
use retina_geometry::Setup;

/// Second radiation constant h c / k, nm K (SI, exact).
const C2_NM_K: f64 = 1.438_776_877e7;
/// Where magnitudes are (V band), nm.
const V_BAND_NM: f64 = 550.0;
/// Of the blackbodies, K.
const TEMPERATURES_K: [f64; 3] = [4000.0, 5800.0, 10_000.0];

/// What a star's spectrum changes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StarForm {
    /// Of a blackbody, K; `None` for a flat spectrum, which the paper assumes.
    pub temperature_k: Option<f64>,
    /// Integral of eta times the spectrum (1 at 550 nm), nm: the bandwidth in eq. 10's place.
    pub bandwidth_nm: f64,
    /// Magnitude that the camera sees in the facility at eq. 10's counts, minus that of the star itself:
    /// above 0, the facility shows too little.
    pub difference_mag: f64,
}

/// Eq. 8 with lines of a width.
#[derive(Debug, Clone, PartialEq)]
pub struct SpectralForm {
    /// Mean of eta over each line, red, green, blue.
    pub line_efficiency: [f64; 3],
    /// Flat, then blackbodies of 4000, 5800, 10 000 K.
    pub stars: Vec<StarForm>,
}

impl SpectralForm {
    /// Of a setup's lines (Gaussian, `optics.linewidth_nm` wide at half maximum) and sensor, for white at
    /// full counts.
    pub fn of(setup: &Setup, calibration: &RadiometricCalibration) -> Self {
        let curve = quantum_efficiency(setup);
        let lines = wavelengths_nm(setup);
        let mut line_efficiency = [0.0; 3];
        for (c, mean) in line_efficiency.iter_mut().enumerate() {
            let width = setup.optics.linewidth_nm[c];
            let sigma_nm = width / (8.0 * 2f64.ln()).sqrt();
            // Below a nanometre the integration's step would miss the line, and eta is straight there.
            *mean = if width < 1.0 {
                curve.relative(lines[c])
            } else {
                let norm = sigma_nm * (2.0 * std::f64::consts::PI).sqrt();
                curve.integral(|nm| (-0.5 * ((nm - lines[c]) / sigma_nm).powi(2)).exp() / norm)
            };
        }
        let full: Vec<f64> = calibration.channels.iter().map(|c| c.irradiance_w_m2[255]).collect();
        let weighed = |eta: &[f64; 3]| eta.iter().zip(&full).map(|(eta, i)| eta * i).sum::<f64>();
        let lines_over_points = weighed(&line_efficiency) / weighed(&calibration.efficiency);
        let star = |temperature_k: Option<f64>| {
            let bandwidth_nm =
                temperature_k.map_or(calibration.bandwidth_nm, |t| curve.integral(|nm| blackbody(nm, t)));
            let shown_over_true = lines_over_points * calibration.bandwidth_nm / bandwidth_nm;
            StarForm { temperature_k, bandwidth_nm, difference_mag: -2.5 * shown_over_true.log10() }
        };
        let stars = std::iter::once(None).chain(TEMPERATURES_K.map(Some)).map(star).collect();
        Self { line_efficiency, stars }
    }
}

/// Planck's law over wavelength, 1 at 550 nm.
fn blackbody(nm: f64, temperature_k: f64) -> f64 {
    let planck = |nm: f64| nm.powi(-5) / (C2_NM_K / (nm * temperature_k)).exp_m1();
    planck(nm) / planck(V_BAND_NM)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Wien's displacement, 2.897 771 955e6 nm K (CODATA), is where it peaks; and at long waves and high
    /// temperature it goes with the fourth power of 1 / wavelength (Rayleigh and Jeans).
    #[test]
    fn plancks_law() {
        let peak = 2.897_771_955e6 / 5800.0;
        assert!(blackbody(peak, 5800.0) > blackbody(peak - 1.0, 5800.0));
        assert!(blackbody(peak, 5800.0) > blackbody(peak + 1.0, 5800.0));
        let ratio = blackbody(2000.0, 1e8) / blackbody(1000.0, 1e8);
        assert!((ratio * 16.0 - 1.0).abs() < 1e-3, "{ratio}");
    }
}
