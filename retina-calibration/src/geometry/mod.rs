//! The facility's geometric calibration (paper, eqs. 11-15, Figs. 9-11).
//!
//! - [`calibrate`]: D^-1 with terms in the irradiance by robust linear least squares, its form chosen on exposures
//!   left out, and D at a reference irradiance.
//! - [`Pattern`]: calibration screens; [`points_from_images`]: their points in the camera's images.
//! - [`write_calibration`], [`to_json`]: the results.
//!
//! Inside, lines of sight are (x, y) on the tangent plane and L is log10 of the irradiance relative to a white
//! pixel at full count.

mod calibrate;
mod centre;
mod checks;
mod direct;
mod errors;
mod fit;
mod form;
mod images;
mod nearest;
mod noise;
mod observations;
mod output;
mod pattern;
mod physical;
mod plan;
mod plots;
mod recognise;
mod record;
mod report;
mod select;
mod uncertainty;
mod warping;

pub use calibrate::{CalibrateOptions, GeometryCalibration, PointResult, calibrate};
pub use direct::DirectFit;
pub use errors::ErrorSummary;
pub use form::{ModelForm, Term};
pub use images::{ImageReport, match_points, points_from_images};
pub use output::{text_summary, to_json, write_residuals};
pub use pattern::{Pattern, PatternOptions, PatternPoint, PatternScreen};
pub use physical::PhysicalFit;
pub use plan::{MeasurementPlan, PLAN_FILE, PlannedExposure};
pub use plots::figures;
pub use recognise::{LOG10_CHANCE_LIMIT, Recognition, recognise};
pub use record::write_calibration;
pub use report::write_report;
pub use select::Rung;
