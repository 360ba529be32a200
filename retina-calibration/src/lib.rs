//! Calibration of the facility from what the camera saw.
//!
//! - [`geometry`]: calibration patterns, their recognition in camera images, and the mapping between lines of sight
//!   and the screen (paper, "Geometric calibration").
//! - [`NoiseGroups`]: noise that depends on brightness.

mod brightness;
pub mod geometry;

pub use brightness::{NoiseGroups, outwards};
