//! Stars as the facility shows them: commanded through a calibration, photographed, measured. What a
//! navigation test on the facility stands on.

use std::fmt::Write as _;

use glam::DVec2;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use retina_bench::{BenchError, Exposure, OpticsDetail, ScreenImage};
use retina_formats::{Calibration, measured_or_power_law};
use retina_image::{CameraImage, Centroid, DetectOptions, detect_points};
use retina_radiometry::irradiance_of_magnitude_w_m2_nm;
use retina_screen::PointPainter;

use crate::points::{camera_image, saturation_dn};
use crate::{Facility, TemperatureProfile};

/// Fields of stars at random places.
#[derive(Debug, Clone, PartialEq)]
pub struct StarsOptions {
    /// Exposures.
    pub exposures: usize,
    /// Stars in each.
    pub stars: usize,
    /// Brightest and faintest magnitude.
    pub magnitudes: [f64; 2],
    /// Exposure time, s; by default the brightest star's peak fills 60 % of the full well.
    pub exposure_s: Option<f64>,
    /// Between exposures, s.
    pub interval_s: f64,
    /// The bench's temperature.
    pub temperature: TemperatureProfile,
    /// The estimator of centroids.
    pub centroid: Centroid,
    /// Detail of the optics.
    pub detail: OpticsDetail,
}

impl Default for StarsOptions {
    fn default() -> Self {
        Self {
            exposures: 20,
            stars: 100,
            magnitudes: [2.0, 5.5],
            exposure_s: None,
            interval_s: 60.0,
            temperature: TemperatureProfile::Constant,
            centroid: Centroid::Windowed,
            detail: OpticsDetail::default(),
        }
    }
}

/// A star that was found again.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StarRow {
    /// The exposure.
    pub image: usize,
    /// Commanded line of sight, tangents.
    pub line_of_sight: DVec2,
    /// Commanded magnitude.
    pub magnitude: f64,
    /// Magnitude that the counts hold.
    pub displayed_magnitude: f64,
    /// Measured less commanded line of sight, rad, along x and y of the tangent plane at the star.
    pub error_rad: DVec2,
    /// Measured magnitude, the camera's sensitivity being known.
    pub measured_magnitude: f64,
    /// Standard deviation of the centroid, rad an axis.
    pub sigma_rad: f64,
    /// A pixel was saturated.
    pub saturated: bool,
}

/// What the fields gave.
#[derive(Debug, Clone, PartialEq)]
pub struct StarsResult {
    /// Stars found again.
    pub rows: Vec<StarRow>,
    /// Stars shown.
    pub shown: usize,
    /// Exposure time, s.
    pub exposure_s: f64,
}

/// Nearest two stars may stand, screen px.
const APART_PX: f64 = 40.0;
/// Radius within which a star's light is summed, camera px: the widest spots of a facility of stock doublets.
const APERTURE_PX: f64 = 13.0;
/// How far from its commanded place a star is looked for, camera px: beyond that it counts as lost.
const NEAR_PX: f64 = 12.0;

