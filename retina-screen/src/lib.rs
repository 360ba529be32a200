//! What a display shows: light turned into digital counts.
//!
//! - [`ScreenEncoder`]: radiance of a resolved scene to the counts of a facility's screen.
//! - [`PointPainter`]: stars and planets added to them, to the sub-pixel.
//! - [`PlainDisplay`]: radiance factor to the samples of an ordinary image, for scenes that are
//!   not shown in a facility.

mod encode;
mod plain;
mod points;
mod quantise;
mod splat;

pub use encode::{Encoded, ScreenEncoder};
pub use plain::{PlainDisplay, PlainSamples, Transfer};
pub use points::{PointPainter, Shown};
pub use quantise::Quantisation;
pub use splat::{Lit, Splat};
