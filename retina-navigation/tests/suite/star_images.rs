//! Whole images, good and bad: solved or refused, never wrong.

use glam::{DQuat, DVec2, DVec3};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng as _, SeedableRng as _};
use rand_distr::{Distribution as _, StandardNormal};
use rayon::prelude::*;
use retina_image::{CameraImage, DetectOptions};
use retina_navigation::image::{ImageContext, ImageResult, solve_image};
use retina_navigation::planets::PriorPosition;
use retina_navigation::stars::{SolverOptions, StarCamera, StarSolver};
use retina_navigation::synthetic::sources;
use retina_sky::ephemeris::Ephemeris;
use retina_sky::observer::Observer;
use retina_sky::planets::{Planet, seen_planet};

const ARCSEC: f64 = std::f64::consts::PI / 648_000.0;
const SIZE: [u32; 2] = [1024, 768];
const TDB_S: f64 = 27.0 * 365.25 * 86_400.0;

fn camera() -> StarCamera {
    StarCamera::from_field(14f64.to_radians(), SIZE)
}

/// At the Earth's place, without the Earth.
fn observer() -> Observer {
    let earth = Ephemeris::analytic().solar_system(TDB_S).unwrap().earth;
    Observer::new(&Ephemeris::analytic(), TDB_S, earth.position_m + DVec3::Z * 1e9, Some(earth.velocity_m_s))
        .unwrap()
}

/// Boresight at a right ascension and declination, turned about it.
fn attitude(ra_deg: f64, dec_deg: f64, turn: f64) -> DQuat {
    let (ra, dec) = (ra_deg.to_radians(), dec_deg.to_radians());
    let axis = DVec3::new(dec.cos() * ra.cos(), dec.cos() * ra.sin(), dec.sin());
    DQuat::from_rotation_z(turn) * DQuat::from_rotation_arc(axis, DVec3::Z)
}

/// A dark image: offset 100, noise 3 DN, 12 bits.
fn dark(random: &mut ChaCha8Rng) -> CameraImage {
    let mut image = CameraImage::new(SIZE[0], SIZE[1], 4095.0);
    for value in &mut image.values {
        let noise: f32 = StandardNormal.sample(random);
        *value = 100.0 + 3.0 * noise;
    }
    image
}

/// Adds a Gaussian spot of 0.9 px.
fn spot(image: &mut CameraImage, at: DVec2, light_dn: f64) {
    let half = 12.0;
    for y in (at.y - half).max(0.0) as u32..((at.y + half) as u32).min(SIZE[1]) {
        for x in (at.x - half).max(0.0) as u32..((at.x + half) as u32).min(SIZE[0]) {
            let off = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5) - at;
            let share = (-0.5 * off.length_squared() / 0.81).exp() / (std::f64::consts::TAU * 0.81);
            image.values[(y * SIZE[0] + x) as usize] += (light_dn * share) as f32;
        }
    }
}

/// The sky, each star drawn at `copies` places along a trail (px): V 3 has 20 000 DN.
fn sky(truth: DQuat, random: &mut ChaCha8Rng, trail_px: DVec2) -> CameraImage {
    let mut image = dark(random);
    let copies = 1 + trail_px.length() as usize;
    for source in sources(&observer(), truth, &camera().pinhole, 7.0).unwrap() {
        let light = 20_000.0 * 10f64.powf(0.4 * (3.0 - source.magnitude)) / copies as f64;
        let middle = camera().pinhole.pixel(source.line_of_sight);
        for i in 0..copies {
            let along = (i as f64 + 0.5) / copies as f64 - 0.5;
            spot(&mut image, middle + trail_px * along, light);
        }
    }
    image
}

/// As a sensor gives it: whole numbers up to full scale.
fn digitised(mut image: CameraImage) -> CameraImage {
    image.values.iter_mut().for_each(|value| *value = value.round().clamp(0.0, 4095.0));
    image
}

fn solve(image: CameraImage, solver: &StarSolver, context: &ImageContext) -> ImageResult {
    solve_image(&digitised(image), &camera(), solver, &DetectOptions::default(), context).unwrap()
}

fn solver() -> StarSolver {
    StarSolver::new(&camera(), SolverOptions { tdb_s: TDB_S, ..SolverOptions::default() })
}

fn known() -> ImageContext {
    ImageContext { observer: Some(observer()), ..ImageContext::default() }
}

fn cross_arcsec(result: &ImageResult, truth: DQuat) -> Option<f64> {
    let found = result.solution.as_ref().ok()?.camera_from_inertial();
    Some((found.inverse() * DVec3::Z).angle_between(truth.inverse() * DVec3::Z) / ARCSEC)
}

#[test]
fn a_clean_image_is_solved_and_a_trailed_one_is_solved_or_refused() {
    let solver = solver();
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let truth = attitude(83.0, -2.0, 0.7);
    let clean = solve(sky(truth, &mut random, DVec2::ZERO), &solver, &known());
    assert!(cross_arcsec(&clean, truth).unwrap() < 3.0);
    // 15 px of trail: the middle of each is found or nothing is.
    for trail in [DVec2::new(6.0, 3.0), DVec2::new(15.0, 0.0), DVec2::new(-30.0, 40.0)] {
        let trailed = solve(sky(truth, &mut random, trail), &solver, &known());
        if let Some(off) = cross_arcsec(&trailed, truth) {
            // A pixel is 49 arcsec.
            assert!(off < 60.0, "trail {trail}: {off} arcsec");
        }
    }
}

