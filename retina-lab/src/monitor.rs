//! Whether a calibration still holds: reference points, looked at now and then.

mod record;

use std::path::{Path, PathBuf};

use faer::Mat;
use faer::linalg::solvers::SolveLstsq as _;
use glam::DVec2;
use retina_bench::ScreenImage;
use retina_calibration::geometry::{Pattern, PatternOptions};
use retina_campaign::screen_image;
use retina_formats::{Calibration, Channel, log10_irradiance};
use retina_geometry::Setup;

use crate::capture::unix_s;
use crate::spots::{Spot, photographed_spots};
use crate::{LabError, Rig, find_exposure};
pub use record::monitor_figure;
use record::{Log, Reference};

/// What is measured, and what may change.
#[derive(Debug, Clone, PartialEq)]
pub struct MonitorOptions {
    /// Reference points on the screen.
    pub points: usize,
    /// Exposures of a round.
    pub exposures: usize,
    /// Largest RMS error of the points, arcsec.
    pub within_arcsec: f64,
    /// Largest change of their light, of itself.
    pub within_light: f64,
    /// Largest change of their width, of itself.
    pub within_width: f64,
}

impl Default for MonitorOptions {
    /// The paper's goal for lines of sight; light and width by what spots scatter in practice.
    fn default() -> Self {
        Self { points: 80, exposures: 4, within_arcsec: 10.0, within_light: 0.05, within_width: 0.2 }
    }
}

/// What a round saw. Angles are beside the reference: the calibration, or the first round where there is none.
#[derive(Debug, Clone, PartialEq)]
pub struct MonitorReading {
    /// Unix time, s.
    pub unix_s: f64,
    /// Temperature of the camera, degC.
    pub temperature_c: Option<f64>,
    /// Points that were seen.
    pub points: usize,
    /// The scene has moved by so much, along the camera's x and y, arcsec.
    pub boresight_arcsec: [f64; 2],
    /// It has turned about the boresight by so much, from x towards y, arcsec.
    pub roll_arcsec: f64,
    /// It is larger by so much, parts in a million.
    pub scale_ppm: f64,
    /// RMS error of the points' lines of sight, arcsec.
    pub rms_arcsec: f64,
    /// ... what is left of it without shift, roll and scale, arcsec.
    pub left_arcsec: f64,
    /// Median width of the spots (standard deviation), camera px.
    pub width_px: f64,
    /// Light over that of the first round.
    pub light: f64,
    /// What has changed too much, a sentence each.
    pub alarms: Vec<String>,
}

/// Fewest points that tell a shift, a roll and a scale.
const FEWEST: usize = 8;
const ARCSEC_PER_RAD: f64 = 648_000.0 / std::f64::consts::PI;

/// Looks at reference points, round by round. Its folder holds `monitor.csv`, a line a round; `monitor.svg`; and
/// `reference.csv`, the points of the first round.
pub struct Monitor {
    setup: Setup,
    options: MonitorOptions,
    calibration: Option<Calibration>,
    pattern: Pattern,
    image: ScreenImage,
    folder: PathBuf,
    reference: Option<Reference>,
    log: Log,
}

impl Monitor {
    /// Begins in `folder`, or goes on there.
    ///
    /// # Errors
    /// A file cannot be read or written; the folder's reference is of other points; the calibration has no inverse.
    pub fn open(
        setup: &Setup,
        calibration: Option<Calibration>,
        options: MonitorOptions,
        folder: &Path,
    ) -> Result<Self, LabError> {
        if let Some(calibration) = calibration.as_ref().filter(|calibration| calibration.inverse.is_none()) {
            return Err(crate::calibrate::no_inverse(calibration).into());
        }
        let wanted = PatternOptions {
            points: options.points,
            screens: Some(1),
            counts: vec![255],
            ..PatternOptions::default()
        };
        let pattern = Pattern::make(setup, &wanted)?;
        Ok(Self {
            setup: setup.clone(),
            options,
            image: screen_image(&pattern.screens[0], setup.screen.width_px, setup.screen.height_px),
            calibration,
            reference: Reference::read(folder, &pattern)?,
            pattern,
            folder: folder.into(),
            log: Log::open(folder)?,
        })
    }

    /// Rounds so far, those of earlier runs included.
    pub fn readings(&self) -> &[MonitorReading] {
        &self.log.readings
    }

