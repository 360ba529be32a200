//! What a display shows: light turned into digital counts.
//!
//! - [`ScreenEncoder`]: radiance of a resolved scene to the counts of a facility's screen.
//! - [`PlainDisplay`]: radiance factor to the samples of an ordinary image, for scenes that are
//!   not shown in a facility.

mod encode;
mod plain;

pub use encode::{Encoded, ScreenEncoder};
pub use plain::{PlainDisplay, PlainSamples, Transfer};
