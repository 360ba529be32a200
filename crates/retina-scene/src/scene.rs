//! `SCENE.toml` and everything it names, read and resolved.

use std::path::{Path, PathBuf};

use glam::DVec3;
use retina_files::{InputError, hash_bytes, hash_file, parse_toml, read_text};
use retina_geometry::{Calibration, Distortion, Setup};
use retina_model::{external_files, load_body};
use retina_radiometry::Photometry;
use retina_render::{BodyModel, Quality};
use retina_sky::Trajectory;

use crate::checks;
use crate::file::{BodyTable, Compensation, Layer, QualityName, ScaleKey, SceneFile, Shading};
use crate::photometry::photometry;
use crate::sequence;

/// Mean radius of the Moon's reference sphere, m (IAU).
const MOON_RADIUS_M: f64 = 1_737_400.0;
/// A frame's name has six digits.
const MOST_FRAMES: usize = 1_000_000;

/// A scene: facility, trajectory, bodies, and what is wanted of them. All of it has been checked.
#[derive(Debug, Clone)]
pub struct Scene {
    /// The file it was read from.
    pub file: PathBuf,
    /// The facility.
    pub setup: Setup,
    /// The frames.
    pub trajectory: Trajectory,
    /// Displayed over true radiance.
    pub radiance_scale: RadianceScale,
    /// How the facility's distortion is undone beforehand.
    pub compensation: Compensation,
    /// D, where it is undone.
    pub distortion: Option<Distortion>,
    /// The bodies, in the file's order.
    pub bodies: Vec<SceneBody>,
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
    /// What it is to the scene: `scene`, `setup`, `trajectory`, `calibration`, `body moon`.
    pub role: String,
    /// BLAKE3 of its content.
    pub hash: String,
}

