//! A fitted response as the table `[response]` of `calibration.toml`.

use retina_formats::{ChannelRecord, DataRecord, ResponseRecord, wavelengths_nm};
use retina_geometry::Setup;

use crate::channel::COVARIANCE_OF;
use crate::{Calibrated, ChannelResponse, Estimate};

impl Calibrated {
    /// The table `[response]`, of readings that were taken with `measured_with`.
    pub fn record(&self, measured_with: &Setup) -> ResponseRecord {
        let calibration = &self.calibration;
        let range = calibration.magnitude_range();
        let data = self.readings.files.iter().map(|file| DataRecord {
            file: file.path.file_name().unwrap_or(file.path.as_os_str()).to_string_lossy().into_owned(),
            blake3: file.blake3.clone(),
        });
        let [r, g, b] = [0, 1, 2].map(|c| channel(&self.fits[c]));
        ResponseRecord {
            wavelength_nm: wavelengths_nm(measured_with),
            efficiency: calibration.efficiency,
            bandwidth_nm: calibration.bandwidth_nm,
            magnitude_range: [range.brightest, range.faintest],
            measured_with: measured_with.name.clone(),
            data: data.collect(),
            r,
            g,
            b,
        }
    }
}

fn channel(fit: &ChannelResponse) -> ChannelRecord {
    let pair = |estimate: Estimate| [estimate.value, estimate.sigma];
    ChannelRecord {
        gamma: pair(fit.gamma),
        full_w_m2: pair(fit.full_w_m2),
        black: pair(fit.black),
        zero_w_m2: fit.zero_w_m2.map(pair),
        covariance_of: COVARIANCE_OF[..fit.covariance.len()].iter().map(|&name| name.into()).collect(),
        covariance: fit.covariance.clone(),
        knots: fit.knots,
        readings: fit.readings,
        outliers: fit.outliers.len(),
        rms_relative: fit.rms_relative,
        irradiance_w_m2: fit.irradiance_w_m2.clone(),
        sigma_w_m2: fit.sigma_w_m2.clone(),
    }
}
