//! A scene through the facility: a calibration measured on the bench, screen images, and their photographs. What is
//! finished is kept.

use std::path::{Path, PathBuf};

use retina_batch::{
    BackendChoice, Batch, BatchError, FrameRange, Options, Progress as BatchProgress, Selection, Shard,
    merge_shards,
};
use retina_bench::{Bench, BenchError, Exposure, OpticsDetail, ScreenImage};
use retina_calibration::geometry::{self, CalibrateOptions, calibrate};
use retina_campaign::{
    Facility, FramesOptions, PointsOptions, TemperatureProfile, adopt_frames, photograph_frames,
    simulate_points,
};
use retina_files::{InputError, hash_bytes, hash_file, read_text, write_atomic};
use retina_formats::TableKind;
use retina_geometry::Setup;
use retina_scene::{Compensation, Display, Scene};
use serde::Deserialize;
use thiserror::Error;

use crate::lines::list_name;
use crate::parts::{begun, part_folder, part_of, parts};
pub use crate::parts::{busy_folders, torn_in_part};

/// What ends the experiment.
#[derive(Debug, Error)]
pub enum ExperimentError {
    /// Input that does not fit.
    #[error(transparent)]
    Input(#[from] InputError),
    /// The bench.
    #[error(transparent)]
    Bench(#[from] BenchError),
    /// Rendering.
    #[error(transparent)]
    Batch(#[from] BatchError),
}

/// Is told how far the experiment is.
pub trait Watcher {
    /// Something the user should know.
    fn note(&mut self, text: &str);
    /// A step begins.
    fn step(&mut self, name: &str);
    /// So many of it are done.
    fn done(&mut self, done: usize, all: usize);
}

/// A watcher as the renderer's observer.
struct Rendering<'a>(&'a mut dyn Watcher);

impl retina_batch::Observer for Rendering<'_> {
    fn note(&mut self, text: &str) {
        self.0.note(text);
    }

    fn progress(&mut self, progress: BatchProgress) {
        self.0.done(progress.done, progress.to_do);
    }
}

/// Says of which scenario a folder is.
const MARK: &str = "made-from.txt";

/// The calibration's campaign of points.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Campaign {
    /// Exposures.
    pub exposures: usize,
    /// Points in each.
    pub points: usize,
}

impl Default for Campaign {
    fn default() -> Self {
        Self { exposures: 40, points: 50 }
    }
}

/// A scene's way through the facility, and the folder that keeps it.
pub(crate) struct Chain<'a> {
    /// The scene's facility.
    pub(crate) setup: Setup,
    /// The calibration that screens are compensated by.
    pub(crate) calibration: PathBuf,
    scene: Scene,
    /// The frames of the whole.
    whole: Selection,
    /// Those of this run.
    selection: Selection,
    part: Option<Part>,
    seed: u64,
    out: &'a Path,
    backend: BackendChoice,
}

/// The part that a run makes, and the places of its frames in the whole.
struct Part {
    shard: Shard,
    places: Vec<usize>,
}

/// What the scenarios of such experiments have in common.
#[derive(Debug, Clone)]
pub struct ChainScenario {
    /// The scene; its compensation is replaced.
    pub scene: PathBuf,
    /// Which of its frames.
    pub selection: Selection,
    /// Seed of the bench.
    pub seed: u64,
    /// The bench's calibration; it is measured where absent.
    pub calibration: Option<PathBuf>,
    /// How it is measured.
    pub campaign: Campaign,
    /// Hash of the scenario's file and of all that it names: a folder is one scenario's alone.
    pub hash: String,
}

/// The keys of it, as a scenario's file has them beside its own.
pub(crate) struct ChainKeys {
    pub(crate) scene: PathBuf,
    pub(crate) every: usize,
    pub(crate) frames: Option<String>,
    pub(crate) seed: u64,
    pub(crate) calibration: Option<PathBuf>,
    pub(crate) campaign: Campaign,
}

/// Default of [`ChainKeys::every`].
pub(crate) fn each() -> usize {
    1
}

impl ChainScenario {
    /// How many frames of the scene it takes.
    ///
    /// # Errors
    /// The scene does not read, or has not the frames.
    pub fn frames(&self) -> Result<usize, InputError> {
        Ok(self.selection.frames(Scene::read(&self.scene)?.frame_count())?.len())
    }

    /// Checks the keys of a scenario's file; names in it are relative to it.
    ///
    /// # Errors
    /// A value does not fit, or what is named cannot be read.
    pub(crate) fn new(path: &Path, keys: ChainKeys) -> Result<Self, InputError> {
        let ChainKeys { every, seed, campaign, .. } = keys;
        check_values(
            path,
            &[
                ("every", every as f64, every > 0, "1 or more"),
                (
                    "campaign.exposures",
                    campaign.exposures as f64,
                    (3..=999).contains(&campaign.exposures),
                    "3 to 999",
                ),
                (
                    "campaign.points",
                    campaign.points as f64,
                    (3..=5000).contains(&campaign.points),
                    "3 to 5000",
                ),
            ],
        )?;
        let range = match &keys.frames {
            None => None,
            Some(text) => Some(
                text.parse::<FrameRange>()
                    .map_err(|error| InputError::new(path, error).at("key `frames`"))?,
            ),
        };
        let folder = path.parent().unwrap_or(Path::new(""));
        let scene = folder.join(&keys.scene);
        let calibration = keys.calibration.as_ref().map(|own| folder.join(own));
        let mut text = read_text(path)?;
        for named in [Some(&scene), calibration.as_ref()].into_iter().flatten() {
            text.push_str(&hash_file(named)?);
        }
        let selection = Selection { range, every: Some(every), shard: None };
        Ok(Self { scene, selection, seed, calibration, campaign, hash: hash_bytes(text.as_bytes()) })
    }
}

