//! What a setup's camera will see, before any lens is traced.

use retina_geometry::Setup;
use retina_radiometry::magnitude_of_irradiance;

use crate::bench::pupil_area_m2;
use crate::sensor::efficiency_of;

/// Signal over noise at the limiting magnitude.
const LIMIT_SIGMAS: f64 = 5.0;
/// Of the light, nm.
const WAVELENGTH_NM: f64 = 550.0;
/// Standard deviation of the normal curve that fits an Airy pattern's core, in wavelengths times the f-number.
const AIRY_SIGMA: f64 = 0.42;
/// Full width at half the maximum of a normal curve, in its standard deviations: 2 sqrt(2 ln 2).
const FWHM: f64 = 2.354_82;

/// What follows from a setup's numbers alone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prediction {
    /// Camera pixels across a pixel of the screen, on the axis.
    pub screen_pixel_camera_px: f64,
    /// Full width at half maximum of the spot of one lit pixel by both screens' pixels and diffraction, camera px. The lenses'
    /// aberrations add to it.
    pub spot_fwhm_px: f64,
    /// Magnitudes that one pixel shows at digital counts 255 and 1.
    pub displayed_magnitudes: [f64; 2],
    /// Exponent of the display's response.
    pub response_gamma: f64,
    /// Exposure that the limit is of, s.
    pub exposure_s: f64,
    /// Magnitude whose spot stands five sigmas above the camera's noise.
    pub limiting_magnitude: f64,
}

impl Prediction {
    /// Of a setup, for an exposure.
    ///
    /// A spot of S electrons and standard deviation s covers 4 pi s^2 pixels of noise, so S / sqrt(S + 4 pi s^2 b) = 5 with
    /// b = read noise^2 + dark current times exposure gives S = 25 / 2 (1 + sqrt(1 + 16 pi s^2 b / 25)) (I. R. King, PASP
    /// 95, 1983).
    pub fn of(setup: &Setup, exposure_s: f64) -> Self {
        let (camera, screen) = (setup.camera_pinhole(), setup.facility_pinhole());
        let screen_pixel_camera_px = camera.fy_px / screen.fy_px;
        let airy_px = AIRY_SIGMA * WAVELENGTH_NM * 1e-3 * setup.camera.f_number / setup.camera.pixel_um;
        let variance_px2 = (screen_pixel_camera_px.powi(2) + 1.0) / 12.0 + airy_px * airy_px;
        let noise = &setup.noise;
        let pixel_noise = noise.read_noise_e.powi(2) + noise.dark_e_s * exposure_s;
        let square = LIMIT_SIGMAS * LIMIT_SIGMAS;
        let pixels = 4.0 * std::f64::consts::PI * variance_px2;
        let signal_e = 0.5 * square * (1.0 + (1.0 + 4.0 * pixels * pixel_noise / square).sqrt());
        let efficiency = efficiency_of(noise);
        let irradiance = signal_e
            / (exposure_s
                * efficiency.bandwidth_nm()
                * pupil_area_m2(setup)
                * efficiency.electrons_per_joule());
        let (brightest, gamma) = (setup.brightest_magnitude(), setup.response_gamma());
        Self {
            screen_pixel_camera_px,
            spot_fwhm_px: FWHM * variance_px2.sqrt(),
            displayed_magnitudes: [brightest, brightest + 2.5 * gamma * 255f64.log10()],
            response_gamma: gamma,
            exposure_s,
            limiting_magnitude: magnitude_of_irradiance(irradiance),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    /// At the limit the photons are 25 where nothing else is noise; four times the exposure then shows stars four times as
    /// faint.
    #[test]
    fn photons_alone_go_with_the_exposure() {
        let mut setup = Setup::shipped(Path::new("wide-fov")).unwrap();
        (setup.noise.read_noise_e, setup.noise.dark_e_s) = (0.0, 0.0);
        let [one, four] = [1.0, 4.0].map(|exposure| Prediction::of(&setup, exposure).limiting_magnitude);
        assert!((four - one - 2.5 * 4f64.log10()).abs() < 1e-12);
        let bench_e_s = retina_radiometry::irradiance_of_magnitude_w_m2_nm(one)
            * efficiency_of(&setup.noise).bandwidth_nm()
            * pupil_area_m2(&setup)
            * efficiency_of(&setup.noise).electrons_per_joule();
        assert!((bench_e_s - 25.0).abs() < 1e-9, "{bench_e_s}");
    }

    /// The wide configuration of the paper: 7246 camera px and 5661 screen px of focal length, -1.44 mag.
    #[test]
    fn the_papers_wide_configuration() {
        let found = Prediction::of(&Setup::shipped(Path::new("wide-fov")).unwrap(), 1.0);
        assert!((found.screen_pixel_camera_px - 1.28).abs() < 0.01, "{found:?}");
        assert!((found.displayed_magnitudes[0] + 1.44).abs() < 0.01);
        assert!((1.0..1.5).contains(&found.spot_fwhm_px), "{found:?}");
    }
}
