//! Points of light that a camera in deep space would measure, without pixels.
//!
//! - [`sources`]: stars and planets in a camera's field.
//! - [`measured`]: their points with noise, the faint ones lost and false ones added.

mod points;
mod sky;

pub use points::{PointNoise, measured, uniform};
pub use sky::{Source, sources};
