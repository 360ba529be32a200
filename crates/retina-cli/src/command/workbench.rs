//! What compare, diagnose and fit read alike.

use std::path::PathBuf;

use retina_diagnosis::{AddedEffect, Baseline, Dataset, Source};
use retina_files::InputError;
use retina_geometry::{Calibration, Setup};

use crate::failure::Failure;

#[derive(clap::Args)]
pub(crate) struct Input {
    /// The facility, schema retina.setup/1.
    #[arg(long)]
    setup: PathBuf,
    /// A table of points, power or phase; may be given more than once.
    #[arg(long, required = true, value_name = "TABLE")]
    data: Vec<PathBuf>,
    /// A calibration that is held fixed but for shift, rotation and scale.
    #[arg(long)]
    calibration: Option<PathBuf>,
    /// What is fitted without a calibration: `physical`, or `polynomial:N` with N from 1 to 7.
    #[arg(long, default_value = "physical")]
    baseline: String,
}

impl Input {
    /// Setup and data.
    pub(crate) fn read(&self) -> Result<(Setup, Dataset), Failure> {
        let baseline = Baseline::parse(&self.baseline)?;
        if self.calibration.is_some() && baseline != Baseline::Physical {
            return Err(InputError::new(
                "--baseline",
                "means nothing beside --calibration, which is held fixed",
            )
            .help("leave out one of the two")
            .into());
        }
        let setup = Setup::read(&self.setup)?;
        let calibration =
            self.calibration.as_ref().map(|path| Calibration::read(path, &setup)).transpose()?;
        let source = Source { files: &self.data, setup: &setup, calibration: calibration.as_ref(), baseline };
        let data = Dataset::read(&source)?;
        Ok((setup, data))
    }
}

/// The effects of `--effect`.
pub(crate) fn added(effects: &[String], data: &Dataset) -> Result<Vec<AddedEffect>, Failure> {
    let mut out: Vec<AddedEffect> = Vec::new();
    for text in effects {
        let effect = AddedEffect::read(text, data)?;
        if out.iter().any(|other| other.name() == effect.name()) {
            return Err(InputError::new("--effect", "is given twice")
                .found(format!("`{}`", effect.name()))
                .into());
        }
        out.push(effect);
    }
    retina_diagnosis::check_effects(data, &out)?;
    Ok(out)
}
