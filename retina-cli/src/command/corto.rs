//! What `retina render` and `retina serve` take of CORTO's scenarios.

use std::path::{Path, PathBuf};

use retina_corto::{Products, Scenario, Shown, parse_products};
use retina_scene::{Compensation, Scene};

use crate::failure::Failure;
use crate::output::tell;

#[derive(clap::Args)]
pub(crate) struct CortoArguments {
    /// CORTO scenario folder (scene/, geometry/, body/) to use instead of a scene.
    #[arg(long, value_name = "SCENARIO_DIR", conflicts_with = "scene")]
    corto: Option<PathBuf>,
    /// Sidecar file, schema retina.corto-sidecar/1 [default: the folder's retina.toml].
    ///
    /// It holds what CORTO keeps in its scripts. Without one, the values are guessed, and each
    /// guess is printed.
    #[arg(long, requires = "corto", value_name = "FILE")]
    sidecar: Option<PathBuf>,
    /// Facility whose screen shows the scenario, instead of CORTO's camera.
    #[arg(long, requires = "corto", value_name = "FILE")]
    setup: Option<PathBuf>,
    /// How the facility's distortion is compensated in the screen image.
    #[arg(long, requires = "setup", value_enum, default_value_t = CompensationName::None)]
    compensation: CompensationName,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum CompensationName {
    /// No compensation.
    None,
    /// Render an undistorted image and resample it.
    Resample,
    /// Render along each pixel's distorted line of sight.
    Direct,
}

impl CortoArguments {
    /// `--corto`.
    pub(crate) fn folder(&self) -> Option<&Path> {
        self.corto.as_deref()
    }

    /// Reads the scenario and tells what was guessed.
    pub(crate) fn scenario(&self, folder: &Path) -> Result<Scenario, Failure> {
        let scenario = Scenario::read(folder, self.sidecar.as_deref())?;
        tell_notes(&scenario.notes);
        Ok(scenario)
    }

    /// What shows it.
    pub(crate) fn shown(&self) -> Shown {
        match &self.setup {
            None => Shown::Camera,
            Some(setup) => Shown::Facility {
                setup: setup.clone(),
                compensation: match self.compensation {
                    CompensationName::None => Compensation::None,
                    CompensationName::Resample => Compensation::Resample,
                    CompensationName::Direct => Compensation::Direct,
                },
            },
        }
    }

    /// The scenario as a scene with frames, and its by-products where any are asked for.
    pub(crate) fn scene(
        &self,
        folder: &Path,
        by_products: Option<&str>,
    ) -> Result<(Scene, Option<Products>), Failure> {
        let wanted =
            by_products.map(|names| parse_products(Path::new("--by-products"), names)).transpose()?;
        let scenario = self.scenario(folder)?;
        let shown = self.shown();
        let (scene, notes) = scenario.scene(&shown, true)?;
        tell_notes(&notes);
        let products = wanted.map(|wanted| Products::of(&scenario, &shown, &scene, &wanted)).transpose()?;
        Ok((scene, products))
    }
}

/// Notes on standard error, a line each.
pub(crate) fn tell_notes(notes: &[String]) {
    for note in notes {
        tell!("{note}");
    }
}
