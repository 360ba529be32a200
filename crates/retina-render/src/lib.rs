//! Scenes rendered to radiance, and turned into screen images.
mod cpu;
mod frame;
mod gpu;

pub use cpu::{CpuRenderer, CpuSampling};
pub use frame::{BodyModel, BodyState, FrameState, PLANE_NAMES, Planes, Quality, RadianceImage, RenderError};
pub use gpu::{FRAMES_IN_FLIGHT, GpuDevice, GpuRenderer, GpuWarp};