    /// Photographs the points and says what has changed. The screen is dark afterwards.
    ///
    /// # Errors
    /// A device fails, the user wants an end, a file cannot be written, or the first round does not see the points.
    pub fn round(&mut self, rig: &mut Rig<'_>) -> Result<MonitorReading, LabError> {
        let exposure_s = match &self.reference {
            Some(reference) => reference.exposure_s,
            None => find_exposure(rig, &self.image, 0.01)?,
        };
        let at_s = unix_s();
        let shown = (&self.pattern, &self.image);
        let exposures = (self.options.exposures, exposure_s);
        let spots = photographed_spots(rig, shown, &self.setup, exposures, |_, _| {})?;
        let temperature_c = rig.take(exposure_s)?.temperature_c;
        rig.screen.show(&ScreenImage::dark(self.image.width_px, self.image.height_px))?;
        let spots = spots.unwrap_or_else(|| vec![None; self.pattern.screens[0].points.len()]);
        let sights = self.sights(&spots);
        let reference = match self.reference.take() {
            Some(reference) => reference,
            None => {
                let seen = spots.iter().flatten().count();
                if 2 * seen < spots.len() || seen < FEWEST {
                    return Err(LabError::Camera {
                        camera: rig.camera.name(),
                        problem: format!(
                            "sees {seen} of {} reference points. Is the bench in focus, and does the camera see the \
                             screen? `retina lab check` says more",
                            spots.len()
                        ),
                    });
                }
                Reference::write(&self.folder, &self.pattern, exposure_s, &sights, &spots)?
            }
        };
        let reading = self.reading(&reference, &spots, &sights, at_s, temperature_c);
        self.reference = Some(reference);
        self.log.append(&reading)?;
        Ok(reading)
    }

    /// Lines of sight of the spots, as the calibration has them.
    fn sights(&self, spots: &[Option<Spot>]) -> Vec<Option<DVec2>> {
        let camera = self.setup.camera_pinhole();
        let inverse = self.calibration.as_ref().and_then(|calibration| {
            let light = log10_irradiance(&calibration.screen_response(&self.setup), Channel::W, 255.0);
            calibration.inverse.as_ref().map(|inverse| (inverse, light))
        });
        let sight = |spot: &Spot| {
            let raw = camera.line_of_sight(spot.at_px);
            inverse.map_or(raw, |(inverse, light)| inverse.undistort(raw, light))
        };
        spots.iter().map(|spot| spot.as_ref().map(sight)).collect()
    }

    fn reading(
        &self,
        reference: &Reference,
        spots: &[Option<Spot>],
        sights: &[Option<DVec2>],
        unix_s: f64,
        temperature_c: Option<f64>,
    ) -> MonitorReading {
        let facility = self.setup.facility_pinhole();
        let shown = &self.pattern.screens[0].points;
        let (mut pairs, mut widths, mut lights) = (Vec::new(), Vec::new(), Vec::new());
        for (place, (spot, sight)) in spots.iter().zip(sights).enumerate() {
            let (Some(spot), Some(sight), Some(first)) = (spot, sight, &reference.points[place]) else {
                continue;
            };
            let expected = match self.calibration {
                Some(_) => facility.line_of_sight(shown[place].screen_px()),
                None => first.sight,
            };
            pairs.push((expected, *sight));
            widths.push((spot.variance_px2.sqrt(), first.variance_px2.sqrt()));
            lights.push(spot.flux_dn / first.flux_dn);
        }
        let drift = Drift::fit(&pairs);
        let median = |mut values: Vec<f64>| {
            values.sort_by(f64::total_cmp);
            values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
        };
        let width_px = median(widths.iter().map(|width| width.0).collect());
        let first_px = median(widths.iter().map(|width| width.1).collect());
        let mut reading = MonitorReading {
            unix_s,
            temperature_c,
            points: pairs.len(),
            boresight_arcsec: [drift.state[0], drift.state[1]].map(|angle| angle * ARCSEC_PER_RAD),
            roll_arcsec: drift.state[2] * ARCSEC_PER_RAD,
            scale_ppm: drift.state[3] * 1e6,
            rms_arcsec: drift.rms_rad * ARCSEC_PER_RAD,
            left_arcsec: drift.left_rad * ARCSEC_PER_RAD,
            width_px,
            light: median(lights),
            alarms: Vec::new(),
        };
        reading.alarms = self.alarms(&reading, reference, width_px / first_px);
        reading
    }

