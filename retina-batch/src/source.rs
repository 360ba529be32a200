//! Frames from either renderer, several under way at a time where it allows that.

use std::collections::VecDeque;

use retina_render::{
    BodyModel, CpuRenderer, FRAMES_IN_FLIGHT, FrameState, GpuDevice, GpuRenderer, GpuWarp, Quality,
    RadianceImage, RenderError,
};
use retina_scene::SceneFrame;

use crate::{ImagePlan, Resampler};

/// Which renderer is wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum BackendChoice {
    /// The GPU's, or the CPU's where there is no adapter.
    #[default]
    Auto,
    /// The GPU's or none.
    Gpu,
    /// The CPU's.
    Cpu,
}

/// What renders.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AdapterName {
    /// `gpu` or `cpu`.
    pub backend: &'static str,
    /// The adapter; `cpu` for the CPU renderer.
    pub adapter: String,
    /// Its driver and version; the program's version for the CPU renderer.
    pub driver: String,
}

impl AdapterName {
    fn cpu() -> Self {
        Self {
            backend: "cpu",
            adapter: "cpu".into(),
            driver: format!("retina {}", env!("CARGO_PKG_VERSION")),
        }
    }

    /// The renderer that a choice would take, and, where that is not the one hoped for, why.
    ///
    /// # Errors
    /// The GPU is asked for and there is no adapter.
    pub fn of_choice(choice: BackendChoice) -> Result<(Self, Option<RenderError>), RenderError> {
        let (device, fallback) = open(choice)?;
        Ok((device.map_or_else(Self::cpu, |device| Self::of_device(&device)), fallback))
    }

    fn of_device(device: &GpuDevice) -> Self {
        Self { backend: "gpu", adapter: device.name().into(), driver: device.driver().into() }
    }
}

fn open(choice: BackendChoice) -> Result<(Option<GpuDevice>, Option<RenderError>), RenderError> {
    match choice {
        BackendChoice::Cpu => Ok((None, None)),
        BackendChoice::Gpu => Ok((Some(GpuDevice::open()?), None)),
        BackendChoice::Auto => match GpuDevice::open() {
            Ok(device) => Ok((Some(device), None)),
            Err(error) => Ok((None, Some(error))),
        },
    }
}

/// A renderer of a scene's frames by a plan.
pub(crate) struct FrameSource {
    renderer: Renderer,
    plan: ImagePlan,
    /// The resampling that is left to do on the CPU.
    pub(crate) resampler: Option<Resampler>,
    pub(crate) name: AdapterName,
}

#[allow(clippy::large_enum_variant, reason = "one value in a program")]
enum Renderer {
    Gpu(GpuRenderer),
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
            let name = AdapterName { adapter: "none".into(), ..AdapterName::cpu() };
            let source = Self { renderer: Renderer::Dark(0), plan: plan.clone(), resampler: None, name };
            return Ok((source, None));
        }
        let (device, mut fallback) = open(choice)?;
        let models = match device {
            None => models,
            Some(device) => {
                // The scene may not fit the adapter: then the CPU still needs the bodies.
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
        let cpu = CpuRenderer::new(models, quality.into(), plan.planes);
        let resampler = plan.resampling.clone().map(|(map, canvas)| Resampler::new(map, canvas));
        let renderer = Renderer::Cpu(cpu, VecDeque::new());
        Ok((Self { renderer, plan: plan.clone(), resampler, name: AdapterName::cpu() }, fallback))
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
            Renderer::Cpu(..) | Renderer::Dark(_) => 1,
        }
    }

    /// Frames started and not yet finished.
    pub(crate) fn in_flight(&self) -> usize {
        match &self.renderer {
            Renderer::Gpu(gpu) => gpu.in_flight(),
            Renderer::Cpu(_, waiting) => waiting.len(),
            Renderer::Dark(waiting) => *waiting,
        }
    }

    /// Starts a frame.
    pub(crate) fn start(&mut self, frame: &SceneFrame) -> Result<(), RenderError> {
        let state = frame.state(self.plan.image, self.plan.distortion.clone());
        match &mut self.renderer {
            Renderer::Gpu(gpu) => gpu.start(&state)?,
            Renderer::Cpu(_, waiting) => waiting.push_back(state),
            Renderer::Dark(waiting) => *waiting += 1,
        }
        Ok(())
    }

    /// The oldest frame under way.
    pub(crate) fn finish(&mut self) -> Result<Option<RadianceImage>, RenderError> {
        match &mut self.renderer {
            Renderer::Gpu(gpu) => gpu.finish(),
            Renderer::Cpu(cpu, waiting) => Ok(waiting.pop_front().map(|state| cpu.render(&state))),
            Renderer::Dark(waiting) => {
                let image = (*waiting > 0).then(|| self.plan.dark());
                *waiting = waiting.saturating_sub(1);
                Ok(image)
            }
        }
    }
}
