//! The whole experiment: flashes on ideal images and on those of the bench.

use std::path::Path;

use glam::DVec2;
use retina_batch::{BackendChoice, Selection};
use retina_bench::{Bench, Exposure, OpticsDetail, ScreenImage};
use retina_campaign::{camera_image, saturation_dn};
use retina_files::InputError;
use retina_formats::measured_or_power_law;
use retina_image::{DetectOptions, detect_points};
use retina_radiometry::irradiance_of_magnitude_w_m2_nm;
use retina_scene::{Compensation, Scene};
use retina_screen::PointPainter;

use super::report::Watched;
use super::scenario::FlashScenario;
use super::sequence::{CameraLight, watch_sequence};
use super::summary::summarise;
use crate::experiment::{Chain, ExperimentError, Watcher};
use crate::full_disk::{ImageKind, Source, SourceChoice};
use retina_navigation::flashes::ZeroPoint;
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
    let light = camera_light(&facility.bench(OpticsDetail::default())?, exposure_s)?;
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

/// Places along each side at which the camera's light is measured.
const PLACES: [u32; 2] = [5, 3];
/// Their magnitude beyond that of a pixel at full count: three pixels show it, as they show a flash.
const FAINTER_MAG: f64 = 1.0;
/// The places stand anywhere in their pixels: multiples of this, the golden ratio's fraction, are spread evenly.
const GOLDEN: f64 = 0.618_034;
/// Share of the full well that the measured points' brightest pixel fills.
const POINT_SHARE: f64 = 0.6;
/// The width is measured with a window of this standard deviation first, px.
const FIRST_SPOT_SIGMA_PX: f64 = 1.0;

/// Zero point for an exposure time, and width of spots: points of known irradiance over the screen, photographed once for
/// a time in which they do not saturate.
///
/// # Errors
/// The bench refuses the screen, or the points are not found.
fn camera_light(bench: &Bench, exposure_s: f64) -> Result<CameraLight, ExperimentError> {
    let setup = bench.setup();
    let [width, height] = [setup.screen.width_px, setup.screen.height_px];
    let magnitude = setup.brightest_magnitude() + FAINTER_MAG;
    let response = measured_or_power_law(None, setup);
    let painter = PointPainter::new(setup.facility_pinhole(), None, response);
    let mut counts = vec![0; (width * height) as usize];
    for k in 0..PLACES[0] * PLACES[1] {
        let at = |index: u32, places: u32, size: u32, turn: f64| {
            let middle = (f64::from(index) + 0.5) * f64::from(size) / f64::from(places);
            middle.floor() + (f64::from(k + 1) * GOLDEN * turn).fract()
        };
        let place = DVec2::new(
            at(k % PLACES[0], PLACES[0], width, 1.0),
            at(k / PLACES[0], PLACES[1], height, GOLDEN),
        );
        painter.draw(&mut counts, place, irradiance_of_magnitude_w_m2_nm(magnitude));
    }
    let screen = ScreenImage::grey(width, height, &counts);
    let light = bench.light_e(&screen, &Exposure::new(1.0, 0))?;
    let peak_e = f64::from(light.iter().copied().fold(0.0, f32::max));
    let short_s = POINT_SHARE * bench.sensor().full_well_e() / peak_e;
    let exposure = Exposure::new(short_s, 0);
    let image = camera_image(bench, bench.read(&light_at(&light, short_s), &exposure));
    let options = |sigma_px: f64| DetectOptions {
        threshold_sigma: 20.0,
        spot_sigma_px: Some(sigma_px),
        saturation_dn: Some(saturation_dn(bench)),
        gain_e_per_dn: Some(bench.sensor().gain_e_per_dn),
        ..DetectOptions::default()
    };
    let mut widths: Vec<f64> = detect_points(&image, &options(FIRST_SPOT_SIGMA_PX))
        .points
        .iter()
        .filter_map(|p| p.width_px)
        .collect();
    widths.sort_by(f64::total_cmp);
    let missing = || {
        InputError::new(&setup.file, "the points that measure the camera's zero point are not seen")
            .expected("points on the screen within the camera's field")
    };
    let spot_sigma_px = *widths.get(widths.len() / 2).ok_or_else(missing)?;
    let found = detect_points(&image, &options(spot_sigma_px)).points;
    let size_px = DVec2::new(f64::from(image.width_px), f64::from(image.height_px));
    let measured: Vec<(f64, f64)> = found
        .iter()
        .filter(|point| point.flux_dn > 0.0)
        .map(|point| {
            let zero = magnitude + 2.5 * (point.flux_dn * exposure_s / short_s).log10();
            (ZeroPoint::distance2(DVec2::new(point.x_px, point.y_px), size_px), zero)
        })
        .collect();
    let zero_point = zero_point_through(&measured).ok_or_else(missing)?;
    Ok(CameraLight { zero_point: Some(zero_point), spot_sigma_px })
}

/// The line of zero points over squared distances from the middle that leaves the least squares; `None` for none, or all
/// at one distance.
fn zero_point_through(measured: &[(f64, f64)]) -> Option<ZeroPoint> {
    let count = measured.len() as f64;
    let mean = |of: &dyn Fn(&(f64, f64)) -> f64| measured.iter().map(of).sum::<f64>() / count;
    let (distance, zero) = (mean(&|m| m.0), mean(&|m| m.1));
    let spread = mean(&|m| (m.0 - distance).powi(2));
    if spread.is_nan() || spread <= 0.0 {
        return None;
    }
    let slope = mean(&|m| (m.0 - distance) * (m.1 - zero)) / spread;
    Some(ZeroPoint { magnitude: zero - slope * distance, corner_magnitude: slope })
}

/// Electrons of an exposure from those of one second.
fn light_at(light_e_s: &[f32], exposure_s: f64) -> Vec<f32> {
    light_e_s.iter().map(|light| light * exposure_s as f32).collect()
}
