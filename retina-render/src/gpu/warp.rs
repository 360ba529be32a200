//! Resampling through the distortion on the GPU.

use retina_geometry::WarpMap;

use super::layout::{Frame, Warp};
use super::pipelines::{compute, entry, storage, uniform};
use super::{GpuDevice, bind};
use crate::RenderError;

/// A resampling of a canvas of undistorted radiance into a screen image: screen pixel R reads the
/// canvas at D(K_f^-1 R).
pub struct GpuWarp {
    pipeline: wgpu::ComputePipeline,
    frame_group: wgpu::BindGroup,
    layout: wgpu::BindGroupLayout,
    parameters: wgpu::Buffer,
    screen: wgpu::Buffer,
    size_px: [u32; 2],
    map: WarpMap,
    source: Warp,
}

impl GpuWarp {
    /// `map` is the screen's; the canvas has its corner at `source_origin_px` of the screen's
    /// pixel coordinates and is `source_size_px` large.
    ///
    /// # Errors
    /// The image does not fit the adapter.
    pub fn new(
        gpu: &GpuDevice,
        map: &WarpMap,
        source_origin_px: [i32; 2],
        source_size_px: [u32; 2],
    ) -> Result<Self, RenderError> {
        use wgpu::BufferUsages as Usage;
        let stage = wgpu::ShaderStages::COMPUTE;
        let group = |entries: &[wgpu::BindGroupLayoutEntry]| {
            gpu.device
                .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some("warp"), entries })
        };
        let frame_layout = group(&[entry(0, stage, uniform())]);
        let layout = group(&[
            entry(0, stage, storage(true)),
            entry(1, stage, storage(false)),
            entry(2, stage, uniform()),
        ]);
        let pipeline =
            compute(&gpu.device, &[&frame_layout, &layout], retina_shaders::warp(), "resample", false);
        let k = &map.pinhole;
        let mut frame: Frame = bytemuck::Zeroable::zeroed();
        frame.intrinsics_px = [k.fx_px, k.fy_px, k.cx_px, k.cy_px].map(|v| v as f32);
        frame.size_px = [k.width_px, k.height_px];
        frame.distortion_degree = map.distortion.degree();
        for (index, c) in map.distortion.coefficients().iter().enumerate() {
            frame.distortion[index / 2][2 * (index % 2)] = c.x as f32;
            frame.distortion[index / 2][2 * (index % 2) + 1] = c.y as f32;
        }
        let frame = gpu.filled_buffer("warp frame", &[frame], Usage::UNIFORM)?;
        let source = Warp { source_origin_px, source_size_px };
        let parameters = gpu.filled_buffer("warp", &[source], Usage::UNIFORM)?;
        let pixels = u64::from(k.width_px) * u64::from(k.height_px);
        let screen = gpu.buffer("screen", 4 * pixels, Usage::STORAGE | Usage::COPY_SRC)?;
        let frame_group = bind(gpu, &frame_layout, &[frame.as_entire_binding()]);
        let size_px = [k.width_px, k.height_px];
        Ok(Self { pipeline, frame_group, layout, parameters, screen, size_px, map: map.clone(), source })
    }

    /// The same resampling on another device.
    pub(crate) fn on(&self, gpu: &GpuDevice) -> Result<Self, RenderError> {
        Self::new(gpu, &self.map, self.source.source_origin_px, self.source.source_size_px)
    }

    pub(crate) fn size_px(&self) -> [u32; 2] {
        self.size_px
    }

    pub(crate) fn output(&self) -> &wgpu::Buffer {
        &self.screen
    }

    pub(crate) fn encode(&self, gpu: &GpuDevice, encoder: &mut wgpu::CommandEncoder, source: &wgpu::Buffer) {
        let resources = [
            source.as_entire_binding(),
            self.screen.as_entire_binding(),
            self.parameters.as_entire_binding(),
        ];
        let group = bind(gpu, &self.layout, &resources);
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.frame_group, &[]);
        pass.set_bind_group(1, &group, &[]);
        pass.dispatch_workgroups(self.size_px[0].div_ceil(8), self.size_px[1].div_ceil(8), 1);
    }
}
