//! The whole experiment: a calibration measured on the bench, screen images with and without compensation, their
//! photographs, and the navigation of four kinds of images.

use std::path::{Path, PathBuf};

use retina_batch::{BackendChoice, Batch, BatchError, Options, Progress as BatchProgress, Selection};
use retina_bench::{BenchError, Exposure, OpticsDetail, ScreenImage};
use retina_calibration::geometry::{self, CalibrateOptions, calibrate};
use retina_campaign::{
    Facility, FramesOptions, PointsOptions, Table, TemperatureProfile, simulate_frames, simulate_points,
};
use retina_files::{InputError, read_text, write_atomic};
use retina_geometry::Setup;
use retina_scene::{Compensation, Display, Scene};
use thiserror::Error;

use super::filter::{FilterOptions, run_filter};
use super::report::Sequence;
use super::scenario::FullDiskScenario;
use super::sequence::{navigate_sequence, summarise};
use super::source::{ImageKind, Source, SourceChoice};
use super::truth::FrameTruth;
use crate::limb::LimbOptions;

/// What ends the experiment.
#[derive(Debug, Error)]
pub enum FullDiskError {
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

/// Runs a scenario into `out`; what is there of the same scenario is kept. Gives the sequences in the order ideal,
/// uncompensated, compensated downstream, upstream.
///
/// # Errors
/// Something named does not fit, the folder is another scenario's, a step fails.
pub fn run_scenario(
    scenario: &FullDiskScenario,
    out: &Path,
    backend: BackendChoice,
    watcher: &mut dyn Watcher,
) -> Result<Vec<Sequence>, FullDiskError> {
    let scene = Scene::read(&scenario.scene)?;
    let Display::Facility(setup) = scene.display.clone() else {
        return Err(InputError::new(&scenario.scene, "shows no facility").into());
    };
    scenario.selection.frames(scene.frame_count())?;
    std::fs::create_dir_all(out)
        .map_err(|error| InputError::new(out, format!("the folder cannot be made: {error}")))?;
    claim(out, &scenario.hash)?;
    let calibration = match &scenario.calibration {
        Some(own) => own.clone(),
        None => measured_calibration(scenario, &setup, out, watcher)?,
    };
    let mut screens = Vec::new();
    for (name, mode) in [("uncompensated", Compensation::None), ("upstream", Compensation::Direct)] {
        watcher.step(&format!("rendering, {}", mode.name()));
        let dir = out.join("screen").join(name);
        let options =
            Options { dir: dir.clone(), selection: scenario.selection, resume: true, backend, quality: None };
        let compensated = scene.clone().with_compensation(mode, &calibration)?;
        Batch::new(compensated, options).run(&mut Rendering(watcher))?;
        screens.push(dir);
    }
    let photographs = photographs(scenario, &setup, &screens, out, watcher)?;
    let jitter_rad = (setup.noise.jitter_arcsec / 3600.0).to_radians();
    let pointing =
        scenario.limb.pointing_sigma_arcsec.map_or(jitter_rad, |arcsec| (arcsec / 3600.0).to_radians());
    let kinds = [
        ("ideal", 0, ImageKind::Screen, true),
        ("uncompensated", 0, ImageKind::Camera, false),
        ("downstream", 0, ImageKind::Camera, true),
        ("upstream", 1, ImageKind::Camera, false),
    ];
    let mut sequences = Vec::new();
    for (label, screen, kind, calibrated) in kinds {
        watcher.step(&format!("navigating, {label}"));
        let source = Source::open(SourceChoice {
            dir: screens[screen].clone(),
            images: (kind == ImageKind::Camera).then(|| photographs[screen].clone()),
            kind: Some(kind),
            setup: Some(setup.file.clone()),
            calibration: calibrated.then(|| calibration.clone()),
            body: None,
            selection: Selection::default(),
            limb: LimbOptions {
                limb_height_m: scenario.limb.height_m,
                limb_height_sigma_m: scenario.limb.height_sigma_m,
                ..LimbOptions::default()
            },
            pointing_sigma_rad: if kind == ImageKind::Camera { pointing } else { 0.0 },
        })?;
        let list = out.join(format!("{label}.jsonl"));
        sequences.push(navigate(&source, label, Some(&list), Some(&scenario.filter), watcher)?);
    }
    Ok(sequences)
}

/// Measures a sequence's frames and runs the filter over them where there is one to run.
///
/// # Errors
/// A frame does not fit, or the list is another sequence's.
pub fn navigate(
    source: &Source,
    label: &str,
    list: Option<&Path>,
    filter: Option<&FilterOptions>,
    watcher: &mut dyn Watcher,
) -> Result<Sequence, InputError> {
    let all = source.frames.len();
    let frames = navigate_sequence(source, list, &mut |done| watcher.done(done, all))?;
    let truths: Vec<FrameTruth> =
        source.frames.iter().map(|&frame| source.truth(frame)).collect::<Result<_, _>>()?;
    let radius_m = truths.first().map_or(0.0, |truth| truth.limb_body().mean_radius_m());
    let filter = match filter {
        None => Err("not asked for".to_owned()),
        Some(options) => run_filter(&frames, &truths, options).map_err(|error| error.to_string()),
    };
    let summary = summarise(&frames, radius_m);
    Ok(Sequence { label: label.to_owned(), frames, summary, filter })
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
    scenario: &FullDiskScenario,
    setup: &Setup,
    out: &Path,
    watcher: &mut dyn Watcher,
) -> Result<PathBuf, FullDiskError> {
    let path = out.join("calibration.toml");
    if path.is_file() {
        return Ok(path);
    }
    let options = PointsOptions {
        exposures: scenario.campaign.exposures,
        points: scenario.campaign.points,
        ..PointsOptions::default()
    };
    watcher.step("calibrating the bench");
    let facility = Facility::new(setup, &[], Table::Points, options.length_s(), scenario.seed)?;
    let told = std::cell::RefCell::new(watcher);
    let campaign =
        simulate_points(&facility, &options, None, |done| told.borrow_mut().done(done, options.exposures))?;
    let watcher = told.into_inner();
    let result = calibrate(&campaign.table, setup, &CalibrateOptions::default())?;
    watcher.note(&format!("the bench is calibrated: {:.2} arcsec rms", result.errors.rms_arcsec));
    geometry::write_calibration(&path, &result, &campaign.table, setup)?;
    Ok(path)
}

/// Photographs of the screens, all of one exposure time.
fn photographs(
    scenario: &FullDiskScenario,
    setup: &Setup,
    screens: &[PathBuf],
    out: &Path,
    watcher: &mut dyn Watcher,
) -> Result<Vec<PathBuf>, FullDiskError> {
    let facility = Facility::new(setup, &[], Table::Frames, f64::MAX, scenario.seed)?;
    let exposure_s = exposure_s(&facility, scenario.full_well_share)?;
    let told = std::cell::RefCell::new(watcher);
    screens
        .iter()
        .map(|screen| {
            let name = screen.file_name().unwrap_or_default();
            told.borrow_mut().step(&format!("photographing, {}", name.to_string_lossy()));
            let options = FramesOptions {
                screens: screen.clone(),
                exposure_s: Some(exposure_s),
                interval_s: 60.0,
                temperature: TemperatureProfile::Constant,
                detail: OpticsDetail::default(),
            };
            let folder = out.join("bench").join(name);
            simulate_frames(&facility, &options, &folder, |done, all| told.borrow_mut().done(done, all))?;
            Ok(folder)
        })
        .collect()
}

/// Side of the square that the exposure is found with, px: wide against the PSF, cheap to image.
const SQUARE_PX: u32 = 64;

/// The time in which light as bright as the screen can show fills this share of the full well.
fn exposure_s(facility: &Facility, share: f64) -> Result<f64, BenchError> {
    let bench = facility.bench(OpticsDetail::default())?;
    let screen = &facility.setup.screen;
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
