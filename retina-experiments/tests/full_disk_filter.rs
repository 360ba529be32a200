//! The filter about the Moon, on measurements that are drawn and not taken from images.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

use glam::{DMat3, DQuat, DVec3};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng as _;
use rand_distr::{Distribution as _, StandardNormal};
use rayon::prelude::*;
use retina_experiments::far_range::chi2_mean_bounds;
use retina_experiments::full_disk::{
    FilterOptions, FilterResult, FrameResult, FrameTruth, Position, run_filter, summarise,
};
use retina_geometry::Pinhole;
use retina_sky::FramePose;
use retina_sky::ephemeris::Ephemeris;
use retina_sky::halo::LumioHalo;

const RUNS: usize = 40;
/// Standard deviations of one image's own error and of what images share, camera axes, m.
const NEW_M: DVec3 = DVec3::new(1e3, 1e3, 2e4);
const SHARED_M: DVec3 = DVec3::new(2e3, 2e3, 8e4);

/// A filter's result, and the root mean square of single frames, km.
type Run = (FilterResult, [f64; 3]);

/// Each `every`-th frame of the default sequence.
fn poses(every: usize) -> Vec<FramePose> {
    let whole = LumioHalo::default();
    let halo =
        LumioHalo { frames: (whole.frames - 1) / every + 1, step_s: whole.step_s * every as f64, ..whole };
    halo.generate(&Ephemeris::analytic()).unwrap().0.frames
}

fn truth(frame: usize, pose: &FramePose) -> FrameTruth {
    let place = pose.camera_position_m;
    let sun = pose.sun_position_m.unwrap().normalize();
    FrameTruth {
        frame,
        time_s: pose.time_s,
        camera_from_inertial: pose.camera_from_inertial,
        image: Pinhole { fx_px: 1.0, fy_px: 1.0, cx_px: 0.0, cy_px: 0.0, width_px: 1, height_px: 1 },
        compensated: false,
        position_camera_m: pose.camera_from_inertial * -place,
        camera_from_body: pose.camera_from_inertial * pose.bodies["moon"].body_from_inertial.inverse(),
        sun_direction_camera: pose.camera_from_inertial * sun,
        phase_rad: place.angle_between(sun),
        semi_axes_m: DVec3::splat(1.7374e6),
        velocity_m_s: pose.camera_velocity_m_s,
    }
}

/// How much of the shared error two frames have in common: 55 deg of the sight on the Moon, 27 deg of the lit side.
fn in_common(before: &FrameTruth, now: &FrameTruth) -> f64 {
    let on_moon = |truth: &FrameTruth, camera: DVec3| truth.camera_from_body.inverse() * camera;
    let sights = [before, now].map(|truth| on_moon(truth, DVec3::Z));
    let sides = [before, now].map(|truth| {
        let sun = on_moon(truth, truth.sun_direction_camera);
        let sight = on_moon(truth, DVec3::Z);
        (sun - sight * sun.dot(sight)).normalize()
    });
    let tilt_deg = sights[0].dot(sights[1]).clamp(-1.0, 1.0).acos().to_degrees();
    let carried = DQuat::from_rotation_arc(sights[0], sights[1]) * sides[0];
    let roll_deg = carried.dot(sides[1]).clamp(-1.0, 1.0).acos().to_degrees();
    (-((tilt_deg / 55.0).powi(2) + (roll_deg / 27.0).powi(2)).sqrt()).exp()
}

/// The poses measured with the errors that the filter is told of: a shared part, and a new one in each frame. Gives
/// the filter's result and the root mean square of single frames, km.
fn run(poses: &[FramePose], seed: u64, told_shared: bool, acceleration_sigma_m_s2: f64) -> Run {
    let mut random = ChaCha8Rng::seed_from_u64(1000 + seed);
    let mut draw = || -> DVec3 {
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        DVec3::new(normal(), normal(), normal())
    };
    let truths: Vec<FrameTruth> = poses.iter().enumerate().map(|(k, pose)| truth(k, pose)).collect();
    let square = |v: DVec3| DMat3::from_diagonal(v * v);
    let all = square(NEW_M) + square(SHARED_M);
    let mut shared = draw();
    let mut frames = Vec::new();
    for (k, truth) in truths.iter().enumerate() {
        if k > 0 {
            let kept = in_common(&truths[k - 1], truth);
            shared = shared * kept + draw() * (1.0 - kept * kept).sqrt();
        }
        let error = draw() * NEW_M + shared * SHARED_M;
        let position = Position {
            position_camera_m: (truth.position_camera_m + error).to_array(),
            error_m: error.to_array(),
            covariance_m2: all.to_cols_array_2d(),
            noise_covariance_m2: if told_shared { square(NEW_M) } else { all }.to_cols_array_2d(),
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
            frame: k,
            time_s: truth.time_s,
            phase_deg: truth.phase_rad.to_degrees(),
            distance_m: truth.position_camera_m.length(),
            outcome: "solved".to_owned(),
            message: None,
            position: Some(position),
            inputs: String::new(),
        });
    }
    let options = FilterOptions { seed, acceleration_sigma_m_s2, ..FilterOptions::default() };
    let single = summarise(&frames, 1.7374e6).rms_km;
    (run_filter(&frames, &truths, &options, &Ephemeris::analytic()).unwrap(), single)
}

