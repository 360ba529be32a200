//! Scenes rendered to radiance: what each pixel of an image receives from bodies in sunlight, in
//! W m^-2 sr^-1 nm^-1 at 550 nm and as I/F, linear.
//!
//! - [`FrameState`], [`BodyModel`], [`BodyState`]: what a frame shows; [`RadianceImage`]: what comes back.
//! - [`GpuRenderer`]: wgpu, from a real GPU to Mesa's lavapipe. It is behind the feature `gpu`, which is on by default;
//!   without it no adapter is ever found.
//! - [`NativeRenderer`]: f32 on the processor's cores; the one to take where there is no real GPU.
//! - [`CpuRenderer`]: an independent f64 ray caster, the reference for both.
//! - [`GpuWarp`]: resampling through the facility's distortion on the way back.

mod arrays;
mod cpu;
mod frame;
#[cfg(feature = "gpu")]
mod gpu;
mod native;
#[cfg(not(feature = "gpu"))]
mod no_gpu;
mod placing;
mod small;

pub use arrays::keep_bodies_in;
pub use cpu::{CpuRenderer, CpuSampling};
pub use frame::{BodyModel, BodyState, FrameState, PLANE_NAMES, Planes, Quality, RadianceImage, RenderError};
#[cfg(feature = "gpu")]
pub use gpu::{FRAMES_IN_FLIGHT, GpuDevice, GpuRenderer, GpuWarp};
pub use native::NativeRenderer;
#[cfg(not(feature = "gpu"))]
pub use no_gpu::{FRAMES_IN_FLIGHT, GpuDevice, GpuRenderer, GpuWarp};