impl Scene {
    /// Reads a scene and everything it names, and checks every frame's geometry.
    ///
    /// # Errors
    /// Whatever does not fit, in whichever of the files: an unknown key, a model that does not
    /// load, a trajectory with a bad cell, a camera inside a body, ...
    pub fn read(path: impl AsRef<Path>) -> Result<Self, InputError> {
        let path = path.as_ref();
        let text = read_text(path)?;
        let file: SceneFile = parse_toml(path, &text)?;
        if file.schema != "retina.scene/1" {
            return Err(InputError::new(path, "is not a scene")
                .at("key `schema`")
                .found(format!("`{}`", file.schema))
                .expected("`retina.scene/1`"));
        }
        if file.stars.is_some() {
            return Err(InputError::new(path, "this version draws no stars")
                .at("table `stars`")
                .help("remove the table [stars]; bodies alone can be rendered"));
        }
        let folder = path.parent().unwrap_or(Path::new(""));
        let mut inputs = vec![SceneInput { role: "scene".into(), hash: hash_bytes(text.as_bytes()) }];
        let mut input = |role: String, hash: String| inputs.push(SceneInput { role, hash });

        let setup_file = folder.join(&file.setup);
        let setup = Setup::read(&setup_file)?;
        input("setup".into(), hash_file(&setup_file)?);
        let distortion = distortion(path, &file, &setup, &mut input)?;
        check_names(path, &file.body)?;
        let names: Vec<String> = file.body.iter().map(|body| body.name.clone()).collect();
        let (trajectory, hash) = sequence::trajectory(path, &file.trajectory, &names)?;
        input("trajectory".into(), hash);
        if trajectory.frames.len() > MOST_FRAMES {
            return Err(InputError::new(&trajectory.source, "the sequence is too long")
                .found(format!("{} frames", trajectory.frames.len()))
                .expected(format!("at most {MOST_FRAMES}"))
                .help("part it into several scenes"));
        }

        let (mut bodies, mut models) = (Vec::new(), Vec::new());
        for table in &file.body {
            let (body, model) = read_body(path, folder, table)?;
            let model_file = folder.join(&table.model);
            input(format!("body {}", table.name), hash_file(&model_file)?);
            for external in external_files(&model_file)? {
                let name = external.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
                input(format!("body {}: {name}", table.name), hash_file(&external)?);
            }
            bodies.push(body);
            models.push(model);
        }
        let layers = file.output.layers.clone();
        let scene = Self {
            file: path.to_path_buf(),
            setup,
            trajectory,
            radiance_scale: match file.radiance_scale {
                ScaleKey::Auto => RadianceScale::Auto,
                ScaleKey::Value(value) => RadianceScale::Value(value),
            },
            compensation: file.compensation.mode,
            distortion,
            bodies,
            quality: match file.render.quality {
                QualityName::Draft => Quality::Draft,
                QualityName::Default => Quality::Default,
                QualityName::Best => Quality::Best,
            },
            output: Output { exr: file.output.radiance_exr || !layers.is_empty(), layers },
            seed: file.seed,
            allow_empty_frames: file.allow_empty_frames,
            inputs,
            models,
        };
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

/// D, where the scene compensates; a calibration that is named is read in any case.
fn distortion(
    path: &Path,
    file: &SceneFile,
    setup: &Setup,
    input: &mut impl FnMut(String, String),
) -> Result<Option<Distortion>, InputError> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let table = &file.compensation;
    let own = table.calibration.as_ref().map(|calibration| folder.join(calibration));
    let compensates = table.mode != Compensation::None;
    let Some(calibration) = own.or_else(|| setup.calibration_path().filter(|_| compensates)) else {
        if compensates {
            return Err(InputError::new(path, "there is no calibration to compensate with")
                .at("table `compensation`")
                .expected("a key `calibration`, or a setup that names one")
                .help(
                    "add calibration = \"calibration.toml\" below [compensation], or set mode = \"none\"",
                ));
        }
        return Ok(None);
    };
    let read = Calibration::read(&calibration, setup)?;
    input("calibration".into(), hash_file(&calibration)?);
    Ok(compensates.then_some(read.distortion))
}

fn check_names(path: &Path, bodies: &[BodyTable]) -> Result<(), InputError> {
    for (i, body) in bodies.iter().enumerate() {
        let place = format!("body {}, key `name`", i + 1);
        let simple = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
        if body.name.is_empty() || !body.name.chars().all(simple) {
            return Err(InputError::new(path, "the name does not do for columns and keys")
                .at(place)
                .found(format!("`{}`", body.name))
                .expected("letters, digits, `_` and `-`"));
        }
        if ["camera", "sun"].contains(&body.name.as_str()) {
            return Err(InputError::new(path, "the name is the trajectory's own")
                .at(place)
                .found(format!("`{}`", body.name))
                .help("give the body another name"));
        }
        if bodies[..i].iter().any(|other| other.name == body.name) {
            return Err(InputError::new(path, format!("two bodies are called `{}`", body.name)).at(place));
        }
    }
    Ok(())
}

fn read_body(path: &Path, folder: &Path, table: &BodyTable) -> Result<(SceneBody, BodyModel), InputError> {
    let place = format!("body `{}`", table.name);
    let photometry = photometry(path, &place, &table.photometry)?;
    let model_file = folder.join(&table.model);
    let mut shape = load_body(&model_file)?;
    match table.shading {
        Shading::Auto => {}
        Shading::Smooth => shape.smooth_normals(),
        Shading::Flat => shape.surfaces.iter_mut().for_each(|surface| surface.flat = true),
    }
    let bounding_radius_m = shape.bounding_radius_m();
    if !(bounding_radius_m.is_finite() && bounding_radius_m > 0.0) {
        return Err(
            InputError::new(&model_file, "the mesh has no extent").found(format!("{bounding_radius_m} m"))
        );
    }
    let reference_semi_axes_m = match (table.reference_radius_m, table.reference_semi_axes_m) {
        (Some(_), Some(_)) => {
            return Err(InputError::new(path, "the reference body is given twice")
                .at(place)
                .found("`reference_radius_m` and `reference_semi_axes_m`")
                .expected("one of the two"));
        }
        (Some(radius_m), None) => DVec3::splat(radius_m),
        (None, Some(axes_m)) => DVec3::from_array(axes_m),
        (None, None) if table.name == "moon" => DVec3::splat(MOON_RADIUS_M),
        (None, None) => DVec3::splat(shape.volume_equivalent_radius_m()),
    };
    if !(reference_semi_axes_m.is_finite() && reference_semi_axes_m.min_element() > 0.0) {
        return Err(InputError::new(path, "the reference sphere or ellipsoid has no extent")
            .at(place)
            .found(format!("{reference_semi_axes_m} m"))
            .expected("metres above 0")
            .help("set reference_radius_m, or reference_semi_axes_m = [a, b, c]"));
    }
    let body = SceneBody {
        name: table.name.clone(),
        photometry,
        bounding_radius_m,
        reference_semi_axes_m,
        may_be_behind: table.may_be_behind,
    };
    Ok((body, BodyModel { name: table.name.clone(), shape, photometry }))
}
