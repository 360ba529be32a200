//! A display's response as if it had been measured.

use std::path::Path;

use retina_formats::{
    CalibrationFile, ChannelRecord, MeasuredResponse, ResponseRecord, efficiencies, wavelengths_nm,
};
use retina_geometry::Setup;

/// A measured response (B / 255)^gamma, the three channels alike.
pub(crate) fn response(setup: &Setup, gamma: f64) -> MeasuredResponse {
    let (efficiency, bandwidth_nm) = efficiencies(setup);
    let light: Vec<f64> = (0..256).map(|b| 2e-8 * (f64::from(b) / 255.0).powf(gamma)).collect();
    let channel = ChannelRecord {
        gamma: [gamma, 0.01],
        full_w_m2: [2e-8, 1e-10],
        black: [0.0, 1e-6],
        zero_w_m2: None,
        covariance_of: Vec::new(),
        covariance: Vec::new(),
        knots: 2,
        readings: 40,
        outliers: 0,
        rms_relative: 0.01,
        sigma_w_m2: light.iter().map(|light| 0.01 * light).collect(),
        irradiance_w_m2: light,
    };
    let record = ResponseRecord {
        wavelength_nm: wavelengths_nm(setup),
        efficiency,
        bandwidth_nm,
        magnitude_range: [-1.4, 8.0],
        measured_with: setup.name.clone(),
        data: Vec::new(),
        r: channel.clone(),
        g: channel.clone(),
        b: channel,
    };
    let mut file = CalibrationFile::new(setup);
    file.response = Some(record);
    MeasuredResponse::of_file(&file, Path::new("response.toml"), setup).unwrap().unwrap()
}
