//! Random poses: which attitudes and planets are found, and how well.

use std::path::Path;

use glam::{DMat3, DQuat, DVec3};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution as _, StandardNormal};
use rayon::prelude::*;
use retina_batch::{Selection, Shard};
use retina_files::InputError;
use retina_sky::observer::Observer;
use retina_sky::planets::Planet;
use retina_sky::trajectory::FramePose;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::photograph::Photographer;
use super::scenario::{Images, Scenario};
use super::verdict::planet_verdict;
use crate::lines::{Line, append, list_name, read_done};
use retina_navigation::image::{ImageContext, solve_points};
use retina_navigation::planets::PriorPosition;
use retina_navigation::stars::{SolverOptions, StarSolver};
use retina_navigation::synthetic::sources;

pub(super) const ARCSEC: f64 = std::f64::consts::PI / 648_000.0;
/// Poses between two writes of the list.
const CHUNK: usize = 32;

/// What ends the experiment.
#[derive(Debug, Error)]
pub enum FarRangeError {
    /// Input that does not fit.
    #[error(transparent)]
    Input(#[from] InputError),
    /// The bench.
    #[error(transparent)]
    Bench(#[from] retina_bench::BenchError),
    /// The poses or the sky.
    #[error("{0}")]
    Sky(String),
}

/// What one pose gave.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PoseResult {
    /// Its index.
    pub pose: usize,
    /// The planet that the camera points at.
    pub planet: String,
    /// Points of light found.
    pub points: usize,
    /// `solved`, or why not.
    pub outcome: String,
    /// Stars matched.
    pub matches: usize,
    /// Errors of the attitude: across the boresight (length of both axes), about it, arcsec.
    pub cross_arcsec: Option<f64>,
    /// About the boresight.
    pub about_arcsec: Option<f64>,
    /// Squared Mahalanobis distance of the attitude's error, chi-square of three degrees of freedom. On the bench the
    /// setup's jitter counts beside the solution's covariance: the error is against the commanded attitude.
    pub attitude_distance2: Option<f64>,
    /// log10 of the bound on the chance of a false answer.
    pub log10_false_probability: Option<f64>,
    /// The pose's planet: `found`, `missed` or `wrong`; nothing where the attitude was not found.
    pub planet_outcome: Option<String>,
    /// Error of the planet's line of sight along inertial axes, arcsec.
    pub planet_arcsec: Option<f64>,
    /// Squared Mahalanobis distance of it, chi-square of two degrees of freedom.
    pub planet_distance2: Option<f64>,
    /// Its point is saturated.
    pub planet_saturated: Option<bool>,
    /// Where the camera would see the planet without any error, px; nothing where it is not shown.
    pub planet_px: Option<[f64; 2]>,
}

/// Runs the poses, or a shard's, that are not yet in `folder`'s lists, and returns them in order. The lists are
/// `poses.jsonl` and, of shards, `poses-I-of-N.jsonl`; one's own is written. `progress` hears how many are done.
///
/// # Errors
/// The folder holds another scenario's poses or cannot be written; the poses cannot be made.
pub fn run_poses(
    scenario: &Scenario,
    shard: Option<Shard>,
    folder: &Path,
    progress: &mut dyn FnMut(usize),
) -> Result<Vec<PoseResult>, FarRangeError> {
    let poses = scenario.deep_space();
    let (trajectory, planets) =
        poses.generate(&scenario.ephemeris).map_err(|error| FarRangeError::Sky(error.to_string()))?;
    let path = folder.join(list_name("poses", shard));
    let mut done = read_done::<PoseResult>(&path, &scenario.poses_hash)?;
    let photographer = Photographer::new(scenario)?;
    let middle_s = 0.5 * (poses.epochs_tdb_s[0] + poses.epochs_tdb_s[1]);
    let solver =
        StarSolver::new(photographer.camera(), SolverOptions { tdb_s: middle_s, ..SolverOptions::default() });
    let selection = Selection { shard, ..Selection::default() };
    let wanted = selection.frames(scenario.poses.count)?;
    let missing: Vec<usize> = wanted.iter().copied().filter(|at| !done.contains_key(at)).collect();
    let mut finished = wanted.len() - missing.len();
    progress(finished);
    for chunk in missing.chunks(CHUNK) {
        let results: Vec<PoseResult> = chunk
            .par_iter()
            .map(|&at| run_pose(scenario, &photographer, &solver, at, &trajectory.frames[at], planets[at]))
            .collect::<Result<_, FarRangeError>>()?;
        append(&path, &results)?;
        finished += results.len();
        done.extend(results.into_iter().map(|result| (result.pose, result)));
        progress(finished);
    }
    Ok(wanted.iter().filter_map(|pose| done.remove(pose)).collect())
}

impl Line for PoseResult {
    const SCHEMA: &str = "retina.far-range-poses/1";
    const OF: &str = "scenario";
    const WHAT: &str = "poses";

