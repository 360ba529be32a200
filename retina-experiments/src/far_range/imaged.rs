//! One run of a transfer's filter whose lines of sight come from images: photographed, solved, identified.

use std::path::Path;

use glam::{DMat3, DQuat, DVec2, DVec3};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rayon::prelude::*;
use retina_geometry::Pinhole;
use retina_sky::observer::Observer;
use retina_sky::planets::{Planet, seen_planet};
use serde::{Deserialize, Serialize};

use super::photograph::Photographer;
use super::poses::{ARCSEC, FarRangeError, rotation};
use super::scenario::{Images, Scenario};
use super::transfer::{Course, Standing, chi2_mean_bounds, not_definite};
use super::transfer_file::Transfer;
use super::verdict::planet_verdict;
use crate::lines::{Line, append, read_done};
use retina_navigation::filter::{Filter, PhaseState};
use retina_navigation::image::{ImageContext, solve_points};
use retina_navigation::planets::{PlanetSight, PriorPosition};
use retina_navigation::stars::{SolverOptions, StarPoint, StarSolver};
use retina_navigation::synthetic::uniform;
use retina_navigation::synthetic::{Source, sources};

/// What one image gave: a line of `transfer.jsonl`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct ImagedLine {
    /// Its number among the images that are taken.
    image: usize,
    /// The planet that the camera looks at.
    planet: String,
    /// Points of light found.
    points: usize,
    /// `solved`, `wrong`, or why not.
    outcome: String,
    /// The planet: `found`, `missed` or `wrong`; nothing where there is no attitude.
    planet_outcome: Option<String>,
    /// Its line of sight along inertial axes, as measured.
    direction: Option<DVec3>,
    /// The direction's covariance along inertial axes, rad^2; rank two.
    covariance_rad2: Option<DMat3>,
    /// Error of the line of sight, arcsec, where the planet was found.
    planet_arcsec: Option<f64>,
    /// The planet's point is saturated.
    planet_saturated: Option<bool>,
}

impl Line for ImagedLine {
    const SCHEMA: &str = "retina.far-range-transfer/1";
    const OF: &str = "scenario";
    const WHAT: &str = "images";

    fn number(&self) -> usize {
        self.image
    }
}

/// The filter at the end of a session.
#[derive(Debug, Clone, Serialize)]
pub struct ImagedSession {
    /// Since the beginning, days.
    pub day: f64,
    /// Error: km, m/s.
    pub error: [f64; 2],
    /// Three sigma (root of the covariance's trace): km, m/s.
    pub three_sigma: [f64; 2],
    /// Normalised estimation error squared; chi-square of six degrees of freedom.
    pub nees: f64,
    /// Lines of sight that were taken in.
    pub updates: usize,
    /// Their mean normalised innovation squared; 2 is expected.
    pub nis: Option<f64>,
}

/// A run of the filter on images.
#[derive(Debug, Clone, Serialize)]
pub struct ImagedResult {
    /// Images taken.
    pub images: usize,
    /// Attitudes found, and right.
    pub attitudes_found: usize,
    /// Planets identified, and right.
    pub planets_identified: usize,
    /// Attitudes and planets that were given and are not right; the filter has taken them in.
    pub wrong: usize,
    /// Planets identified whose point is saturated.
    pub planets_saturated: usize,
    /// Errors of the lines of sight: 50 and 95 % are within, arcsec.
    pub planet_percentiles_arcsec: Option<[f64; 2]>,
    /// Error at the end: km, m/s.
    pub final_error: [f64; 2],
    /// Three sigma at the end: km, m/s.
    pub final_three_sigma: [f64; 2],
    /// Mean normalised innovation squared over all lines of sight; 2 is expected.
    pub nis: Option<f64>,
    /// Its 99 % bounds.
    pub nis_bounds: [f64; 2],
    /// 99 % bounds of one session's NEES.
    pub nees_bounds: [f64; 2],
    /// Session by session.
    pub by_session: Vec<ImagedSession>,
}

/// One image, as the true path has it.
struct Shot {
    /// Its number among all that are taken.
    image: usize,
    tdb_s: f64,
    planet: Planet,
    camera_from_inertial: DQuat,
    shown: Vec<Source>,
}

