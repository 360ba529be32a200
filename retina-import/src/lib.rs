//! Camera models and corner tables of mrcal and OpenCV as measurements of this project, and fitted lenses back as files of
//! theirs.
//!
//! - [`read_mrcal`]: a `.cameramodel` with its `optimization_inputs`, or with tables of corners (`.vnl`).
//! - [`read_opencv`]: calibrations that `cv::FileStorage` or common tools write, YAML or JSON.
//! - [`Boards`]: what both give, corners with the directions that their boards' poses predict; [`Boards::write`] writes
//!   `points.csv`, `setup.toml` and, where its polynomials can follow the lens, `calibration.toml`.
//! - [`write_camera_model`]: a lens as `.cameramodel` or as OpenCV's YAML or JSON.
//!
//! mrcal and OpenCV count pixels from the centre of the first one, this project from its corner: half a pixel is added and
//! taken off.

mod boards;
mod export;
mod literal;
mod mrcal;
mod opencv;
mod pose;

pub use boards::{Boards, Corner, ImportOptions, Imported, SourceCamera, View};
pub use export::write_camera_model;
pub use mrcal::read_mrcal;
pub use opencv::read_opencv;

/// Pixel position of this project less that of mrcal and OpenCV.
const HALF_PIXEL: f64 = 0.5;
