//! `points.csv` from the bench: patterns shown, photographed, detected.

use std::path::Path;

use glam::DVec2;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use retina_bench::{Bench, BenchError, CameraFrame, Exposure, OpticsDetail, ScreenImage};
use retina_calibration::geometry::{
    MeasurementPlan, Pattern, PatternOptions, PatternScreen, PlannedExposure,
};
use retina_files::InputError;
use retina_formats::{Channel, PointRow, PointsTable};
use retina_image::{CameraImage, Centroid, DetectOptions, LightPoint, Steps, detect_points};

use crate::{Facility, TemperatureProfile};

/// A campaign of points.
#[derive(Debug, Clone, PartialEq)]
pub struct PointsOptions {
    /// Exposures.
    pub exposures: usize,
    /// Points in each.
    pub points: usize,
    /// Between exposures, s.
    pub interval_s: f64,
    /// The bench's temperature.
    pub temperature: TemperatureProfile,
    /// Exposure time of the faintest group of counts, s; by default the brightest point's peak fills 60 % of
    /// the full well.
    pub exposure_s: Option<f64>,
    /// Sub-pixels that are lit.
    pub channel: Channel,
    /// Digital counts; every 0.75 mag where empty.
    pub counts: Vec<u8>,
    /// The estimator of centroids.
    pub centroid: Centroid,
    /// Detail of the optics.
    pub detail: OpticsDetail,
}

impl Default for PointsOptions {
    fn default() -> Self {
        Self {
            exposures: 40,
            points: 50,
            interval_s: 60.0,
            temperature: TemperatureProfile::default(),
            exposure_s: None,
            channel: Channel::W,
            counts: Vec::new(),
            centroid: Centroid::Windowed,
            detail: OpticsDetail::default(),
        }
    }
}

impl PointsOptions {
    /// Length of the campaign, s.
    pub fn length_s(&self) -> f64 {
        self.interval_s * self.exposures as f64
    }
}

/// What a campaign gave.
#[derive(Debug, Clone, PartialEq)]
pub struct PointsResult {
    /// The table.
    pub table: PointsTable,
    /// Points shown that the camera sees.
    pub shown: usize,
    /// Exposure time of each exposure, s.
    pub exposures_s: Vec<f64>,
}

/// How far from its expected place a point is looked for, camera px.
const NEAR_PX: f64 = 5.0;

/// Shows a pattern on the bench and measures it. `progress` is told the number of finished exposures;
/// `keep` is a folder for the pattern and the camera's images, so that the calibration can be run from them.
///
/// # Errors
/// The bench cannot be built, the pattern not be made, a file not be written.
pub fn simulate_points(
    facility: &Facility,
    options: &PointsOptions,
    keep: Option<&Path>,
    progress: impl Fn(usize),
) -> Result<PointsResult, BenchError> {
    let pattern_options = PatternOptions {
        points: options.points,
        screens: Some(options.exposures),
        counts: options.counts.clone(),
        channel: options.channel,
        seed: facility.seed,
        response: None,
    };
    let pattern = Pattern::make(&facility.setup, &pattern_options)?;
    let roll_deg = facility.wrong.camera_roll_rad.to_degrees();
    let exposures = (0..pattern.screens.len()).map(|index| {
        let time_s = index as f64 * options.interval_s;
        PlannedExposure {
            image: pattern.screens[index].file.clone(),
            screen: index,
            exposure_s: None,
            time_s: Some(time_s),
            temperature_c: Some(options.temperature.at_c(time_s)),
            camera_roll_deg: Some(roll_deg),
            mounting: None,
        }
    });
    let plan = MeasurementPlan { exposures: exposures.collect(), pattern };
    if let Some(folder) = keep {
        plan.pattern.write(&folder.join("pattern"), &facility.setup, facility.seed)?;
    }
    simulate_plan(facility, &plan, options, keep, progress)
}

