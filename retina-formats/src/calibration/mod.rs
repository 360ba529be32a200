//! `calibration.toml`, schema `retina.calibration/1`: what is known of a facility's geometry and response.

mod file;
mod geometry;
mod response;

pub use file::{
    CalibrationFile, ChannelRecord, CovarianceRecord, DataRecord, DistortionRecord, FieldRecord,
    InverseRecord, ResponseRecord, RingsRecord,
};
pub use geometry::Calibration;
pub use response::{
    ChannelCurve, FAINTEST_ERROR_MAG, MagnitudeRange, MeasuredResponse, RadiometricCalibration, efficiencies,
    measured_or_power_law, quantum_efficiency, wavelengths_nm,
};
