//! A sequence of frames, each measured by its limb; resumable.

use std::collections::BTreeMap;
use std::path::Path;

use glam::{DMat3, DVec3};
use retina_files::InputError;
use serde::{Deserialize, Serialize};

use super::source::Source;
use super::truth::FrameTruth;
use crate::frame_lines::{FrameLine, measure_frames};
use crate::lines::Line;
use retina_navigation::limb::{LimbOptions, solve_limb};

/// A position that a frame gave.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Position {
    /// The body's centre, camera frame, m.
    pub position_camera_m: [f64; 3],
    /// Less the truth, m.
    pub error_m: [f64; 3],
    /// Columns of the covariance, m^2.
    pub covariance_m2: [[f64; 3]; 3],
    /// Of the part that is new in each image.
    pub noise_covariance_m2: [[f64; 3]; 3],
    /// Normalised error squared: chi-square of three degrees of freedom where all is modelled.
    pub nees: f64,
    /// Outline in the undistorted image: its centre and mean radius, px.
    pub center_px: [f64; 2],
    /// Mean radius and its standard deviation.
    pub radius_px: [f64; 2],
    /// Root mean square of the limb points' residuals, px.
    pub rms_px: f64,
    /// Standard deviation beyond the points' noise, px.
    pub excess_px: f64,
    /// Standard deviation of the edge's blur, px.
    pub blur_px: f64,
    /// Length of the measured arc, deg.
    pub arc_deg: f64,
    /// Limb points in use.
    pub points: usize,
}

/// What one frame gave: a line of `frames.jsonl`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FrameResult {
    /// Its number.
    pub frame: usize,
    /// TDB seconds since J2000.
    pub time_s: f64,
    /// Sun, body, camera, deg.
    pub phase_deg: f64,
    /// True distance, m.
    pub distance_m: f64,
    /// `solved`, or the reason of the refusal.
    pub outcome: String,
    /// Why it was refused, in words.
    pub message: Option<String>,
    /// The position, where there is one.
    #[serde(flatten)]
    pub position: Option<Position>,
    /// Hash of its image and truth.
    pub inputs: String,
}

fn columns(matrix: DMat3) -> [[f64; 3]; 3] {
    matrix.to_cols_array_2d()
}

/// Measures one frame.
///
/// # Errors
/// Its image or truth do not fit.
pub fn navigate_frame(source: &Source, frame: usize) -> Result<FrameResult, InputError> {
    let truth = source.truth(frame)?;
    let inputs = source.frame_hash(frame)?;
    let image = source.image(frame)?;
    let options = LimbOptions {
        sun_direction_px: truth.sun_direction_px().or(source.choice.limb.sun_direction_px),
        ..source.choice.limb
    };
    let (outcome, message, position) =
        match solve_limb(&image, &source.camera, &source.limb_body(&truth), &options) {
            Err(refusal) => (refusal.reason().to_owned(), Some(refusal.to_string()), None),
            Ok(solution) => {
                let found = solution.position_camera_m;
                // An attitude that is off moves the body across the line of sight.
                let along = found.normalize();
                let outer = DMat3::from_cols(along * along.x, along * along.y, along * along.z);
                let pointing =
                    (DMat3::IDENTITY - outer) * (found.length() * source.choice.pointing_sigma_rad).powi(2);
                let covariance = solution.covariance_m2 + pointing;
                let error = found - truth.position_camera_m;
                let position = Position {
                    position_camera_m: found.to_array(),
                    error_m: error.to_array(),
                    covariance_m2: columns(covariance),
                    noise_covariance_m2: columns(solution.noise_covariance_m2 + pointing),
                    nees: error.dot(covariance.inverse() * error),
                    center_px: solution.ellipse.center_px.to_array(),
                    radius_px: solution.radius_px,
                    rms_px: solution.rms_px,
                    excess_px: solution.excess_sigma_px,
                    blur_px: solution.blur_sigma_px,
                    arc_deg: solution.arc_rad.to_degrees(),
                    points: solution.points.iter().filter(|point| point.used).count(),
                };
                ("solved".to_owned(), None, Some(position))
            }
        };
    Ok(result(&truth, outcome, message, position, inputs))
}

fn result(
    truth: &FrameTruth,
    outcome: String,
    message: Option<String>,
    position: Option<Position>,
    inputs: String,
) -> FrameResult {
    FrameResult {
        frame: truth.frame,
        time_s: truth.time_s,
        phase_deg: truth.phase_rad.to_degrees(),
        distance_m: truth.position_camera_m.length(),
        outcome,
        message,
        position,
        inputs,
    }
}

impl Line for FrameResult {
    const SCHEMA: &str = "retina.navigation-full-disk/1";
    const OF: &str = "sequence";
    const WHAT: &str = "frames";

    fn number(&self) -> usize {
        self.frame
    }
}

impl FrameLine for FrameResult {
    fn inputs(&self) -> &str {
        &self.inputs
    }
}

