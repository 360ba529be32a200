//! The virtual bench: screen image in, camera image out.
//!
//! 1. [`Display`]: digital counts to the light of sub-pixels that stand side by side.
//! 2. [`BenchOptics`]: where each sub-pixel's light lands on the sensor and how it is spread there, by
//!    traced optics and diffraction: few sources directly, full scenes by Fourier transform.
//! 3. [`Sensor`]: light to electrons to digital numbers, with a real sensor's noise.
//! 4. [`Bench`]: the three together, exposure by exposure; [`Imperfections`] says what is wrong with it.
//!
//! Nothing is painted on: distortion is traced, the walk of a bright point's centroid comes out of coma,
//! threshold and noise.

mod bench;
mod buffers;
mod display;
mod error;
mod hash;
mod imperfections;
mod light;
mod noise;
mod optics;
mod prediction;
mod sensor;

pub use bench::{Bench, BenchOptions, CameraFrame, Exposure};
pub use display::{Display, ScreenImage, SubPixel};
pub use error::BenchError;
pub use imperfections::{GroupOffset, Imperfections, Objective, ScreenPlacement};
pub use optics::{
    BenchOptics, CameraPose, ExposurePose, Landed, OpticsDetail, PointImage, SceneLight, Source, SpotTracer,
    channel_lines, facility_system,
};
pub use prediction::Prediction;
pub use sensor::Sensor;
