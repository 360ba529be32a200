//! llvmpipe gives a shader invocation 65535 loop turns and then leaves every loop without a word.
//! The walks through the hierarchy say when they were cut short; here one is.

use glam::{DMat3, DQuat, DVec3};
use retina_geometry::Pinhole;
use retina_model::{BuildSpec, build_body, load_body};
use retina_radiometry::{AU_M, Lambert, PhaseFunction, Photometry};

use super::layout::Chunk;
use super::*;
use crate::BodyState;

/// One invocation that walks the hierarchy `chunk.pixels` times, and says how many walks met the
/// sphere.
const MANY_WALKS: &str = "
@compute @workgroup_size(1)
fn many_walks() {
    var hits = 0u;
    for (var k = 0u; k < chunk.pixels; k++) {
        let hit = first_hit(vec2<f32>(32.0 + f32(k % 7u) * 0.1, 32.0));
        hits += select(0u, 1u, hit.triangle != NONE);
    }
    candidates[0] = hits;
    note_cut_short();
}
";

fn sphere() -> BodyModel {
    let spec = BuildSpec {
        name: "sphere".into(),
        radius_m: 1e6,
        relief: None,
        albedo: None,
        cells: 32,
        texels: 8,
        jpeg_quality: None,
        sources: Vec::new(),
        copyright: None,
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sphere.glb");
    std::fs::write(&path, build_body(&spec).unwrap().glb).unwrap();
    let photometry = Photometry::new(Lambert, PhaseFunction::CONSTANT, Some(0.1));
    BodyModel { name: "sphere".into(), shape: load_body(&path).unwrap(), photometry }
}

fn state() -> FrameState {
    let image = Pinhole { fx_px: 200.0, fy_px: 200.0, cx_px: 32.0, cy_px: 32.0, width_px: 64, height_px: 64 };
    let body = BodyState {
        position_camera_m: DVec3::new(0.0, 0.0, 1e7),
        camera_from_body: DMat3::from_quat(DQuat::IDENTITY),
        sun_position_body_m: DVec3::new(0.3, 0.2, -1.0) * AU_M,
    };
    FrameState { image, distortion: None, bodies: vec![body] }
}

/// (walks that met the sphere, walks cut short) of `walks` walks in one invocation.
fn walk(renderer: &GpuRenderer, walks: u32) -> (u32, u32) {
    use wgpu::BufferUsages as Usage;
    let gpu = &renderer.gpu;
    let source = retina_shaders::refine(&retina_shaders::Kinds::all()) + MANY_WALKS;
    let layouts = [&renderer.pipelines.scene_layout, &renderer.pipelines.refine_layout];
    let pipeline = pipelines::compute(&gpu.device, &layouts, source, "many_walks", false);
    let output = |what| gpu.buffer(what, 4096, Usage::STORAGE | Usage::COPY_SRC).unwrap();
    let (planes, work, samples, candidates) = (output("a"), output("b"), output("c"), output("d"));
    let chunk = Chunk { list: 1, first: 0, pixels: walks, samples_log2: 0 };
    let chunk = gpu.filled_buffer("chunk", &[chunk], Usage::UNIFORM).unwrap();
    let buffers = [&planes, &work, &samples, &chunk, &candidates];
    let mut resources = buffers.map(wgpu::Buffer::as_entire_binding).to_vec();
    resources.push(wgpu::BindingResource::TextureView(&renderer.targets.as_ref().unwrap().visible));
    let group = bind(gpu, &renderer.pipelines.refine_layout, &resources);
    let staging = gpu.buffer("read-back", 32, Usage::COPY_DST | Usage::MAP_READ).unwrap();
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    {
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &renderer.scene.group, &[]);
        pass.set_bind_group(1, &group, &[0]);
        pass.dispatch_workgroups(1, 1, 1);
    }
    encoder.copy_buffer_to_buffer(&candidates, 0, &staging, 0, 16);
    encoder.copy_buffer_to_buffer(&work, 0, &staging, 16, 16);
    gpu.queue.submit([encoder.finish()]);
    staging.slice(..).map_async(wgpu::MapMode::Read, |_| {});
    gpu.device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
    let view = staging.slice(..).get_mapped_range().unwrap();
    let word = |at: usize| bytemuck::pod_read_unaligned::<u32>(&view[at..at + 4]);
    (word(0), word(28))
}

#[test]
fn a_walk_that_is_cut_short_is_noticed() {
    let Some(gpu) = GpuDevice::open_for_test() else { return };
    let mut renderer = GpuRenderer::new(gpu, vec![sphere()], Quality::Draft, Planes::Radiance).unwrap();
    // A frame first: it fills the uniforms; and no walk of an ordinary frame is cut short.
    renderer.start(&state()).unwrap();
    let image = renderer.finish().unwrap().unwrap();
    assert!(image.radiance().iter().any(|&v| v > 0.0));
    assert_eq!(walk(&renderer, 20), (20, 0));
    // Some 10 million turns: either the driver runs them all, or it is noticed that it did not.
    let (hits, cut_short) = walk(&renderer, 100_000);
    println!("{hits} of 100000 walks met the sphere, {cut_short} cut short");
    assert!(
        hits == 100_000 || cut_short > 0,
        "{hits} of 100000 walks met the sphere and none was noticed as cut short"
    );
}

#[test]
fn the_host_refuses_a_frame_with_a_walk_cut_short() {
    let Some(gpu) = GpuDevice::open_for_test() else { return };
    let mut renderer = GpuRenderer::new(gpu, vec![sphere()], Quality::Draft, Planes::Radiance).unwrap();
    renderer.start(&state()).unwrap();
    let staging = renderer.pending[0].staging.clone();
    renderer.finish().unwrap();
    // The next frame's read-back buffer, with the counter set as the shaders would set it.
    assert_eq!(renderer.free_staging.len(), 1);
    let counter = 4 * 64 * 64 + 12;
    let encoder = renderer.gpu.device.create_command_encoder(&Default::default());
    renderer.gpu.queue.write_buffer(&renderer.targets.as_ref().unwrap().work, 12, &7u32.to_le_bytes());
    let mut copy = encoder;
    copy.copy_buffer_to_buffer(&renderer.targets.as_ref().unwrap().work, 12, &staging, counter, 4);
    let submission = renderer.gpu.queue.submit([copy.finish()]);
    staging.slice(..).map_async(wgpu::MapMode::Read, |_| {});
    renderer.free_staging.clear();
    renderer.pending.push_back(Pending {
        staging,
        submission,
        size: [64, 64],
        planes: Planes::Radiance,
        window: None,
    });
    assert!(matches!(renderer.finish(), Err(RenderError::CutShort(7))));
}
