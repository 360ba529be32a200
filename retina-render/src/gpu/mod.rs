//! The wgpu renderer: rasterised visibility, deferred shading, rays where that is not enough.
//!
//! 1. `visibility`: every triangle is rasterised at 2 x 2 samples a pixel; each sample keeps the
//!    index of the triangle it sees.
//! 2. `shade`: each sample is shaded at the exact point where its ray meets that triangle. Pixels
//!    on an edge, or whose samples differ, are listed; where the body's relief (bounded
//!    beforehand, `arrays::horizon`) or another body may stand before the Sun, one ray a pixel probes
//!    it, and pixels on a shadow's edge are listed too.
//! 3. `refine`: listed pixels are sampled anew, each sample with a primary and a Sun ray.

mod device;
mod layout;
mod nodes;
mod pipelines;
mod state;
mod targets;
mod warp;

use std::collections::VecDeque;

pub use device::GpuDevice;
pub use warp::GpuWarp;

use crate::arrays::SceneArrays;
use crate::placing::{self, Region};
use crate::small::Window;
use crate::{BodyModel, FrameState, Planes, Quality, RadianceImage, RenderError};
use layout::{Body, Frame, MOST_BODIES};
use pipelines::Pipelines;
use state::GRID;
use targets::{Targets, check_size};

/// Frames after which a software device is opened anew: Mesa 22.3's lavapipe keeps up to
/// 8 MB of each frame until its device is destroyed.
const SOFTWARE_FRAMES: u32 = 48;
/// Size of the arguments of an indirect dispatch.
const DISPATCH_BYTES: u64 = 12;
/// The lists of shaders/shared/output.wgsl, and how many there are.
const LIST_EDGE: u32 = 1;
const LIST_INNER: u32 = 2;
const LISTS: u64 = 3;
/// Lists' lengths and the count of walks cut short, at the head of the work buffer.
const WORK_HEAD: u64 = 16;
/// Uniform offsets are aligned to this on every adapter.
const UNIFORM_STRIDE: u64 = 256;
/// Frames that may be under way at a time.
pub const FRAMES_IN_FLIGHT: usize = 2;

/// A renderer of one set of bodies into images of one size.
pub struct GpuRenderer {
    gpu: GpuDevice,
    models: Vec<BodyModel>,
    quality: Quality,
    planes: Planes,
    arrays: SceneArrays,
    pipelines: Pipelines,
    scene: SceneBuffers,
    targets: Option<Targets>,
    warp: Option<GpuWarp>,
    pending: VecDeque<Pending>,
    /// Finished when the device was opened anew, and not yet asked for.
    finished: VecDeque<RadianceImage>,
    frames_on_device: u32,
    free_staging: Vec<wgpu::Buffer>,
}

struct SceneBuffers {
    frame: wgpu::Buffer,
    bodies: wgpu::Buffer,
    vertices: wgpu::Buffer,
    indices: wgpu::Buffer,
    group: wgpu::BindGroup,
}

struct Pending {
    staging: wgpu::Buffer,
    submission: wgpu::SubmissionIndex,
    size: [u32; 2],
    planes: Planes,
    /// Where the image belongs, if it is an enlarged window.
    window: Option<Window>,
}

impl GpuRenderer {
    /// Uploads the bodies. `planes` is the most that any frame will be asked for.
    ///
    /// # Errors
    /// The bodies do not fit the adapter.
    pub fn new(
        gpu: GpuDevice,
        models: Vec<BodyModel>,
        quality: Quality,
        planes: Planes,
    ) -> Result<Self, RenderError> {
        if models.len() > MOST_BODIES {
            return Err(RenderError::TooManyBodies(models.len()));
        }
        let kinds = kinds(&models);
        // The driver compiles on one thread while the others build the hierarchy.
        let (pipelines, arrays) = rayon::join(
            || Pipelines::new(&gpu.device, &kinds, planes == Planes::Layers),
            || SceneArrays::new(&models),
        );
        let scene = SceneBuffers::new(&gpu, &pipelines, &arrays)?;
        // Textures and shapes are on the device now; only photometry and names are needed here.
        let models = models.into_iter().map(BodyModel::without_shape).collect();
        Ok(Self {
            gpu,
            models,
            arrays,
            quality,
            planes,
            pipelines,
            scene,
            targets: None,
            warp: None,
            pending: VecDeque::new(),
            finished: VecDeque::new(),
            frames_on_device: 0,
            free_staging: Vec::new(),
        })
    }

