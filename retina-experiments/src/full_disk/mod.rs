//! The paper's LUMIO experiment (Figs. 14 and 15): full-disk navigation over a rendered sequence.
//!
//! - [`Source`]: a sequence's images with their truth, checked; ideal, uncompensated, compensated down- or upstream.
//! - [`navigate_sequence`]: each frame's position by its limb, resumable.
//! - [`run_filter`]: position and velocity relative to the Moon by an extended Kalman filter.
//! - [`report`]: JSON, table, figures, page.
//! - [`FullDiskScenario`], [`run_scenario`]: the whole experiment from one file: calibration, rendering, bench,
//!   navigation.

mod experiment;
mod figures;
mod filter;
mod moon_motion;
pub mod report;
mod scenario;
mod sequence;
pub(crate) mod source;
mod truth;

pub use experiment::{LAST_LIST, navigate, prepare_parts, run_part, run_scenario};
pub use figures::{Shown, figure_15, figure_errors, figure_filter};
pub use filter::{FilterOptions, FilterResult, FilterStep, run_filter};
pub use scenario::{FullDiskScenario, LimbTable};
pub use sequence::{
    CHI2_3_99, FrameResult, Position, SequenceSummary, navigate_frame, navigate_sequence, summarise,
};
pub use source::{ImageKind, Source, SourceChoice};
pub use truth::FrameTruth;
