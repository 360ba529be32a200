//! Flashes of impacts on a body's night side: the detector, and its experiment.
//!
//! - [`night_mask`]: where the night side is, from the body's known place and the Sun's.
//! - [`detect_flashes`]: points of light there, with place, magnitude and a stated number of false alarms.
//! - [`watch_sequence`]: a rendered sequence, compared with its truth, resumable.
//! - [`summarise`]: detection rate against magnitude, false detections, errors.
//! - [`FlashScenario`], [`run_scenario`]: the whole experiment from one file.

mod detect;
mod experiment;
mod figures;
mod night;
mod rates;
pub mod report;
mod scenario;
mod sequence;
mod summary;

pub use detect::{
    Candidate, FlashOptions, Light, NightSide, Spot, ZeroPoint, detect_flashes, normal_tail, threshold_sigma,
};
pub use experiment::run_scenario;
pub use figures::figure_rates;
pub use night::{BodyPose, Margins, Met, night_mask};
pub use rates::{Logistic, RateBin, Trial, fit_logistic, rate_bins, wilson};
pub use scenario::FlashScenario;
pub use sequence::{CameraLight, FlashFrame, FlashOutcome, flash_notes, watch_frame, watch_sequence};
pub use summary::{FlashSummary, summarise, trials};
