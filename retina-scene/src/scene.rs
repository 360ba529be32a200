//! The scene: facility or image, trajectory, bodies, and what is wanted of them.

use std::path::{Path, PathBuf};

use glam::DVec3;
use retina_files::{InputError, hash_bytes};
use retina_geometry::{Distortion, InverseDistortion, Pinhole, Setup};
use retina_model::Body;
use retina_radiometry::{Photometry, ScreenResponse};
use retina_render::{BodyModel, Quality};
use retina_screen::{PlainDisplay, Quantisation};
use retina_sky::Trajectory;
use retina_sky::ephemeris::Ephemeris;

use crate::checks;
use crate::file::{Compensation, Layer};
use crate::occult::Occulter;
use crate::{Flashes, Stars};

/// A frame's name has six digits.
const MOST_FRAMES: usize = 1_000_000;

/// A scene: facility, trajectory, bodies, and what is wanted of them. All of it has been checked.
#[derive(Debug, Clone)]
pub struct Scene {
    /// The file it was read from.
    pub file: PathBuf,
    /// The image that shows it: K_f of the facility's screen, or a camera of the scene's own.
    pub image: Pinhole,
    /// What shows it.
    pub display: Display,
    /// The frames.
    pub trajectory: Trajectory,
    /// Where Sun, Moon and planets are, wherever the trajectory does not say it.
    pub ephemeris: Ephemeris,
    /// Displayed over true radiance.
    pub radiance_scale: RadianceScale,
    /// How the facility's distortion is undone beforehand.
    pub compensation: Compensation,
    /// D, where it is undone.
    pub distortion: Option<Distortion>,
    /// The calibrated D^-1, where it is undone and the calibration has it: places points of light.
    pub inverse: Option<InverseDistortion>,
    /// The screen's measured response, where the calibration has one; otherwise the setup's power law holds.
    pub response: Option<ScreenResponse>,
    /// The bodies, in the file's order.
    pub bodies: Vec<SceneBody>,
    /// Stars and planets, where they are shown.
    pub stars: Option<Stars>,
    /// Flashes of impacts, where they are shown.
    pub flashes: Option<Flashes>,
    /// How finely a frame is sampled.
    pub quality: Quality,
    /// Beside the screen images.
    pub output: Output,
    /// For what is random.
    pub seed: u64,
    /// A frame without any body in view is meant.
    pub allow_empty_frames: bool,
    /// Every file that the frames depend on.
    pub inputs: Vec<SceneInput>,
    pub(crate) models: Vec<BodyModel>,
    pub(crate) occulters: Vec<Occulter>,
    /// Places of the listed flashes on their bodies, body axes, m.
    pub(crate) flash_sites_m: Vec<DVec3>,
}

/// What shows a scene.
#[derive(Debug, Clone)]
#[allow(clippy::large_enum_variant, reason = "one value in a scene")]
pub enum Display {
    /// The screen of a facility.
    Facility(Setup),
    /// No facility: an ordinary image.
    Plain(PlainDisplay),
}

/// What a scene is put together from, where it does not come from a `SCENE.toml`. The fields are
/// [`Scene`]'s.
#[derive(Debug)]
#[allow(missing_docs, reason = "they are Scene's")]
pub struct SceneParts {
    pub file: PathBuf,
    pub image: Pinhole,
    pub display: Display,
    pub trajectory: Trajectory,
    pub ephemeris: Ephemeris,
    pub radiance_scale: RadianceScale,
    pub compensation: Compensation,
    pub distortion: Option<Distortion>,
    pub inverse: Option<InverseDistortion>,
    pub response: Option<ScreenResponse>,
    pub bodies: Vec<BodyParts>,
    pub stars: Option<Stars>,
    pub flashes: Option<Flashes>,
    pub quality: Quality,
    pub output: Output,
    pub seed: u64,
    pub allow_empty_frames: bool,
    pub inputs: Vec<SceneInput>,
}

/// A body of [`SceneParts`].
#[derive(Debug)]
pub struct BodyParts {
    /// Its name.
    pub name: String,
    /// Its mesh, body-fixed axes, metres.
    pub shape: Body,
    /// How it scatters light.
    pub photometry: Photometry,
    /// Semi-axes of the reference ellipsoid, m; by default the sphere of the mesh's volume.
    pub reference_semi_axes_m: Option<DVec3>,
    /// Frames in which it is behind the camera are meant.
    pub may_be_behind: bool,
}

/// Displayed over true radiance; one value for a whole sequence.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum RadianceScale {
    /// The brightest pixel of the brightest frame shows just below saturation.
    Auto,
    /// This value, above 0.
    Value(f64),
}

/// What is written beside the screen images and the truth.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Output {
    /// An EXR with radiance and radiance factor; a layer asked for writes it too.
    pub exr: bool,
    /// Further layers of the EXR.
    pub layers: Vec<Layer>,
    /// How a body's light is rounded to digital counts.
    pub quantisation: Quantisation,
}

/// A body of the scene, without its mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneBody {
    /// Its name.
    pub name: String,
    /// How it scatters light.
    pub photometry: Photometry,
    /// Distance of the mesh's farthest vertex from the body's centre, m.
    pub bounding_radius_m: f64,
    /// Semi-axes of the reference sphere or ellipsoid along the body's axes, m.
    pub reference_semi_axes_m: DVec3,
    /// Frames in which it is behind the camera are meant.
    pub may_be_behind: bool,
}

