//! From radiance to the screen image's digital counts.

use retina_geometry::Setup;
use retina_radiometry::ScreenResponse;

use crate::{Quantisation, quantise};

/// Count at which the brightest pixel of a sequence with an automatic radiance scale is shown.
const BRIGHTEST_COUNT: u8 = 254;

/// Turns radiance into the digital counts of a setup's screen.
#[derive(Debug, Clone)]
pub struct ScreenEncoder {
    response: ScreenResponse,
    width_px: u32,
    pixel_sr: f64,
}

/// A screen image.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Encoded {
    /// The same count for all three channels, row by row.
    pub counts: Vec<u8>,
    /// Pixels whose wanted irradiance is beyond the brightest count by more than half a step.
    pub saturated_px: u64,
}

impl ScreenEncoder {
    /// For a setup's screen and the power law that the setup states.
    pub fn new(setup: &Setup) -> Self {
        let response = ScreenResponse::power_law(setup.response_gamma(), setup.brightest_magnitude());
        Self::with_response(setup, response)
    }

    /// For a setup's screen and a response that was measured.
    pub fn with_response(setup: &Setup, response: ScreenResponse) -> Self {
        Self {
            response,
            width_px: setup.screen.width_px,
            pixel_sr: setup.facility_pinhole().boresight_pixel_sr(),
        }
    }

    /// The response that is inverted.
    pub fn response(&self) -> &ScreenResponse {
        &self.response
    }

    /// The radiance scale that shows `radiance` (W m^-2 sr^-1 nm^-1) just below saturation.
    pub fn scale_for_brightest(&self, radiance: f64) -> f64 {
        self.response.irradiance_w_m2_nm([BRIGHTEST_COUNT; 3]) / (radiance * self.pixel_sr)
    }

    /// Counts of an image of radiance (W m^-2 sr^-1 nm^-1): radiance is uniform over the screen, so
    /// a pixel's irradiance is radiance x scale x the boresight pixel's solid angle.
    ///
    /// # Errors
    /// The number of pixels that are not finite.
    pub fn encode(
        &self,
        radiance: &[f32],
        radiance_scale: f64,
        quantisation: Quantisation,
    ) -> Result<Encoded, usize> {
        let not_finite = radiance.iter().filter(|value| !value.is_finite()).count();
        if not_finite > 0 {
            return Err(not_finite);
        }
        let factor = radiance_scale * self.pixel_sr;
        let wanted: Vec<f32> =
            radiance.iter().map(|&value| (f64::from(value.max(0.0)) * factor) as f32).collect();
        let brightest = self.response.brightest_w_m2_nm();
        let half_step = 0.5 * (brightest - self.response.irradiance_w_m2_nm([254; 3]));
        let most = (brightest + half_step) as f32;
        let saturated_px = wanted.iter().filter(|&&wanted| wanted > most).count() as u64;
        let counts = match quantisation {
            Quantisation::Nearest => quantise::nearest(&self.response, &wanted),
            Quantisation::Diffused => quantise::diffused(&self.response, &wanted, self.width_px as usize),
        };
        Ok(Encoded { counts, saturated_px })
    }
}
