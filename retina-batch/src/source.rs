//! Frames from either renderer, several under way at a time where it allows that.

use std::collections::VecDeque;

use retina_render::{
    BodyModel, CpuRenderer, FRAMES_IN_FLIGHT, FrameState, GpuDevice, GpuRenderer, GpuWarp, NativeRenderer,
    Quality, RadianceImage, RenderError,
};
use retina_scene::SceneFrame;

use crate::{ImagePlan, Resampler};

/// Which renderer is wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum BackendChoice {
    /// The GPU's where there is a real one, else the native one.
    #[default]
    Auto,
    /// The GPU's, by any adapter, or none.
    Gpu,
    /// The native one, on the processor's cores.
    Native,
    /// The f64 reference.
    Cpu,
}

/// What renders.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AdapterName {
    /// `gpu`, `native` or `cpu`.
    pub backend: &'static str,
    /// The adapter; the backend's name where there is none.
    pub adapter: String,
    /// Its driver and version; the program's version where there is none.
    pub driver: String,
}

impl AdapterName {
    /// Of a renderer of our own.
    fn own(backend: &'static str) -> Self {
        Self { backend, adapter: backend.into(), driver: format!("retina {}", env!("CARGO_PKG_VERSION")) }
    }

    /// The renderer that a choice would take, and, where it was left open and there is no real GPU, why.
    ///
    /// # Errors
    /// The GPU is asked for and there is no adapter.
    pub fn of_choice(choice: BackendChoice) -> Result<(Self, Option<RenderError>), RenderError> {
        let (opened, fallback) = open(choice)?;
        let name = match &opened {
            Opened::Gpu(device) => Self::of_device(device),
            Opened::Native => Self::own("native"),
            Opened::Cpu => Self::own("cpu"),
        };
        Ok((name, fallback))
    }

    fn of_device(device: &GpuDevice) -> Self {
        Self { backend: "gpu", adapter: device.name().into(), driver: device.driver().into() }
    }
}

/// What a choice comes to.
#[allow(clippy::large_enum_variant, reason = "one value in a program")]
enum Opened {
    Gpu(GpuDevice),
    Native,
    Cpu,
}

fn open(choice: BackendChoice) -> Result<(Opened, Option<RenderError>), RenderError> {
    Ok(match choice {
        BackendChoice::Cpu => (Opened::Cpu, None),
        BackendChoice::Native => (Opened::Native, None),
        BackendChoice::Gpu => (Opened::Gpu(GpuDevice::open()?), None),
        BackendChoice::Auto => match GpuDevice::open_hardware() {
            Ok(device) => (Opened::Gpu(device), None),
            Err(error) => (Opened::Native, Some(error)),
        },
    })
}

/// A renderer of a scene's frames by a plan.
pub(crate) struct FrameSource {
    renderer: Renderer,
    plan: ImagePlan,
    /// The resampling that the renderer leaves to be done.
    pub(crate) resampler: Option<Resampler>,
    pub(crate) name: AdapterName,
}

#[allow(clippy::large_enum_variant, reason = "one value in a program")]
enum Renderer {
    Gpu(GpuRenderer),
    Native(NativeRenderer, VecDeque<FrameState>),
    Cpu(CpuRenderer, VecDeque<FrameState>),
    /// A scene without bodies: nothing is resolved, so frames are dark but for their point sources.
    Dark(usize),
}

