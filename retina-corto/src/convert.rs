//! A scenario as a scene that can be rendered.

use std::path::{Path, PathBuf};

use retina_files::{InputError, hash_file};
use retina_formats::Calibration;
use retina_geometry::Setup;
use retina_radiometry::ScreenResponse;
use retina_render::Quality;
use retina_scene::{Compensation, Display, Output, RadianceScale, Scene, SceneInput, SceneParts};
use retina_sky::Trajectory;
use retina_sky::ephemeris::Ephemeris;

use crate::scenario::{Scenario, load_bodies};

/// What shows a scenario.
#[derive(Debug, Clone, Default)]
pub enum Shown {
    /// CORTO's own camera, as Blender's image.
    #[default]
    Camera,
    /// The screen of a facility.
    Facility {
        /// The setup's file.
        setup: PathBuf,
        /// How its distortion is undone beforehand, with the calibration that the setup names.
        compensation: Compensation,
    },
}

impl Scenario {
    /// Loads the bodies and puts the scene together; `with_frames` says whether the poses of the
    /// geometry file become its frames (else it has none, and poses come one by one). Gives also
    /// what was replaced or not read, a sentence each.
    ///
    /// # Errors
    /// A file that cannot be loaded or does not fit, a camera inside a body.
    pub fn scene(&self, shown: &Shown, with_frames: bool) -> Result<(Scene, Vec<String>), InputError> {
        let mut notes = Vec::new();
        let mut inputs = self.inputs.clone();
        let (image, display, radiance_scale, compensation, (calibration, response)) = match shown {
            Shown::Camera => {
                let display = Display::Plain(self.settings.display());
                (
                    self.settings.pinhole(),
                    display,
                    RadianceScale::Value(1.0),
                    Compensation::None,
                    (None, None),
                )
            }
            Shown::Facility { setup: file, compensation } => {
                let setup = Setup::named(file, Path::new(""))?;
                let hash = setup.hash_of_named(file, Path::new(""))?;
                inputs.push(SceneInput { role: "setup".into(), hash });
                let calibration = calibration(file, &setup, *compensation, &mut inputs)?;
                notes.push(
                    "the setup takes the place of the scene's camera: fov, resolution, exposure, sensor, bits and view \
                     transform have no effect"
                        .into(),
                );
                let image = setup.facility_pinhole();
                (image, Display::Facility(setup), RadianceScale::Auto, *compensation, calibration)
            }
        };
        let bodies = load_bodies(self, &mut notes)?;
        let frames = if with_frames {
            self.poses.iter().map(|pose| self.world.frame(pose)).collect()
        } else {
            Vec::new()
        };
        let scene = Scene::assemble(SceneParts {
            file: self.scene_file.clone(),
            image,
            display,
            trajectory: Trajectory::new(&self.geometry_file, frames),
            ephemeris: Ephemeris::analytic(),
            radiance_scale,
            compensation,
            inverse: calibration.as_ref().and_then(|calibration| calibration.inverse.clone()),
            distortion: calibration.map(|calibration| calibration.distortion),
            response,
            bodies,
            stars: None,
            flashes: None,
            quality: Quality::Default,
            output: Output::default(),
            seed: 0,
            // Blender renders a frame without a body as a black image, and sequences have them.
            allow_empty_frames: true,
            inputs,
        });
        Ok((scene.map_err(|error| in_blender_units(error, &self.geometry_file))?, notes))
    }
}

/// An error about a frame's geometry names what CORTO's user has set.
pub(crate) fn in_blender_units(error: InputError, geometry_file: &Path) -> InputError {
    if error.file != geometry_file {
        return error;
    }
    error.help(
        "check the positions (Blender units), and set_scale and scale_m_per_bu in the sidecar: lengths in this message \
         are metres",
    )
}

/// The calibration and the screen's measured response, where the distortion is compensated.
fn calibration(
    file: &Path,
    setup: &Setup,
    compensation: Compensation,
    inputs: &mut Vec<SceneInput>,
) -> Result<(Option<Calibration>, Option<ScreenResponse>), InputError> {
    if compensation == Compensation::None {
        return Ok((None, None));
    }
    let Some(calibration) = setup.calibration_path() else {
        return Err(InputError::new(file, "there is no calibration to compensate with")
            .expected("a setup that names one")
            .help("leave --compensation out, or name a calibration in the setup"));
    };
    inputs.push(SceneInput { role: "calibration".into(), hash: hash_file(&calibration)? });
    let read = Calibration::read(&calibration, setup)?;
    let response = read.response.as_ref().map(|measured| measured.curve.clone());
    Ok((Some(read), response))
}
