//! `SCENE.toml` and everything it names, read and resolved.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::DVec3;
use retina_files::{InputError, hash_bytes, hash_file, parse_schema, read_text};
use retina_formats::{Calibration, CalibrationFile, MeasuredResponse};
use retina_geometry::Setup;
use retina_model::{external_files, load_body};
use retina_radiometry::ScreenResponse;
use retina_render::Quality;
use retina_screen::Quantisation;
use retina_sky::Trajectory;
use retina_sky::catalogue::StarCatalogue;
use retina_sky::ephemeris::Ephemeris;

use crate::file::{BodyTable, Compensation, QualityName, QuantisationName, ScaleKey, SceneFile, StarsTable};
use crate::read_flashes::read_flashes;
use crate::scene::{BodyParts, Display, Output, RadianceScale, Scene, SceneInput, SceneParts};
use crate::{Stars, sequence};

/// Mean radius of the Moon's reference sphere, m (IAU).
const MOON_RADIUS_M: f64 = 1_737_400.0;

/// What a program gives in the place of what a scene's file names.
#[derive(Debug, Clone, Default)]
pub struct Given {
    /// The facility, in the place of the key `setup`.
    pub setup: Option<Setup>,
    /// The trajectory's table as text, in the place of the key `trajectory`.
    pub trajectory_csv: Option<String>,
}

impl Scene {
    /// Reads a scene and everything it names, and checks every frame's geometry.
    ///
    /// # Errors
    /// Whatever does not fit, in whichever of the files: an unknown key, a model that does not
    /// load, a trajectory with a bad cell, a camera inside a body, ...
    pub fn read(path: impl AsRef<Path>) -> Result<Self, InputError> {
        Self::read_with(path, Given::default())
    }

    /// As [`Scene::read`], with what a program gives in the place of what the file names.
    ///
    /// # Errors
    /// As [`Scene::read`].
    pub fn read_with(path: impl AsRef<Path>, given: Given) -> Result<Self, InputError> {
        let path = path.as_ref();
        Self::parse(path, &read_text(path)?, given)
    }

    /// As [`Scene::read_with`], from text already in memory; `path` names it in errors, and paths in it are relative to
    /// `path`.
    ///
    /// # Errors
    /// As [`Scene::read`].
    pub fn parse(path: &Path, text: &str, given: Given) -> Result<Self, InputError> {
        let file: SceneFile = parse_schema(path, text, "retina.scene/1", "a scene")?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let mut inputs = vec![SceneInput { role: "scene".into(), hash: hash_bytes(text.as_bytes()) }];
        let mut input = |role: String, hash: String| inputs.push(SceneInput { role, hash });

        let setup = match given.setup {
            Some(setup) => {
                input("setup".into(), hash_bytes(format!("{setup:?}").as_bytes()));
                setup
            }
            None => {
                let setup =
                    Setup::named(&file.setup, folder).map_err(|error| error.named_by(path, "setup"))?;
                let hash = setup.hash_of_named(&file.setup, folder)?;
                input("setup".into(), hash);
                setup
            }
        };
        let (calibration, response) = calibration(path, &file, &setup, &mut input)?;
        let (distortion, inverse) = match calibration {
            Some(calibration) => (Some(calibration.distortion), calibration.inverse),
            None => (None, None),
        };
        check_names(path, &file.body)?;
        let names: Vec<String> = file.body.iter().map(|body| body.name.clone()).collect();
        let kernels: Vec<PathBuf> = file.ephemeris.kernels.iter().map(|own| folder.join(own)).collect();
        let ephemeris =
            Ephemeris::read(&kernels).map_err(|error| error.named_by(path, "ephemeris.kernels"))?;
        let (trajectory, hash) = match given.trajectory_csv {
            Some(text) => {
                (Trajectory::parse(Path::new("<trajectory>"), &text, &names)?, hash_bytes(text.as_bytes()))
            }
            None => sequence::trajectory(path, &file, &names, &setup, &ephemeris)?,
        };
        input("trajectory".into(), hash);
        for (at, kernel) in ephemeris.kernel_files().iter().enumerate() {
            input(format!("ephemeris {}: {}", at + 1, kernel.name()), kernel.hash.clone());
        }

        let mut bodies = Vec::new();
        for table in &file.body {
            bodies.push(read_body(path, folder, table, &ephemeris)?);
            let model_file = folder.join(&table.model);
            input(format!("body {}", table.name), hash_file(&model_file)?);
            for external in external_files(&model_file)? {
                let name = external.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
                input(format!("body {}: {name}", table.name), hash_file(&external)?);
            }
        }
        let stars =
            file.stars.as_ref().map(|table| read_stars(path, folder, table, &mut input)).transpose()?;
        let flashes =
            file.flashes.as_ref().map(|table| read_flashes(path, table, &names, &mut input)).transpose()?;
        let layers = file.output.layers.clone();
        Self::assemble(SceneParts {
            file: path.to_path_buf(),
            image: setup.facility_pinhole(),
            display: Display::Facility(setup),
            trajectory,
            ephemeris,
            radiance_scale: match file.radiance_scale {
                ScaleKey::Auto => RadianceScale::Auto,
                ScaleKey::Value(value) => RadianceScale::Value(value),
            },
            compensation: file.compensation.mode,
            distortion,
            inverse,
            response,
            bodies,
            stars,
            flashes,
            quality: match file.render.quality {
                QualityName::Draft => Quality::Draft,
                QualityName::Default => Quality::Default,
                QualityName::Best => Quality::Best,
            },
            output: Output {
                exr: file.output.radiance_exr || !layers.is_empty(),
                layers,
                quantisation: match file.output.quantisation {
                    QuantisationName::Nearest => Quantisation::Nearest,
                    QuantisationName::Diffused => Quantisation::Diffused,
                },
            },
            seed: file.seed,
            allow_empty_frames: file.allow_empty_frames,
            inputs,
        })
    }
}

