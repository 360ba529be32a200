//! What stands in the GPU renderer's place in a build without the feature `gpu`: no adapter is ever found, so that
//! values of these types do not exist.

use retina_geometry::WarpMap;

use crate::{BodyModel, FrameState, Planes, Quality, RadianceImage, RenderError};

/// Frames that may be under way at a time.
pub const FRAMES_IN_FLIGHT: usize = 2;

/// An opened graphics device: none here.
pub enum GpuDevice {}

/// The renderer by wgpu: none here.
pub enum GpuRenderer {}

/// The resampling by wgpu: none here.
pub enum GpuWarp {}

impl GpuDevice {
    /// Finds no adapter.
    ///
    /// # Errors
    /// Always: the build has no GPU renderer.
    pub fn open() -> Result<Self, RenderError> {
        Err(RenderError::NoAdapter("this build of retina-render has no feature `gpu`".into()))
    }

    /// Finds no adapter.
    ///
    /// # Errors
    /// Always: the build has no GPU renderer.
    pub fn open_hardware() -> Result<Self, RenderError> {
        Self::open()
    }

    /// `None`: tests that need an adapter are skipped in this build.
    pub fn open_for_test() -> Option<Self> {
        None
    }

    /// Name of the adapter.
    pub fn name(&self) -> &str {
        match *self {}
    }

    /// Name and version of the driver.
    pub fn driver(&self) -> &str {
        match *self {}
    }
}

impl GpuRenderer {
    /// See the GPU renderer.
    ///
    /// # Errors
    /// None: there is no device to give.
    pub fn new(
        device: GpuDevice,
        _models: Vec<BodyModel>,
        _quality: Quality,
        _planes: Planes,
    ) -> Result<Self, RenderError> {
        match device {}
    }

    /// The device.
    pub fn device(&self) -> &GpuDevice {
        match *self {}
    }

    /// See the GPU renderer.
    ///
    /// # Errors
    /// None.
    pub fn check_size(&self, _size_px: [u32; 2]) -> Result<(), RenderError> {
        match *self {}
    }

    /// See the GPU renderer.
    pub fn set_warp(&mut self, _warp: Option<GpuWarp>) {
        match *self {}
    }

    /// See the GPU renderer.
    ///
    /// # Errors
    /// None.
    pub fn start(&mut self, _state: &FrameState) -> Result<(), RenderError> {
        match *self {}
    }

    /// Frames under way.
    pub fn in_flight(&self) -> usize {
        match *self {}
    }

    /// See the GPU renderer.
    ///
    /// # Errors
    /// None.
    pub fn finish(&mut self) -> Result<Option<RadianceImage>, RenderError> {
        match *self {}
    }
}

impl GpuWarp {
    /// See the GPU renderer.
    ///
    /// # Errors
    /// None.
    pub fn new(
        device: &GpuDevice,
        _map: &WarpMap,
        _origin_px: [i32; 2],
        _size_px: [u32; 2],
    ) -> Result<Self, RenderError> {
        match *device {}
    }
}
