//! Scenes rendered to radiance: what each pixel of an image receives from bodies in sunlight, in
//! W m^-2 sr^-1 nm^-1 at 550 nm and as I/F, linear.
//!
//! - [`FrameState`], [`BodyModel`], [`BodyState`]: what a frame shows; [`RadianceImage`]: what comes back.
//! - [`GpuRenderer`]: wgpu, from a real GPU to Mesa's lavapipe.
//! - [`CpuRenderer`]: an independent f64 ray caster, reference and fallback.
//! - [`GpuWarp`]: resampling through the facility's distortion on the way back.

mod cpu;
mod frame;
mod gpu;
mod small;

pub use cpu::{CpuRenderer, CpuSampling};
pub use frame::{BodyModel, BodyState, FrameState, PLANE_NAMES, Planes, Quality, RadianceImage, RenderError};
pub use gpu::{FRAMES_IN_FLIGHT, GpuDevice, GpuRenderer, GpuWarp};