/// Refuses the first value that does not fit: its key, itself, whether it fits, what was expected.
///
/// # Errors
/// There is one.
pub(crate) fn check_values(path: &Path, values: &[(&str, f64, bool, &str)]) -> Result<(), InputError> {
    match values.iter().find(|(_, _, fits, _)| !fits) {
        None => Ok(()),
        Some((key, value, _, expected)) => Err(InputError::new(path, "the value does not fit")
            .at(format!("key `{key}`"))
            .found(value)
            .expected(*expected)),
    }
}

impl<'a> Chain<'a> {
    /// Reads the scene, has `check` look at it, claims the folder, and calibrates the bench where that is not done. With a
    /// shard, the run makes that part of the frames.
    ///
    /// # Errors
    /// Something does not fit, the folder is another scenario's, or the calibration fails.
    pub(crate) fn open(
        scenario: &ChainScenario,
        out: &'a Path,
        backend: BackendChoice,
        shard: Option<Shard>,
        check: impl FnOnce(&Scene) -> Result<(), InputError>,
        watcher: &mut dyn Watcher,
    ) -> Result<Self, ExperimentError> {
        let (seed, whole) = (scenario.seed, scenario.selection);
        let scene = Scene::read(&scenario.scene)?;
        let Display::Facility(setup) = scene.display.clone() else {
            return Err(InputError::new(&scenario.scene, "shows no facility").into());
        };
        whole.frames(scene.frame_count())?;
        check(&scene)?;
        let (selection, part) = match shard {
            None => (whole, None),
            Some(shard) => {
                let (selection, places) = part_of(whole, shard, scene.frame_count())?;
                (selection, Some(Part { shard, places }))
            }
        };
        std::fs::create_dir_all(out)
            .map_err(|error| InputError::new(out, format!("the folder cannot be made: {error}")))?;
        claim(out, &scenario.hash)?;
        let calibration = match &scenario.calibration {
            Some(own) => own.clone(),
            None => measured_calibration(scenario.campaign, seed, &setup, out, watcher)?,
        };
        Ok(Self { setup, calibration, scene, whole, selection, part, seed, out, backend })
    }

    /// The folder of this run's screens and photographs.
    fn dir(&self) -> PathBuf {
        match &self.part {
            None => self.out.to_path_buf(),
            Some(part) => part_folder(self.out, part.shard),
        }
    }

    /// The list of a label's results.
    pub(crate) fn list(&self, label: &str) -> PathBuf {
        self.out.join(list_name(label, self.part.as_ref().map(|part| part.shard)))
    }

    /// The scene.
    pub(crate) fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Renders the screens of a mode into `screen/NAME` of the run's folder; gives that folder. The whole takes what its
    /// parts have.
    ///
    /// # Errors
    /// The calibration is not the setup's, or rendering fails.
    pub(crate) fn screens(
        &self,
        name: &str,
        mode: Compensation,
        watcher: &mut dyn Watcher,
    ) -> Result<PathBuf, ExperimentError> {
        let own = Path::new("screen").join(name);
        let dir = self.dir().join(&own);
        if self.part.is_none() {
            let of_parts = parts(self.out).into_iter().map(|(_, folder)| folder.join(&own)).collect();
            let of_parts = begun(of_parts)?;
            if !of_parts.is_empty() {
                watcher.step(&format!("joining the parts' screens, {}", mode.name()));
                merge_shards(&of_parts, &dir, true, &mut Rendering(watcher))?;
            }
        }
        watcher.step(&format!("rendering, {}", mode.name()));
        self.batch(dir.clone(), mode)?.run(&mut Rendering(watcher))?;
        Ok(dir)
    }

    fn batch(&self, dir: PathBuf, mode: Compensation) -> Result<Batch, InputError> {
        let compensated = self.scene.clone().with_compensation(mode, &self.calibration)?;
        let (selection, backend) = (self.selection, self.backend);
        Ok(Batch::new(compensated, Options { dir, selection, resume: true, backend, quality: None }))
    }

