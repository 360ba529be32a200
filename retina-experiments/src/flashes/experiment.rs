//! The whole experiment: flashes on ideal images and on those of the bench.

use std::path::Path;

use retina_batch::{BackendChoice, Selection};
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

/// Runs a scenario into `out`; what is there of the same scenario is kept. Gives ideal images first, then the bench's:
/// screens compensated upstream, photographed with the flashes' exposure time.
///
/// # Errors
/// Something named does not fit, the folder is another scenario's, a step fails.
pub fn run_scenario(
    scenario: &FlashScenario,
    out: &Path,
    backend: BackendChoice,
    watcher: &mut dyn Watcher,
) -> Result<Vec<Watched>, ExperimentError> {
    let file = &scenario.chain.scene;
    let mut exposure_s = 0.0;
    let check = |scene: &Scene| {
        let missing = || InputError::new(file, "has no flashes").expected("a table [flashes]");
        exposure_s = scene.flashes.as_ref().ok_or_else(missing)?.exposure_s;
        Ok(())
    };
    let chain = Chain::open(&scenario.chain, out, backend, check, watcher)?;
    let ideal = chain.screens("ideal", Compensation::None, watcher)?;
    let upstream = chain.screens("upstream", Compensation::Direct, watcher)?;
    let mut facility = chain.facility()?;
    facility.wrong.blooming = scenario.blooming;
    let calibration = Calibration::read(&chain.calibration, &chain.setup)?;
    let light = camera_light(&facility.bench(OpticsDetail::default())?, &calibration, exposure_s)?;
    let photographs = chain.photographs(&facility, &upstream, exposure_s, watcher)?;
    let mut all = Vec::new();
    for (label, dir, images) in [("ideal", ideal, None), ("bench", upstream, Some(photographs))] {
        watcher.step(&format!("looking for flashes, {label}"));
        let source = Source::open(SourceChoice {
            dir,
            kind: Some(if images.is_some() { ImageKind::Camera } else { ImageKind::Screen }),
            images,
            setup: Some(chain.setup.file.clone()),
            calibration: None,
            body: None,
            selection: Selection::default(),
            limb: LimbOptions::default(),
            silhouette: None,
            pointing_sigma_rad: 0.0,
        })?;
        let count = source.frames.len();
        let list = out.join(format!("{label}.jsonl"));
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
