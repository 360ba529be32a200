//! The whole experiment: a calibration measured on the bench, screen images with and without compensation, their
//! photographs, and the navigation of four kinds of images.

use std::path::{Path, PathBuf};

use retina_batch::{BackendChoice, Selection, Shard};
use retina_bench::OpticsDetail;
use retina_files::InputError;
use retina_scene::{Compensation, Scene};
use retina_sky::ephemeris::Ephemeris;

use super::filter::{FilterOptions, run_filter};
use super::report::Sequence;
use super::scenario::FullDiskScenario;
use super::sequence::{navigate_sequence, summarise};
use super::source::{ImageKind, Source, SourceChoice};
use super::truth::FrameTruth;
use crate::experiment::{Chain, ExperimentError, Watcher, exposure_s};
use retina_navigation::limb::LimbOptions;

/// The screens that are rendered: their names, and how the facility's distortion is compensated in them.
const SCREENS: [(&str, Compensation); 2] =
    [("uncompensated", Compensation::None), ("upstream", Compensation::Direct)];

/// The images that are navigated: a label, which of [`SCREENS`], their kind, and whether the calibration undoes the
/// facility's distortion.
const KINDS: [(&str, usize, ImageKind, bool); 4] = [
    ("ideal", 0, ImageKind::Screen, true),
    ("uncompensated", 0, ImageKind::Camera, false),
    ("downstream", 0, ImageKind::Camera, true),
    ("upstream", 1, ImageKind::Camera, false),
];

/// Label of the list that a part finishes last.
pub const LAST_LIST: &str = KINDS[KINDS.len() - 1].0;

/// Runs a scenario into `out`; what is there of the same scenario, or of its parts, is kept. Gives the sequences in the
/// order ideal, uncompensated, compensated downstream, upstream.
///
/// # Errors
/// Something named does not fit, the folder is another scenario's, a step fails.
pub fn run_scenario(
    scenario: &FullDiskScenario,
    out: &Path,
    backend: BackendChoice,
    watcher: &mut dyn Watcher,
) -> Result<Vec<Sequence>, ExperimentError> {
    let taken = Taken::make(scenario, open(scenario, out, backend, None, watcher)?, watcher)?;
    let ephemeris = &taken.chain.scene().ephemeris;
    let mut sequences = Vec::new();
    for kind in KINDS {
        let label = kind.0;
        watcher.step(&format!("navigating, {label}"));
        let (source, list) = (taken.source(scenario, kind)?, taken.chain.list(label));
        sequences.push(navigate(&source, label, Some(&list), Some(&scenario.filter), ephemeris, watcher)?);
    }
    Ok(sequences)
}

/// Makes one part of a scenario's frames: renders, photographs and measures them. The whole, run into the same folder,
/// takes them. Gives the number of its frames.
///
/// # Errors
/// As [`run_scenario`].
pub fn run_part(
    scenario: &FullDiskScenario,
    out: &Path,
    backend: BackendChoice,
    part: Shard,
    watcher: &mut dyn Watcher,
) -> Result<usize, ExperimentError> {
    let taken = Taken::make(scenario, open(scenario, out, backend, Some(part), watcher)?, watcher)?;
    let mut frames = 0;
    for kind in KINDS {
        watcher.step(&format!("measuring, {}", kind.0));
        let source = taken.source(scenario, kind)?;
        frames = source.frames.len();
        navigate_sequence(&source, Some(&taken.chain.list(kind.0)), &mut |done| watcher.done(done, frames))?;
    }
    Ok(frames)
}

/// Prepares a folder for so many parts: the calibration, and the folders of their screens.
///
/// # Errors
/// As [`run_scenario`].
pub fn prepare_parts(
    scenario: &FullDiskScenario,
    out: &Path,
    backend: BackendChoice,
    count: usize,
    watcher: &mut dyn Watcher,
) -> Result<(), ExperimentError> {
    open(scenario, out, backend, None, watcher)?.prepare(count, &SCREENS, watcher)
}

