//! The crate's tests. One executable: each one more would be compiled and linked on its own.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

mod common;
mod limb_among_stars;
mod limb_discs;
mod limb_photograph;
mod limb_refusals;
mod limb_saturated;
mod limb_shape;
mod star_fields;
mod star_images;
