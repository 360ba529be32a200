//! The files that measurements and calibrations come in. Each has one reader, one writer and one type here; every
//! other crate takes the types.
//!
//! - [`PointsTable`], [`PowerTable`], [`PhaseTable`], [`FramesTable`]: the four tables, read from CSV or made in memory.
//! - [`Measurements`]: any of the first three, told apart by their columns.
//! - [`Channel`]: which sub-pixels of the display are lit.
//! - [`EffectId`]: the catalogued physical effects.
//! - [`CalibrationFile`]: `calibration.toml` as it stands, schema `retina.calibration/1`; the one reader and writer.
//! - [`Calibration`]: the geometry that such a file states, checked against a setup, with the response beside it.
//! - [`RadiometricCalibration`]: the response that such a file states.

mod calibration;
mod channel;
mod columns;
mod effect_id;
mod frames;
mod measurements;
mod phase;
mod points;
mod power;
mod sample;
mod setup_stamp;
mod stated;

pub use calibration::{
    Calibration, CalibrationFile, ChannelCurve, ChannelRecord, CovarianceRecord, DataRecord,
    DistortionRecord, FAINTEST_ERROR_MAG, FieldRecord, InverseRecord, MagnitudeRange, MeasuredResponse,
    RadiometricCalibration, ResponseRecord, RingsRecord, efficiencies, measured_or_power_law,
    quantum_efficiency, wavelengths_nm,
};
pub use channel::{Channel, log10_irradiance};
pub use columns::{ExtraColumn, SourceFile, csv_text};
pub use effect_id::{EffectId, FramesEffect, PhaseEffect, PointsEffect, PowerEffect};
pub use frames::{FrameRow, FramesTable, Prediction};
pub use measurements::{Measurements, TableKind};
pub use phase::{PhaseRow, PhaseTable};
pub use points::{PointRow, PointsTable};
pub use power::{PowerRow, PowerTable};
pub use setup_stamp::SetupStamp;
pub use stated::stated_by_most;