fn open<'a>(
    scenario: &FullDiskScenario,
    out: &'a Path,
    backend: BackendChoice,
    part: Option<Shard>,
    watcher: &mut dyn Watcher,
) -> Result<Chain<'a>, ExperimentError> {
    let file = &scenario.chain.scene;
    let check = |scene: &Scene| match &scene.bodies[..] {
        [_] => Ok(()),
        bodies => Err(InputError::new(file, "the experiment measures one body")
            .at("key `body`")
            .found(format!("{} bodies", bodies.len()))
            .expected("a scene with one")),
    };
    Chain::open(&scenario.chain, out, backend, part, check, watcher)
}

/// Screens and their photographs.
struct Taken<'a> {
    chain: Chain<'a>,
    screens: Vec<PathBuf>,
    photographs: Vec<PathBuf>,
}

impl<'a> Taken<'a> {
    fn make(
        scenario: &FullDiskScenario,
        chain: Chain<'a>,
        watcher: &mut dyn Watcher,
    ) -> Result<Self, ExperimentError> {
        let mut screens = Vec::new();
        for (name, mode) in SCREENS {
            screens.push(chain.screens(name, mode, watcher)?);
        }
        let facility = chain.facility()?;
        let bench = facility.bench(OpticsDetail::default())?;
        let exposure_s = exposure_s(&bench, scenario.full_well_share)?;
        let mut photographs = Vec::new();
        for screen in &screens {
            photographs.push(chain.photographs(&facility, &bench, screen, exposure_s, watcher)?);
        }
        Ok(Self { chain, screens, photographs })
    }

    fn source(
        &self,
        scenario: &FullDiskScenario,
        (_, screen, kind, calibrated): (&str, usize, ImageKind, bool),
    ) -> Result<Source, InputError> {
        let (setup, calibration) = (&self.chain.setup, &self.chain.calibration);
        let jitter_rad = (setup.noise.jitter_arcsec / 3600.0).to_radians();
        let pointing =
            scenario.limb.pointing_sigma_arcsec.map_or(jitter_rad, |arcsec| (arcsec / 3600.0).to_radians());
        Source::open(SourceChoice {
            dir: self.screens[screen].clone(),
            images: (kind == ImageKind::Camera).then(|| self.photographs[screen].clone()),
            kind: Some(kind),
            setup: Some(setup.reference()),
            calibration: calibrated.then(|| calibration.clone()),
            body: None,
            selection: Selection::default(),
            limb: LimbOptions {
                limb_height_m: scenario.limb.height_m,
                limb_height_sigma_m: scenario.limb.height_sigma_m,
                ..LimbOptions::default()
            },
            silhouette: scenario.silhouette.clone(),
            pointing_sigma_rad: if kind == ImageKind::Camera { pointing } else { 0.0 },
        })
    }
}

/// Measures a sequence's frames and runs the filter over them where there is one to run; the ephemeris says where it
/// takes Sun, Earth and Moon to be.
///
/// # Errors
/// A frame does not fit, or the list is another sequence's.
pub fn navigate(
    source: &Source,
    label: &str,
    list: Option<&Path>,
    filter: Option<&FilterOptions>,
    ephemeris: &Ephemeris,
    watcher: &mut dyn Watcher,
) -> Result<Sequence, InputError> {
    let all = source.frames.len();
    let truths: Vec<FrameTruth> =
        source.frames.iter().map(|&frame| source.truth(frame)).collect::<Result<_, _>>()?;
    // Kernels that the filter cannot do with are said before the frames are measured.
    if let (Some(_), [first, .., last], Some(kernel)) =
        (filter, &truths[..], ephemeris.kernel_files().first())
    {
        for truth in [first, last] {
            ephemeris
                .solar_system(truth.time_s)
                .map_err(|error| InputError::new(&kernel.path, error.to_string()))?;
        }
    }
    let frames = navigate_sequence(source, list, &mut |done| watcher.done(done, all))?;
    let radius_m = truths.first().map_or(0.0, |truth| truth.limb_body().mean_radius_m());
    let filter = match filter {
        None => Err("not asked for".to_owned()),
        Some(options) => run_filter(&frames, &truths, options, ephemeris).map_err(|error| error.to_string()),
    };
    let summary = summarise(&frames, radius_m);
    Ok(Sequence { label: label.to_owned(), frames, summary, filter })
}
