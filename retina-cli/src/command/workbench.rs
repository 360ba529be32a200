//! What compare, diagnose and fit read alike.

use std::path::{Path, PathBuf};

use retina::workbench::{
    self, GivenCalibration, GivenEffect, Measured, TableMaterial, added_effects, frame_effects,
};
use retina_diagnosis::{AddedEffect, Baseline, Dataset};
use retina_frames::{FrameSet, PICTURES_CAPTION};
use retina_report::Section;

use crate::failure::Failure;
use crate::setup::read_setup;

#[derive(clap::Args)]
pub(crate) struct Input {
    /// Facility, schema retina.setup/1.
    #[arg(long)]
    setup: PathBuf,
    /// Measurement table: points, power, phase or frames.
    ///
    /// Its columns show which. Repeat the flag to read several tables of one facility together.
    #[arg(long, required = true, value_name = "TABLE")]
    data: Vec<PathBuf>,
    /// Calibration to hold fixed.
    ///
    /// For points its distortion is held; only shift, rotation and scale are fitted. For power
    /// readings its response is held; only one gain is fitted.
    #[arg(long)]
    calibration: Option<PathBuf>,
    /// Baseline model, which is always fitted.
    ///
    /// Points: `physical`, `polynomial:N` with N from 1 to 7, or a lens model: `pinhole`,
    /// `fisheye:equidistant`, `fisheye:equisolid`, `fisheye:stereographic`,
    /// `fisheye:kannala-brandt` (or `fisheye`), `rational`. Frames: `physical` (gain, offset,
    /// shift, roll, scale), or `gain` alone.
    #[arg(long, default_value = "physical")]
    baseline: String,
}

impl Input {
    /// Outputs have the names of what they are, can be written, and are no inputs.
    pub(crate) fn check_outputs(
        &self,
        effects: &[String],
        outputs: &[(&Option<PathBuf>, &str)],
    ) -> Result<(), Failure> {
        for (path, extension) in outputs {
            path.as_ref().map_or(Ok(()), |path| crate::check_file(path, extension))?;
        }
        let effects: Vec<PathBuf> = effects.iter().map(PathBuf::from).collect();
        let outputs = outputs.iter().map(|(path, _)| path.as_ref());
        let inputs = self.data.iter().chain([&self.setup]).chain(&self.calibration).chain(&effects);
        crate::check_apart(inputs, outputs, None)
    }

    /// Outputs of any name are no inputs, and no two are one.
    pub(crate) fn check_written<'a>(
        &'a self,
        outputs: impl IntoIterator<Item = &'a Option<PathBuf>>,
    ) -> Result<(), Failure> {
        let inputs = self.data.iter().chain([&self.setup]).chain(&self.calibration);
        crate::check_apart(inputs, outputs.into_iter().map(Option::as_ref), None)
    }

    /// Whether the baseline is a lens model.
    pub(crate) fn has_lens(&self) -> bool {
        matches!(Baseline::parse(&self.baseline), Ok(Baseline::Lens(_)))
    }

    /// The first table, for errors about all.
    pub(crate) fn table(&self) -> &Path {
        self.data.first().map_or(Path::new("--data"), PathBuf::as_path)
    }

    /// Reads the setup and the calibration.
    pub(crate) fn read(&self) -> Result<workbench::Input, Failure> {
        let setup = read_setup(&self.setup)?;
        let calibration =
            self.calibration.as_ref().map(|path| GivenCalibration::read(path, &setup)).transpose()?;
        let measured = Measured::Files(self.data.clone());
        Ok(workbench::Input { setup, measured, calibration, baseline: self.baseline.clone() })
    }
}

/// What a command works on: pixels with their frames, or a table.
pub(crate) enum Material {
    Frames(Box<FrameSet>, Box<Dataset>),
    Table(Box<TableMaterial>),
}

impl Material {
    /// Reads the tables with the effects of `--effect`.
    pub(crate) fn read(input: &Input, effects: &[String]) -> Result<(Self, Vec<AddedEffect>), Failure> {
        let effects: Vec<GivenEffect> = effects.iter().cloned().map(GivenEffect::Text).collect();
        let input = input.read()?;
        if let Some(mut set) = input.frames()? {
            let (data, added) = set.with_effects(&frame_effects(&effects)?)?;
            retina_diagnosis::check_effects(&data, &added)?;
            return Ok((Self::Frames(Box::new(set), Box::new(data)), added));
        }
        let material = input.table()?;
        let added = added_effects(&effects, &material.data)?;
        Ok((Self::Table(Box::new(material)), added))
    }

    pub(crate) fn data(&self) -> &Dataset {
        match self {
            Self::Frames(_, data) => data,
            Self::Table(material) => &material.data,
        }
    }

    /// A section of pictures, of frames.
    pub(crate) fn pictures(&self) -> Option<Section> {
        match self {
            Self::Frames(set, _) => Some(pictures(set)),
            Self::Table(_) => None,
        }
    }
}

/// Predicted and measured images with what is left.
pub(crate) fn pictures(set: &FrameSet) -> Section {
    Section::new("Images").figure(&set.pictures(), PICTURES_CAPTION)
}
