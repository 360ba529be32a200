//! The filter about the Moon, and the forces that it goes by.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

use glam::{DMat3, DQuat, DVec3};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng as _;
use rand_distr::{Distribution as _, StandardNormal};
use retina_experiments::far_range::chi2_mean_bounds;
use retina_experiments::full_disk::{
    FilterOptions, FilterResult, FrameResult, FrameTruth, MoonMotion, Position, run_filter,
};
use retina_geometry::Pinhole;
use retina_sky::ephemeris::Ephemeris;

const START_S: f64 = 8.7e8;
const STEP_S: f64 = 7200.0;
const FRAMES: usize = 30;
const RUNS: usize = 60;

/// A path under the forces alone, measured with the errors that the filter is told of: a shared part that decays
/// over 10 h and a new part in each frame.
fn run(seed: u64, told_shared: bool) -> FilterResult {
    let options = FilterOptions {
        initial_position_3_sigma_km: 60.0,
        initial_velocity_3_sigma_m_s: 3.0,
        acceleration_sigma_m_s2: 1e-9,
        terrain_time_h: 10.0,
        settle_h: 24.0,
        seed,
        ..FilterOptions::default()
    };
    let motion =
        MoonMotion::new(&Ephemeris::analytic(), [START_S, START_S + FRAMES as f64 * STEP_S], 1e-9, 3.6e5)
            .unwrap();
    let mut random = ChaCha8Rng::seed_from_u64(1000 + seed);
    let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
    let mut state = [4e7, -3e7, -4e7, 60.0, 90.0, 40.0];
    let mut shared = DVec3::new(normal(), normal(), normal());
    let decay = (-STEP_S / 3.6e4f64).exp();
    let (mut frames, mut truths) = (Vec::new(), Vec::new());
    // Three kilometres of noise across, ten along; terrain three times that.
    let sigma = DVec3::new(3e3, 3e3, 1e4);
    for frame in 0..FRAMES {
        let time_s = START_S + frame as f64 * STEP_S;
        let place = DVec3::new(state[0], state[1], state[2]);
        let truth = FrameTruth {
            frame,
            time_s,
            camera_from_inertial: DQuat::from_rotation_arc(-place.normalize(), DVec3::Z),
            image: Pinhole { fx_px: 1.0, fy_px: 1.0, cx_px: 0.0, cy_px: 0.0, width_px: 1, height_px: 1 },
            compensated: false,
            position_camera_m: DVec3::Z * place.length(),
            camera_from_body: DQuat::IDENTITY,
            sun_direction_camera: DVec3::X,
            phase_rad: 1.0,
            semi_axes_m: DVec3::splat(1.7374e6),
            velocity_m_s: Some(DVec3::new(state[3], state[4], state[5])),
        };
        let new = DVec3::new(normal(), normal(), normal()) * sigma;
        let error = new + shared * sigma * 3.0;
        let square = |v: DVec3| DMat3::from_diagonal(v * v);
        let all = square(sigma) + square(sigma * 3.0);
        let noise = if told_shared { square(sigma) } else { all };
        let position = Position {
            position_camera_m: (truth.position_camera_m + error).to_array(),
            error_m: error.to_array(),
            covariance_m2: all.to_cols_array_2d(),
            noise_covariance_m2: noise.to_cols_array_2d(),
            nees: 3.0,
            center_px: [0.0; 2],
            radius_px: [0.0; 2],
            rms_px: 0.0,
            excess_px: 0.0,
            blur_px: 0.0,
            arc_deg: 0.0,
            points: 0,
        };
        frames.push(FrameResult {
            frame,
            time_s,
            phase_deg: 0.0,
            distance_m: place.length(),
            outcome: "solved".to_owned(),
            message: None,
            position: Some(position),
            inputs: String::new(),
        });
        truths.push(truth);
        state = motion.propagate(state, time_s, time_s + STEP_S);
        let fresh = DVec3::new(normal(), normal(), normal());
        shared = shared * decay + fresh * (1.0 - decay * decay).sqrt();
    }
    run_filter(&frames, &truths, &options, &Ephemeris::analytic()).unwrap()
}

fn last_nees(told_shared: bool) -> f64 {
    let of = |seed| run(seed, told_shared).steps.last().map_or(f64::NAN, |step| step.nees);
    (0..RUNS as u64).map(of).sum::<f64>() / RUNS as f64
}

#[test]
fn over_runs_of_its_own_model_the_normalised_errors_are_chi_squares() {
    let [low, high] = chi2_mean_bounds(6, RUNS);
    let nees = last_nees(true);
    assert!((low..high).contains(&nees), "{nees}, expected {low} to {high}");
    let nis = (0..RUNS as u64).map(|seed| run(seed, true).nis_mean).sum::<f64>() / RUNS as f64;
    let [low, high] = chi2_mean_bounds(3, RUNS * (FRAMES - 12));
    assert!((low..high).contains(&nis), "{nis}, expected {low} to {high}");
}

/// What images share, taken for new in each, is averaged away that should not be.
#[test]
fn shared_errors_taken_for_new_ones_make_the_covariance_too_small() {
    let nees = last_nees(false);
    assert!(nees > chi2_mean_bounds(6, RUNS)[1], "{nees}");
}

#[test]
fn frames_out_of_order_are_refused() {
    let error = run_filter(&[], &[], &FilterOptions::default(), &Ephemeris::analytic()).unwrap_err();
    assert!(error.to_string().contains("follow each other"), "{error}");
}

fn motion() -> MoonMotion {
    MoonMotion::new(&Ephemeris::analytic(), [START_S, START_S + 20.0 * 86_400.0], 0.0, 86_400.0).unwrap()
}

/// A quarter of a circular orbit takes a quarter of Kepler's period.
#[test]
fn close_to_the_moon_the_orbit_is_keplers() {
    let motion = motion();
    // 2500 km: the Moon's pull is 0.78 m/s^2, the Earth's tide 2e-5 of that.
    let (radius, gm) = (2.5e6, 4.902_800_118e12f64);
    let speed = (gm / radius).sqrt();
    let state = [radius, 0.0, 0.0, 0.0, speed, 0.0];
    let span_s = std::f64::consts::FRAC_PI_2 * radius / speed;
    let end = motion.propagate(state, START_S, START_S + span_s);
    let off = DVec3::new(end[0], end[1] - radius, end[2]).length() / radius;
    assert!(off < 2e-3, "{off}");
}

/// The Earth's own centre, relative to the Moon, is a particle at which the Earth does not pull: the theories'
/// second differences are the oracle of all else.
#[test]
fn the_tide_of_earth_and_sun_is_the_theories() {
    let motion = motion();
    let earth = |t: f64| {
        let bodies = Ephemeris::analytic().solar_system(t).unwrap();
        bodies.earth.position_m - bodies.moon.position_m
    };
    let (t, h) = (START_S + 5.0 * 86_400.0, 3600.0);
    let theory = (earth(t + h) - earth(t) * 2.0 + earth(t - h)) / (h * h);
    // At the Earth's own place its pull is singular: the mean of two places to either side cancels it.
    let side = DVec3::new(0.3, -0.8, 0.5).normalize() * 1e7;
    let [a, b] = [side, -side].map(|off| motion.acceleration(t, earth(t) + off).0);
    let own = (a + b) * 0.5;
    let off = (own - theory).length() / theory.length();
    assert!(off < 1e-3, "{own} {theory}");
}
