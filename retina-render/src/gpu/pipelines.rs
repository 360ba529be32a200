//! The compiled stages and their binding layouts.

use retina_shaders::Kinds;
use std::num::NonZeroU64;

use crate::arrays::Vertex;

pub(crate) const VISIBILITY_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R32Uint;
pub(crate) const DEPTH_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

pub(crate) struct Pipelines {
    /// Group 0 of every stage: the frame and the scene.
    pub scene_layout: wgpu::BindGroupLayout,
    pub shade_layout: wgpu::BindGroupLayout,
    pub plan_layout: wgpu::BindGroupLayout,
    pub refine_layout: wgpu::BindGroupLayout,
    /// Visibility, one-sided bodies and bodies with two-sided surfaces.
    pub visibility: [wgpu::RenderPipeline; 2],
    pub shade: wgpu::ComputePipeline,
    pub probe: wgpu::ComputePipeline,
    pub settle: wgpu::ComputePipeline,
    pub plan: wgpu::ComputePipeline,
    pub gather: wgpu::ComputePipeline,
    pub take_samples: wgpu::ComputePipeline,
    pub sum_samples: wgpu::ComputePipeline,
}

pub(crate) fn entry(
    binding: u32,
    visibility: wgpu::ShaderStages,
    ty: wgpu::BindingType,
) -> wgpu::BindGroupLayoutEntry {
    wgpu::BindGroupLayoutEntry { binding, visibility, ty, count: None }
}

pub(crate) fn storage(read_only: bool) -> wgpu::BindingType {
    wgpu::BindingType::Buffer {
        ty: wgpu::BufferBindingType::Storage { read_only },
        has_dynamic_offset: false,
        min_binding_size: None,
    }
}

pub(crate) fn uniform() -> wgpu::BindingType {
    wgpu::BindingType::Buffer {
        ty: wgpu::BufferBindingType::Uniform,
        has_dynamic_offset: false,
        min_binding_size: None,
    }
}

fn texture(sample_type: wgpu::TextureSampleType) -> wgpu::BindingType {
    wgpu::BindingType::Texture {
        sample_type,
        view_dimension: wgpu::TextureViewDimension::D2,
        multisampled: false,
    }
}

pub(crate) fn compute(
    device: &wgpu::Device,
    layouts: &[&wgpu::BindGroupLayout],
    source: String,
    entry_point: &str,
    layers: bool,
) -> wgpu::ComputePipeline {
    let layouts: Vec<_> = layouts.iter().map(|&layout| Some(layout)).collect();
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some(entry_point),
        bind_group_layouts: &layouts,
        immediate_size: 0,
    });
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(entry_point),
        source: wgpu::ShaderSource::Wgsl(source.into()),
    });
    let constants = [("LAYERS", f64::from(u8::from(layers)))];
    device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(entry_point),
        layout: Some(&layout),
        module: &module,
        entry_point: Some(entry_point),
        compilation_options: wgpu::PipelineCompilationOptions {
            constants: if entry_point == "resample" { &[] } else { &constants },
            ..Default::default()
        },
        cache: None,
    })
}

