//! What compare, diagnose, fit and investigate work on: a facility, its measurements and a model, checked against each other.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use retina_bench::{BenchError, SpotTracer};
use retina_diagnosis::{AddedEffect, Baseline, Dataset, DiagnoseOptions, OwnEffect, Source};
use retina_files::InputError;
use retina_formats::{
    Calibration, CalibrationFile, Channel, Measurements, PointsTable, RadiometricCalibration, TableKind,
};
use retina_frames::{FrameSet, FramesSource, diagnose_frames};
use retina_geometry::{Setup, SpotShifts};
use retina_investigation::{Investigation, KnownEffect, Options, investigate};

/// Measurements: tables in files, or one made in memory.
#[derive(Debug, Clone)]
pub enum Measured {
    /// Files of one kind, read together.
    Files(Vec<PathBuf>),
    /// Points, power readings or a phase curve.
    Memory(Box<Measurements>),
}

/// A calibration as it stands in its file; the path names it in errors.
#[derive(Debug, Clone)]
pub struct GivenCalibration {
    /// Its contents, read for the setup.
    pub file: CalibrationFile,
    /// Where it lies, or what made it.
    pub path: PathBuf,
}

impl GivenCalibration {
    /// Reads a calibration of `setup`.
    ///
    /// # Errors
    /// It cannot be read, or is another setup's.
    pub fn read(path: &Path, setup: &Setup) -> Result<Self, InputError> {
        Ok(Self { file: CalibrationFile::read(path, setup)?, path: path.to_path_buf() })
    }

    /// Its geometry.
    ///
    /// # Errors
    /// It has none.
    pub fn geometry(&self, setup: &Setup) -> Result<Calibration, InputError> {
        Calibration::of_file(self.file.clone(), &self.path, setup)
    }

    /// Its response, for readings of a power meter.
    ///
    /// # Errors
    /// It has none.
    pub fn response(&self, setup: &Setup) -> Result<RadiometricCalibration, InputError> {
        RadiometricCalibration::of_file(&self.file, &self.path, setup)?.ok_or_else(|| {
            InputError::new(&self.path, "the calibration has no response")
                .at("table `response`")
                .expected("a calibration of the display's light, for readings of a power meter")
                .help("`retina calibrate radiometry --data power.csv --out ...` makes one")
        })
    }
}

/// A facility, its measurements, and the model that they are compared with.
#[derive(Debug, Clone)]
pub struct Input {
    /// The facility.
    pub setup: Setup,
    /// The measurements.
    pub measured: Measured,
    /// A calibration that is held fixed. Of points its distortion is held, of power readings its response.
    pub calibration: Option<GivenCalibration>,
    /// The baseline's name, as [`Baseline::parse`] takes it; of frames `physical` or `gain`.
    pub baseline: String,
}

/// Measurements with what they are compared with.
pub struct TableMaterial {
    /// The facility.
    pub setup: Setup,
    /// The measurements.
    pub tables: Measurements,
    /// The distortion that is held fixed.
    pub calibration: Option<Calibration>,
    /// Their residuals, groups and covariates.
    pub data: Dataset,
    baseline: Baseline,
    /// The chief rays at the display, of points where the setup's lenses can be traced.
    lenses: Option<Lenses>,
}

impl TableMaterial {
    /// Other points of the facility, under the same model.
    ///
    /// # Errors
    /// They do not fit it.
    pub fn data_of(&self, points: PointsTable) -> Result<Dataset, InputError> {
        let data = Dataset::new(&Source {
            tables: &Measurements::Points(points),
            setup: &self.setup,
            calibration: self.calibration.as_ref(),
            response: None,
            baseline: self.baseline,
        })?;
        Ok(match &self.lenses {
            Some(lenses) => lenses.put_into(data),
            None => data,
        })
    }
}

/// What a calibration is held for.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Calibrated {
    Nothing,
    Geometry,
    Response,
}

impl Input {
    fn kind(&self) -> Result<Option<TableKind>, InputError> {
        match &self.measured {
            Measured::Files(files) => files.first().map(|file| TableKind::of_file(file)).transpose(),
            Measured::Memory(tables) => Ok(Some(tables.kind())),
        }
    }

    /// What the table is called in errors.
    fn name(&self) -> String {
        match &self.measured {
            Measured::Files(files) => {
                files.first().map_or_else(String::new, |file| file.display().to_string())
            }
            Measured::Memory(tables) => tables.kind().name().to_owned(),
        }
    }