    /// Makes the folders of so many parts' screens: the radiance scale is looked for once, and all parts have it.
    ///
    /// # Errors
    /// As [`Batch::prepare`].
    pub(crate) fn prepare(
        &self,
        count: usize,
        modes: &[(&str, Compensation)],
        watcher: &mut dyn Watcher,
    ) -> Result<(), ExperimentError> {
        for (name, mode) in modes {
            let folders: Vec<PathBuf> = (0..count)
                .map(|index| part_folder(self.out, Shard { index, count }).join("screen").join(name))
                .collect();
            watcher.step(&format!("preparing {count} parts, {}", mode.name()));
            self.batch(folders[0].clone(), *mode)?.prepare(&folders, &mut Rendering(watcher))?;
        }
        Ok(())
    }

    /// The facility that photographs.
    ///
    /// # Errors
    /// As [`Facility::new`].
    pub(crate) fn facility(&self) -> Result<Facility, InputError> {
        Facility::new(&self.setup, &[], TableKind::Frames, f64::MAX, self.seed)
    }

    /// Photographs the screens of a folder into `bench/NAME` of the run's folder; gives that folder. The whole takes what
    /// its parts have.
    ///
    /// # Errors
    /// The bench refuses them, or a file cannot be written.
    pub(crate) fn photographs(
        &self,
        facility: &Facility,
        bench: &Bench,
        screens: &Path,
        exposure_s: f64,
        watcher: &mut dyn Watcher,
    ) -> Result<PathBuf, ExperimentError> {
        let name = screens.file_name().unwrap_or_default();
        let own = Path::new("bench").join(name);
        let folder = self.dir().join(&own);
        let options = |screens: PathBuf, places: Option<Vec<usize>>| FramesOptions {
            screens,
            places,
            exposure_s: Some(exposure_s),
            interval_s: 60.0,
            temperature: TemperatureProfile::Constant,
            detail: OpticsDetail::default(),
        };
        let wanted = options(screens.to_path_buf(), self.part.as_ref().map(|part| part.places.clone()));
        if self.part.is_none() {
            let mut taken = Vec::new();
            for (shard, part) in parts(self.out) {
                let (_, places) = part_of(self.whole, shard, self.scene.frame_count())?;
                taken.push((options(part.join("screen").join(name), Some(places)), part.join(&own)));
            }
            for left in adopt_frames(facility, &wanted, &taken, &folder)? {
                watcher.note(&format!(
                    "{}: not all of these photographs can be taken over; they are taken anew",
                    left.display()
                ));
            }
        }
        watcher.step(&format!("photographing, {}", name.to_string_lossy()));
        let told = std::cell::RefCell::new(watcher);
        photograph_frames(facility, bench, &wanted, &folder, |done, all| told.borrow_mut().done(done, all))?;
        Ok(folder)
    }
}

/// Marks the folder as the scenario's, or finds that it is.
fn claim(out: &Path, hash: &str) -> Result<(), InputError> {
    let (mark, own) = (out.join(MARK), format!("{hash}\n"));
    if !mark.exists() {
        return write_atomic(&mark, own.as_bytes())
            .map_err(|error| InputError::new(&mark, format!("cannot be written: {error}")));
    }
    if read_text(&mark)? != own {
        return Err(InputError::new(out, "the folder holds the results of another scenario")
            .help("give --out another folder, or empty this one"));
    }
    Ok(())
}

/// A calibration from points on the bench, kept in the folder.
fn measured_calibration(
    campaign: Campaign,
    seed: u64,
    setup: &Setup,
    out: &Path,
    watcher: &mut dyn Watcher,
) -> Result<PathBuf, ExperimentError> {
    let path = out.join("calibration.toml");
    if path.is_file() {
        return Ok(path);
    }
    let options =
        PointsOptions { exposures: campaign.exposures, points: campaign.points, ..PointsOptions::default() };
    watcher.step("calibrating the bench");
    let facility = Facility::new(setup, &[], TableKind::Points, options.length_s(), seed)?;
    let told = std::cell::RefCell::new(watcher);
    let points =
        simulate_points(&facility, &options, None, |done| told.borrow_mut().done(done, options.exposures))?;
    let watcher = told.into_inner();
    let result = calibrate(&points.table, setup, &CalibrateOptions::default())?;
    watcher.note(&format!("the bench is calibrated: {:.2} arcsec rms", result.errors.rms_arcsec));
    geometry::write_calibration(&path, &result, &points.table, setup)?;
    Ok(path)
}

/// Side of the square that the exposure is found with, px: wide against the PSF, cheap to image.
const SQUARE_PX: u32 = 64;

/// The time in which light as bright as the screen can show fills this share of the full well.
///
/// # Errors
/// The bench cannot be built.
pub(crate) fn exposure_s(bench: &Bench, share: f64) -> Result<f64, BenchError> {
    let screen = &bench.setup().screen;
    let mut square = ScreenImage::dark(screen.width_px, screen.height_px);
    let [left, top] = [screen.width_px, screen.height_px].map(|size| (size - SQUARE_PX) / 2);
    for row in top..top + SQUARE_PX {
        for column in left..left + SQUARE_PX {
            square.set(column, row, [255; 3]);
        }
    }
    let light = bench.light_e(&square, &Exposure::new(1.0, 0))?;
    let peak = f64::from(light.iter().copied().fold(0.0, f32::max));
    Ok(share * bench.sensor().full_well_e() / peak)
}
