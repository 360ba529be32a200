//! A transfer that ends near Mars, navigated by planets: Monte Carlo of the filter.

use glam::{DMat3, DVec3};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution as _, StandardNormal};
use rayon::prelude::*;
use retina_sky::ephemeris::{Ephemeris, EphemerisTable};
use retina_sky::observer::{Observer, separation_rad};
use retina_sky::planets::{Planet, seen_planet};
use serde::Serialize;

use super::poses::{ARCSEC, FarRangeError};
use super::transfer_file::Transfer;
use retina_navigation::filter::{
    Beacon, Dynamics, Filter, Matrix6, PhaseState, apparent_direction, cholesky, quadratic_form_inverse,
    tangent_axes, triangulate,
};
use retina_navigation::synthetic::uniform;

/// A planet with a larger disc is no point any more, rad: half a pixel of the wide configuration.
const GREATEST_RADIUS_RAD: f64 = 14.0 / 3600.0 * std::f64::consts::PI / 180.0;
/// Fainter planets are not looked at.
const FAINTEST_MAGNITUDE: f64 = 5.0;

/// One session of a transfer, over all samples.
#[derive(Debug, Clone, Serialize)]
pub struct SessionResult {
    /// Since the beginning, days.
    pub day: f64,
    /// The planets looked at.
    pub planets: Vec<&'static str>,
    /// Their distances, m.
    pub distances_m: Vec<f64>,
    /// Filter's three sigma (root of the covariance's trace), mean over samples: km, m/s.
    pub three_sigma: [f64; 2],
    /// Root mean square of the samples' errors: km, m/s.
    pub rms: [f64; 2],
    /// Each sample's error: km, m/s.
    pub errors: Vec<[f64; 2]>,
    /// Mean normalised estimation error squared; 6 is expected.
    pub nees: f64,
    /// Mean normalised innovation squared; 2 is expected.
    pub nis: f64,
    /// Samples within three sigma of position and of velocity (root of the trace), fractions.
    pub within: [f64; 2],
    /// Triangulation of one pair of images alone: root mean square error, and its own 3 sigma, km.
    pub fix_km: Option<[f64; 2]>,
}

/// A transfer's Monte Carlo.
#[derive(Debug, Clone, Serialize)]
pub struct TransferResult {
    /// Session by session.
    pub sessions: Vec<SessionResult>,
    /// Standard deviation of a line of sight per axis, arcsec.
    pub line_of_sight_sigma_arcsec: f64,
    /// Share of images that give a line of sight.
    pub images_used: f64,
    /// Samples.
    pub samples: usize,
    /// Bounds within which a session's mean NEES stays in 99 % of cases.
    pub nees_bounds: [f64; 2],
    /// Share of sessions within them.
    pub nees_within: f64,
    /// Mean NIS over all updates, and its bounds of 99 %.
    pub nis: f64,
    /// Its bounds.
    pub nis_bounds: [f64; 2],
    /// Distance from the Sun along the way, au: least and greatest.
    pub sun_distance_au: [f64; 2],
}

/// What a sample brought in a session.
struct Record {
    standing: Standing,
    nis: (f64, usize),
    fix: Option<[f64; 2]>,
}

/// A session as it is planned on the reference trajectory.
pub(super) struct Session {
    /// When its first image is taken.
    pub(super) tdb_s: f64,
    /// The planets it looks at, with their distances, m.
    planets: Vec<(Planet, f64)>,
}

impl Session {
    /// The planet that an image of the session looks at: one in its first half, the other in its second.
    pub(super) fn planet(&self, image: usize, images: usize) -> Option<Planet> {
        self.planets.get(2 * image / images).or(self.planets.first()).map(|&(planet, _)| planet)
    }
}

/// The reference trajectory with its sessions.
pub(super) struct Course {
    pub(super) dynamics: Dynamics,
    begin: PhaseState,
    pub(super) begin_s: f64,
    pub(super) sessions: Vec<Session>,
}