    fn calibrated(&self) -> Result<Calibrated, InputError> {
        let flag = if self.calibration.is_some() {
            "--calibration"
        } else if self.baseline != "physical" {
            "--baseline"
        } else {
            return Ok(Calibrated::Nothing);
        };
        match self.kind()? {
            None => return Ok(Calibrated::Nothing),
            Some(TableKind::Points) => return Ok(Calibrated::Geometry),
            Some(TableKind::Power) if flag == "--calibration" => return Ok(Calibrated::Response),
            Some(_) => {}
        }
        let tables = if flag == "--baseline" { "points" } else { "points or of power readings" };
        Err(InputError::new(flag, format!("applies only to tables of {tables}"))
            .found(format!("{}, a table of another kind", self.name()))
            .help(format!("leave out {flag}: other tables have one baseline")))
    }

    /// The frames, where the first table is one of frames.
    ///
    /// # Errors
    /// A table, an image or the baseline does not fit.
    pub fn frames(&self) -> Result<Option<FrameSet>, InputError> {
        let Measured::Files(files) = &self.measured else { return Ok(None) };
        if self.kind()? != Some(TableKind::Frames) {
            return Ok(None);
        }
        let register = match self.baseline.as_str() {
            "physical" => true,
            "gain" => false,
            other => {
                return Err(InputError::new("--baseline", "is not a baseline for frames")
                    .found(format!("`{other}`"))
                    .expected("`physical` (gain, offset, shift, roll, scale) or `gain`"));
            }
        };
        let calibration = self.calibration.as_ref().map(|given| given.geometry(&self.setup)).transpose()?;
        let source = FramesSource { files, setup: &self.setup, calibration: calibration.as_ref(), register };
        FrameSet::read(&source).map(Some)
    }

    /// Points, power readings or a phase curve with their model.
    ///
    /// # Errors
    /// A table, the calibration or the baseline does not fit.
    pub fn table(self) -> Result<TableMaterial, InputError> {
        let baseline = Baseline::parse(&self.baseline)?;
        if self.calibration.is_some() && baseline != Baseline::Physical {
            return Err(InputError::new(
                "--baseline",
                "has no effect with --calibration, which is held fixed",
            )
            .help("leave out one of the two"));
        }
        let kind = self.calibrated()?;
        let Self { setup, measured, calibration: given, .. } = self;
        let given = |of: Calibrated| given.as_ref().filter(|_| kind == of);
        let calibration = given(Calibrated::Geometry).map(|given| given.geometry(&setup)).transpose()?;
        let response = given(Calibrated::Response).map(|given| given.response(&setup)).transpose()?;
        let tables = match measured {
            Measured::Files(files) => Measurements::read(&files)?,
            Measured::Memory(tables) => *tables,
        };
        let source = Source {
            tables: &tables,
            setup: &setup,
            calibration: calibration.as_ref(),
            response: response.as_ref(),
            baseline,
        };
        let mut data = Dataset::new(&source)?;
        let mut lenses = None;
        if let Measurements::Points(points) = &tables {
            // Coma by itself is told from the lenses' own by a calibration alone.
            match Lenses::traced(&setup, lit(points), calibration.is_some()) {
                Ok(traced) => lenses = Some(traced),
                Err(error) => data
                    .notes
                    .push(format!("effects of the display's place have their leading forms: {error}")),
            }
        }
        if let Some(lenses) = &lenses {
            data = lenses.put_into(data);
            if setup.optics.system.is_none() {
                data = data.with_default_lenses();
            }
        }
        Ok(TableMaterial { setup, tables, calibration, data, baseline, lenses })
    }
}

/// What the facility's lenses make of the display's depth, and of coma.
struct Lenses {
    shifts: SpotShifts,
    /// Where coma is looked for.
    tracer: Option<Arc<SpotTracer>>,
}

impl Lenses {
    fn traced(setup: &Setup, lit: Range<usize>, with_coma: bool) -> Result<Self, BenchError> {
        let camera = setup.camera_pinhole();
        let corner = glam::DVec2::new(
            f64::from(camera.width_px) / camera.fx_px,
            f64::from(camera.height_px) / camera.fy_px,
        );
        let tracer = SpotTracer::new(setup, 0.5 * corner.length(), lit)?;
        Ok(Self { shifts: tracer.shifts(with_coma)?, tracer: with_coma.then(|| Arc::new(tracer)) })
    }

    fn put_into(&self, data: Dataset) -> Dataset {
        let data = data.with_spot_shifts(self.shifts);
        match &self.tracer {
            Some(tracer) => data.with_coma_tracer(Arc::clone(tracer) as _),
            None => data,
        }
    }
}

/// The channels of a table's points; all of them where points differ.
fn lit(points: &PointsTable) -> Range<usize> {
    let mut channels = points.rows.iter().map(|row| row.channel);
    let first = channels.next().unwrap_or_default();
    if channels.all(|channel| channel == first) { first.lit() } else { Channel::W.lit() }
}