    fn number(&self) -> usize {
        self.pose
    }
}

fn run_pose(
    scenario: &Scenario,
    photographer: &Photographer,
    solver: &StarSolver,
    at: usize,
    pose: &FramePose,
    planet: Planet,
) -> Result<PoseResult, FarRangeError> {
    let sky = |error: &dyn std::fmt::Display| FarRangeError::Sky(error.to_string());
    let mut random = ChaCha8Rng::seed_from_u64(scenario.seed ^ 0x6661_725f_7261_6e67);
    random.set_stream(at as u64);
    let camera = photographer.camera();
    let observer =
        Observer::new(&scenario.ephemeris, pose.time_s, pose.camera_position_m, pose.camera_velocity_m_s)
            .map_err(|error| sky(&error))?;
    let shown =
        sources(&observer, pose.camera_from_inertial, &camera.pinhole, scenario.poses.faintest_magnitude)
            .map_err(|error| sky(&error))?;
    let sigma_m = scenario.poses.position_3_sigma_km * 1e3 / 3.0;
    let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
    let off = DVec3::new(normal(), normal(), normal()) * sigma_m;
    let assumed = Observer::new(
        &scenario.ephemeris,
        pose.time_s,
        pose.camera_position_m + off,
        pose.camera_velocity_m_s,
    )
    .map_err(|error| sky(&error))?;
    let points = photographer.points(&shown, at as u64, &mut random)?;
    let context = ImageContext {
        observer: Some(assumed.clone()),
        prior: Some(PriorPosition { observer: assumed, sigma_m }),
        ..ImageContext::default()
    };
    let result = solve_points(points, camera, solver, &context).map_err(|error| sky(&error))?;
    let mut out = PoseResult {
        pose: at,
        planet: planet.name().to_owned(),
        points: result.points.len(),
        outcome: "solved".to_owned(),
        matches: 0,
        cross_arcsec: None,
        about_arcsec: None,
        attitude_distance2: None,
        log10_false_probability: None,
        planet_outcome: None,
        planet_arcsec: None,
        planet_distance2: None,
        planet_saturated: None,
        planet_px: shown
            .iter()
            .find(|source| source.planet == Some(planet))
            .map(|source| camera.pinhole.pixel(source.line_of_sight).to_array()),
    };
    let solution = match &result.solution {
        Err(refusal) => {
            refusal.reason().clone_into(&mut out.outcome);
            return Ok(out);
        }
        Ok(solution) => solution,
    };
    let error = rotation(solution.camera_from_inertial(), pose.camera_from_inertial);
    let cross_arcsec = error.truncate().length() / ARCSEC;
    out.matches = solution.matches.len();
    out.cross_arcsec = Some(cross_arcsec);
    out.about_arcsec = Some(error.z.abs() / ARCSEC);
    let covariance = solution.attitude_covariance_rad2 + jitter_covariance_rad2(scenario);
    out.attitude_distance2 = Some(error.dot(covariance.inverse() * error));
    out.log10_false_probability = Some(solution.log10_false_probability);
    if cross_arcsec > scenario.poses.found_within_arcsec {
        "wrong".clone_into(&mut out.outcome);
        return Ok(out);
    }
    let verdict = planet_verdict(&result, planet, camera, &shown, pose.camera_from_inertial);
    out.planet_outcome = Some(verdict.outcome.to_owned());
    if let (Some(sight), Some(found)) = (verdict.sight, verdict.found) {
        out.planet_arcsec = Some(found.error_arcsec);
        out.planet_saturated = Some(found.saturated);
        let seen = solution.camera_from_inertial() * found.direction;
        let off = sight.line_of_sight - seen.truncate() / seen.z;
        out.planet_distance2 = Some(off.dot(sight.covariance_rad2.inverse() * off));
    }
    Ok(out)
}

/// Covariance of the bench's camera about its commanded attitude, rotation vector along camera axes: its jitter turns
/// stars and camera together, so no image shows it.
fn jitter_covariance_rad2(scenario: &Scenario) -> DMat3 {
    let jitter_rad = match scenario.images {
        Images::Bench => scenario.setup.noise.jitter_arcsec * ARCSEC,
        Images::Points | Images::Ideal => 0.0,
    };
    DMat3::from_diagonal(DVec3::new(1.0, 1.0, 0.0) * jitter_rad.powi(2))
}

/// The rotation vector from a true attitude to one that was found, camera axes, the short way round.
pub(super) fn rotation(found: DQuat, truth: DQuat) -> DVec3 {
    let off = found * truth.inverse();
    (if off.w < 0.0 { -off } else { off }).to_scaled_axis()
}

/// Rates and distributions of the poses.
#[derive(Debug, Clone, Serialize)]
pub struct PosesSummary {
    /// Poses.
    pub poses: usize,
    /// Attitudes found, per cent of all poses; the paper's is 98.22.
    pub attitude_found_percent: f64,
    /// Attitudes given that were wrong.
    pub attitude_wrong: usize,
    /// Poses refused, by reason.
    pub refused: std::collections::BTreeMap<String, usize>,
    /// Planets identified, per cent of the attitudes found; the paper's is 98.82.
    pub planet_found_percent: f64,
    /// Planets that were taken for another point.
    pub planet_wrong: usize,
    /// 50, 68, 95 and 99 % of the errors across the boresight are within, arcsec.
    pub cross_percentiles_arcsec: [f64; 4],
    /// And about it.
    pub about_percentiles_arcsec: [f64; 4],
    /// And of the planets' lines of sight.
    pub planet_percentiles_arcsec: [f64; 4],
    /// Standard deviation per axis of the planets' lines of sight, arcsec, from the median.
    pub planet_sigma_arcsec: f64,
    /// Mean squared Mahalanobis distance of the attitudes found, over 3: 1 where the covariance is right.
    pub attitude_nees_ratio: f64,
    /// And of planets' lines of sight, over 2.
    pub planet_nees_ratio: f64,
    /// Planets found whose point is saturated.
    pub planet_saturated: usize,
}

/// Summarises the poses.
pub fn summarise(results: &[PoseResult]) -> PosesSummary {
    let found: Vec<&PoseResult> = results.iter().filter(|r| r.outcome == "solved").collect();
    let of = |pick: fn(&PoseResult) -> Option<f64>| -> Vec<f64> {
        let mut values: Vec<f64> = found.iter().filter_map(|r| pick(r)).collect();
        values.sort_by(f64::total_cmp);
        values
    };
    let percentiles = |values: &[f64]| {
        [0.5, 0.68, 0.95, 0.99].map(|p: f64| {
            values
                .get(((values.len() as f64 * p) as usize).min(values.len().saturating_sub(1)))
                .copied()
                .unwrap_or(f64::NAN)
        })
    };
    // Not a number without any.
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let with = |outcome: &str| found.iter().filter(|r| r.planet_outcome.as_deref() == Some(outcome)).count();
    let mut refused = std::collections::BTreeMap::new();
    for result in results.iter().filter(|r| r.outcome != "solved" && r.outcome != "wrong") {
        *refused.entry(result.outcome.clone()).or_insert(0) += 1;
    }
    let planets = of(|r| r.planet_arcsec);
    PosesSummary {
        poses: results.len(),
        attitude_found_percent: 100.0 * found.len() as f64 / results.len().max(1) as f64,
        attitude_wrong: results.iter().filter(|r| r.outcome == "wrong").count(),
        refused,
        planet_found_percent: 100.0 * with("found") as f64 / found.len().max(1) as f64,
        planet_wrong: with("wrong"),
        cross_percentiles_arcsec: percentiles(&of(|r| r.cross_arcsec)),
        about_percentiles_arcsec: percentiles(&of(|r| r.about_arcsec)),
        planet_percentiles_arcsec: percentiles(&planets),
        // Median of a Rayleigh distribution: sigma sqrt(2 ln 2).
        planet_sigma_arcsec: percentiles(&planets)[0] / (2.0 * std::f64::consts::LN_2).sqrt(),
        attitude_nees_ratio: mean(&of(|r| r.attitude_distance2)) / 3.0,
        planet_saturated: found.iter().filter(|r| r.planet_saturated == Some(true)).count(),
        planet_nees_ratio: mean(&of(|r| r.planet_distance2)) / 2.0,
    }
}