impl Course {
    /// Integrates backwards from the arrival, and plans the sessions.
    pub(super) fn new(transfer: &Transfer, ephemeris: &Ephemeris) -> Result<Self, FarRangeError> {
        let begin_s = transfer.arrival_tdb_s - transfer.length_s;
        // Light from Saturn is up to 2 hours old; the last session ends after the arrival.
        let session_length_s = transfer.images_per_session as f64 * transfer.interval_s;
        let table =
            EphemerisTable::new(ephemeris, [begin_s, transfer.arrival_tdb_s + session_length_s + 86_400.0])
                .map_err(|error| FarRangeError::Sky(error.to_string()))?;
        let dynamics = Dynamics { ephemeris: table, pressure_area_m2_kg: transfer.pressure_area_m2_kg };
        let mars_s = transfer.arrival_tdb_s;
        let mars = |t: f64| dynamics.ephemeris.planet(Planet::Mars, t);
        let arrival = PhaseState {
            position_m: mars(mars_s) + DVec3::from_array(transfer.arrival_offset_m),
            velocity_m_s: (mars(mars_s + 300.0) - mars(mars_s - 300.0)) / 600.0
                + DVec3::from_array(transfer.arrival_velocity_m_s),
        };
        let begin = dynamics.propagate(arrival, mars_s, begin_s);
        let sessions = plan(transfer, ephemeris, &dynamics, begin, begin_s)?;
        if sessions.iter().all(|session| session.planet(0, transfer.images_per_session).is_none()) {
            return Err(FarRangeError::Sky(
                "in no session of the transfer is there a planet to look at: of `planets` none is bright, small and far \
                 enough from the Sun (`sun_exclusion_deg`)"
                    .to_owned(),
            ));
        }
        Ok(Self { dynamics, begin, begin_s, sessions })
    }

    /// The truth at the beginning, and a filter that starts off by a draw of its initial covariance.
    pub(super) fn start(&self, transfer: &Transfer, random: &mut ChaCha8Rng) -> Option<(PhaseState, Filter)> {
        let mut covariance: Matrix6 = [[0.0; 6]; 6];
        for i in 0..6 {
            covariance[i][i] = transfer.initial_sigma[i / 3].powi(2);
        }
        let root = cholesky(&covariance)?;
        let deviates: [f64; 6] = std::array::from_fn(|_| normal(random));
        let start = self.begin.to_array();
        let first: [f64; 6] =
            std::array::from_fn(|i| start[i] + (0..6).map(|j| root[i][j] * deviates[j]).sum::<f64>());
        let filter = Filter {
            tdb_s: self.begin_s,
            state: PhaseState::from_array(first),
            covariance,
            acceleration_sigma_m_s2: transfer.acceleration_sigma_m_s2,
        };
        Some((self.begin, filter))
    }

    /// The truth at a later instant, pulled by an acceleration that the filter does not know, as it believes it to be.
    pub(super) fn pulled(
        &self,
        truth: PhaseState,
        [from_s, to_s]: [f64; 2],
        acceleration_sigma_m_s2: f64,
        random: &mut ChaCha8Rng,
    ) -> PhaseState {
        let dt = to_s - from_s;
        let mut truth = self.dynamics.propagate(truth, from_s, to_s);
        let pull = DVec3::from_array(std::array::from_fn(|_| normal(random))) * acceleration_sigma_m_s2;
        truth.position_m += pull * (0.5 * dt * dt);
        truth.velocity_m_s += pull * dt;
        truth
    }
}

pub(super) fn normal(random: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(random)
}

/// Where a filter stands beside the truth.
pub(super) struct Standing {
    /// Error: km, m/s.
    pub(super) error: [f64; 2],
    /// Three sigma: km, m/s.
    pub(super) three_sigma: [f64; 2],
    /// Normalised estimation error squared.
    pub(super) nees: f64,
}

impl Standing {
    /// `None`: the covariance is not positive definite.
    pub(super) fn new(filter: &Filter, truth: &PhaseState) -> Option<Self> {
        let error = truth.minus(filter.state);
        let length = |first: usize| error[first..first + 3].iter().map(|v| v * v).sum::<f64>().sqrt();
        let [r, v] = filter.three_sigma();
        Some(Self {
            error: [length(0) / 1e3, length(3)],
            three_sigma: [r / 1e3, v],
            nees: quadratic_form_inverse(&filter.covariance, &error)?,
        })
    }
}

/// Runs the Monte Carlo: `sigma_rad` is a line of sight's standard deviation per axis, `used` the share of images
/// that give one.
///
/// # Errors
/// The transfer is outside the ephemeris, or a covariance loses its positive definiteness.
pub fn run_transfer(
    transfer: &Transfer,
    ephemeris: &Ephemeris,
    sigma_rad: f64,
    used: f64,
    seed: u64,
) -> Result<TransferResult, FarRangeError> {
    run(transfer, ephemeris, Noise { sigma_rad, believed_rad: sigma_rad, used }, seed)
}

