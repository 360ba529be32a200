//! The wgpu renderer: rasterised visibility, deferred shading, rays where that is not enough.
//!
//! 1. `visibility`: every triangle is rasterised at 2 x 2 samples a pixel; each sample keeps the
//!    index of the triangle it sees.
//! 2. `shade`: each sample is shaded at the exact point where its ray meets that triangle. Sun
//!    rays are traced only where the body's relief (bounded beforehand, [`horizon`]) or another
//!    body may stand before the Sun. Pixels on an edge, or whose samples differ, are listed.
//! 3. `refine`: listed pixels are sampled anew by 16, 64 or 256 rays.

mod bvh;
mod device;
mod horizon;
mod layout;
mod pipelines;
mod shaders;
mod state;
mod upload;
mod warp;

use std::collections::VecDeque;

pub use device::GpuDevice;
pub use warp::GpuWarp;

use crate::{BodyModel, FrameState, Planes, Quality, RadianceImage, RenderError};
use layout::{Body, Frame, MOST_BODIES};
use pipelines::{DEPTH_FORMAT, Pipelines, VISIBILITY_FORMAT};
use state::{GRID, Region};
use upload::{BodyRange, SceneArrays};

/// Most bytes that the refinement's samples take at a time.
const SAMPLE_BYTES: u64 = 48 << 20;
/// Size of `Sample` in shaders/shared/surface.wgsl.
const SAMPLE_SIZE: u64 = 48;
/// Uniform offsets are aligned to this on every adapter.
const UNIFORM_STRIDE: u64 = 256;
/// Frames that may be under way at a time.
pub const FRAMES_IN_FLIGHT: usize = 2;

/// A renderer of one set of bodies into images of one size.
pub struct GpuRenderer {
    gpu: GpuDevice,
    models: Vec<BodyModel>,
    ranges: Vec<BodyRange>,
    quality: Quality,
    planes: Planes,
    pipelines: Pipelines,
    scene: SceneBuffers,
    targets: Option<Targets>,
    warp: Option<GpuWarp>,
    pending: VecDeque<Pending>,
    free_staging: Vec<wgpu::Buffer>,
}

struct SceneBuffers {
    frame: wgpu::Buffer,
    bodies: wgpu::Buffer,
    vertices: wgpu::Buffer,
    indices: wgpu::Buffer,
    group: wgpu::BindGroup,
}

/// What depends on the image's size.
struct Targets {
    size: [u32; 2],
    visible: wgpu::TextureView,
    depth: wgpu::TextureView,
    planes: wgpu::Buffer,
    work: wgpu::Buffer,
    dispatches: wgpu::Buffer,
    chunk_pixels: u32,
    chunks: u32,
    shade_group: wgpu::BindGroup,
    plan_group: wgpu::BindGroup,
    refine_group: wgpu::BindGroup,
}

struct Pending {
    staging: wgpu::Buffer,
    submission: wgpu::SubmissionIndex,
    size: [u32; 2],
    planes: Planes,
}

impl GpuRenderer {
    /// Uploads the bodies. `planes` is the most that any frame will be asked for.
    ///
    /// # Errors
    /// The bodies do not fit the adapter.
    pub fn new(gpu: GpuDevice, models: Vec<BodyModel>, quality: Quality, planes: Planes) -> Result<Self, RenderError> {
        if models.len() > MOST_BODIES {
            return Err(RenderError::TooManyBodies(models.len()));
        }
        let pipelines = Pipelines::new(&gpu.device, planes == Planes::Layers);
        let arrays = SceneArrays::new(&models);
        let scene = SceneBuffers::new(&gpu, &pipelines, &arrays)?;
        // Textures and shapes are on the device now; only photometry and names are needed here.
        let models = models.into_iter().map(BodyModel::without_shape).collect();
        Ok(Self {
            gpu,
            models,
            ranges: arrays.ranges,
            quality,
            planes,
            pipelines,
            scene,
            targets: None,
            warp: None,
            pending: VecDeque::new(),
            free_staging: Vec::new(),
        })
    }

    /// The device it renders on.
    pub fn device(&self) -> &GpuDevice {
        &self.gpu
    }

    /// Has every further frame resampled through `warp` on its way back: the image returned has
    /// the warp's size and holds radiance alone.
    pub fn set_warp(&mut self, warp: Option<GpuWarp>) {
        self.warp = warp;
    }

