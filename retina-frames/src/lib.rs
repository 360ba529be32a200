//! Acquired images against rendered ones.
//!
//! - [`FrameSet`]: a table of frames with its predictions, registered; [`FrameSet::dataset`] gives the pixels that
//!   `retina-diagnosis` compares, diagnoses and fits.
//! - [`diagnose_frames`]: which effects are missing; the prediction is made anew with each that is found.
//! - [`FrameSet::pictures`]: predicted, measured and what is left, side by side.

mod best;
mod choice;
mod covariates;
mod diagnose;
mod exr;
mod form;
mod grid;
mod layers;
mod measured;
mod model;
mod photograph;
mod physical;
mod picture;
mod pixels;
mod place;
mod predicted;
mod register;
mod scene;
mod set;
mod solve;
mod stages;
mod told;
mod window;

pub use choice::Kept;
pub use diagnose::diagnose_frames;
pub use picture::PICTURES_CAPTION;
pub use set::{FrameSet, FramesSource};
