//! The paper's far-range experiment (Figs. 12 and 13): random poses among the planets, and a transfer to Mars.
//!
//! - [`Scenario`]: what is done, from a file.
//! - [`Photographer`]: a pose's points, also from images of an ideal camera and of the virtual bench.
//! - [`run_poses`]: attitudes and planets over random poses, resumable.
//! - [`run_transfer`]: Monte Carlo of the filter.
//! - [`run_imaged`]: one run of it whose lines of sight come from images, resumable.
//! - [`report`]: JSON and figures.

mod imaged;
mod photograph;
mod poses;
pub mod report;
mod scenario;
mod transfer;
mod transfer_file;
mod verdict;

pub use imaged::{ImagedResult, ImagedSession, run_imaged};
pub use photograph::Photographer;
pub use poses::{FarRangeError, PoseResult, PosesSummary, run_poses, summarise};
pub use scenario::{Choice, ExposureChoice, Images, Poses, Scenario};
pub use transfer::{SessionResult, TransferResult, chi2_mean_bounds, run_transfer};
pub use transfer_file::{Transfer, TransferImages};