    /// The device it renders on.
    pub fn device(&self) -> &GpuDevice {
        &self.gpu
    }

    /// Whether the adapter can render an image of this size, pixels.
    ///
    /// # Errors
    /// [`RenderError::TooLarge`].
    pub fn check_size(&self, size_px: [u32; 2]) -> Result<(), RenderError> {
        check_size(&self.gpu, size_px)
    }

    /// Has every further frame resampled through `warp` on its way back: the image returned has
    /// the warp's size and holds radiance alone.
    pub fn set_warp(&mut self, warp: Option<GpuWarp>) {
        self.warp = warp;
        self.free_staging.clear();
    }

    /// Starts a frame; [`GpuRenderer::finish`] gives frames back in the order they were started.
    ///
    /// # Errors
    /// The image is too large for the adapter.
    pub fn start(&mut self, state: &FrameState) -> Result<(), RenderError> {
        if self.gpu.is_software() && self.frames_on_device >= SOFTWARE_FRAMES {
            self.reopen()?;
        }
        self.frames_on_device += 1;
        // A warp reads the whole image on the device.
        let radii_m: Vec<f64> = self.arrays.ranges.iter().map(|range| range.bounding_radius_m).collect();
        let small = if self.warp.is_none() { Window::of(state, &radii_m) } else { None };
        let (window, state) =
            small.as_ref().map_or((None, state), |(window, enlarged)| (Some(*window), enlarged));
        let size = [state.image.width_px, state.image.height_px];
        if self.targets.as_ref().is_none_or(|targets| targets.size != size) {
            self.targets = Some(Targets::new(&self.gpu, &self.pipelines, size, self.quality, self.planes)?);
            self.free_staging.clear();
        }
        let Some(targets) = &self.targets else { return Ok(()) };
        let (back_size, back_planes) = match &self.warp {
            Some(warp) => (warp.size_px(), Planes::Radiance),
            None => (size, self.planes),
        };
        let plane_bytes = 4 * u64::from(back_size[0]) * u64::from(back_size[1]) * back_planes.count() as u64;
        // Frames of another size may still have been under way when the size changed.
        let fitting = self.free_staging.iter().position(|buffer| buffer.size() == plane_bytes + WORK_HEAD);
        let staging = match fitting {
            Some(index) => self.free_staging.swap_remove(index),
            None => self.gpu.buffer(
                "read-back",
                plane_bytes + WORK_HEAD,
                wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            )?,
        };
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        encoder.clear_buffer(&targets.planes, 0, None);
        encoder.clear_buffer(&targets.work, 0, Some(WORK_HEAD));
        encoder.clear_buffer(&targets.light, 0, None);
        if let Some(region) = placing::region(state, &self.arrays.ranges) {
            let frame = state::frame_uniform(state, region, &self.arrays.ranges);
            let bodies = state::body_uniforms(state, &self.models, &self.arrays.ranges, self.quality);
            self.gpu.queue.write_buffer(&self.scene.frame, 0, bytemuck::bytes_of(&frame));
            self.gpu.queue.write_buffer(&self.scene.bodies, 0, bytemuck::cast_slice(&bodies));
            self.encode_visibility(&mut encoder, targets, region);
            self.encode_shading(&mut encoder, targets, region);
        }
        match &self.warp {
            Some(warp) => {
                warp.encode(&self.gpu, &mut encoder, &targets.planes);
                encoder.copy_buffer_to_buffer(warp.output(), 0, &staging, 0, plane_bytes);
            }
            None => encoder.copy_buffer_to_buffer(&targets.planes, 0, &staging, 0, plane_bytes),
        }
        encoder.copy_buffer_to_buffer(&targets.work, 0, &staging, plane_bytes, WORK_HEAD);
        let submission = self.gpu.queue.submit([encoder.finish()]);
        staging.slice(..).map_async(wgpu::MapMode::Read, |_| {});
        self.pending.push_back(Pending { staging, submission, size: back_size, planes: back_planes, window });
        Ok(())
    }

    /// Number of frames started and not yet given back.
    pub fn in_flight(&self) -> usize {
        self.pending.len() + self.finished.len()
    }

