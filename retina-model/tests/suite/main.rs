//! The crate's tests. One executable: each one more would be compiled and linked on its own.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

mod building;
mod common;
mod loading;
mod obj;
mod robustness;
mod shapes;
