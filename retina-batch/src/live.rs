//! Single frames on demand, from a renderer that stays open.

use retina_files::InputError;
use retina_render::{Quality, RenderError};
use retina_scene::{RadianceScale, Scene, SceneFrame};

use crate::picture::{Picture, PointSources};
use crate::source::FrameSource;
use crate::{AdapterName, BackendChoice, BatchError, ImagePlan};

/// A renderer that holds a scene's bodies and makes a frame's image whenever it is asked.
pub struct LiveRenderer {
    source: FrameSource,
    plan: ImagePlan,
    picture: Picture,
    radiance_scale: f64,
}

impl LiveRenderer {
    /// Opens the renderer. Gives also why the GPU is not used where the choice was left open.
    ///
    /// # Errors
    /// The scene's radiance scale is automatic, which takes a sequence; it has stars; the renderer
    /// cannot be opened.
    pub fn open(
        scene: &Scene,
        backend: BackendChoice,
        quality: Quality,
    ) -> Result<(Self, Option<RenderError>), BatchError> {
        let RadianceScale::Value(radiance_scale) = scene.radiance_scale else {
            return Err(InputError::new(&scene.file, "single poses have no brightest frame to scale by")
                .at("radiance scale")
                .found("automatic")
                .expected("a number above 0")
                .help("give --radiance-scale, such as the one that `retina render` states for a sequence")
                .into());
        };
        if scene.stars.is_some() {
            return Err(InputError::new(
                &scene.file,
                "single poses have no epoch and no barycentric place to see stars from",
            )
            .at("table `stars`")
            .help("remove the table [stars]")
            .into());
        }
        let plan = ImagePlan::of(scene);
        let (source, fallback) = FrameSource::open(backend, scene.models().to_vec(), quality, &plan)?;
        Ok((Self { source, picture: Picture::of(scene), plan, radiance_scale }, fallback))
    }

    /// What renders.
    pub fn name(&self) -> &AdapterName {
        &self.source.name
    }

    /// The image of a frame as a PNG, the bytes that a run writes for it.
    ///
    /// # Errors
    /// The renderer fails or gives values that are not finite.
    pub fn png(&mut self, frame: &SceneFrame) -> Result<Vec<u8>, BatchError> {
        self.source.start(frame)?;
        let Some(image) = self.source.finish()? else {
            return Err(BatchError::encode(format!("frame {}", frame.index), &"the renderer gave no image"));
        };
        let developed = self.plan.develop(&image, self.source.resampler.as_ref());
        let painted =
            self.picture.paint(frame.index, &developed, PointSources::default(), self.radiance_scale)?;
        self.picture.png(frame.index, &painted.samples, painted.filtered)
    }
}