    /// Starts a frame; [`GpuRenderer::finish`] gives frames back in the order they were started.
    ///
    /// # Errors
    /// The image is too large for the adapter.
    pub fn start(&mut self, state: &FrameState) -> Result<(), RenderError> {
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
        let staging = match self.free_staging.pop() {
            Some(buffer) => buffer,
            None => self.gpu.buffer(
                "read-back",
                plane_bytes + 8,
                wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            )?,
        };
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        encoder.clear_buffer(&targets.planes, 0, None);
        encoder.clear_buffer(&targets.work, 0, Some(8));
        if let Some(region) = state::region(state, &self.ranges) {
            let frame = state::frame_uniform(state, region, self.quality, targets.chunk_pixels, &self.ranges);
            let bodies = state::body_uniforms(state, &self.models, &self.ranges, self.quality);
            self.gpu.queue.write_buffer(&self.scene.frame, 0, bytemuck::bytes_of(&frame));
            self.gpu.queue.write_buffer(&self.scene.bodies, 0, bytemuck::cast_slice(&bodies));
            self.encode_visibility(&mut encoder, targets, region);
            if std::env::var("NOSHADE").is_err() { self.encode_shading(&mut encoder, targets, region); }
        }
        match &self.warp {
            Some(warp) => {
                warp.encode(&self.gpu, &mut encoder, &targets.planes);
                encoder.copy_buffer_to_buffer(warp.output(), 0, &staging, 0, plane_bytes);
            }
            None => encoder.copy_buffer_to_buffer(&targets.planes, 0, &staging, 0, plane_bytes),
        }
        encoder.copy_buffer_to_buffer(&targets.work, 0, &staging, plane_bytes, 8);
        let submission = self.gpu.queue.submit([encoder.finish()]);
        staging.slice(..).map_async(wgpu::MapMode::Read, |_| {});
        self.pending.push_back(Pending { staging, submission, size: back_size, planes: back_planes });
        Ok(())
    }

    /// Number of frames started and not yet finished.
    pub fn in_flight(&self) -> usize {
        self.pending.len()
    }

    /// Waits for the oldest frame under way; `None` when there is none.
    ///
    /// # Errors
    /// The device failed, or cut a shader's loops short.
    pub fn finish(&mut self) -> Result<Option<RadianceImage>, RenderError> {
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
            bytemuck::pod_read_unaligned::<u32>(&view[4 * pixels + 4..4 * pixels + 8])
        };
        if std::env::var("DBG").is_ok() { let v = pending.staging.slice(..).get_mapped_range().unwrap(); eprintln!("listed {}", bytemuck::pod_read_unaligned::<u32>(&v[4 * pixels..4 * pixels + 4])); }
        pending.staging.unmap();
        self.free_staging.push(pending.staging);
        if cut_short > 0 {
            return Err(RenderError::CutShort(cut_short));
        }
        Ok(Some(RadianceImage { width_px: pending.size[0], height_px: pending.size[1], data }))
    }

    fn encode_visibility(&self, encoder: &mut wgpu::CommandEncoder, targets: &Targets, region: Region) {
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("visibility"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &targets.visible,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT), store: wgpu::StoreOp::Store },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &targets.depth,
                depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(0.0), store: wgpu::StoreOp::Discard }),
                stencil_ops: None,
            }),
            ..Default::default()
        });
        let [width, height] = region.size.map(|side| (side * GRID) as f32);
        pass.set_viewport(0.0, 0.0, width, height, 0.0, 1.0);
        pass.set_bind_group(0, &self.scene.group, &[]);
        pass.set_vertex_buffer(0, self.scene.vertices.slice(..));
        pass.set_index_buffer(self.scene.indices.slice(..), wgpu::IndexFormat::Uint32);
        for (body, range) in self.ranges.iter().enumerate() {
            pass.set_pipeline(&self.pipelines.visibility[usize::from(range.double_sided)]);
            let first = 3 * range.triangle_first;
            let instance = body as u32;
            pass.draw_indexed(first..first + 3 * range.triangle_count, 0, instance..instance + 1);
        }
    }

    fn encode_shading(&self, encoder: &mut wgpu::CommandEncoder, targets: &Targets, region: Region) {
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_bind_group(0, &self.scene.group, &[]);
        pass.set_pipeline(&self.pipelines.shade);
        pass.set_bind_group(1, &targets.shade_group, &[]);
        pass.dispatch_workgroups(region.size[0].div_ceil(8), region.size[1].div_ceil(8), 1);
        if std::env::var("NOREF").is_ok() { return; }
        pass.set_pipeline(&self.pipelines.plan);
        pass.set_bind_group(1, &targets.plan_group, &[]);
        pass.dispatch_workgroups(targets.chunks.div_ceil(64), 1, 1);
        // No more chunks than the region's pixels can fill.
        let pixels = region.size[0] * region.size[1];
        for chunk in 0..pixels.div_ceil(targets.chunk_pixels) {
            pass.set_bind_group(1, &targets.refine_group, &[chunk * UNIFORM_STRIDE as u32]);
            pass.set_pipeline(&self.pipelines.take_samples);
            pass.dispatch_workgroups_indirect(&targets.dispatches, 24 * u64::from(chunk));
            pass.set_pipeline(&self.pipelines.sum_samples);
            pass.dispatch_workgroups_indirect(&targets.dispatches, 24 * u64::from(chunk) + 12);
        }
    }
}