fn runs(every: usize, told_shared: bool, acceleration_sigma_m_s2: f64) -> Vec<Run> {
    let poses = poses(every);
    let of_seed = |seed| run(&poses, seed, told_shared, acceleration_sigma_m_s2);
    (0..RUNS as u64).into_par_iter().map(of_seed).collect()
}

fn last_nees(runs: &[Run]) -> f64 {
    let last = |(result, _): &Run| result.steps.last().map_or(f64::NAN, |step| step.nees);
    runs.iter().map(last).sum::<f64>() / runs.len() as f64
}

/// Settled steps of a run that took a measurement in.
fn settled(result: &FilterResult) -> usize {
    result.steps.iter().filter(|step| step.nis.is_some() && step.elapsed_s >= 43_200.0).count()
}

/// One set of options at three cadences: 50 minutes, 5 hours and 30 hours between frames.
#[test]
fn at_each_cadence_the_filter_is_better_than_single_frames_and_its_errors_are_chi_squares() {
    for every in [10, 60, 360] {
        // The truth has no unmodelled acceleration: told so, the filter has errors that are chi-squares; told of what
        // is likely, it is more careful.
        for (careful, acceleration_sigma_m_s2) in
            [(false, 1e-12), (true, FilterOptions::default().acceleration_sigma_m_s2)]
        {
            let runs = runs(every, true, acceleration_sigma_m_s2);
            let mean = |pick: &dyn Fn(&Run) -> f64| runs.iter().map(pick).sum::<f64>() / runs.len() as f64;
            let [low, high] = chi2_mean_bounds(6, RUNS);
            let nees = last_nees(&runs);
            let [nis_low, nis_high] = chi2_mean_bounds(3, RUNS * settled(&runs[0].0));
            let nis = mean(&|(result, _)| result.nis_mean);
            println!(
                "every {every}: NEES {nees:.2} ({low:.2} to {high:.2}), NIS {nis:.3} ({nis_low:.3} to {nis_high:.3})"
            );
            for axis in 0..3 {
                let filtered = mean(&|(result, _)| result.rms_km[axis].powi(2)).sqrt();
                let single = mean(&|(_, single)| single[axis].powi(2)).sqrt();
                println!("  axis {axis}: {filtered:.3} km, single frames {single:.3} km");
                assert!(filtered < 0.9 * single, "every {every}, axis {axis}: {filtered} {single}");
            }
            assert!(
                nees < high && (careful || nees > low),
                "every {every}: {nees}, expected {low} to {high}"
            );
            assert!(
                (nis_low..nis_high).contains(&nis),
                "every {every}: {nis}, expected {nis_low} to {nis_high}"
            );
            // The truth is a path of the filter's own forces: what is left is the steps' rounding.
            let unmodelled = runs[0].0.unmodelled_m_s2.unwrap();
            println!("  unmodelled {unmodelled:.1e} m/s^2");
            assert!(unmodelled < 1e-11, "every {every}: {unmodelled}");
        }
    }
}

/// What images share, taken for new in each, is averaged away that should not be.
#[test]
fn shared_errors_taken_for_new_ones_make_the_covariance_too_small() {
    let nees = last_nees(&runs(10, false, 1e-12));
    assert!(nees > chi2_mean_bounds(6, RUNS)[1], "{nees}");
}

#[test]
fn frames_out_of_order_are_refused() {
    let error = run_filter(&[], &[], &FilterOptions::default(), &Ephemeris::analytic()).unwrap_err();
    assert!(error.to_string().contains("follow each other"), "{error}");
}