/// Takes the transfer's images that are not yet in `folder`'s `transfer.jsonl`, solves them, and runs the filter over
/// all of them. The run has its own draw of the initial state and of the unknown acceleration. `progress` hears how
/// many images are done.
///
/// # Errors
/// The folder holds another scenario's images or cannot be written; the bench or the ephemeris refuses; a covariance
/// loses its positive definiteness.
pub fn run_imaged(
    scenario: &Scenario,
    transfer: &Transfer,
    images: Images,
    folder: &Path,
    progress: &mut dyn FnMut(usize),
) -> Result<ImagedResult, FarRangeError> {
    let path = folder.join("transfer.jsonl");
    let mut done = read_done::<ImagedLine>(&path, &scenario.transfer_hash)?;
    let course = Course::new(transfer, &scenario.ephemeris)?;
    let photographer = Photographer::new(&Scenario { images, ..scenario.clone() })?;
    let middle_s = transfer.arrival_tdb_s - 0.5 * transfer.length_s;
    let solver =
        StarSolver::new(photographer.camera(), SolverOptions { tdb_s: middle_s, ..SolverOptions::default() });
    let mut random = ChaCha8Rng::seed_from_u64(scenario.seed ^ 0x696d_6167_6564);
    let (mut truth, mut filter) = course.start(transfer, &mut random).ok_or_else(not_definite)?;
    let mut now_s = course.begin_s;
    let (mut lines, mut by_session) = (Vec::new(), Vec::new());
    let mut all_nis = (0.0, 0);
    for (number, session) in course.sessions.iter().enumerate() {
        let mut shots = Vec::new();
        for k in 0..transfer.imaged_per_session {
            let at = k * transfer.images_per_session / transfer.imaged_per_session;
            let tdb_s = session.tdb_s + at as f64 * transfer.interval_s;
            truth = course.pulled(truth, [now_s, tdb_s], transfer.acceleration_sigma_m_s2, &mut random);
            now_s = tdb_s;
            if let Some(planet) = session.planet(at, transfer.images_per_session) {
                let image = number * transfer.imaged_per_session + k;
                shots.push((image, tdb_s, planet, truth));
            }
        }
        // What a camera sees depends on the truth alone; what is made of it depends on the filter, image by image.
        let taken: Vec<Option<(Shot, Vec<StarPoint>)>> = shots
            .par_iter()
            .map(|&shot| {
                (!done.contains_key(&shot.0)).then(|| take(scenario, &photographer, shot)).transpose()
            })
            .collect::<Result<_, FarRangeError>>()?;
        let (mut fresh, mut nis) = (Vec::new(), (0.0, 0));
        for (&(image, tdb_s, planet, _), taken) in shots.iter().zip(taken) {
            filter.predict(&course.dynamics, tdb_s);
            let line = match (done.remove(&image), taken) {
                (Some(line), _) => line,
                (None, Some((shot, points))) => {
                    let line = look(scenario, &photographer, &solver, &filter, &shot, points)?;
                    fresh.push(line.clone());
                    line
                }
                (None, None) => continue,
            };
            if let (Some(direction), Some(covariance)) = (line.direction, line.covariance_rad2) {
                let innovation = filter
                    .update(&course.dynamics, planet, direction, covariance)
                    .ok_or_else(not_definite)?;
                nis = (nis.0 + innovation.nis, nis.1 + 1);
            }
            lines.push(line);
        }
        append(&path, &fresh)?;
        progress(lines.len());
        // The truth may be past the last image of a session that looks at nothing.
        filter.predict(&course.dynamics, now_s);
        let Standing { error, three_sigma, nees } =
            Standing::new(&filter, &truth).ok_or_else(not_definite)?;
        by_session.push(ImagedSession {
            day: (session.tdb_s - course.begin_s) / 86_400.0,
            error,
            three_sigma,
            nees,
            updates: nis.1,
            nis: mean(nis),
        });
        all_nis = (all_nis.0 + nis.0, all_nis.1 + nis.1);
    }
    let last =
        by_session.last().ok_or_else(|| FarRangeError::Sky("the transfer has no session".to_owned()))?;
    let of = |outcome: &str| lines.iter().filter(|l| l.planet_outcome.as_deref() == Some(outcome)).count();
    let mut errors: Vec<f64> = lines.iter().filter_map(|line| line.planet_arcsec).collect();
    errors.sort_by(f64::total_cmp);
    Ok(ImagedResult {
        images: lines.len(),
        attitudes_found: lines.iter().filter(|line| line.outcome == "solved").count(),
        planets_identified: of("found"),
        wrong: of("wrong") + lines.iter().filter(|line| line.outcome == "wrong").count(),
        planets_saturated: lines.iter().filter(|line| line.planet_saturated == Some(true)).count(),
        planet_percentiles_arcsec: (!errors.is_empty())
            .then(|| [0.5, 0.95].map(|p| errors[(errors.len() as f64 * p) as usize])),
        final_error: last.error,
        final_three_sigma: last.three_sigma,
        nis: mean(all_nis),
        nis_bounds: chi2_mean_bounds(2, all_nis.1.max(1)),
        nees_bounds: chi2_mean_bounds(6, 1),
        by_session,
    })
}

fn mean((sum, count): (f64, usize)) -> Option<f64> {
    (count > 0).then(|| sum / count as f64)
}