    /// Moves to a fresh device, which frees what the driver kept with the old one.
    fn reopen(&mut self) -> Result<(), RenderError> {
        while let Some(image) = self.finish_oldest()? {
            self.finished.push_back(image);
        }
        self.gpu = GpuDevice::open()?;
        self.pipelines =
            Pipelines::new(&self.gpu.device, &kinds(&self.models), self.planes == Planes::Layers);
        self.scene = SceneBuffers::new(&self.gpu, &self.pipelines, &self.arrays)?;
        self.warp = self.warp.as_ref().map(|warp| warp.on(&self.gpu)).transpose()?;
        self.targets = None;
        self.free_staging.clear();
        self.frames_on_device = 0;
        Ok(())
    }

    /// Waits for the oldest frame under way; `None` when there is none.
    ///
    /// # Errors
    /// The device failed, or cut a shader's loops short.
    pub fn finish(&mut self) -> Result<Option<RadianceImage>, RenderError> {
        match self.finished.pop_front() {
            Some(image) => Ok(Some(image)),
            None => self.finish_oldest(),
        }
    }

    fn finish_oldest(&mut self) -> Result<Option<RadianceImage>, RenderError> {
        let Some(pending) = self.pending.pop_front() else { return Ok(None) };
        let failed = |error: &dyn std::fmt::Display| RenderError::Device(error.to_string());
        self.gpu
            .device
            .poll(wgpu::PollType::Wait { submission_index: Some(pending.submission), timeout: None })
            .map_err(|error| failed(&error))?;
        let pixels = pending.size[0] as usize * pending.size[1] as usize * pending.planes.count();
        let mut data = vec![0f32; pixels];
        let cut_short = {
            let view = pending.staging.slice(..).get_mapped_range().map_err(|error| failed(&error))?;
            bytemuck::cast_slice_mut(&mut data).copy_from_slice(&view[..4 * pixels]);
            bytemuck::pod_read_unaligned::<u32>(&view[4 * pixels + 12..4 * pixels + 16])
        };
        pending.staging.unmap();
        self.free_staging.push(pending.staging);
        if cut_short > 0 {
            return Err(RenderError::CutShort(cut_short));
        }
        let image = RadianceImage {
            width_px: pending.size[0],
            height_px: pending.size[1],
            data,
            photocentre_px: None,
        };
        Ok(Some(match pending.window {
            Some(window) => window.place(&image),
            None => image,
        }))
    }

    fn encode_visibility(&self, encoder: &mut wgpu::CommandEncoder, targets: &Targets, region: Region) {
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("visibility"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &targets.visible,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                    store: wgpu::StoreOp::Store,
                },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &targets.depth,
                depth_ops: Some(wgpu::Operations {
                    load: wgpu::LoadOp::Clear(0.0),
                    store: wgpu::StoreOp::Discard,
                }),
                stencil_ops: None,
            }),
            ..Default::default()
        });
        let [width, height] = region.size.map(|side| (side * GRID) as f32);
        pass.set_viewport(0.0, 0.0, width, height, 0.0, 1.0);
        pass.set_bind_group(0, &self.scene.group, &[]);
        pass.set_vertex_buffer(0, self.scene.vertices.slice(..));
        pass.set_index_buffer(self.scene.indices.slice(..), wgpu::IndexFormat::Uint32);
        for (body, range) in self.arrays.ranges.iter().enumerate() {
            pass.set_pipeline(&self.pipelines.visibility[usize::from(range.double_sided)]);
            let first = 3 * range.triangle_first;
            let instance = body as u32;
            pass.draw_indexed(first..first + 3 * range.triangle_count, 0, instance..instance + 1);
        }
    }

    fn encode_shading(&self, encoder: &mut wgpu::CommandEncoder, targets: &Targets, region: Region) {
        let mut pass = encoder.begin_compute_pass(&Default::default());
        let plan = |pass: &mut wgpu::ComputePass<'_>| {
            pass.set_pipeline(&self.pipelines.plan);
            pass.set_bind_group(1, &targets.plan_group, &[]);
            pass.dispatch_workgroups((targets.chunks.len() as u32).div_ceil(64), 1, 1);
        };
        pass.set_bind_group(0, &self.scene.group, &[]);
        pass.set_pipeline(&self.pipelines.shade);
        pass.set_bind_group(1, &targets.shade_group, &[]);
        pass.dispatch_workgroups(region.size[0].div_ceil(8), region.size[1].div_ceil(8), 1);
        plan(&mut pass);
        pass.set_bind_group(1, &targets.shade_group, &[]);
        pass.set_pipeline(&self.pipelines.probe);
        pass.dispatch_workgroups_indirect(&targets.dispatches, 0);
        pass.set_pipeline(&self.pipelines.settle);
        pass.dispatch_workgroups_indirect(&targets.dispatches, 0);
        plan(&mut pass);
        // No list is longer than the region has pixels.
        let pixels = region.size[0] * region.size[1];
        for (index, _) in (0u64..).zip(&targets.chunks).filter(|(_, chunk)| chunk.first < pixels) {
            let samples = DISPATCH_BYTES * (1 + 2 * index);
            pass.set_bind_group(1, &targets.refine_group, &[(index * UNIFORM_STRIDE) as u32]);
            pass.set_pipeline(&self.pipelines.gather);
            pass.dispatch_workgroups_indirect(&targets.dispatches, samples + DISPATCH_BYTES);
            pass.set_pipeline(&self.pipelines.take_samples);
            pass.dispatch_workgroups_indirect(&targets.dispatches, samples);
            pass.set_pipeline(&self.pipelines.sum_samples);
            pass.dispatch_workgroups_indirect(&targets.dispatches, samples + DISPATCH_BYTES);
        }
    }
}