#[test]
fn empty_and_noisy_images_are_refused() {
    let solver = solver();
    let taken = (0..60u64)
        .into_par_iter()
        .filter(|seed| {
            let mut random = ChaCha8Rng::seed_from_u64(100 + seed);
            let mut image = dark(&mut random);
            let uniform = |random: &mut ChaCha8Rng| (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64;
            match seed % 3 {
                // Nothing but noise.
                0 => {}
                // A nebula: smooth blobs with noise of their own light.
                1 => {
                    for _ in 0..12 {
                        let at = [uniform(&mut random) * 1024.0, uniform(&mut random) * 768.0];
                        let (wide, high) = (20.0 + 80.0 * uniform(&mut random), 300.0 * uniform(&mut random));
                        for (pixel, value) in image.values.iter_mut().enumerate() {
                            let off = [(pixel % 1024) as f64 - at[0], (pixel / 1024) as f64 - at[1]];
                            let light =
                                high * (-0.5 * (off[0] * off[0] + off[1] * off[1]) / (wide * wide)).exp();
                            if light > 0.5 {
                                let noise: f64 = StandardNormal.sample(&mut random);
                                *value += (light + noise * (4.0 * light).sqrt()) as f32;
                            }
                        }
                    }
                }
                // False stars.
                _ => {
                    for _ in 0..80 {
                        let at = DVec2::new(uniform(&mut random) * 1024.0, uniform(&mut random) * 768.0);
                        spot(&mut image, at, 400.0 / uniform(&mut random).max(1e-2));
                    }
                }
            }
            solve(image, &solver, &ImageContext::default()).solution.is_ok()
        })
        .count();
    assert_eq!(taken, 0);
}

#[test]
fn a_saturated_planet_does_not_disturb_and_is_identified() {
    let solver = solver();
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let jupiter = seen_planet(&observer(), Planet::Jupiter).unwrap().unwrap();
    let off = DQuat::from_axis_angle(jupiter.direction.any_orthonormal_vector(), 0.04);
    let truth = DQuat::from_rotation_z(1.0) * DQuat::from_rotation_arc(off * jupiter.direction, DVec3::Z);
    let mut image = sky(truth, &mut random, DVec2::ZERO);
    let v = truth * jupiter.direction;
    let at = camera().pinhole.pixel(v.truncate() / v.z);
    // A blooming column beside the disc.
    for y in (at.y - 20.0) as usize..(at.y + 20.0) as usize {
        image.values[y * 1024 + at.x as usize] += 6000.0;
    }
    let prior = PriorPosition { observer: observer(), sigma_m: 1e8 / 3.0 };
    let context = ImageContext { observer: Some(observer()), prior: Some(prior), ..ImageContext::default() };
    let result = solve(image, &solver, &context);
    assert!(cross_arcsec(&result, truth).unwrap() < 3.0);
    let sight = result.planets.iter().find(|sight| sight.planet == Planet::Jupiter).unwrap();
    assert!(result.points[sight.point].saturated);
    assert!(sight.direction.angle_between(jupiter.direction) < 60.0 * ARCSEC);
}

#[test]
fn a_planet_is_not_found_where_the_prior_position_says_it_is_not() {
    let solver = solver();
    let mut random = ChaCha8Rng::seed_from_u64(4);
    let saturn = seen_planet(&observer(), Planet::Saturn).unwrap().unwrap();
    let truth = DQuat::from_rotation_arc(
        DQuat::from_axis_angle(saturn.direction.any_orthonormal_vector(), 0.03) * saturn.direction,
        DVec3::Z,
    );
    let find = |prior: PriorPosition, random: &mut ChaCha8Rng| {
        let context = ImageContext {
            observer: Some(prior.observer.clone()),
            prior: Some(prior),
            ..ImageContext::default()
        };
        solve(sky(truth, random, DVec2::ZERO), &solver, &context).planets
    };
    let right = find(PriorPosition { observer: observer(), sigma_m: 1e8 / 3.0 }, &mut random);
    let sight = right.iter().find(|sight| sight.planet == Planet::Saturn).unwrap();
    // 3 arcsec is a sixteenth of a pixel.
    assert!(sight.direction.angle_between(saturn.direction) < 3.0 * ARCSEC);
    // It is saturated: no less than 0.05 px of 49.5 arcsec (2 tan(7 deg) / 1024), but the spot is round, and 0.3 px would
    // be far too much.
    let sigma_arcsec = sight.covariance_rad2.x_axis.x.sqrt() / ARCSEC;
    assert!((2.4..15.0).contains(&sigma_arcsec), "{sigma_arcsec}");
    // Ten million kilometres off, which is 25 arcmin at Saturn, and sure of 10^5.
    let elsewhere = Observer::new(
        &Ephemeris::analytic(),
        TDB_S,
        observer().position_m() + saturn.direction.any_orthonormal_vector() * 1e10,
        Some(Ephemeris::analytic().solar_system(TDB_S).unwrap().earth.velocity_m_s),
    )
    .unwrap();
    let wrong = find(PriorPosition { observer: elsewhere, sigma_m: 1e8 / 3.0 }, &mut random);
    assert!(wrong.iter().all(|sight| sight.planet != Planet::Saturn));
}