/// An effect that the model already has.
#[derive(Clone)]
pub enum GivenEffect {
    /// An id of the catalogue, or a file that ends in `.toml`.
    Text(String),
    /// A program's own.
    Own(Arc<dyn OwnEffect>),
}

impl GivenEffect {
    pub(crate) fn name(&self) -> &str {
        match self {
            Self::Text(text) => text,
            Self::Own(effect) => effect.name(),
        }
    }
}

/// The effects that a model of tables has, each once.
///
/// # Errors
/// One is given twice, does not fit the table, or cannot be fitted to it.
pub fn added_effects(effects: &[GivenEffect], data: &Dataset) -> Result<Vec<AddedEffect>, InputError> {
    let mut out: Vec<AddedEffect> = Vec::new();
    for effect in effects {
        let effect = match effect {
            GivenEffect::Text(text) => AddedEffect::read(text, data)?,
            GivenEffect::Own(effect) => AddedEffect::own_shared(Arc::clone(effect), data)?,
        };
        if out.iter().any(|other| other.name() == effect.name()) {
            return Err(twice(effect.name()));
        }
        out.push(effect);
    }
    retina_diagnosis::check_effects(data, &out)?;
    Ok(out)
}

/// The effects that a model of frames has, as text, each once.
///
/// # Errors
/// One is given twice, or is a program's own: pixels are predicted anew, which takes an effect of the catalogue.
pub fn frame_effects(effects: &[GivenEffect]) -> Result<Vec<String>, InputError> {
    let repeated =
        effects.iter().enumerate().find(|(k, e)| effects[..*k].iter().any(|o| o.name() == e.name()));
    if let Some((_, effect)) = repeated {
        return Err(twice(effect.name()));
    }
    let of = |effect: &GivenEffect| match effect {
        GivenEffect::Text(text) => Ok(text.clone()),
        GivenEffect::Own(effect) => {
            Err(InputError::new("--effect", "is a function, which frames do not take")
                .found(format!("`{}`", effect.name()))
                .expected("an effect's id, or a file that ends in .toml"))
        }
    };
    effects.iter().map(of).collect()
}

fn twice(name: &str) -> InputError {
    InputError::new("--effect", "is given twice")
        .found(format!("two effects of the name `{name}`"))
        .help("two files? give one of them another `name = ...`")
}

/// Formulas of what the best prediction of images leaves. Known effects of images change the prediction, which is made
/// anew with each: so they are found first, and the set keeps them. But beside something unknown a diagnosis takes known
/// effects for it. So where formulas are found that are not weak beside the known effects, formulas are looked for without
/// these, too. They stand alone if they predict tiles left out as well. `effects` belong to the model already.
///
/// # Errors
/// An effect that these frames cannot show, too few tiles.
pub fn investigate_frames(
    set: &mut FrameSet,
    effects: &[String],
    options: &Options,
    progress: &(dyn Fn(&str, f64) + Sync),
) -> Result<(Dataset, Investigation), InputError> {
    progress("looking for known effects", 0.0);
    let diagnose = DiagnoseOptions { seed: options.seed, ..DiagnoseOptions::default() };
    let (data, added, found) = diagnose_frames(set, effects, &diagnose)?;
    let mut result = investigate(&data, &added, options, progress)?;
    if !found.accepted.is_empty() && result.terms.iter().any(|term| term.weak_beside.is_none()) {
        let kept = set.keep();
        found.accepted.iter().for_each(|name| set.remove(name));
        let bare = set.dataset(true)?;
        let mut alone = investigate(&bare, &added[..effects.len()], options, progress)?;
        let [with, without] = [&result, &alone].map(|found| found.fit.heldout_rms);
        if without <= AS_WELL * with {
            alone.notes.push(format!(
                "left out of the model: {}, which a diagnosis finds first; formulas alone predict tiles left out as well ({without:.4} instead of {with:.4} DN)",
                found.accepted.join(", ")
            ));
            return Ok((bare, alone));
        }
        set.restore(kept);
    }
    result.known = found.accepted.into_iter().map(KnownEffect::catalogued).collect();
    Ok((data, result))
}

/// Predicted and measured images with what is left of them, as SVG: the last row of an image is with the formulas.
pub fn pictures_of(set: &FrameSet, found: &Investigation) -> String {
    match found.terms.is_empty() {
        true => set.pictures(),
        false => set.pictures_of_fit("with the formulas", &found.fit.residual),
    }
}

/// Errors of tiles left out that differ by less than this factor say nothing: what an effect has to lower them by.
const AS_WELL: f64 = 1.002;