impl Scene {
    /// The scene with another compensation by another calibration, in the place of what its file says; the screen's
    /// response is the calibration's where it has one.
    ///
    /// # Errors
    /// It is no facility's, or the calibration is not of its setup.
    pub fn with_compensation(mut self, mode: Compensation, calibration: &Path) -> Result<Self, InputError> {
        let Display::Facility(setup) = &self.display else {
            return Err(InputError::new(&self.file, "shows no facility: there is nothing to compensate"));
        };
        let read = Calibration::read(calibration, setup)?;
        self.response = read.response.map(|measured| measured.curve);
        (self.distortion, self.inverse) = match mode {
            Compensation::None => (None, None),
            _ => (Some(read.distortion), read.inverse),
        };
        self.compensation = mode;
        self.inputs.retain(|input| input.role != "calibration");
        self.inputs.push(SceneInput { role: "calibration".into(), hash: hash_file(calibration)? });
        let mode = hash_bytes(mode.name().as_bytes());
        self.inputs.push(SceneInput { role: "compensation in the place of the scene's".into(), hash: mode });
        Ok(self)
    }
}

/// Stars of these magnitudes exist; what a screen shows of them is another matter.
const FAINTEST_MAGNITUDES: std::ops::RangeInclusive<f64> = -30.0..=30.0;

fn read_stars(
    path: &Path,
    folder: &Path,
    table: &StarsTable,
    input: &mut impl FnMut(String, String),
) -> Result<Stars, InputError> {
    if !FAINTEST_MAGNITUDES.contains(&table.faintest_magnitude) {
        return Err(InputError::new(path, "the faintest magnitude does not fit")
            .at("key `stars.faintest_magnitude`")
            .found(table.faintest_magnitude)
            .expected("a magnitude, 8.25 for instance"));
    }
    let catalogue = match &table.catalogue {
        None => None,
        Some(file) => {
            let file = folder.join(file);
            let catalogue =
                StarCatalogue::read(&file).map_err(|error| error.named_by(path, "stars.catalogue"))?;
            input("catalogue".into(), hash_file(&file)?);
            Some(Arc::new(catalogue))
        }
    };
    Ok(Stars { catalogue, faintest_magnitude: table.faintest_magnitude, planets: table.planets })
}

/// The calibration, where the scene compensates, and the screen's response, where it was measured. A calibration that
/// is named is read in any case; one without D does where nothing is compensated.
fn calibration(
    path: &Path,
    file: &SceneFile,
    setup: &Setup,
    input: &mut impl FnMut(String, String),
) -> Result<(Option<Calibration>, Option<ScreenResponse>), InputError> {
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
        return Ok((None, None));
    };
    let named = |error: InputError| error.named_by(path, "compensation.calibration");
    let contents = CalibrationFile::read(&calibration, setup).map_err(named)?;
    let response = MeasuredResponse::of_file(&contents, &calibration, setup).map_err(named)?;
    let response = response.map(|measured| measured.curve);
    input("calibration".into(), hash_file(&calibration)?);
    if response.is_some() && !compensates {
        return Ok((None, response));
    }
    let read = Calibration::of_file(contents, &calibration, setup).map_err(named)?;
    Ok((compensates.then_some(read), response))
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

fn read_body(
    path: &Path,
    folder: &Path,
    table: &BodyTable,
    ephemeris: &Ephemeris,
) -> Result<BodyParts, InputError> {
    let place = format!("body `{}`", table.name);
    let photometry = table.photometry.resolve(path, &place)?;
    let mut shape = load_body(&folder.join(&table.model)).map_err(|error| error.named_by(path, "model"))?;
    table.shading.apply(&mut shape);
    let reference_semi_axes_m = match (table.reference_radius_m, table.reference_semi_axes_m) {
        (Some(_), Some(_)) => {
            return Err(InputError::new(path, "the reference body is given twice")
                .at(place)
                .found("`reference_radius_m` and `reference_semi_axes_m`")
                .expected("one of the two"));
        }
        (Some(radius_m), None) => Some(DVec3::splat(radius_m)),
        (None, Some(axes_m)) => Some(DVec3::from_array(axes_m)),
        (None, None) => ephemeris
            .semi_axes_m(&table.name)
            .or_else(|| (table.name == "moon").then_some(DVec3::splat(MOON_RADIUS_M))),
    };
    Ok(BodyParts {
        name: table.name.clone(),
        shape,
        photometry,
        reference_semi_axes_m,
        may_be_behind: table.may_be_behind,
    })
}
