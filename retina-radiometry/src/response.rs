//! The screen's response: digital count to spectral irradiance at the pupil, and back.

/// Digital counts of one pixel, red, green, blue.
pub type DigitalCounts = [u8; 3];

/// Response of an 8-bit display seen through the facility: the effective spectral irradiance
/// (paper, eq. 10, divided by the sensor's bandwidth) that one pixel on the boresight sends into
/// the camera's pupil. The power law gives each channel a third of it; the curves are tabulated, so measured
/// ones take the same path.
#[derive(Debug, Clone, PartialEq)]
pub struct ScreenResponse {
    /// Irradiance of a pixel with all three channels at count B, W m^-2 nm^-1; rising.
    white_w_m2_nm: Vec<f64>,
    /// What each channel gives to it, red, green, blue; `[channel][count]`, W m^-2 nm^-1.
    channels_w_m2_nm: [Vec<f64>; 3],
    /// Midpoints between neighbouring counts' irradiance: the nearest count is found among them.
    midpoints_w_m2_nm: Vec<f32>,
}

impl ScreenResponse {
    /// (B / 255)^gamma times the irradiance of `brightest_magnitude` at B = 255.
    pub fn power_law(gamma: f64, brightest_magnitude: f64) -> Self {
        let full = crate::irradiance_of_magnitude_w_m2_nm(brightest_magnitude);
        let white: Vec<f64> = (0..=255).map(|b| full * (f64::from(b) / 255.0).powf(gamma)).collect();
        let third: Vec<f64> = white.iter().map(|white| white / 3.0).collect();
        Self::tabulated(white, [third.clone(), third.clone(), third])
    }

    /// Of measured curves, red, green, blue: what a pixel's channel gives to the effective spectral
    /// irradiance at each of the 256 counts (eta I_c(B) over the bandwidth, eq. 10), W m^-2 nm^-1. `None`
    /// unless there are 256 values each, finite, none negative, and their sum rises with every count.
    pub fn measured(channels_w_m2_nm: [Vec<f64>; 3]) -> Option<Self> {
        let fits = |curve: &Vec<f64>| curve.len() == 256 && curve.iter().all(|v| v.is_finite() && *v >= 0.0);
        if !channels_w_m2_nm.iter().all(fits) {
            return None;
        }
        let white: Vec<f64> = (0..256).map(|b| channels_w_m2_nm.iter().map(|curve| curve[b]).sum()).collect();
        white.windows(2).all(|pair| pair[1] > pair[0]).then(|| Self::tabulated(white, channels_w_m2_nm))
    }

    fn tabulated(white_w_m2_nm: Vec<f64>, channels_w_m2_nm: [Vec<f64>; 3]) -> Self {
        let midpoints_w_m2_nm =
            white_w_m2_nm.windows(2).map(|pair| (0.5 * (pair[0] + pair[1])) as f32).collect();
        Self { white_w_m2_nm, channels_w_m2_nm, midpoints_w_m2_nm }
    }

    /// Irradiance of one pixel on the boresight at these counts, W m^-2 nm^-1.
    pub fn irradiance_w_m2_nm(&self, counts: DigitalCounts) -> f64 {
        self.channels_w_m2_nm.iter().zip(counts).map(|(curve, b)| curve[usize::from(b)]).sum()
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

    /// Channels of unequal shares and curves: a mixture is the sum of what each gives, by hand.
    #[test]
    fn measured_channels_add_up() {
        let curve =
            |full: f64, gamma: i32| (0..=255).map(|b| full * (f64::from(b) / 255.0).powi(gamma)).collect();
        let response = ScreenResponse::measured([curve(1.0, 2), curve(2.0, 1), curve(4.0, 3)]).unwrap();
        assert!((response.irradiance_w_m2_nm([255, 51, 0]) - 1.4).abs() < 1e-12);
        assert!((response.brightest_w_m2_nm() - 7.0).abs() < 1e-12);
        assert_eq!(response.nearest_count(response.irradiance_w_m2_nm([77; 3]) as f32), 77);
        assert_eq!(ScreenResponse::measured([curve(1.0, 2), curve(2.0, 1), vec![0.0; 255]]), None);
        assert_eq!(ScreenResponse::measured([curve(0.0, 2), curve(0.0, 1), curve(0.0, 1)]), None);
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
