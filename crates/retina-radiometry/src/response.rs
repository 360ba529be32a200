//! The screen's response: digital count to spectral irradiance at the pupil, and back.

/// Digital counts of one pixel, red, green, blue.
pub type DigitalCounts = [u8; 3];

/// Response of an 8-bit display seen through the facility: the effective spectral irradiance
/// (paper, eq. 10, divided by the sensor's bandwidth) that one pixel on the boresight sends into
/// the camera's pupil. Each channel carries a third of it; the curve is tabulated, so a measured
/// one takes the same path.
#[derive(Debug, Clone, PartialEq)]
pub struct ScreenResponse {
    /// Irradiance of a pixel with all three channels at count B, W m^-2 nm^-1; rising.
    white_w_m2_nm: Vec<f64>,
    /// Midpoints between neighbouring counts' irradiance: the nearest count is found among them.
    midpoints_w_m2_nm: Vec<f32>,
}

impl ScreenResponse {
    /// (B / 255)^gamma times the irradiance of `brightest_magnitude` at B = 255.
    pub fn power_law(gamma: f64, brightest_magnitude: f64) -> Self {
        let full = crate::irradiance_of_magnitude_w_m2_nm(brightest_magnitude);
        let white: Vec<f64> = (0..=255).map(|b| full * (f64::from(b) / 255.0).powf(gamma)).collect();
        let midpoints = white.windows(2).map(|pair| (0.5 * (pair[0] + pair[1])) as f32).collect();
        Self { white_w_m2_nm: white, midpoints_w_m2_nm: midpoints }
    }

    /// Irradiance of one pixel on the boresight at these counts, W m^-2 nm^-1.
    pub fn irradiance_w_m2_nm(&self, counts: DigitalCounts) -> f64 {
        counts.iter().map(|&b| self.white_w_m2_nm[usize::from(b)] / 3.0).sum()
    }

    /// The largest irradiance one pixel can show, W m^-2 nm^-1.
    pub fn brightest_w_m2_nm(&self) -> f64 {
        self.white_w_m2_nm[255]
    }

    /// The equal counts whose irradiance is nearest to the wanted one; the largest count where
    /// the wanted irradiance is beyond it.
    pub fn nearest_count(&self, irradiance_w_m2_nm: f32) -> u8 {
        self.midpoints_w_m2_nm.partition_point(|&middle| middle <= irradiance_w_m2_nm) as u8
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{irradiance_of_magnitude_w_m2_nm, magnitude_of_irradiance};

    #[test]
    fn the_contracts_default_response() {
        let wide = ScreenResponse::power_law(2.2, -1.44);
        assert!((magnitude_of_irradiance(wide.irradiance_w_m2_nm([255; 3])) + 1.44).abs() < 1e-12);
        // The declared faint limit 8.25 falls at B = 4.4: between counts 4 and 5.
        let faint = irradiance_of_magnitude_w_m2_nm(8.25);
        assert!(wide.irradiance_w_m2_nm([4; 3]) < faint && faint < wide.irradiance_w_m2_nm([5; 3]));
    }

    #[test]
    fn every_count_is_found_again_and_the_nearest_is_nearest() {
        let response = ScreenResponse::power_law(2.2, 0.065);
        for b in 0..=255u8 {
            assert_eq!(response.nearest_count(response.irradiance_w_m2_nm([b; 3]) as f32), b);
        }
        let (low, high) = (response.irradiance_w_m2_nm([99; 3]), response.irradiance_w_m2_nm([100; 3]));
        assert_eq!(response.nearest_count((low + 0.49 * (high - low)) as f32), 99);
        assert_eq!(response.nearest_count((low + 0.51 * (high - low)) as f32), 100);
        assert_eq!(response.nearest_count(1.0), 255);
        assert_eq!(response.nearest_count(0.0), 0);
    }
}