/// Carries out planned exposures on the bench; `options` give their centroids, the optics' detail, and what the plan
/// leaves open. The camera's images go into `keep/images`.
///
/// # Errors
/// The bench cannot be built, a file not be written.
pub fn simulate_plan(
    facility: &Facility,
    plan: &MeasurementPlan,
    options: &PointsOptions,
    keep: Option<&Path>,
    progress: impl Fn(usize),
) -> Result<PointsResult, BenchError> {
    let MeasurementPlan { pattern, exposures } = plan;
    let mut benches: Vec<(f64, Bench)> = Vec::new();
    if let Some(folder) = keep {
        make_folder(&folder.join("images"))?;
    }
    let mut base_s = options.exposure_s;
    let mut result = PointsResult { table: PointsTable::default(), shown: 0, exposures_s: Vec::new() };
    let mut list = String::from("image,screen,exposure_s,time_s,temperature_c,camera_roll_deg,mounting\n");
    let own_roll_deg = facility.wrong.camera_roll_rad.to_degrees();
    for (index, planned) in exposures.iter().enumerate() {
        let roll_deg = planned.camera_roll_deg.unwrap_or(own_roll_deg);
        let at = match benches.iter().position(|(roll, _)| *roll == roll_deg) {
            Some(at) => at,
            None => {
                let mut rolled = facility.clone();
                rolled.wrong.camera_roll_rad = roll_deg.to_radians();
                benches.push((roll_deg, rolled.bench(options.detail)?));
                benches.len() - 1
            }
        };
        let bench = &benches[at].1;
        let screen = &pattern.screens[planned.screen];
        let time_s = planned.time_s.unwrap_or(index as f64 * options.interval_s);
        let temperature_c = planned.temperature_c.unwrap_or_else(|| options.temperature.at_c(time_s));
        let exposure_s = match planned.exposure_s {
            Some(exposure_s) => exposure_s,
            None => *base_s.get_or_insert_with(|| well_exposed_s(bench, pattern)) * screen.exposure_ratio,
        };
        let frame = frame_number(index, planned);
        let focal_px = bench.camera().pinhole.fx_px;
        let mut pose = facility.dynamics.pose(
            focal_px,
            roll_deg.to_radians(),
            time_s,
            temperature_c,
            facility.seed,
            frame,
        );
        pose.shift_px += mounted_anew_px(planned.mounting, facility.seed);
        let exposure = Exposure { exposure_s, temperature_c, pose, frame };
        let shown = screen_image(screen, facility.setup.screen.width_px, facility.setup.screen.height_px);
        let image = camera_image(bench, bench.expose(&shown, &exposure)?);
        if let Some(folder) = keep {
            image.write_png(&folder.join("images").join(&planned.image))?;
            list.push_str(&format!(
                "{},{},{exposure_s},{time_s},{temperature_c},{roll_deg},{}\n",
                planned.image,
                screen.file,
                planned.mounting.map_or_else(String::new, |number| number.to_string())
            ));
        }
        let detect = DetectOptions {
            saturation_dn: Some(saturation_dn(bench)),
            gain_e_per_dn: Some(bench.sensor().gain_e_per_dn),
            centroid: options.centroid,
            ..DetectOptions::default()
        };
        let found = detect_points(&image, &detect).points;
        for point in &screen.points {
            let Some(expected) = expected_px(bench, screen.channel, point.screen_px(), &exposure) else {
                continue;
            };
            result.shown += 1;
            let Some(seen) = nearest_point(&found, expected) else { continue };
            result.table.rows.push(PointRow {
                channel: screen.channel,
                sigma_px: Some(seen.sigma_px),
                time_s: Some(time_s),
                temperature_c: Some(temperature_c),
                camera_roll_deg: Some(roll_deg),
                mounting: planned.mounting,
                exposure_s: Some(exposure_s),
                flux_dn: Some(seen.flux_dn),
                saturated: seen.saturated,
                row_load: Some(pattern.row_load(planned.screen, point.row, facility.setup.screen.width_px)),
                ..PointRow::new(
                    index,
                    point.screen_px(),
                    f64::from(point.digital_count),
                    DVec2::new(seen.x_px, seen.y_px),
                )
            });
        }
        result.table.images.push(planned.image.clone());
        result.exposures_s.push(exposure_s);
        progress(index + 1);
    }
    if let Some(folder) = keep {
        let path = folder.join("images").join("images.csv");
        retina_files::write_atomic(&path, list.as_bytes())
            .map_err(|error| InputError::new(&path, format!("cannot be written: {error}")))?;
    }
    Ok(result)
}