/// A line of sight's noise.
#[derive(Debug, Clone, Copy)]
struct Noise {
    /// Standard deviation per axis, rad.
    sigma_rad: f64,
    /// What the filter takes it to be.
    believed_rad: f64,
    /// Share of images that give one.
    used: f64,
}

fn run(
    transfer: &Transfer,
    ephemeris: &Ephemeris,
    noise: Noise,
    seed: u64,
) -> Result<TransferResult, FarRangeError> {
    let Noise { sigma_rad, used, .. } = noise;
    let course = Course::new(transfer, ephemeris)?;
    let (dynamics, begin, begin_s) = (&course.dynamics, course.begin, course.begin_s);
    let samples: Vec<Vec<Record>> = (0..transfer.samples)
        .into_par_iter()
        .map(|sample| run_sample(transfer, &course, noise, seed, sample))
        .collect::<Option<_>>()
        .ok_or_else(not_definite)?;
    let sessions = course
        .sessions
        .iter()
        .enumerate()
        .map(|(at, session)| {
            let records: Vec<&Record> = samples.iter().map(|sample| &sample[at]).collect();
            summarise(session, begin_s, &records)
        })
        .collect::<Vec<_>>();
    let nees_bounds = chi2_mean_bounds(6, transfer.samples);
    let inside = sessions.iter().filter(|s| (nees_bounds[0]..=nees_bounds[1]).contains(&s.nees)).count();
    let (nis, updates) = samples
        .iter()
        .flatten()
        .fold((0.0, 0), |(sum, count), record| (sum + record.nis.0, count + record.nis.1));
    let distances: Vec<f64> = (0..=50)
        .map(|i| {
            let t = begin_s + transfer.length_s * f64::from(i) / 50.0;
            let at = dynamics.propagate(begin, begin_s, t).position_m - dynamics.ephemeris.sun(t);
            at.length() / retina_sky::ephemeris::ASTRONOMICAL_UNIT_M
        })
        .collect();
    Ok(TransferResult {
        line_of_sight_sigma_arcsec: sigma_rad.to_degrees() * 3600.0,
        images_used: used,
        samples: transfer.samples,
        nees_bounds,
        nees_within: inside as f64 / sessions.len() as f64,
        nis: nis / updates.max(1) as f64,
        nis_bounds: chi2_mean_bounds(2, updates.max(1)),
        sun_distance_au: [
            distances.iter().copied().fold(f64::INFINITY, f64::min),
            distances.iter().copied().fold(0.0, f64::max),
        ],
        sessions,
    })
}

/// A filter's failure.
pub(super) fn not_definite() -> FarRangeError {
    FarRangeError::Sky("a covariance of the filter is not positive definite".to_owned())
}

/// The sessions, each with the two planets that fix the position best: least trace of the triangulation's covariance.
fn plan(
    transfer: &Transfer,
    ephemeris: &Ephemeris,
    dynamics: &Dynamics,
    begin: PhaseState,
    begin_s: f64,
) -> Result<Vec<Session>, FarRangeError> {
    // Which pair is best does not depend on it.
    let sigma_rad = ARCSEC;
    let count = (transfer.length_s / transfer.session_s + 1e-9) as usize + 1;
    let mut sessions = Vec::new();
    let (mut state, mut now_s) = (begin, begin_s);
    for at in 0..count {
        let tdb_s = begin_s + at as f64 * transfer.session_s;
        state = dynamics.propagate(state, now_s, tdb_s);
        now_s = tdb_s;
        let observer = Observer::new(ephemeris, tdb_s, state.position_m, Some(state.velocity_m_s))
            .map_err(|error| FarRangeError::Sky(error.to_string()))?;
        let sun = observer.apparent_source(observer.bodies().sun_from_m(state.position_m));
        let mut visible = Vec::new();
        for &planet in &transfer.planets {
            let seen =
                seen_planet(&observer, planet).map_err(|error| FarRangeError::Sky(error.to_string()))?;
            visible.extend(seen.filter(|seen| {
                seen.angular_radius_rad < GREATEST_RADIUS_RAD
                    && seen.magnitude < FAINTEST_MAGNITUDE
                    && separation_rad(seen.direction, sun) > transfer.sun_exclusion_rad
            }));
        }
        let mut best: Option<(f64, Vec<(Planet, f64)>)> = None;
        for (i, a) in visible.iter().enumerate() {
            for b in &visible[i + 1..] {
                let beacons =
                    [a, b].map(|seen| Beacon { planet: seen.planet, direction: seen.direction, sigma_rad });
                let Some(fix) = triangulate(&dynamics.ephemeris, tdb_s, state.velocity_m_s, &beacons) else {
                    continue;
                };
                let c = fix.covariance_m2;
                let trace = c.x_axis.x + c.y_axis.y + c.z_axis.z;
                if best.as_ref().is_none_or(|(least, _)| trace < *least) {
                    best = Some((trace, vec![(a.planet, a.distance_m), (b.planet, b.distance_m)]));
                }
            }
        }
        // With one planet in sight the whole session looks at it, with none there is no session.
        let planets = best.map_or_else(
            || visible.first().map(|seen| vec![(seen.planet, seen.distance_m)]).unwrap_or_default(),
            |(_, planets)| planets,
        );
        sessions.push(Session { tdb_s, planets });
    }
    Ok(sessions)
}