/// Points the camera, so that the planet stands at a random place of the field, and takes the image.
fn take(
    scenario: &Scenario,
    photographer: &Photographer,
    (image, tdb_s, planet, truth): (usize, f64, Planet, PhaseState),
) -> Result<(Shot, Vec<StarPoint>), FarRangeError> {
    let sky = |error: &dyn std::fmt::Display| FarRangeError::Sky(error.to_string());
    let mut random = ChaCha8Rng::seed_from_u64(scenario.seed ^ 0x696d_6167_6573);
    random.set_stream(image as u64);
    let camera = &photographer.camera().pinhole;
    let observer = Observer::new(&scenario.ephemeris, tdb_s, truth.position_m, Some(truth.velocity_m_s))
        .map_err(|error| sky(&error))?;
    let seen = seen_planet(&observer, planet)
        .map_err(|error| sky(&error))?
        .ok_or_else(|| FarRangeError::Sky(format!("{} is not seen", planet.name())))?;
    let camera_from_inertial = pointing(camera, seen.direction, &mut random);
    let shown = sources(&observer, camera_from_inertial, camera, scenario.poses.faintest_magnitude)
        .map_err(|error| sky(&error))?;
    let points = photographer.points(&shown, image as u64, &mut random)?;
    Ok((Shot { image, tdb_s, planet, camera_from_inertial, shown }, points))
}

/// An attitude that shows a direction at a random pixel, at a random roll.
fn pointing(camera: &Pinhole, direction: DVec3, random: &mut ChaCha8Rng) -> DQuat {
    let size = DVec2::new(f64::from(camera.width_px), f64::from(camera.height_px));
    let pixel = DVec2::new(uniform(random), uniform(random)) * size;
    let towards = camera.line_of_sight(pixel).extend(1.0).normalize();
    let roll = DQuat::from_axis_angle(towards, std::f64::consts::TAU * uniform(random));
    roll * DQuat::from_rotation_arc(direction, towards)
}

/// Attitude and planet of an image, with what the filter knows of the position, and how right they are.
fn look(
    scenario: &Scenario,
    photographer: &Photographer,
    solver: &StarSolver,
    filter: &Filter,
    shot: &Shot,
    points: Vec<StarPoint>,
) -> Result<ImagedLine, FarRangeError> {
    let sky = |error: &dyn std::fmt::Display| FarRangeError::Sky(error.to_string());
    let assumed = Observer::new(
        &scenario.ephemeris,
        shot.tdb_s,
        filter.state.position_m,
        Some(filter.state.velocity_m_s),
    )
    .map_err(|error| sky(&error))?;
    // The root of the trace: no less than along the worst axis.
    let sigma_m = filter.three_sigma()[0] / 3.0;
    let context = ImageContext {
        observer: Some(assumed.clone()),
        prior: Some(PriorPosition { observer: assumed, sigma_m }),
        ..ImageContext::default()
    };
    let camera = photographer.camera();
    let result = solve_points(points, camera, solver, &context).map_err(|error| sky(&error))?;
    let mut line = ImagedLine {
        image: shot.image,
        planet: shot.planet.name().to_owned(),
        points: result.points.len(),
        outcome: "solved".to_owned(),
        planet_outcome: None,
        direction: None,
        covariance_rad2: None,
        planet_arcsec: None,
        planet_saturated: None,
    };
    let solution = match &result.solution {
        Err(refusal) => {
            refusal.reason().clone_into(&mut line.outcome);
            return Ok(line);
        }
        Ok(solution) => solution,
    };
    let off = rotation(solution.camera_from_inertial(), shot.camera_from_inertial);
    if off.truncate().length() > scenario.poses.found_within_arcsec * ARCSEC {
        "wrong".clone_into(&mut line.outcome);
    }
    let verdict = planet_verdict(&result, shot.planet, camera, &shot.shown, shot.camera_from_inertial);
    line.planet_outcome = Some(verdict.outcome.to_owned());
    if let Some(sight) = verdict.sight {
        line.direction = Some(sight.direction);
        line.covariance_rad2 = Some(inertial_covariance(sight, solution.camera_from_inertial()));
    }
    if let Some(found) = verdict.found {
        line.planet_arcsec = Some(found.error_arcsec);
        line.planet_saturated = Some(found.saturated);
    }
    Ok(line)
}

/// The covariance of a direction along inertial axes, from the one on the tangent plane: for u = p / |p|, p = (x, y, 1),
/// du = (I - u u^T) dp / |p|.
fn inertial_covariance(sight: &PlanetSight, camera_from_inertial: DQuat) -> DMat3 {
    let p = sight.line_of_sight.extend(1.0);
    let u = p.normalize();
    let columns = [DVec3::X, DVec3::Y]
        .map(|axis| camera_from_inertial.inverse() * ((axis - u * u.dot(axis)) / p.length()));
    let c = sight.covariance_rad2;
    let weighted = [
        columns[0] * c.x_axis.x + columns[1] * c.x_axis.y,
        columns[0] * c.y_axis.x + columns[1] * c.y_axis.y,
    ];
    let outer = |a: DVec3, b: DVec3| DMat3::from_cols(a * b.x, a * b.y, a * b.z);
    outer(weighted[0], columns[0]) + outer(weighted[1], columns[1])
}
