//! Flashes of impacts on a body's night side, over sequences.
//!
//! - [`watch_sequence`]: a rendered sequence, compared with its truth, resumable.
//! - [`summarise`]: detection rate against magnitude, false detections, errors.
//! - [`FlashScenario`], [`run_scenario`]: the whole experiment from one file.

mod camera_light;
mod experiment;
mod figures;
mod rates;
pub mod report;
mod scenario;
mod sequence;
mod summary;

pub use experiment::{LAST_LIST, prepare_parts, run_part, run_scenario};
pub use figures::figure_rates;
pub use rates::{Logistic, RateBin, Trial, fit_logistic, rate_bins, wilson};
pub use scenario::FlashScenario;
pub use sequence::{CameraLight, FlashFrame, FlashOutcome, flash_notes, watch_frame, watch_sequence};
pub use summary::{FlashSummary, summarise, trials};