fn run_sample(
    transfer: &Transfer,
    course: &Course,
    Noise { sigma_rad, believed_rad, used }: Noise,
    seed: u64,
    sample: usize,
) -> Option<Vec<Record>> {
    let dynamics = &course.dynamics;
    let mut random = ChaCha8Rng::seed_from_u64(seed ^ 0x6d61_7273);
    random.set_stream(sample as u64);
    let (mut truth, mut filter) = course.start(transfer, &mut random)?;
    let believed = DMat3::from_diagonal(DVec3::splat(believed_rad * believed_rad));
    let mut records = Vec::new();
    for session in &course.sessions {
        let mut nis = (0.0, 0);
        for image in 0..transfer.images_per_session {
            let tdb_s = session.tdb_s + image as f64 * transfer.interval_s;
            let span_s = [filter.tdb_s, tdb_s];
            truth = course.pulled(truth, span_s, transfer.acceleration_sigma_m_s2, &mut random);
            filter.predict(dynamics, tdb_s);
            let Some(planet) = session.planet(image, transfer.images_per_session) else { continue };
            let noise = [normal(&mut random), normal(&mut random)];
            if uniform(&mut random) >= used {
                continue;
            }
            let (direction, _) = apparent_direction(&dynamics.ephemeris, planet, tdb_s, &truth);
            let axes = tangent_axes(direction);
            let measured = (direction + (axes[0] * noise[0] + axes[1] * noise[1]) * sigma_rad).normalize();
            let innovation = filter.update(dynamics, planet, measured, believed)?;
            nis = (nis.0 + innovation.nis, nis.1 + 1);
        }
        let fix = fix_error(dynamics, session, &filter, &truth, &mut random, sigma_rad);
        records.push(Record { standing: Standing::new(&filter, &truth)?, nis, fix });
    }
    Some(records)
}

/// Error and 3 sigma (km) of a triangulation from both planets seen at once at the session's end.
fn fix_error(
    dynamics: &Dynamics,
    session: &Session,
    filter: &Filter,
    truth: &PhaseState,
    random: &mut ChaCha8Rng,
    sigma_rad: f64,
) -> Option<[f64; 2]> {
    let beacons: Vec<Beacon> = session
        .planets
        .iter()
        .map(|&(planet, _)| {
            let (direction, _) = apparent_direction(&dynamics.ephemeris, planet, filter.tdb_s, truth);
            let axes = tangent_axes(direction);
            let noise: [f64; 2] = std::array::from_fn(|_| StandardNormal.sample(random));
            let measured = (direction + (axes[0] * noise[0] + axes[1] * noise[1]) * sigma_rad).normalize();
            Beacon { planet, direction: measured, sigma_rad }
        })
        .collect();
    let fix = triangulate(&dynamics.ephemeris, filter.tdb_s, filter.state.velocity_m_s, &beacons)?;
    let c = fix.covariance_m2;
    Some([
        fix.position_m.distance(truth.position_m) / 1e3,
        3.0 * (c.x_axis.x + c.y_axis.y + c.z_axis.z).sqrt() / 1e3,
    ])
}

