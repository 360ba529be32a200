//! `points.csv` from the bench: patterns shown, photographed, detected.

use std::path::Path;

use glam::DVec2;
use retina_bench::{Bench, BenchError, CameraFrame, Exposure, OpticsDetail, ScreenImage};
use retina_calibration::geometry::{Pattern, PatternOptions, PatternScreen};
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
    let bench = facility.bench(options.detail)?;
    let pattern_options = PatternOptions {
        points: options.points,
        screens: Some(options.exposures),
        counts: options.counts.clone(),
        channel: options.channel,
        seed: facility.seed,
        response: None,
    };
    let setup = &facility.setup;
    let pattern = Pattern::make(setup, &pattern_options)?;
    if let Some(folder) = keep {
        pattern.write(&folder.join("pattern"), setup, facility.seed)?;
        make_folder(&folder.join("images"))?;
    }
    let base_s = options.exposure_s.unwrap_or_else(|| well_exposed_s(&bench, &pattern));
    let mut result = PointsResult { table: PointsTable::default(), shown: 0, exposures_s: Vec::new() };
    let mut list = String::from("image,screen,exposure_s,time_s,temperature_c,camera_roll_deg\n");
    let roll_deg = facility.wrong.camera_roll_rad.to_degrees();
    for (index, screen) in pattern.screens.iter().enumerate() {
        let time_s = index as f64 * options.interval_s;
        let temperature_c = options.temperature.at_c(time_s);
        let exposure = Exposure {
            exposure_s: base_s * screen.exposure_ratio,
            temperature_c,
            pose: facility.dynamics.pose(
                bench.camera().pinhole.fx_px,
                time_s,
                temperature_c,
                facility.seed,
                index as u64,
            ),
            frame: index as u64,
        };
        let shown = screen_image(&pattern, screen, setup.screen.width_px, setup.screen.height_px);
        let frame = bench.expose(&shown, &exposure)?;
        let image = camera_image(&bench, frame);
        let name = screen.file.clone();
        if let Some(folder) = keep {
            image.write_png(&folder.join("images").join(&name))?;
            list.push_str(&format!(
                "{name},{name},{},{time_s},{temperature_c},{roll_deg}\n",
                exposure.exposure_s
            ));
        }
        let detect = DetectOptions {
            saturation_dn: Some(saturation_dn(&bench)),
            gain_e_per_dn: Some(bench.sensor().gain_e_per_dn),
            centroid: options.centroid,
            ..DetectOptions::default()
        };
        let found = detect_points(&image, &detect).points;
        for point in &screen.points {
            let Some(expected) = expected_px(&bench, options.channel, point.screen_px(), &exposure) else {
                continue;
            };
            result.shown += 1;
            let Some(seen) = nearest_point(&found, expected) else { continue };
            result.table.rows.push(PointRow {
                channel: options.channel,
                sigma_px: Some(seen.sigma_px),
                time_s: Some(time_s),
                temperature_c: Some(temperature_c),
                camera_roll_deg: Some(roll_deg),
                exposure_s: Some(exposure.exposure_s),
                flux_dn: Some(seen.flux_dn),
                saturated: seen.saturated,
                row_load: Some(pattern.row_load(index, point.row, setup.screen.width_px)),
                ..PointRow::new(
                    index,
                    point.screen_px(),
                    f64::from(point.digital_count),
                    DVec2::new(seen.x_px, seen.y_px),
                )
            });
        }
        result.table.images.push(name);
        result.exposures_s.push(exposure.exposure_s);
        progress(index + 1);
    }
    if let Some(folder) = keep {
        let path = folder.join("images").join("images.csv");
        retina_files::write_atomic(&path, list.as_bytes())
            .map_err(|error| InputError::new(&path, format!("cannot be written: {error}")))?;
    }
    Ok(result)
}

pub(crate) fn make_folder(path: &Path) -> Result<(), InputError> {
    std::fs::create_dir_all(path)
        .map_err(|error| InputError::new(path, format!("the folder cannot be made: {error}")))
}

/// The exposure of the faintest group at which the brightest point's peak fills 60 % of the full well,
/// wherever on the sensor it is sharpest.
fn well_exposed_s(bench: &Bench, pattern: &Pattern) -> f64 {
    let lit = pattern.channel.lit().len() as f64;
    let brightest = pattern
        .screens
        .iter()
        .flat_map(|screen| {
            screen.points.iter().map(move |point| {
                bench.display().levels[1][usize::from(point.digital_count)] * screen.exposure_ratio
            })
        })
        .fold(f64::MIN_POSITIVE, f64::max);
    0.6 * bench.sensor().full_well_e() / (lit * bench.sharpest_peak_e_s() * brightest)
}

/// Digital number from which a pixel counts as saturated: 99 % of what the sensor can give.
pub fn saturation_dn(bench: &Bench) -> f32 {
    0.99 * bench.sensor().saturation_dn() as f32
}

/// A screen of a pattern as the display takes it.
fn screen_image(pattern: &Pattern, screen: &PatternScreen, width_px: u32, height_px: u32) -> ScreenImage {
    let mut image = ScreenImage::dark(width_px, height_px);
    for point in &screen.points {
        image.set(point.column, point.row, pattern.channel.counts(point.digital_count));
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