    fn alarms(&self, reading: &MonitorReading, reference: &Reference, wider: f64) -> Vec<String> {
        let options = &self.options;
        let mut alarms = Vec::new();
        let all = reference.points.iter().flatten().count();
        if reading.points < FEWEST || 2 * reading.points < all {
            alarms.push(format!("{} of {all} reference points are seen", reading.points));
            return alarms;
        }
        if reading.rms_arcsec.is_nan() || reading.rms_arcsec > options.within_arcsec {
            let [x, y] = reading.boresight_arcsec;
            alarms.push(format!(
                "lines of sight are off by {:.2} arcsec RMS: shift {x:+.2}, {y:+.2} arcsec, roll {:+.1} arcsec, scale \
                 {:+.0} ppm; without these {:.2} arcsec are left",
                reading.rms_arcsec, reading.roll_arcsec, reading.scale_ppm, reading.left_arcsec
            ));
        }
        if reading.light.is_nan() || (reading.light - 1.0).abs() > options.within_light {
            alarms.push(format!("the light has changed by {:+.1} %", 100.0 * (reading.light - 1.0)));
        }
        if wider.is_nan() || (wider - 1.0).abs() > options.within_width {
            alarms.push(format!(
                "the spots' width has changed by {:+.0} %: is the bench in focus?",
                100.0 * (wider - 1.0)
            ));
        }
        alarms
    }
}

/// A turn of the camera and a scale, small, by least squares.
struct Drift {
    /// Shift along x and y, roll, rad; scale.
    state: [f64; 4],
    rms_rad: f64,
    left_rad: f64,
}

impl Drift {
    /// From lines of sight (tangents) that were expected and those that were seen. A turn by a about y moves (x, y) by
    /// a (1 + x^2, x y), one about x by b (x y, 1 + y^2); roll by c (-y, x); scale by s (x, y).
    fn fit(pairs: &[(DVec2, DVec2)]) -> Self {
        if pairs.len() < FEWEST {
            return Self { state: [f64::NAN; 4], rms_rad: f64::NAN, left_rad: f64::NAN };
        }
        let basis = |at: DVec2| {
            let DVec2 { x, y } = at;
            [[1.0 + x * x, x * y, -y, x], [x * y, 1.0 + y * y, x, y]]
        };
        let matrix = Mat::from_fn(2 * pairs.len(), 4, |row, column| basis(pairs[row / 2].0)[row % 2][column]);
        let right = Mat::from_fn(2 * pairs.len(), 1, |row, _| {
            let (expected, seen) = pairs[row / 2];
            (seen - expected)[row % 2]
        });
        let solution = matrix.qr().solve_lstsq(&right);
        let left = &right - &matrix * &solution;
        // Tangents off the axis are longer than their angles.
        let angle = |row: usize, value: f64| {
            let (expected, _) = pairs[row / 2];
            value / (1.0 + expected.length_squared())
        };
        let rms = |of: &dyn Fn(usize) -> f64| {
            let sum: f64 = (0..2 * pairs.len()).map(|row| angle(row, of(row)).powi(2)).sum();
            (sum / pairs.len() as f64).sqrt()
        };
        Self {
            state: std::array::from_fn(|k| solution[(k, 0)]),
            rms_rad: rms(&|row| right[(row, 0)]),
            left_rad: rms(&|row| left[(row, 0)]),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_drift_comes_apart() {
        let truth = [2e-4, -1e-4, 3e-4, -5e-4];
        let mut pairs = Vec::new();
        for k in 0..40 {
            let at = DVec2::new(0.14 * (f64::from(k) * 0.7).sin(), 0.1 * (f64::from(k) * 1.3).cos());
            // The exact turns, one after another.
            let turned = glam::DQuat::from_rotation_y(truth[0])
                * glam::DQuat::from_rotation_x(-truth[1])
                * glam::DQuat::from_rotation_z(truth[2])
                * at.extend(1.0);
            pairs.push((at, (1.0 + truth[3]) * turned.truncate() / turned.z));
        }
        let drift = Drift::fit(&pairs);
        for (found, truth) in drift.state.iter().zip(truth) {
            assert!((found - truth).abs() < 1e-6, "{found} for {truth}");
        }
        assert!(drift.left_rad < 1e-6 && drift.rms_rad > 2e-4, "{} {}", drift.left_rad, drift.rms_rad);
    }
}