impl FrameSource {
    /// Opens the renderer. Gives also why the GPU is not used where the choice was left open.
    pub(crate) fn open(
        choice: BackendChoice,
        models: Vec<BodyModel>,
        quality: Quality,
        plan: &ImagePlan,
    ) -> Result<(Self, Option<RenderError>), RenderError> {
        if models.is_empty() {
            let name = AdapterName { adapter: "none".into(), ..AdapterName::own("native") };
            let source = Self { renderer: Renderer::Dark(0), plan: plan.clone(), resampler: None, name };
            return Ok((source, None));
        }
        let (opened, mut fallback) = open(choice)?;
        let is_reference = matches!(opened, Opened::Cpu);
        let models = match opened {
            Opened::Native | Opened::Cpu => models,
            Opened::Gpu(device) => {
                // The scene may not fit the adapter: then the native renderer still needs the bodies.
                let kept = (choice == BackendChoice::Auto).then(|| models.clone());
                match Self::on_gpu(device, models, quality, plan) {
                    Ok(source) => return Ok((source, None)),
                    Err(error) => match kept {
                        Some(models) => {
                            fallback = Some(error);
                            models
                        }
                        None => return Err(error),
                    },
                }
            }
        };
        let waiting = VecDeque::new();
        let (backend, renderer) = if is_reference {
            ("cpu", Renderer::Cpu(CpuRenderer::new(models, quality.into(), plan.planes), waiting))
        } else {
            ("native", Renderer::Native(NativeRenderer::new(&models, quality, plan.planes), waiting))
        };
        let resampler = plan.resampling.clone().map(|(map, canvas)| Resampler::new(map, canvas));
        Ok((Self { renderer, plan: plan.clone(), resampler, name: AdapterName::own(backend) }, fallback))
    }

    fn on_gpu(
        device: GpuDevice,
        models: Vec<BodyModel>,
        quality: Quality,
        plan: &ImagePlan,
    ) -> Result<Self, RenderError> {
        let name = AdapterName::of_device(&device);
        let mut renderer = GpuRenderer::new(device, models, quality, plan.planes)?;
        renderer.check_size([plan.image.width_px, plan.image.height_px])?;
        let mut resampler = None;
        if let Some((map, canvas)) = &plan.resampling {
            if plan.keeps_rendered() {
                // The rendered image comes back whole, so the screen's is made of it here.
                resampler = Some(Resampler::new(map.clone(), *canvas));
            } else {
                let warp = GpuWarp::new(renderer.device(), map, canvas.origin_px, canvas.size_px)?;
                renderer.set_warp(Some(warp));
            }
        }
        Ok(Self { renderer: Renderer::Gpu(renderer), plan: plan.clone(), resampler, name })
    }

    /// Frames that may be under way at a time.
    pub(crate) fn capacity(&self) -> usize {
        match &self.renderer {
            Renderer::Gpu(_) => FRAMES_IN_FLIGHT,
            Renderer::Native(..) | Renderer::Cpu(..) | Renderer::Dark(_) => 1,
        }
    }

    /// Frames started and not yet finished.
    pub(crate) fn in_flight(&self) -> usize {
        match &self.renderer {
            Renderer::Gpu(gpu) => gpu.in_flight(),
            Renderer::Native(_, waiting) | Renderer::Cpu(_, waiting) => waiting.len(),
            Renderer::Dark(waiting) => *waiting,
        }
    }

    /// Starts a frame.
    pub(crate) fn start(&mut self, frame: &SceneFrame) -> Result<(), RenderError> {
        let state = frame.state(self.plan.image, self.plan.distortion.clone());
        match &mut self.renderer {
            Renderer::Gpu(gpu) => gpu.start(&state)?,
            Renderer::Native(_, waiting) | Renderer::Cpu(_, waiting) => waiting.push_back(state),
            Renderer::Dark(waiting) => *waiting += 1,
        }
        Ok(())
    }

    /// The oldest frame under way.
    pub(crate) fn finish(&mut self) -> Result<Option<RadianceImage>, RenderError> {
        match &mut self.renderer {
            Renderer::Gpu(gpu) => gpu.finish(),
            Renderer::Native(native, waiting) => Ok(waiting.pop_front().map(|state| native.render(&state))),
            Renderer::Cpu(cpu, waiting) => Ok(waiting.pop_front().map(|state| cpu.render(&state))),
            Renderer::Dark(waiting) => {
                let image = (*waiting > 0).then(|| self.plan.dark());
                *waiting = waiting.saturating_sub(1);
                Ok(image)
            }
        }
    }
}
