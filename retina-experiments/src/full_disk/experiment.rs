//! The whole experiment: a calibration measured on the bench, screen images with and without compensation, their
//! photographs, and the navigation of four kinds of images.

use std::path::Path;

use retina_batch::{BackendChoice, Selection};
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
) -> Result<Vec<Sequence>, ExperimentError> {
    let file = &scenario.chain.scene;
    let check = |scene: &Scene| match &scene.bodies[..] {
        [_] => Ok(()),
        bodies => Err(InputError::new(file, "the experiment measures one body")
            .at("key `body`")
            .found(format!("{} bodies", bodies.len()))
            .expected("a scene with one")),
    };
    let chain = Chain::open(&scenario.chain, out, backend, check, watcher)?;
    let mut screens = Vec::new();
    for (name, mode) in [("uncompensated", Compensation::None), ("upstream", Compensation::Direct)] {
        screens.push(chain.screens(name, mode, watcher)?);
    }
    let facility = chain.facility()?;
    let exposure_s = exposure_s(&facility.bench(OpticsDetail::default())?, scenario.full_well_share)?;
    let mut photographs = Vec::new();
    for screen in &screens {
        photographs.push(chain.photographs(&facility, screen, exposure_s, watcher)?);
    }
    let (setup, calibration) = (&chain.setup, &chain.calibration);
    let jitter_rad = (setup.noise.jitter_arcsec / 3600.0).to_radians();
    let pointing =
        scenario.limb.pointing_sigma_arcsec.map_or(jitter_rad, |arcsec| (arcsec / 3600.0).to_radians());
    let kinds = [
        ("ideal", 0, ImageKind::Screen, true),
        ("uncompensated", 0, ImageKind::Camera, false),
        ("downstream", 0, ImageKind::Camera, true),
        ("upstream", 1, ImageKind::Camera, false),
    ];
    let ephemeris = &chain.scene().ephemeris;
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
            silhouette: scenario.silhouette.clone(),
            pointing_sigma_rad: if kind == ImageKind::Camera { pointing } else { 0.0 },
        })?;
        let list = out.join(format!("{label}.jsonl"));
        sequences.push(navigate(&source, label, Some(&list), Some(&scenario.filter), ephemeris, watcher)?);
    }
    Ok(sequences)
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