fn kinds(models: &[BodyModel]) -> retina_shaders::Kinds {
    retina_shaders::Kinds::of(models.iter().map(|model| &model.photometry))
}

impl SceneBuffers {
    fn new(gpu: &GpuDevice, pipelines: &Pipelines, arrays: &SceneArrays) -> Result<Self, RenderError> {
        use wgpu::BufferUsages as Usage;
        let frame = gpu.buffer("frame", size_of::<Frame>() as u64, Usage::UNIFORM | Usage::COPY_DST)?;
        let bodies =
            gpu.buffer("bodies", (MOST_BODIES * size_of::<Body>()) as u64, Usage::UNIFORM | Usage::COPY_DST)?;
        let (uint4, float4) = (wgpu::TextureFormat::Rgba32Uint, wgpu::TextureFormat::Rgba32Float);
        let nodes: Vec<[u32; 4]> = arrays
            .ranges
            .iter()
            .flat_map(|range| {
                let own = &arrays.nodes[range.node_first as usize..range.node_end as usize];
                nodes::pack(own, range.bounds_m, range.node_first)
            })
            .collect();
        let textures = [
            gpu.array_texture("bounding volume hierarchy", &nodes, uint4)?,
            gpu.array_texture("triangles", &arrays.triangles, uint4)?,
            gpu.array_texture("vertices", &arrays.vertices, float4)?,
            gpu.array_texture("horizons", &arrays.horizons, float4)?,
            gpu.array_texture("surfaces", &arrays.surfaces, uint4)?,
            gpu.array_texture("maps", &arrays.maps, uint4)?,
            gpu.array_texture("textures", &arrays.texels, wgpu::TextureFormat::R32Uint)?,
            gpu.array_texture("corners", &arrays.corners, float4)?,
        ];
        let vertices = gpu.filled_buffer("vertices", &arrays.vertices, Usage::VERTEX)?;
        let corners: Vec<[u32; 3]> = arrays.triangles.iter().map(|t| [t[0], t[1], t[2]]).collect();
        let indices = gpu.filled_buffer("indices", &corners, Usage::INDEX)?;
        let mut resources = vec![frame.as_entire_binding(), bodies.as_entire_binding()];
        resources.extend(textures.iter().map(wgpu::BindingResource::TextureView));
        let group = bind(gpu, &pipelines.scene_layout, &resources);
        Ok(Self { frame, bodies, vertices, indices, group })
    }
}

fn bind(
    gpu: &GpuDevice,
    layout: &wgpu::BindGroupLayout,
    resources: &[wgpu::BindingResource<'_>],
) -> wgpu::BindGroup {
    let entries: Vec<_> = resources
        .iter()
        .enumerate()
        .map(|(binding, resource)| wgpu::BindGroupEntry {
            binding: binding as u32,
            resource: resource.clone(),
        })
        .collect();
    gpu.device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries: &entries })
}

#[cfg(test)]
mod tests;
