//! What compare, diagnose and fit read alike.

use std::path::{Path, PathBuf};

use glam::DVec2;
use retina_diagnosis::{AddedEffect, Baseline, Dataset, Source};
use retina_files::InputError;
use retina_formats::{Calibration, Measurements, RadiometricCalibration, TableKind};
use retina_frames::{FrameSet, FramesSource};
use retina_geometry::Setup;
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

    /// Which calibration the tables take: of the geometry (points), of the response (power), none (phase).
    fn calibrated(&self) -> Result<Calibrated, Failure> {
        let flag = if self.calibration.is_some() {
            "--calibration"
        } else if self.baseline != "physical" {
            "--baseline"
        } else {
            return Ok(Calibrated::Nothing);
        };
        let Some(path) = self.data.first() else { return Ok(Calibrated::Nothing) };
        match TableKind::of_file(path)? {
            TableKind::Points => return Ok(Calibrated::Geometry),
            TableKind::Power if flag == "--calibration" => return Ok(Calibrated::Response),
            _ => {}
        }
        let tables = if flag == "--baseline" { "points" } else { "points or of power readings" };
        Err(InputError::new(flag, format!("applies only to tables of {tables}"))
            .found(format!("{}, a table of another kind", path.display()))
            .help(format!("leave out {flag}: other tables have one baseline"))
            .into())
    }

    /// The frames, where the first table is one of frames.
    pub(crate) fn frames(&self) -> Result<Option<FrameSet>, Failure> {
        match self.data.first() {
            Some(path) if TableKind::of_file(path)? == TableKind::Frames => {}
            _ => return Ok(None),
        }
        let register = match self.baseline.as_str() {
            "physical" => true,
            "gain" => false,
            other => {
                return Err(InputError::new("--baseline", "is not a baseline for frames")
                    .found(format!("`{other}`"))
                    .expected("`physical` (gain, offset, shift, roll, scale) or `gain`")
                    .into());
            }
        };
        let setup = read_setup(&self.setup)?;
        let calibration =
            self.calibration.as_ref().map(|path| Calibration::read(path, &setup)).transpose()?;
        let source =
            FramesSource { files: &self.data, setup: &setup, calibration: calibration.as_ref(), register };
        Ok(Some(FrameSet::read(&source)?))
    }

    /// Setup, tables, calibration and data.
    fn read(&self) -> Result<TableMaterial, Failure> {
        let baseline = Baseline::parse(&self.baseline)?;
        if self.calibration.is_some() && baseline != Baseline::Physical {
            return Err(InputError::new(
                "--baseline",
                "has no effect with --calibration, which is held fixed",
            )
            .help("leave out one of the two")
            .into());
        }
        let kind = self.calibrated()?;
        let setup = read_setup(&self.setup)?;
        let path = |of: Calibrated| self.calibration.as_ref().filter(|_| kind == of);
        let calibration =
            path(Calibrated::Geometry).map(|path| Calibration::read(path, &setup)).transpose()?;
        let response = path(Calibrated::Response).map(|path| response_of(path, &setup)).transpose()?;
        let tables = Measurements::read(&self.data)?;
        let source = Source {
            tables: &tables,
            setup: &setup,
            calibration: calibration.as_ref(),
            response: response.as_ref(),
            baseline,
        };
        let mut data = Dataset::new(&source)?;
        if matches!(tables, Measurements::Points(_)) {
            data = with_lenses(data, &setup);
        }
        Ok(TableMaterial { setup, tables, calibration, data })
    }
}

/// Gives the data the facility's lenses. Of a setup whose lenses cannot be traced the leading forms hold, and a note says
/// so.
fn with_lenses(mut data: Dataset, setup: &Setup) -> Dataset {
    let camera = setup.camera_pinhole();
    let corner =
        DVec2::new(f64::from(camera.width_px) / camera.fx_px, f64::from(camera.height_px) / camera.fy_px);
    match retina_bench::display_rays(setup, 0.5 * corner.length()) {
        Ok(rays) => data.with_display_rays(rays),
        Err(error) => {
            data.notes.push(format!("effects of the display's place have their leading forms: {error}"));
            data
        }
    }
}

/// What a calibration is held for.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Calibrated {
    Nothing,
    Geometry,
    Response,
}

fn response_of(path: &Path, setup: &Setup) -> Result<RadiometricCalibration, InputError> {
    RadiometricCalibration::read(path, setup)?.ok_or_else(|| {
        InputError::new(path, "the calibration has no response")
            .at("table `response`")
            .expected("a calibration of the display's light, for readings of a power meter")
            .help("`retina calibrate radiometry --data power.csv --out ...` makes one")
    })
}

/// What a command works on: pixels with their frames, or a table.
pub(crate) enum Material {
    Frames(Box<FrameSet>, Box<Dataset>),
    Table(Box<TableMaterial>),
}

/// Tables with what they are compared with.
pub(crate) struct TableMaterial {
    pub(crate) setup: Setup,
    pub(crate) tables: Measurements,
    pub(crate) calibration: Option<Calibration>,
    pub(crate) data: Dataset,
}

impl Material {
    /// Reads the tables with the effects of `--effect`.
    pub(crate) fn read(input: &Input, effects: &[String]) -> Result<(Self, Vec<AddedEffect>), Failure> {
        if let Some(mut set) = input.frames()? {
            no_repeats(effects)?;
            let (data, added) = set.with_effects(effects)?;
            retina_diagnosis::check_effects(&data, &added)?;
            return Ok((Self::Frames(Box::new(set), Box::new(data)), added));
        }
        let material = input.read()?;
        let added = added(effects, &material.data)?;
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
    Section::new("Images").figure(
        &set.pictures(),
        "One row for each state, from the baseline on. The best prediction has all the usual effects: map, relief, law, blur, glare, response. In the errors, purple is darker than predicted and orange is brighter; white pixels do not count. The errors of all states share one scale.",
    )
}

/// An effect is named once.
fn no_repeats(effects: &[String]) -> Result<(), Failure> {
    let repeated = effects.iter().enumerate().find(|(k, name)| effects[..*k].contains(name));
    match repeated {
        Some((_, name)) => {
            Err(InputError::new("--effect", "is given twice").found(format!("`{name}`")).into())
        }
        None => Ok(()),
    }
}

/// The effects of `--effect`.
fn added(effects: &[String], data: &Dataset) -> Result<Vec<AddedEffect>, Failure> {
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
