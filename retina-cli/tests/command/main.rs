//! The command, run as a program. One executable: each one more would be compiled and linked on its own.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

mod bad_input;
mod batch;
mod calibrate;
mod calibrate_radiometry;
mod cluster;
mod common;
mod corto;
mod decide;
mod docs;
mod ephemeris;
mod export;
mod flashes;
mod full_disk;
mod gpu;
mod import;
mod investigate;
mod limb;
mod navigate;
mod optics_bench;
mod optics_output;
mod schemas;
mod simulate;
#[allow(dead_code, reason = "other tests look at the motions")]
#[path = "../../../retina-sky/tests/common/spk.rs"]
mod spk;
mod stars;
mod tools;
mod truth;
mod verbosity;
mod warp;
