//! Optical navigation.
//!
//! - [`stars`]: attitude from the stars of one image, lost in space.
//! - [`planets`]: planets among an image's points, and their lines of sight.
//! - [`image`]: the two together, from pixels.
//! - [`filter`]: position by triangulation, position and velocity by an extended Kalman filter.
//! - [`limb`]: position of a resolved body from its limb.
//! - [`far_range`]: the paper's experiment among the planets.
//! - [`full_disk`]: the paper's experiment about the Moon.
//! - [`flashes`]: flashes of impacts on a body's night side.
//! - [`experiment`]: what experiments on rendered scenes share.

pub mod experiment;
pub mod far_range;
pub mod filter;
pub mod flashes;
mod frame_lines;
pub mod full_disk;
pub mod image;
pub mod limb;
pub mod lines;
pub mod planets;
pub mod stars;
