//! The crate's tests. One executable: each one more would be compiled and linked on its own.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

mod common;
mod frames_benchmark;
mod frames_refusals;
mod known_chains;
mod known_moon;
mod moon_photo;
