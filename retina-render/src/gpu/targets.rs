//! What depends on the image's size: textures, lists, buffers, and how much is refined at a time.

use super::layout::{Chunk, Plan};
use super::pipelines::{DEPTH_FORMAT, Pipelines, VISIBILITY_FORMAT};
use super::state::GRID;
use super::{DISPATCH_BYTES, GpuDevice, LIST_EDGE, LIST_INNER, LISTS, UNIFORM_STRIDE, WORK_HEAD, bind};
use crate::{Planes, Quality, RenderError};

/// Most bytes that the refinement's runs of samples take at a time.
const SAMPLE_BYTES: u64 = 48 << 20;
/// Size of `Sample` in shaders/shared/surface.wgsl.
const SAMPLE_SIZE: u64 = 64;
/// `RUN_LOG2` in shaders/refine.wgsl.
const RUN_LOG2: u32 = 3;
/// Most pixels in a chunk: their candidates take 64 MiB.
const CHUNK_PIXELS: u64 = 1 << 18;
/// `CANDIDATES` in shaders/refine.wgsl.
const CANDIDATES: u64 = 64;

/// What depends on the image's size.
pub(super) struct Targets {
    pub(super) size: [u32; 2],
    pub(super) visible: wgpu::TextureView,
    pub(super) depth: wgpu::TextureView,
    pub(super) planes: wgpu::Buffer,
    pub(super) work: wgpu::Buffer,
    pub(super) light: wgpu::Buffer,
    pub(super) dispatches: wgpu::Buffer,
    pub(super) chunks: Vec<Chunk>,
    pub(super) shade_group: wgpu::BindGroup,
    pub(super) plan_group: wgpu::BindGroup,
    pub(super) refine_group: wgpu::BindGroup,
}

/// The first-pass samples of an image stand in one texture.
pub(super) fn check_size(gpu: &GpuDevice, [width_px, height_px]: [u32; 2]) -> Result<(), RenderError> {
    let allowed = u64::from(gpu.device.limits().max_texture_dimension_2d / GRID);
    let needed = u64::from(width_px.max(height_px));
    if needed > allowed {
        let (what, adapter) = ("the image's longer side, in pixels,", gpu.name().to_owned());
        return Err(RenderError::TooLarge { what, needed, allowed, adapter });
    }
    Ok(())
}

impl Targets {
    pub(super) fn new(
        gpu: &GpuDevice,
        pipelines: &Pipelines,
        size: [u32; 2],
        quality: Quality,
        planes: Planes,
    ) -> Result<Self, RenderError> {
        use wgpu::BufferUsages as Usage;
        check_size(gpu, size)?;
        let texture = |format, usage| {
            let size =
                wgpu::Extent3d { width: size[0] * GRID, height: size[1] * GRID, depth_or_array_layers: 1 };
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
        let chunk_pixels = |log2: u32| {
            ((SAMPLE_BYTES / SAMPLE_SIZE) >> (log2 - RUN_LOG2)).min(CHUNK_PIXELS).min(pixels) as u32
        };
        let (edge_log2, inner_log2) = (quality.edge_samples_log2(), quality.inner_samples_log2());
        let chunks_of = |list: u32, samples_log2: u32| {
            let most = chunk_pixels(samples_log2);
            (0..pixels as u32).step_by(most as usize).map(move |first| Chunk {
                list,
                first,
                pixels: most,
                samples_log2,
            })
        };
        let edge_chunks: Vec<Chunk> = chunks_of(LIST_EDGE, edge_log2).collect();
        let inner_chunks: Vec<Chunk> = chunks_of(LIST_INNER, inner_log2).collect();
        let plan = Plan {
            edge_pixels: chunk_pixels(edge_log2),
            edge_samples_log2: edge_log2,
            inner_pixels: chunk_pixels(inner_log2),
            inner_samples_log2: inner_log2,
            edge_chunks: edge_chunks.len() as u32,
            inner_chunks: inner_chunks.len() as u32,
            run_log2: RUN_LOG2,
        };
        let chunks = [edge_chunks, inner_chunks].concat();
        // Radiance and I/F are always stored; the copy takes what is asked for.
        let stored = planes.count().max(2) as u64;
        let plane_buffer =
            gpu.buffer("image", 4 * pixels * stored, Usage::STORAGE | Usage::COPY_SRC | Usage::COPY_DST)?;
        let work_bytes = WORK_HEAD + LISTS * 4 * pixels;
        let work = gpu.buffer("work list", work_bytes, Usage::STORAGE | Usage::COPY_SRC | Usage::COPY_DST)?;
        let light = gpu.buffer("light", 4 * pixels, Usage::STORAGE | Usage::COPY_DST)?;
        let dispatch_bytes = DISPATCH_BYTES * (1 + 2 * chunks.len() as u64);
        let dispatches = gpu.buffer("dispatches", dispatch_bytes, Usage::STORAGE | Usage::INDIRECT)?;
        let runs = gpu.buffer("sample runs", SAMPLE_BYTES, Usage::STORAGE)?;
        let most_pixels = u64::from(plan.edge_pixels.max(plan.inner_pixels));
        let candidates = gpu.buffer("candidates", 4 * CANDIDATES * most_pixels, Usage::STORAGE)?;
        let mut chunk_bytes = vec![0u8; chunks.len() * UNIFORM_STRIDE as usize];
        for (entry, chunk) in chunk_bytes.chunks_mut(UNIFORM_STRIDE as usize).zip(&chunks) {
            entry[..size_of::<Chunk>()].copy_from_slice(bytemuck::bytes_of(chunk));
        }
        let chunk_buffer = gpu.filled_buffer("chunks", &chunk_bytes, Usage::UNIFORM)?;
        let plan = gpu.filled_buffer("plan", &[plan], Usage::UNIFORM)?;
        let (image, list) = (plane_buffer.as_entire_binding(), work.as_entire_binding());
        let visible_view = wgpu::BindingResource::TextureView(&visible);
        let shade = [image.clone(), list.clone(), light.as_entire_binding(), visible_view.clone()];
        let planning =
            [image.clone(), list.clone(), dispatches.as_entire_binding(), plan.as_entire_binding()];
        let chunk = wgpu::BindingResource::Buffer(wgpu::BufferBinding {
            buffer: &chunk_buffer,
            offset: 0,
            size: std::num::NonZeroU64::new(size_of::<Chunk>() as u64),
        });
        let shade_group = bind(gpu, &pipelines.shade_layout, &shade);
        let plan_group = bind(gpu, &pipelines.plan_layout, &planning);
        let refine_group = bind(
            gpu,
            &pipelines.refine_layout,
            &[image, list, runs.as_entire_binding(), chunk, candidates.as_entire_binding(), visible_view],
        );
        Ok(Self {
            size,
            visible,
            depth,
            planes: plane_buffer,
            work,
            dispatches,
            light,
            chunks,
            shade_group,
            plan_group,
            refine_group,
        })
    }
}