impl SceneBuffers {
    fn new(gpu: &GpuDevice, pipelines: &Pipelines, arrays: &SceneArrays) -> Result<Self, RenderError> {
        use wgpu::BufferUsages as Usage;
        let frame = gpu.buffer("frame", size_of::<Frame>() as u64, Usage::UNIFORM | Usage::COPY_DST)?;
        let bodies = gpu.buffer("bodies", (MOST_BODIES * size_of::<Body>()) as u64, Usage::UNIFORM | Usage::COPY_DST)?;
        let (uint4, float4) = (wgpu::TextureFormat::Rgba32Uint, wgpu::TextureFormat::Rgba32Float);
        let textures = [
            gpu.array_texture("bounding volume hierarchy", &arrays.nodes, uint4)?,
            gpu.array_texture("triangles", &arrays.triangles, uint4)?,
            gpu.array_texture("vertices", &arrays.vertices, float4)?,
            gpu.array_texture("horizons", &arrays.horizons, wgpu::TextureFormat::R32Float)?,
            gpu.array_texture("surfaces", &arrays.surfaces, uint4)?,
            gpu.array_texture("maps", &arrays.maps, uint4)?,
            gpu.array_texture("textures", &arrays.texels, wgpu::TextureFormat::R32Uint)?,
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

fn bind(gpu: &GpuDevice, layout: &wgpu::BindGroupLayout, resources: &[wgpu::BindingResource<'_>]) -> wgpu::BindGroup {
    let entries: Vec<_> = resources
        .iter()
        .enumerate()
        .map(|(binding, resource)| wgpu::BindGroupEntry { binding: binding as u32, resource: resource.clone() })
        .collect();
    gpu.device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries: &entries })
}

impl Targets {
    fn new(gpu: &GpuDevice, pipelines: &Pipelines, size: [u32; 2], quality: Quality, planes: Planes) -> Result<Self, RenderError> {
        use wgpu::BufferUsages as Usage;
        let allowed = gpu.device.limits().max_texture_dimension_2d;
        let needed = size[0].max(size[1]) * GRID;
        if needed > allowed {
            return Err(RenderError::TooLarge {
                what: "the image",
                needed: u64::from(needed),
                allowed: u64::from(allowed),
                adapter: gpu.name().to_owned(),
            });
        }
        let texture = |format, usage| {
            let size = wgpu::Extent3d { width: size[0] * GRID, height: size[1] * GRID, depth_or_array_layers: 1 };
            gpu.device
                .create_texture(&wgpu::TextureDescriptor {
                    label: None,
                    size,
                    mip_level_count: 1,
                    sample_count: 1,
                    dimension: wgpu::TextureDimension::D2,
                    format,
                    usage: usage | wgpu::TextureUsages::RENDER_ATTACHMENT,
                    view_formats: &[],
                })
                .create_view(&Default::default())
        };
        let visible = texture(VISIBILITY_FORMAT, wgpu::TextureUsages::TEXTURE_BINDING);
        let depth = texture(DEPTH_FORMAT, wgpu::TextureUsages::empty());
        let pixels = u64::from(size[0]) * u64::from(size[1]);
        let samples_per_pixel = u64::from(quality.refined_samples());
        let chunk_pixels = (SAMPLE_BYTES / (SAMPLE_SIZE * samples_per_pixel)).min(pixels).max(1);
        let chunks = pixels.div_ceil(chunk_pixels);
        // Radiance and I/F are always stored; the copy takes what is asked for.
        let stored = planes.count().max(2) as u64;
        let plane_buffer = gpu.buffer("image", 4 * pixels * stored, Usage::STORAGE | Usage::COPY_SRC | Usage::COPY_DST)?;
        let work = gpu.buffer("work list", 8 + 4 * pixels, Usage::STORAGE | Usage::COPY_SRC | Usage::COPY_DST)?;
        let dispatches = gpu.buffer("dispatches", 24 * chunks, Usage::STORAGE | Usage::INDIRECT)?;
        let samples = gpu.buffer("samples", SAMPLE_SIZE * samples_per_pixel * chunk_pixels, Usage::STORAGE)?;
        let firsts: Vec<[u32; 64]> = (0..chunks)
            .map(|chunk| {
                let mut entry = [0; 64];
                entry[0] = (chunk * chunk_pixels) as u32;
                entry
            })
            .collect();
        let firsts = gpu.filled_buffer("chunks", &firsts, Usage::UNIFORM)?;
        let (image, list) = (plane_buffer.as_entire_binding(), work.as_entire_binding());
        let shade_group =
            bind(gpu, &pipelines.shade_layout, &[image.clone(), list.clone(), wgpu::BindingResource::TextureView(&visible)]);
        let plan_group = bind(gpu, &pipelines.plan_layout, &[image.clone(), list.clone(), dispatches.as_entire_binding()]);
        let first = wgpu::BindingResource::Buffer(wgpu::BufferBinding {
            buffer: &firsts,
            offset: 0,
            size: std::num::NonZeroU64::new(16),
        });
        let refine_group = bind(gpu, &pipelines.refine_layout, &[image, list, samples.as_entire_binding(), first]);
        Ok(Self {
            size,
            visible,
            depth,
            planes: plane_buffer,
            work,
            dispatches,
            chunk_pixels: chunk_pixels as u32,
            chunks: chunks as u32,
            shade_group,
            plan_group,
            refine_group,
        })
    }
}
#[doc(hidden)]
pub fn stats(models: &[BodyModel]) {
    let a = SceneArrays::new(models);
    let h: Vec<f32> = a.horizons.clone(); let mut s = h.clone(); s.sort_by(f32::total_cmp);
    println!("horizon sine p10 {} p50 {} p90 {} p99 {} unknown {}", s[s.len()/10], s[s.len()/2], s[s.len()*9/10], s[s.len()*99/100], h.iter().filter(|&&x| x > 1.0).count() as f64/h.len() as f64);
    for elev in [2.0f32, 5.0, 10.0] {
        let (mut visits, mut tests, mut n, mut blocked, mut maxv) = (0usize, 0usize, 0usize, 0usize, 0usize);
        for t in (0..a.triangles.len()).step_by(997) {
            let c = a.triangles[t]; let v = |i: u32| glam::Vec3::from_array(a.vertices[i as usize].position);
            let (p0, p1, p2) = (v(c[0]), v(c[1]), v(c[2]));
            let nrm = (p1-p0).cross(p2-p0).normalize();
            let up = p0.normalize(); let (e, _) = up.any_orthonormal_pair();
            let d = (e*elev.to_radians().cos() + up*elev.to_radians().sin()).normalize();
            if d.dot(nrm) <= 0.0 { continue; }
            let o = (p0+p1+p2)/3.0 + nrm*7.0;
            let inv = d.recip(); let mut node = 0usize; let mut vis=0;
            while node < a.nodes.len() {
                let nd = &a.nodes[node]; vis += 1;
                let lo = (glam::Vec3::from_array(nd.low)-o)*inv; let hi = (glam::Vec3::from_array(nd.high)-o)*inv;
                let near = lo.min(hi).max_element(); let far = lo.max(hi).min_element();
                if near > far || far < 0.0 { node = nd.escape as usize; continue; }
                tests += (nd.leaf & 7) as usize;
                let mut hit=false;
                for k in 0..(nd.leaf&7) { let c = a.triangles[(nd.leaf/8+k) as usize]; let (x,y,z)=(v(c[0])-o,v(c[1])-o,v(c[2])-o);
                    let (u,w,q)=(d.dot(z.cross(y)), d.dot(x.cross(z)), d.dot(y.cross(x)));
                    if (u<=0.0&&w<=0.0&&q<=0.0)||(u>=0.0&&w>=0.0&&q>=0.0) { let s=u+w+q; if s!=0.0 && ((x*u+y*w+z*q)/s).dot(d)>0.0 { hit=true; } } }
                if hit { blocked+=1; break; }
                node = if nd.leaf==0 { node+1 } else { nd.escape as usize };
            }
            visits += vis; n+=1; maxv=maxv.max(vis);
        }
        println!("elev {elev}: n {n} visits {:.1} max {maxv} tritests {:.1} blocked {:.3}", visits as f64/n as f64, tests as f64/n as f64, blocked as f64/n as f64);
    }
}