/// Shows fields of stars through a calibration and measures them; without one, uncompensated.
///
/// # Errors
/// The bench cannot be built.
pub fn simulate_stars(
    facility: &Facility,
    calibration: Option<&Calibration>,
    options: &StarsOptions,
    progress: impl Fn(usize),
) -> Result<StarsResult, BenchError> {
    let bench = facility.bench(options.detail)?;
    let setup = &facility.setup;
    let k_f = setup.facility_pinhole();
    let response = calibration
        .map_or_else(|| measured_or_power_law(None, setup), |calibration| calibration.screen_response(setup));
    let painter = PointPainter::new(k_f, calibration.map(|c| c.distortion.clone()), response.clone())
        .with_inverse(calibration.and_then(|c| c.inverse.clone()));
    let camera = setup.camera_pinhole();
    let exposure_s = options.exposure_s.unwrap_or_else(|| {
        // Three pixels share a star's light; its peak is at most that of one that has it all.
        let share = irradiance_of_magnitude_w_m2_nm(options.magnitudes[0]) / response.brightest_w_m2_nm();
        0.6 * bench.sensor().full_well_e() / (3.0 * bench.sharpest_peak_e_s() * share)
    });
    let mut random = ChaCha8Rng::seed_from_u64(facility.seed ^ 0x0073_7461_7273);
    let mut uniform = move || (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64;
    let mut result = StarsResult { rows: Vec::new(), shown: 0, exposure_s };
    for image in 0..options.exposures {
        let mut counts = vec![0u8; (k_f.width_px * k_f.height_px) as usize];
        let mut shown: Vec<(DVec2, f64, f64, DVec2)> = Vec::new();
        let mut tries = 0;
        while shown.len() < options.stars && tries < 50 * options.stars {
            tries += 1;
            // Ten pixels inside the camera's edge.
            let at = |size: u32, u: f64| 10.0 + (f64::from(size) - 20.0) * u;
            let seen = DVec2::new(at(camera.width_px, uniform()), at(camera.height_px, uniform()));
            let [bright, faint] = options.magnitudes;
            let magnitude = bright + (faint - bright) * uniform();
            let line_of_sight = camera.line_of_sight(seen);
            let wanted = irradiance_of_magnitude_w_m2_nm(magnitude);
            let Some(screen) = painter.screen_px(line_of_sight, wanted) else { continue };
            // A star needs its three pixels, and room about it.
            let inside = screen.x > 2.0
                && screen.y > 2.0
                && screen.x < f64::from(k_f.width_px) - 2.0
                && screen.y < f64::from(k_f.height_px) - 2.0;
            if !inside || shown.iter().any(|other| other.3.distance(screen) < APART_PX) {
                continue;
            }
            if let Some(drawn) = painter.draw(&mut counts, screen, wanted) {
                let displayed = retina_radiometry::magnitude_of_irradiance(drawn.splat.displayed_w_m2_nm);
                shown.push((line_of_sight, magnitude, displayed, screen));
            }
        }
        let time_s = image as f64 * options.interval_s;
        let temperature_c = options.temperature.at_c(time_s);
        let pose = facility.dynamics.pose(
            camera.fx_px,
            facility.wrong.camera_roll_rad,
            time_s,
            temperature_c,
            facility.seed,
            image as u64,
        );
        let exposure = Exposure { exposure_s, temperature_c, pose, frame: image as u64 };
        let screen = ScreenImage::grey(k_f.width_px, k_f.height_px, &counts);
        let frame = bench.expose(&screen, &exposure)?;
        let photograph = camera_image(&bench, frame);
        let found = detect_points(
            &photograph,
            &DetectOptions {
                saturation_dn: Some(saturation_dn(&bench)),
                gain_e_per_dn: Some(bench.sensor().gain_e_per_dn),
                centroid: options.centroid,
                ..DetectOptions::default()
            },
        );
        result.shown += shown.len();
        for (line_of_sight, magnitude, displayed_magnitude, _) in shown {
            let expected = camera.pixel(line_of_sight);
            let distance = |x: f64, y: f64| DVec2::new(x, y).distance(expected);
            let nearest = found
                .points
                .iter()
                .min_by(|a, b| distance(a.x_px, a.y_px).total_cmp(&distance(b.x_px, b.y_px)));
            let Some(point) = nearest.filter(|p| distance(p.x_px, p.y_px) < NEAR_PX && !p.blended) else {
                continue;
            };
            let measured = camera.line_of_sight(DVec2::new(point.x_px, point.y_px));
            let light_dn = aperture_dn(&photograph, [point.x_px, point.y_px]);
            let electrons_s = light_dn * bench.sensor().gain_e_per_dn / exposure_s;
            // A star off the axis sees the pupil foreshortened.
            let foreshortened = 1.0 / (1.0 + line_of_sight.length_squared()).sqrt();
            result.rows.push(StarRow {
                image,
                line_of_sight,
                magnitude,
                displayed_magnitude,
                error_rad: angular(measured, line_of_sight),
                measured_magnitude: -2.5 * (electrons_s / (bench.star_e_s(0.0) * foreshortened)).log10(),
                sigma_rad: point.sigma_px / camera.fx_px,
                saturated: point.saturated,
            });
        }
        progress(image + 1);
    }
    Ok(result)
}

/// Light within [`APERTURE_PX`] of a place, above the median of a ring about it, DN; pixels beyond the image count as
/// dark.
fn aperture_dn(image: &CameraImage, [x, y]: [f64; 2]) -> f64 {
    let reach = 1.8 * APERTURE_PX;
    let span = |v: f64, size: u32| {
        (v - reach).max(0.0) as usize..((v + reach).ceil().max(0.0) as usize).min(size as usize)
    };
    let (mut inside, mut pixels) = (0.0, 0.0);
    let mut ring = Vec::new();
    for row in span(y, image.height_px) {
        for column in span(x, image.width_px) {
            let off = (column as f64 + 0.5 - x).hypot(row as f64 + 0.5 - y);
            let value = f64::from(image.at(column, row));
            if off < APERTURE_PX {
                inside += value;
                pixels += 1.0;
            } else if off > 1.3 * APERTURE_PX && off < reach {
                ring.push(value);
            }
        }
    }
    ring.sort_by(f64::total_cmp);
    // The mean of the middle half: a median of whole numbers would be off by up to half of one.
    let middle = &ring[ring.len() / 4..(3 * ring.len()).div_ceil(4)];
    inside - pixels * middle.iter().sum::<f64>() / middle.len().max(1) as f64
}

/// The angle from one line of sight to another, as a small vector: its length is the great-circle angle.
fn angular(measured: DVec2, intended: DVec2) -> DVec2 {
    let (a, b) = (measured.extend(1.0).normalize(), intended.extend(1.0).normalize());
    let angle = a.cross(b).length().atan2(a.dot(b));
    let toward = measured - intended;
    if toward == DVec2::ZERO { toward } else { toward.normalize() * angle }
}

impl StarsResult {
    /// Angular errors of the stars that are not saturated, arcsec, rising.
    pub fn errors_arcsec(&self) -> Vec<f64> {
        let mut errors: Vec<f64> = self
            .rows
            .iter()
            .filter(|row| !row.saturated)
            .map(|row| row.error_rad.length().to_degrees() * 3600.0)
            .collect();
        errors.sort_by(f64::total_cmp);
        errors
    }

    /// The rows as CSV.
    pub fn csv(&self) -> String {
        let mut text = String::from(
            "image,los_x,los_y,magnitude,displayed_magnitude,measured_magnitude,error_x_arcsec,error_y_arcsec,\
             sigma_arcsec,saturated\n",
        );
        for row in &self.rows {
            let error = row.error_rad * (1f64.to_degrees() * 3600.0);
            // Writing to a string cannot fail.
            let _ = writeln!(
                text,
                "{},{:.9},{:.9},{:.4},{:.4},{:.4},{:.4},{:.4},{:.4},{}",
                row.image,
                row.line_of_sight.x,
                row.line_of_sight.y,
                row.magnitude,
                row.displayed_magnitude,
                row.measured_magnitude,
                error.x,
                error.y,
                row.sigma_rad.to_degrees() * 3600.0,
                u8::from(row.saturated)
            );
        }
        text
    }
}