/// Measures the frames of a source that are not yet in `list` (a `frames.jsonl`), and returns all of them in order;
/// without a list nothing is kept. `progress` hears how many are done.
///
/// # Errors
/// A frame does not fit; the list is another sequence's or cannot be written.
pub fn navigate_sequence(
    source: &Source,
    list: Option<&Path>,
    progress: &mut dyn FnMut(usize),
) -> Result<Vec<FrameResult>, InputError> {
    measure_frames(source, &source.hash, list, |frame| navigate_frame(source, frame), progress)
}

/// Rates and distributions of a sequence.
#[derive(Debug, Clone, Serialize)]
pub struct SequenceSummary {
    /// Frames.
    pub frames: usize,
    /// With a position.
    pub solved: usize,
    /// Refused, by reason.
    pub refused: BTreeMap<String, usize>,
    /// Mean error along the camera's axes, km.
    pub bias_km: [f64; 3],
    /// Standard deviation about it, km.
    pub sigma_km: [f64; 3],
    /// Root mean square, km.
    pub rms_km: [f64; 3],
    /// 50, 68, 95 and 99 % of the absolute errors are within, km; by axis.
    pub percentiles_km: [[f64; 4]; 3],
    /// Root mean square of the centre's error across the line of sight, per axis, as an angle, arcsec.
    pub cross_rms_arcsec: f64,
    /// Mean and standard deviation of the error in range as a height of the whole limb, m: range error times radius
    /// over distance.
    pub height_m: [f64; 2],
    /// Mean normalised error squared over 3: 1 where the covariance is right.
    pub nees_ratio: f64,
    /// Share of the positions whose normalised error is within the 99 % bound of chi-square, 11.34.
    pub nees_within: f64,
}

/// 99 % of chi-square with three degrees of freedom are below (Abramowitz and Stegun, table 26.8).
pub const CHI2_3_99: f64 = 11.345;

/// Summarises a sequence of a body of `radius_m`.
pub fn summarise(results: &[FrameResult], radius_m: f64) -> SequenceSummary {
    let solved: Vec<(&FrameResult, &Position)> =
        results.iter().filter_map(|r| Some((r, r.position.as_ref()?))).collect();
    // Of nothing there is no mean: not a number in memory, null in files.
    let count = if solved.is_empty() { f64::NAN } else { solved.len() as f64 };
    let errors: Vec<DVec3> = solved.iter().map(|(_, p)| DVec3::from_array(p.error_m) * 1e-3).collect();
    let bias = errors.iter().sum::<DVec3>() / count;
    let square = errors.iter().map(|e| *e * *e).sum::<DVec3>() / count;
    let root = |v: DVec3| v.to_array().map(|v| if v < 0.0 { 0.0 } else { v.sqrt() });
    let mut refused = BTreeMap::new();
    for result in results.iter().filter(|r| r.position.is_none()) {
        *refused.entry(result.outcome.clone()).or_insert(0) += 1;
    }
    let heights: Vec<f64> = solved.iter().map(|(r, p)| -along(p) * radius_m / r.distance_m).collect();
    let mean = |values: &[f64]| values.iter().sum::<f64>() / count;
    let height = mean(&heights);
    let height_square = mean(&heights.iter().map(|h| (h - height).powi(2)).collect::<Vec<_>>());
    let cross: Vec<f64> = solved
        .iter()
        .map(|(r, p)| {
            let error = DVec3::from_array(p.error_m);
            (error.length_squared() - along(p).powi(2)).max(0.0) / (2.0 * r.distance_m * r.distance_m)
        })
        .collect();
    SequenceSummary {
        frames: results.len(),
        solved: solved.len(),
        refused,
        bias_km: bias.to_array(),
        sigma_km: root(square - bias * bias),
        rms_km: root(square),
        percentiles_km: [0, 1, 2]
            .map(|axis| percentiles(errors.iter().map(|e| e.to_array()[axis].abs()).collect())),
        cross_rms_arcsec: mean(&cross).sqrt().to_degrees() * 3600.0,
        height_m: [height, height_square.sqrt()],
        nees_ratio: mean(&solved.iter().map(|(_, p)| p.nees).collect::<Vec<_>>()) / 3.0,
        nees_within: mean(
            &solved.iter().map(|(_, p)| f64::from(u8::from(p.nees <= CHI2_3_99))).collect::<Vec<_>>(),
        ),
    }
}

/// Error along the line of sight, m.
fn along(position: &Position) -> f64 {
    let found = DVec3::from_array(position.position_camera_m);
    DVec3::from_array(position.error_m).dot(found.normalize())
}

/// 50, 68, 95 and 99 %.
pub(super) fn percentiles(mut values: Vec<f64>) -> [f64; 4] {
    values.sort_by(f64::total_cmp);
    [0.5, 0.68, 0.95, 0.99].map(|share: f64| {
        let at = ((values.len() as f64 * share) as usize).min(values.len().saturating_sub(1));
        values.get(at).copied().unwrap_or(f64::NAN)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_no_solution_there_is_no_error() {
        let summary = serde_json::to_value(summarise(&[], 1.0)).unwrap();
        assert_eq!(summary["rms_km"], serde_json::json!([null, null, null]));
        assert!(summary["nees_ratio"].is_null() && summary["solved"] == 0);
    }
}
