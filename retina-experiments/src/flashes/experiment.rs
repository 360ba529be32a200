//! The whole experiment: flashes on ideal images and on those of the bench.

use std::path::Path;

use retina_batch::{BackendChoice, Selection, Shard};
use retina_bench::OpticsDetail;
use retina_files::InputError;
use retina_formats::Calibration;
use retina_scene::{Compensation, Scene};

use super::camera_light::camera_light;
use super::report::Watched;
use super::scenario::FlashScenario;
use super::sequence::{CameraLight, watch_sequence};
use super::summary::summarise;
use crate::experiment::{Chain, ExperimentError, Watcher};
use crate::full_disk::{ImageKind, Source, SourceChoice};
use retina_navigation::limb::LimbOptions;

/// The screens that are rendered: their names, and how the facility's distortion is compensated in them.
const SCREENS: [(&str, Compensation); 2] =
    [("ideal", Compensation::None), ("upstream", Compensation::Direct)];

/// Label of the list that a part finishes last.
pub const LAST_LIST: &str = "bench";

/// Runs a scenario into `out`; what is there of the same scenario, or of its parts, is kept. Gives ideal images first, then
/// the bench's: screens compensated upstream, photographed with the flashes' exposure time.
///
/// # Errors
/// Something named does not fit, the folder is another scenario's, a step fails.
pub fn run_scenario(
    scenario: &FlashScenario,
    out: &Path,
    backend: BackendChoice,
    watcher: &mut dyn Watcher,
) -> Result<Vec<Watched>, ExperimentError> {
    watch(scenario, out, backend, None, watcher)
}

/// Makes one part of a scenario's frames: renders, photographs and searches them. The whole, run into the same folder,
/// takes them. Gives the number of its frames.
///
/// # Errors
/// As [`run_scenario`].
pub fn run_part(
    scenario: &FlashScenario,
    out: &Path,
    backend: BackendChoice,
    part: Shard,
    watcher: &mut dyn Watcher,
) -> Result<usize, ExperimentError> {
    let all = watch(scenario, out, backend, Some(part), watcher)?;
    Ok(all.first().map_or(0, |watched| watched.frames.len()))
}

/// Prepares a folder for so many parts: the calibration, and the folders of their screens.
///
/// # Errors
/// As [`run_scenario`].
pub fn prepare_parts(
    scenario: &FlashScenario,
    out: &Path,
    backend: BackendChoice,
    count: usize,
    watcher: &mut dyn Watcher,
) -> Result<(), ExperimentError> {
    open(scenario, out, backend, None, watcher)?.0.prepare(count, &SCREENS, watcher)
}

/// The chain, and the flashes' exposure time.
fn open<'a>(
    scenario: &FlashScenario,
    out: &'a Path,
    backend: BackendChoice,
    part: Option<Shard>,
    watcher: &mut dyn Watcher,
) -> Result<(Chain<'a>, f64), ExperimentError> {
    let file = &scenario.chain.scene;
    let mut exposure_s = 0.0;
    let check = |scene: &Scene| {
        let missing = || InputError::new(file, "has no flashes").expected("a table [flashes]");
        exposure_s = scene.flashes.as_ref().ok_or_else(missing)?.exposure_s;
        Ok(())
    };
    let chain = Chain::open(&scenario.chain, out, backend, part, check, watcher)?;
    Ok((chain, exposure_s))
}

fn watch(
    scenario: &FlashScenario,
    out: &Path,
    backend: BackendChoice,
    part: Option<Shard>,
    watcher: &mut dyn Watcher,
) -> Result<Vec<Watched>, ExperimentError> {
    let (chain, exposure_s) = open(scenario, out, backend, part, watcher)?;
    let [ideal, upstream] = SCREENS;
    let ideal = &chain.screens(ideal.0, ideal.1, watcher)?;
    let upstream = &chain.screens(upstream.0, upstream.1, watcher)?;
    let mut facility = chain.facility()?;
    facility.wrong.blooming = scenario.blooming;
    let calibration = Calibration::read(&chain.calibration, &chain.setup)?;
    let bench = facility.bench(OpticsDetail::default())?;
    let light = camera_light(&bench, &calibration, exposure_s)?;
    let photographs = chain.photographs(&facility, &bench, upstream, exposure_s, watcher)?;
    let mut all = Vec::new();
    for (label, dir, images) in [("ideal", ideal, None), (LAST_LIST, upstream, Some(photographs))] {
        watcher.step(&format!("looking for flashes, {label}"));
        let source = Source::open(SourceChoice {
            dir: dir.clone(),
            kind: Some(if images.is_some() { ImageKind::Camera } else { ImageKind::Screen }),
            images,
            setup: Some(chain.setup.reference()),
            calibration: None,
            body: None,
            selection: Selection::default(),
            limb: LimbOptions::default(),
            silhouette: None,
            pointing_sigma_rad: 0.0,
        })?;
        let count = source.frames.len();
        let list = chain.list(label);
        let frames = watch_sequence(&source, &light, &scenario.detector, Some(&list), &mut |done| {
            watcher.done(done, count);
        })?;
        let summary = summarise(&frames, scenario.bin_magnitudes, scenario.detector.false_alarms_per_frame);
        all.push(Watched { label: label.to_owned(), light: images_light(&source, light), frames, summary });
    }
    Ok(all)
}

/// The light that is stated with a sequence: of screens the setup says it.
fn images_light(source: &Source, light: CameraLight) -> Option<CameraLight> {
    (source.kind == ImageKind::Camera).then_some(light)
}
