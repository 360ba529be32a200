//! The paper's experiments: scenes rendered, shown on the virtual bench or taken from real photographs, and navigated.
//!
//! - [`far_range`]: attitudes and planets over random poses, and a transfer to Mars (Figs. 12 and 13).
//! - [`full_disk`]: position about the Moon by its limb (Figs. 14 and 15).
//! - [`flashes`]: impacts on the Moon's night side.
//! - [`experiment`]: a scene through calibration, renderer and bench, which all three share.
//! - [`lines`]: results as lines of a file, so that a killed run goes on.

pub mod experiment;
pub mod far_range;
pub mod flashes;
mod frame_lines;
pub mod full_disk;
pub mod lines;
mod parts;

/// Normalised errors squared beyond this times their number are no chance, and no slightly wrong model either.
pub(crate) const MOST_NEES_RATIO: f64 = 9.0;
