//! Frames in memory: what a run makes of a frame, without a folder.

use retina_files::InputError;
use retina_render::{Quality, RenderError};
use retina_scene::{Display, FrameChecks, RadianceScale, Scene, SceneFrame};
use retina_sky::{FramePose, Trajectory};
use serde_json::Value;

use crate::picture::{Picture, PictureSamples, PointSources};
use crate::scale::{automatic_scale, brightest_candidates};
use crate::source::FrameSource;
use crate::{AdapterName, BackendChoice, BatchError, ImagePlan};

/// A renderer that holds a scene and makes its frames, or frames of other poses, whenever it is asked.
pub struct FrameMaker {
    scene: Scene,
    checks: FrameChecks,
    plan: ImagePlan,
    picture: Picture,
    source: FrameSource,
    /// Displayed over true radiance; `None`: each frame's brightest pixel shows just below saturation.
    radiance_scale: Option<f64>,
}

/// How radiance is scaled to what the screen can show.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Scaling {
    /// As the scene says: one value for its whole sequence.
    OfScene,
    /// This value, displayed over true radiance.
    Value(f64),
    /// Each frame by itself: its brightest pixel shows just below saturation.
    OfFrame,
}

/// A frame, as a run would write it.
pub struct MadeFrame {
    /// Where everything is.
    pub frame: SceneFrame,
    /// Width and height of its images, px.
    pub size_px: [u32; 2],
    /// The screen image: the digital count of each pixel, equal in the three channels, row by row.
    pub counts: Vec<u8>,
    /// True radiance of each of the screen's pixels, before stars and flashes, W m^-2 sr^-1 nm^-1 at 550 nm.
    pub radiance: Vec<f32>,
    /// The layers that the scene asks for, with the names and values of an EXR's channels.
    pub layers: Vec<(String, Vec<f32>)>,
    /// Its ground truth, schema `retina.truth/1`.
    pub truth: Value,
    /// Displayed over true radiance.
    pub radiance_scale: f64,
    /// Pixels brighter than the screen can show.
    pub saturated_px: u64,
    /// Whether its PNG is filtered, for [`screen_png`](crate::screen_png).
    pub png_filtered: bool,
}

impl FrameMaker {
    /// Opens the renderer. Gives also why the GPU is not used where the choice was left open.
    ///
    /// # Errors
    /// The scene shows no facility's screen, the renderer cannot be opened, or the scene's scale is automatic and no
    /// frame shows a lit surface.
    pub fn open(
        scene: Scene,
        backend: BackendChoice,
        quality: Option<Quality>,
        scaling: Scaling,
    ) -> Result<(Self, Option<RenderError>), BatchError> {
        if !matches!(scene.display, Display::Facility(_)) {
            return Err(InputError::new(&scene.file, "shows no facility, so that it has no digital counts")
                .expected("a scene with a setup")
                .into());
        }
        let (plan, picture, checks) = (ImagePlan::of(&scene), Picture::of(&scene), FrameChecks::of(&scene));
        let quality = quality.unwrap_or(scene.quality);
        let (mut source, fallback) = FrameSource::open(backend, scene.models().to_vec(), quality, &plan)?;
        let radiance_scale = match (scaling, scene.radiance_scale) {
            (Scaling::Value(value), _) | (Scaling::OfScene, RadianceScale::Value(value)) => Some(value),
            // Stars and planets alone are shown as bright as they are.
            (_, _) if scene.bodies.is_empty() => Some(1.0),
            (Scaling::OfFrame, _) => None,
            (Scaling::OfScene, RadianceScale::Auto) => {
                let candidates = brightest_candidates(&scene)?;
                Some(automatic_scale(&scene, &plan, &picture, &mut source, &candidates)?)
            }
        };
        Ok((Self { scene, checks, plan, picture, source, radiance_scale }, fallback))
    }

    /// The scene.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// What renders.
    pub fn name(&self) -> &AdapterName {
        &self.source.name
    }

    /// Displayed over true radiance; `None` where each frame has its own.
    pub fn radiance_scale(&self) -> Option<f64> {
        self.radiance_scale
    }

    /// Makes frame `index` of the scene.
    ///
    /// # Errors
    /// There is no such frame, the renderer fails, or it gives values that are not finite.
    pub fn frame(&mut self, index: usize) -> Result<MadeFrame, BatchError> {
        let frame = self.scene.frame(index)?;
        self.make(frame)
    }

    /// Makes a frame of a pose of one's own, in the place of the scene's trajectory; `name` names it in errors.
    ///
    /// # Errors
    /// As [`Self::frame`], and where the camera or the Sun is inside a body, or no body is in view.
    pub fn pose(&mut self, name: &str, pose: FramePose) -> Result<MadeFrame, BatchError> {
        self.scene.trajectory = Trajectory::new(name.as_ref(), vec![pose]);
        let frame = self.scene.frame(0)?;
        self.checks.check(&self.scene, &frame)?;
        self.make(frame)
    }

    fn make(&mut self, frame: SceneFrame) -> Result<MadeFrame, BatchError> {
        let scene = &self.scene;
        self.source.start(&frame)?;
        let Some(image) = self.source.finish()? else {
            return Err(BatchError::encode(format!("frame {}", frame.index), &"the renderer gave no image"));
        };
        let mut developed = self.plan.develop(&image, self.source.resampler.as_ref());
        let brightest = || developed.light.iter().fold(0f32, |most, &value| most.max(value));
        let radiance_scale = match (self.radiance_scale, brightest()) {
            (Some(scale), _) => scale,
            (None, brightest) if brightest > 0.0 => self.picture.scale_for_brightest(f64::from(brightest)),
            // Nothing is lit: any scale shows the same.
            (None, _) => 1.0,
        };
        let sources = PointSources { sky: scene.sky(&frame)?, flashes: scene.flashes_of(&frame) };
        let painted = self.picture.paint(frame.index, &developed, sources, radiance_scale)?;
        let truth = scene.truth(&frame, radiance_scale, &painted.stars, &painted.flashes, painted.body);
        let PictureSamples::Counts(counts) = painted.samples else {
            return Err(BatchError::encode("the frame", &"it is no screen image"));
        };
        let size_px = [scene.image.width_px, scene.image.height_px];
        developed.light.resize(counts.len(), 0.0);
        Ok(MadeFrame {
            frame,
            size_px,
            counts,
            radiance: developed.light,
            layers: developed.channels.map_or_else(Vec::new, |channels| channels.channels),
            truth,
            radiance_scale,
            saturated_px: painted.saturated_px,
            png_filtered: painted.filtered,
        })
    }
}
