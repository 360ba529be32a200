//! Flashes of impacts on a body's night side in one image.
//!
//! - [`night_mask`]: where the night side is, from the body's known place and the Sun's.
//! - [`detect_flashes`]: points of light there, with place, magnitude and a stated number of false alarms.

mod detect;
mod night;
mod threshold;

pub use detect::{Candidate, FlashOptions, Light, NightSide, Spot, ZeroPoint, detect_flashes};
pub use night::{BodyPose, Margins, Met, night_mask};
pub use threshold::{SearchArea, normal_tail, threshold_sigma};