impl SceneBody {
    /// Radius of the reference sphere, or of the sphere of the reference ellipsoid's volume, m.
    pub fn reference_radius_m(&self) -> f64 {
        let axes = self.reference_semi_axes_m;
        if axes.x == axes.y && axes.y == axes.z { axes.x } else { (axes.x * axes.y * axes.z).cbrt() }
    }
}

/// A file that the frames depend on.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SceneInput {
    /// What it is to the scene: `scene`, `setup`, `trajectory`, `calibration`, `body moon`,
    /// `ephemeris 1: de421.bsp`.
    pub role: String,
    /// BLAKE3 of its content.
    pub hash: String,
}

impl Scene {
    /// Puts a scene together and checks every frame's geometry.
    ///
    /// # Errors
    /// Too many frames, a body without extent, a camera inside a body, ...
    pub fn assemble(parts: SceneParts) -> Result<Self, InputError> {
        let trajectory = parts.trajectory;
        if trajectory.frames.len() > MOST_FRAMES {
            return Err(InputError::new(&trajectory.source, "the sequence is too long")
                .found(format!("{} frames", trajectory.frames.len()))
                .expected(format!("at most {MOST_FRAMES}"))
                .help("part it into several scenes"));
        }
        let (mut bodies, mut models) = (Vec::new(), Vec::new());
        for body in parts.bodies {
            let (body, model) = assemble_body(&parts.file, body)?;
            bodies.push(body);
            models.push(model);
        }
        let mut scene = Self {
            file: parts.file,
            image: parts.image,
            display: parts.display,
            trajectory,
            ephemeris: parts.ephemeris,
            radiance_scale: parts.radiance_scale,
            compensation: parts.compensation,
            distortion: parts.distortion,
            inverse: parts.inverse,
            response: parts.response,
            bodies,
            quality: parts.quality,
            output: parts.output,
            seed: parts.seed,
            allow_empty_frames: parts.allow_empty_frames,
            inputs: parts.inputs,
            models,
            stars: parts.stars,
            flashes: parts.flashes,
            occulters: Vec::new(),
            flash_sites_m: Vec::new(),
        };
        scene.find_occulters();
        scene.find_flash_sites()?;
        checks::all_frames(&scene)?;
        Ok(scene)
    }

    /// Number of frames of the sequence.
    pub fn frame_count(&self) -> usize {
        self.trajectory.frames.len()
    }

    /// The bodies' meshes and photometry, as a renderer takes them; empty after
    /// [`Scene::take_models`].
    pub fn models(&self) -> &[BodyModel] {
        &self.models
    }

    /// Moves the meshes out, so that they are held once; nothing else of the scene needs them.
    pub fn take_models(&mut self) -> Vec<BodyModel> {
        std::mem::take(&mut self.models)
    }

    /// One hash over all inputs and their roles: two scenes of the same hash give the same frames.
    pub fn input_hash(&self) -> String {
        let lines: Vec<String> =
            self.inputs.iter().map(|input| format!("{}\t{}\n", input.role, input.hash)).collect();
        hash_bytes(lines.concat().as_bytes())
    }
}

/// `file` is whom an error blames.
fn assemble_body(file: &Path, parts: BodyParts) -> Result<(SceneBody, BodyModel), InputError> {
    let BodyParts { name, shape, photometry, reference_semi_axes_m, may_be_behind } = parts;
    let place = format!("body `{name}`");
    let bounding_radius_m = shape.bounding_radius_m();
    if !(bounding_radius_m.is_finite() && bounding_radius_m > 0.0) {
        return Err(InputError::new(file, "the mesh has no extent")
            .at(place)
            .found(format!("a radius of {bounding_radius_m} m"))
            .expected("metres above 0"));
    }
    let reference_semi_axes_m =
        reference_semi_axes_m.unwrap_or_else(|| DVec3::splat(shape.volume_equivalent_radius_m()));
    if !(reference_semi_axes_m.is_finite() && reference_semi_axes_m.min_element() > 0.0) {
        return Err(InputError::new(file, "the reference sphere or ellipsoid has no extent")
            .at(place)
            .found(format!("{reference_semi_axes_m} m"))
            .expected("metres above 0")
            .help("set reference_radius_m, or reference_semi_axes_m = [a, b, c]"));
    }
    let largest_m = reference_semi_axes_m.max_element();
    if !(0.1 * bounding_radius_m..=10.0 * bounding_radius_m).contains(&largest_m) {
        return Err(InputError::new(file, "the reference sphere or ellipsoid is not of the mesh's size")
            .at(place)
            .found(format!("a largest semi-axis of {largest_m:.6e} m"))
            .expected(format!("about the mesh's largest radius, {bounding_radius_m:.6e} m"))
            .help(
                "check reference_radius_m or reference_semi_axes_m and the model's unit of length (metres)",
            ));
    }
    let body =
        SceneBody { name: name.clone(), photometry, bounding_radius_m, reference_semi_axes_m, may_be_behind };
    Ok((body, BodyModel { name, shape, photometry }))
}
