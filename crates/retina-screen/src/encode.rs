//! From radiance to the screen image's digital counts.

use retina_geometry::Setup;
use retina_radiometry::ScreenResponse;

/// Count at which the brightest pixel of a sequence with an automatic radiance scale is shown.
const BRIGHTEST_COUNT: u8 = 254;

/// Turns radiance into the digital counts of a setup's screen.
#[derive(Debug, Clone)]
pub struct ScreenEncoder {
    response: ScreenResponse,
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
    /// For a setup's screen and response.
    pub fn new(setup: &Setup) -> Self {
        Self {
            response: ScreenResponse::power_law(setup.response_gamma(), setup.brightest_magnitude()),
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
    pub fn encode(&self, radiance: &[f32], radiance_scale: f64) -> Result<Encoded, usize> {
        let not_finite = radiance.iter().filter(|value| !value.is_finite()).count();
        if not_finite > 0 {
            return Err(not_finite);
        }
        let factor = radiance_scale * self.pixel_sr;
        let brightest = self.response.brightest_w_m2_nm();
        let half_step = 0.5 * (brightest - self.response.irradiance_w_m2_nm([254; 3]));
        let mut saturated_px = 0;
        let counts = radiance
            .iter()
            .map(|&value| {
                if value <= 0.0 {
                    return 0;
                }
                let wanted = f64::from(value) * factor;
                saturated_px += u64::from(wanted > brightest + half_step);
                self.response.nearest_count(wanted as f32)
            })
            .collect();
        Ok(Encoded { counts, saturated_px })
    }
}