/// Two exposures of one number have the same noise: those of a follow-up, which has times of its own, are others.
fn frame_number(index: usize, planned: &PlannedExposure) -> u64 {
    match planned.mounting {
        None => index as u64,
        Some(_) => (1 << 32) + planned.time_s.unwrap_or_default() as u64,
    }
}

/// Standard deviation of the image's place when the camera is mounted anew, camera px.
const MOUNTED_WITHIN_PX: f64 = 1.5;

/// Where the image lies when the camera was mounted for the n-th time, beside where it lay at first.
fn mounted_anew_px(mounting: Option<f64>, seed: u64) -> DVec2 {
    let Some(number) = mounting.filter(|number| *number > 0.0) else { return DVec2::ZERO };
    let mut random = ChaCha8Rng::seed_from_u64(seed ^ 0x6d6f_756e_7465_6400);
    random.set_stream(number as u64);
    let mut axis = || -> f64 { StandardNormal.sample(&mut random) };
    MOUNTED_WITHIN_PX * DVec2::new(axis(), axis())
}

pub(crate) fn make_folder(path: &Path) -> Result<(), InputError> {
    std::fs::create_dir_all(path)
        .map_err(|error| InputError::new(path, format!("the folder cannot be made: {error}")))
}

/// The exposure of the faintest group at which the brightest point's peak fills 60 % of the full well,
/// wherever on the sensor it is sharpest.
fn well_exposed_s(bench: &Bench, pattern: &Pattern) -> f64 {
    let brightest = pattern
        .screens
        .iter()
        .flat_map(|screen| {
            let lit = screen.channel.lit().len() as f64;
            screen.points.iter().map(move |point| {
                lit * bench.display().levels[1][usize::from(point.digital_count)] * screen.exposure_ratio
            })
        })
        .fold(f64::MIN_POSITIVE, f64::max);
    0.6 * bench.sensor().full_well_e() / (bench.sharpest_peak_e_s() * brightest)
}

/// Digital number from which a pixel counts as saturated: 99 % of what the sensor can give.
pub fn saturation_dn(bench: &Bench) -> f32 {
    0.99 * bench.sensor().saturation_dn() as f32
}

/// A screen of a pattern as the display takes it.
pub fn screen_image(screen: &PatternScreen, width_px: u32, height_px: u32) -> ScreenImage {
    let mut image = ScreenImage::dark(width_px, height_px);
    for point in &screen.points {
        image.set(point.column, point.row, screen.channel.counts(point.digital_count));
    }
    image
}

/// A frame of the bench as the image that a camera would store.
pub fn camera_image(bench: &Bench, frame: CameraFrame) -> CameraImage {
    CameraImage {
        width_px: frame.width_px as u32,
        height_px: frame.height_px as u32,
        values: frame.dn.iter().map(|&dn| f32::from(dn)).collect(),
        full_scale_dn: f32::from(bench.sensor().largest_dn()),
        steps: Steps::Whole,
    }
}

/// Where a pixel's light lands, its channels' mean; `None` beyond the sensor.
fn expected_px(bench: &Bench, channel: Channel, screen_px: DVec2, exposure: &Exposure) -> Option<DVec2> {
    let mut sum = DVec2::ZERO;
    for c in channel.lit() {
        let stripe = bench.display().stripe_px[c];
        sum += DVec2::from_array(bench.land_px([screen_px.x + stripe, screen_px.y], c, exposure)?);
    }
    let at = sum / channel.lit().len() as f64;
    let camera = &bench.camera().pinhole;
    let inside =
        at.x > 0.0 && at.y > 0.0 && at.x < f64::from(camera.width_px) && at.y < f64::from(camera.height_px);
    inside.then_some(at)
}

fn nearest_point(found: &[LightPoint], expected: DVec2) -> Option<&LightPoint> {
    let distance = |point: &LightPoint| DVec2::new(point.x_px, point.y_px).distance(expected);
    let nearest = found.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
    (distance(nearest) < NEAR_PX && !nearest.blended).then_some(nearest)
}