fn summarise(session: &Session, begin_s: f64, records: &[&Record]) -> SessionResult {
    let count = records.len() as f64;
    let mean = |pick: &dyn Fn(&Record) -> f64| records.iter().map(|r| pick(r)).sum::<f64>() / count;
    let updates = records.iter().map(|r| r.nis.1).sum::<usize>().max(1);
    let fixes: Vec<[f64; 2]> = records.iter().filter_map(|r| r.fix).collect();
    let fix_km = (!fixes.is_empty()).then(|| {
        let n = fixes.len() as f64;
        let squares: f64 = fixes.iter().map(|f| f[0] * f[0]).sum();
        [(squares / n).sqrt(), fixes.iter().map(|f| f[1]).sum::<f64>() / n]
    });
    SessionResult {
        day: (session.tdb_s - begin_s) / 86_400.0,
        planets: session.planets.iter().map(|(planet, _)| planet.name()).collect(),
        distances_m: session.planets.iter().map(|(_, distance)| *distance).collect(),
        three_sigma: [0, 1].map(|k| mean(&|r| r.standing.three_sigma[k])),
        rms: [0, 1].map(|k| mean(&|r| r.standing.error[k].powi(2)).sqrt()),
        errors: records.iter().map(|r| r.standing.error).collect(),
        nees: mean(&|r| r.standing.nees),
        nis: records.iter().map(|r| r.nis.0).sum::<f64>() / updates as f64,
        within: [0, 1]
            .map(|k| mean(&|r| f64::from(u8::from(r.standing.error[k] <= r.standing.three_sigma[k])))),
        fix_km,
    }
}

/// Bounds (0.5 and 99.5 %) of the mean of `count` chi-squares of `freedom` degrees (Wilson & Hilferty 1931).
pub fn chi2_mean_bounds(freedom: usize, count: usize) -> [f64; 2] {
    let n = (freedom * count) as f64;
    [-2.575_829, 2.575_829].map(|z: f64| {
        let spread = 2.0 / (9.0 * n);
        n * (1.0 - spread + z * spread.sqrt()).powi(3) / count as f64
    })
}

#[cfg(test)]
mod tests {
    use super::super::transfer_file::TransferImages;
    use super::*;

    #[test]
    fn bounds_are_those_of_the_tables() {
        // Chi-square of 60 degrees: 35.534 and 91.952 (0.5 and 99.5 %, Abramowitz & Stegun, table 26.8).
        let [low, high] = chi2_mean_bounds(6, 10);
        assert!((low - 3.5534).abs() < 0.01 && (high - 9.1952).abs() < 0.01, "{low} {high}");
    }

    fn transfer(samples: usize) -> Transfer {
        Transfer {
            arrival_tdb_s: 1.04e9,
            length_s: 60.0 * 86_400.0,
            session_s: 10.0 * 86_400.0,
            images_per_session: 12,
            interval_s: 600.0,
            samples,
            images: TransferImages::None,
            imaged_per_session: 4,
            planets: vec![Planet::Venus, Planet::Earth, Planet::Jupiter, Planet::Saturn],
            sun_exclusion_rad: 0.3,
            line_of_sight_sigma_rad: None,
            arrival_offset_m: [-2e9, 1e9, 0.0],
            arrival_velocity_m_s: [100.0, -200.0, 0.0],
            initial_sigma: [3.3e7, 30.0],
            pressure_area_m2_kg: 0.02,
            acceleration_sigma_m_s2: 2e-9,
        }
    }

    #[test]
    fn the_filter_is_consistent_and_a_wrong_one_is_not() {
        let sigma_rad = 5e-5;
        let run = |believed: f64, samples| {
            let noise = Noise { sigma_rad, believed_rad: believed * sigma_rad, used: 0.95 };
            super::run(&transfer(samples), &Ephemeris::analytic(), noise, 3).unwrap()
        };
        let honest = run(1.0, 60);
        assert!((honest.nis_bounds[0]..=honest.nis_bounds[1]).contains(&honest.nis), "{}", honest.nis);
        let last = honest.sessions.last().unwrap();
        assert!((4.5..7.6).contains(&last.nees), "{}", last.nees);
        assert!(last.within[0] > 0.98 && last.three_sigma[0] < honest.sessions[0].three_sigma[0]);
        // Noise that is half of what is there: NIS four times as large.
        let wrong = run(0.5, 20);
        assert!(wrong.nis > 1.5 * wrong.nis_bounds[1], "{}", wrong.nis);
        let fix = last.fix_km.unwrap();
        // The rms of errors is a third of the 3 sigma of the trace.
        assert!((3.0 * fix[0] / fix[1] - 1.0).abs() < 0.3, "{fix:?}");
    }
}