impl Pipelines {
    /// For bodies of these laws and phase functions.
    pub(crate) fn new(device: &wgpu::Device, kinds: &Kinds, layers: bool) -> Self {
        let everywhere = wgpu::ShaderStages::VERTEX_FRAGMENT | wgpu::ShaderStages::COMPUTE;
        let only_compute = wgpu::ShaderStages::COMPUTE;
        let layout = |label: &str, entries: &[wgpu::BindGroupLayoutEntry]| {
            device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some(label), entries })
        };
        let mut scene = vec![entry(0, everywhere, uniform()), entry(1, everywhere, uniform())];
        let float = wgpu::TextureSampleType::Float { filterable: false };
        let uint = wgpu::TextureSampleType::Uint;
        let types = [uint, uint, float, float, uint, uint, uint, float];
        scene.extend(
            (2..).zip(types).map(|(binding, sample_type)| entry(binding, everywhere, texture(sample_type))),
        );
        let scene_layout = layout("scene", &scene);
        let outputs = [entry(0, only_compute, storage(false)), entry(1, only_compute, storage(false))];
        let visible = texture(uint);
        let third = entry(2, only_compute, storage(false));
        let shade_layout = layout("shade", &[outputs[0], outputs[1], third, entry(3, only_compute, visible)]);
        let plan_layout = layout("plan", &[outputs[0], outputs[1], third, entry(3, only_compute, uniform())]);
        let chunk = wgpu::BindingType::Buffer {
            ty: wgpu::BufferBindingType::Uniform,
            has_dynamic_offset: true,
            min_binding_size: NonZeroU64::new(16),
        };
        let refine_layout = layout(
            "refine",
            &[
                outputs[0],
                outputs[1],
                third,
                entry(3, only_compute, chunk),
                entry(4, only_compute, storage(false)),
                entry(5, only_compute, visible),
            ],
        );
        Self {
            visibility: [Some(wgpu::Face::Back), None].map(|cull| visibility(device, &scene_layout, cull)),
            shade: compute(
                device,
                &[&scene_layout, &shade_layout],
                retina_shaders::shade(kinds),
                "shade_pixels",
                layers,
            ),
            probe: compute(
                device,
                &[&scene_layout, &shade_layout],
                retina_shaders::shade(kinds),
                "probe_shadows",
                layers,
            ),
            settle: compute(
                device,
                &[&scene_layout, &shade_layout],
                retina_shaders::shade(kinds),
                "settle_shadows",
                layers,
            ),
            plan: compute(
                device,
                &[&scene_layout, &plan_layout],
                retina_shaders::refine_plan(kinds),
                "plan_chunks",
                layers,
            ),
            gather: compute(
                device,
                &[&scene_layout, &refine_layout],
                retina_shaders::refine(kinds),
                "gather_candidates",
                layers,
            ),
            take_samples: compute(
                device,
                &[&scene_layout, &refine_layout],
                retina_shaders::refine(kinds),
                "take_samples",
                layers,
            ),
            sum_samples: compute(
                device,
                &[&scene_layout, &refine_layout],
                retina_shaders::refine(kinds),
                "sum_samples",
                layers,
            ),
            scene_layout,
            shade_layout,
            plan_layout,
            refine_layout,
        }
    }
}

fn visibility(
    device: &wgpu::Device,
    scene_layout: &wgpu::BindGroupLayout,
    cull_mode: Option<wgpu::Face>,
) -> wgpu::RenderPipeline {
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some("visibility"),
        source: wgpu::ShaderSource::Wgsl(retina_shaders::visibility().into()),
    });
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some("visibility"),
        bind_group_layouts: &[Some(scene_layout)],
        immediate_size: 0,
    });
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("visibility"),
        layout: Some(&layout),
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("vertex"),
            compilation_options: Default::default(),
            buffers: &[Some(wgpu::VertexBufferLayout {
                array_stride: size_of::<Vertex>() as u64,
                step_mode: wgpu::VertexStepMode::Vertex,
                attributes: &[wgpu::VertexAttribute {
                    format: wgpu::VertexFormat::Float32x3,
                    offset: 0,
                    shader_location: 0,
                }],
            })],
        },
        primitive: wgpu::PrimitiveState {
            // Camera axes have y down like the image, and the stage flips y for the clip space:
            // seen from outside, a body's triangles stay counter-clockwise.
            front_face: wgpu::FrontFace::Ccw,
            cull_mode,
            ..Default::default()
        },
        depth_stencil: Some(wgpu::DepthStencilState {
            format: DEPTH_FORMAT,
            depth_write_enabled: Some(true),
            depth_compare: Some(wgpu::CompareFunction::Greater),
            stencil: Default::default(),
            bias: Default::default(),
        }),
        multisample: Default::default(),
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some("fragment"),
            compilation_options: Default::default(),
            targets: &[Some(VISIBILITY_FORMAT.into())],
        }),
        multiview_mask: None,
        cache: None,
    })
}
