//! Simulated fields at many attitudes, and images that are no sky: solved or refused, never wrong.

use glam::{DQuat, DVec2, DVec3};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng as _, SeedableRng as _};
use rand_distr::{Distribution as _, StandardNormal};
use rayon::prelude::*;
use retina_geometry::Pinhole;
use retina_navigation::stars::{Refusal, SolverOptions, StarCamera, StarPoint, StarSolution, StarSolver};
use retina_navigation::synthetic::{PointNoise, measured};
use retina_navigation::synthetic::{Source, sources};
use retina_sky::ephemeris::{ASTRONOMICAL_UNIT_M, Ephemeris};
use retina_sky::observer::Observer;

use crate::common::draws;

const ARCSEC: f64 = std::f64::consts::PI / 648_000.0;

/// The wide configuration of the paper, 16.09 x 12.10 deg.
fn wide() -> StarCamera {
    StarCamera::from_field(2.0 * (1024.0_f64 * 3.45e-3 / 25.0).atan(), [2048, 1536])
}

/// The narrow one, 8.08 x 6.07 deg.
fn narrow() -> StarCamera {
    StarCamera::from_field(2.0 * (1024.0_f64 * 3.45e-3 / 50.0).atan(), [2048, 1536])
}

fn uniform(random: &mut ChaCha8Rng) -> f64 {
    (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64
}

fn normal(random: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(random)
}

/// Uniform over all rotations: a quaternion of four normal deviates.
fn attitude(random: &mut ChaCha8Rng) -> DQuat {
    DQuat::from_xyzw(normal(random), normal(random), normal(random), normal(random)).normalize()
}

/// 2027, at 1 au, at the Earth's speed.
fn observer() -> Observer {
    Observer::new(
        &Ephemeris::analytic(),
        27.0 * 365.25 * 86_400.0,
        DVec3::X * ASTRONOMICAL_UNIT_M,
        Some(DVec3::new(0.0, 27_000.0, 12_000.0)),
    )
    .unwrap()
}

/// A simulated field: the true attitude and the points.
fn field(camera: &Pinhole, noise: &PointNoise, seed: u64) -> (DQuat, Vec<StarPoint>) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let truth = attitude(&mut random);
    let shown: Vec<Source> = sources(&observer(), truth, camera, 8.4).unwrap();
    let points = measured(&shown, camera, noise, &mut random).into_iter().map(|(point, _)| point).collect();
    (truth, points)
}

/// (cross-boresight, about-boresight) error, arcsec.
fn error_arcsec(found: DQuat, truth: DQuat) -> [f64; 2] {
    let off = rotation(found, truth);
    [off.truncate().length() / ARCSEC, off.z.abs() / ARCSEC]
}

/// The rotation vector from one attitude to another, camera axes, the short way round.
fn rotation(found: DQuat, truth: DQuat) -> DVec3 {
    let off = found * truth.inverse();
    (if off.w < 0.0 { -off } else { off }).to_scaled_axis()
}

/// Solved, wrong (beyond 60 arcsec), and all the errors.
fn rates(camera: &StarCamera, noise: &PointNoise, fields: u64) -> (usize, usize, Vec<[f64; 2]>) {
    let solver = StarSolver::new(camera, SolverOptions::default());
    let errors: Vec<[f64; 2]> = (0..fields)
        .into_par_iter()
        .filter_map(|seed| {
            let (truth, points) = field(&camera.pinhole, noise, seed);
            let found = solver.solve(&points, Some(&observer())).ok()?;
            Some(error_arcsec(found.camera_from_inertial(), truth))
        })
        .collect();
    let wrong = errors.iter().filter(|[cross, _]| *cross > 60.0).count();
    (errors.len(), wrong, errors)
}

#[test]
fn fields_at_random_attitudes_are_solved_and_none_wrongly() {
    for (camera, noise) in [
        (wide(), PointNoise::default()),
        (narrow(), PointNoise { limiting_magnitude: 7.5, ..PointNoise::default() }),
    ] {
        let (solved, wrong, mut errors) = rates(&camera, &noise, 500);
        assert_eq!(wrong, 0);
        assert!(solved >= 495, "{solved} of 500");
        // Some 40 stars of 0.14 to 0.2 px (28.5 or 14 arcsec): below 2 arcsec each way across, tens about.
        errors.sort_by(|a, b| a[0].total_cmp(&b[0]));
        assert!(errors[errors.len() / 2][0] < 2.0, "{:?}", errors[errors.len() / 2]);
    }
}

#[test]
fn the_covariance_is_honest() {
    let camera = wide();
    let solver = StarSolver::new(&camera, SolverOptions::default());
    let noise = PointNoise { false_points: 0.0, ..PointNoise::default() };
    let distances: Vec<f64> = (0..300)
        .into_par_iter()
        .filter_map(|seed| {
            let (truth, points) = field(&camera.pinhole, &noise, 10_000 + seed);
            let found = solver.solve(&points, Some(&observer())).ok()?;
            let off = rotation(found.camera_from_inertial(), truth);
            Some(off.dot(found.attitude_covariance_rad2.inverse() * off))
        })
        .collect();
    let mean = distances.iter().sum::<f64>() / distances.len() as f64;
    // Chi-square of three degrees of freedom: mean 3, of 300 samples +- 0.14. Outliers are cut off and the spread is
    // estimated by a median, so it is allowed a fifth.
    assert!((2.4..3.8).contains(&mean), "{mean}");
}

#[test]
fn without_an_observer_the_answer_is_the_apparent_sky() {
    let camera = wide();
    let solver = StarSolver::new(&camera, SolverOptions::default());
    let (truth, points) = field(&camera.pinhole, &PointNoise::default(), 77);
    let found = solver.solve(&points, None).unwrap();
    let [cross, _] = error_arcsec(found.camera_from_inertial(), truth);
    // Aberration at 29.5 km/s is up to 20.3 arcsec; here it is not corrected.
    assert!(cross > 2.0 && cross < 25.0, "{cross}");
}

/// Points at random places with the light of stars: counts that grow by 10^0.4 a magnitude or so.
fn random_points(camera: &Pinhole, count: usize, clumped: bool, random: &mut ChaCha8Rng) -> Vec<StarPoint> {
    let centres: Vec<DVec2> =
        (0..4).map(|_| DVec2::new(uniform(random) * 2048.0, uniform(random) * 1536.0)).collect();
    let mut points: Vec<StarPoint> = (0..count)
        .map(|i| {
            let mut pixel = DVec2::new(uniform(random) * 2048.0, uniform(random) * 1536.0);
            if clumped {
                let about = DVec2::new(normal(random), normal(random)) * 90.0;
                pixel = (centres[i % 4] + about).clamp(DVec2::ONE, DVec2::new(2047.0, 1535.0));
            }
            StarPoint {
                pixel,
                line_of_sight: camera.line_of_sight(pixel),
                sigma_rad: 0.1 / camera.fx_px,
                flux: 100.0 / uniform(random).max(1e-4),
                saturated: false,
                on_edge: false,
            }
        })
        .collect();
    points.sort_by(|a, b| b.flux.total_cmp(&a.flux));
    points
}

/// A camera of which nothing is known but that its field is 2 to 70 deg wide, and a solver for it.
fn blind(size: [u32; 2]) -> (StarCamera, StarSolver) {
    let [short, long] = [70.0f64, 2.0].map(|field_deg| 1.0 / (0.5 * field_deg.to_radians()).tan());
    let middle = (short * long).sqrt();
    let camera = StarCamera::from_field(2.0 * (1.0 / middle).atan(), size);
    let options = SolverOptions {
        focal_ratio: [short / middle, long / middle],
        mirrored_too: true,
        ..SolverOptions::default()
    };
    let solver = StarSolver::new(&camera, options);
    (camera, solver)
}

#[test]
fn no_field_of_false_stars_is_taken_for_the_sky() {
    let camera = wide();
    // Every other field at any focal length; a mirrored answer is a false one, too.
    let known = StarSolver::new(&camera, SolverOptions::default());
    let (anything, blind) = blind([2048, 1536]);
    let accepted: usize = (0..draws(500))
        .into_par_iter()
        .filter(|seed| {
            let mut random = ChaCha8Rng::seed_from_u64(*seed);
            let count = [4, 8, 15, 30, 60, 200][*seed as usize / 2 % 6];
            let (camera, solver) = if seed % 2 == 0 { (&camera, &known) } else { (&anything, &blind) };
            let points = random_points(&camera.pinhole, count, seed % 3 == 0, &mut random);
            !matches!(
                solver.solve(&points, None),
                Err(Refusal::NoMatch { .. } | Refusal::TooFewPoints { .. })
            )
        })
        .count();
    assert_eq!(accepted, 0);
}

#[test]
fn fields_of_any_width_are_solved_without_knowing_it_mirrored_or_not() {
    let size = [1024, 768];
    let (anything, blind) = blind(size);
    // Horizontal field, deg, and magnitudes that leave some 30 stars in it.
    let fields = [
        (4.0, 8.4),
        (6.0, 8.0),
        (8.0, 7.5),
        (11.4, 7.0),
        (16.0, 6.3),
        (24.0, 5.5),
        (35.0, 4.8),
        (50.0, 4.2),
        (65.0, 4.0),
    ];
    for (field_deg, limiting_magnitude) in fields {
        let camera = StarCamera::from_field(f64::to_radians(field_deg), size);
        let noise = PointNoise { limiting_magnitude, false_points: 8.0, ..PointNoise::default() };
        let solved = (0..40u64)
            .into_par_iter()
            .filter(|seed| {
                let (truth, points) = field(&camera.pinhole, &noise, 500 + seed);
                let mirrored = seed % 2 == 1;
                let points: Vec<StarPoint> = points
                    .iter()
                    .map(|p| StarPoint {
                        line_of_sight: anything.pinhole.line_of_sight(p.pixel),
                        sigma_rad: p.sigma_rad * camera.pinhole.fx_px / anything.pinhole.fx_px,
                        ..*p
                    })
                    .map(|p| if mirrored { p.flipped() } else { p })
                    .collect();
                let Ok(found) = blind.solve(&points, Some(&observer())) else { return false };
                let [cross, about] = error_arcsec(found.camera_from_inertial(), truth);
                let pixel_arcsec = field_deg * 3600.0 / 1024.0;
                // No answer is wrong: the focal length and the attitude are those of the field.
                let focal = anything.pinhole.fx_px * found.fit.focal_ratio / camera.pinhole.fx_px;
                assert!(
                    cross < pixel_arcsec && about < 30.0 * pixel_arcsec,
                    "{field_deg} {seed}: {cross} {about}"
                );
                assert!(
                    (focal - 1.0).abs() < 5e-3 && found.mirrored == mirrored,
                    "{field_deg} {seed}: {focal}"
                );
                true
            })
            .count();
        assert!(solved >= 38, "{field_deg} deg: {solved} of 40");
    }
}

#[test]
fn the_search_stops_at_its_limit_and_says_so() {
    let camera = wide();
    let points = random_points(&camera.pinhole, 60, false, &mut ChaCha8Rng::seed_from_u64(1));
    let refusal = |most_hypotheses: usize| {
        let options = SolverOptions { most_hypotheses, ..SolverOptions::default() };
        StarSolver::new(&camera, options).solve(&points, None).unwrap_err()
    };
    let all = match refusal(usize::MAX) {
        Refusal::NoMatch { hypotheses, stopped: false, .. } => hypotheses,
        other => panic!("{other}"),
    };
    // None is looked at beyond the limit; a known camera's are fewer than the default allows.
    let most = all / 2;
    let stopped = refusal(most);
    assert!(
        matches!(stopped, Refusal::NoMatch { hypotheses, stopped: true, .. } if hypotheses == most),
        "{stopped}"
    );
    assert!(stopped.to_string().contains(&format!("of {most} hypotheses")), "{stopped}");
    assert!(stopped.to_string().contains("the search stopped at that number"), "{stopped}");
    let whole = refusal(SolverOptions::default().most_hypotheses);
    assert!(
        matches!(whole, Refusal::NoMatch { hypotheses, stopped: false, .. } if hypotheses == all),
        "{whole}"
    );
    // A sky is found before a limit that a false one reaches.
    let (truth, points) = field(&camera.pinhole, &PointNoise::default(), 5);
    let options = SolverOptions { most_hypotheses: 100, ..SolverOptions::default() };
    let found = StarSolver::new(&camera, options).solve(&points, Some(&observer())).unwrap();
    assert!(error_arcsec(found.camera_from_inertial(), truth)[0] < 10.0);
}

#[test]
fn an_empty_sky_is_refused() {
    let camera = wide();
    let solver = StarSolver::new(&camera, SolverOptions::default());
    let refusal = solver.solve(&[], None).unwrap_err();
    assert_eq!(refusal.reason(), "too_few_points");
    assert!(refusal.to_string().contains("only 0 separate points"), "{refusal}");
}

fn solved(points: &[StarPoint], camera: &StarCamera) -> Result<StarSolution, Refusal> {
    StarSolver::new(camera, SolverOptions::default()).solve(points, Some(&observer()))
}

#[test]
fn a_focal_length_wrong_by_two_per_cent_is_found() {
    for factor in [0.98, 1.02] {
        let camera = wide();
        let (truth, points) = field(&camera.pinhole, &PointNoise::default(), 5);
        let mut wrong = camera.clone();
        wrong.pinhole.fx_px *= factor;
        wrong.pinhole.fy_px *= factor;
        let points: Vec<StarPoint> = points
            .iter()
            .map(|p| StarPoint { line_of_sight: wrong.pinhole.line_of_sight(p.pixel), ..*p })
            .collect();
        let found = solved(&points, &wrong).unwrap();
        assert!((found.fit.focal_ratio * factor - 1.0).abs() < 2e-4, "{}", found.fit.focal_ratio);
        assert!(error_arcsec(found.camera_from_inertial(), truth)[0] < 10.0);
    }
}

#[test]
fn a_focal_length_that_was_ruled_out_is_refused() {
    let camera = wide();
    let (_, points) = field(&camera.pinhole, &PointNoise::default(), 5);
    let seen_with = |factor: f64| {
        let mut wrong = camera.clone();
        wrong.pinhole.fx_px *= factor;
        wrong.pinhole.fy_px *= factor;
        let points: Vec<StarPoint> = points
            .iter()
            .map(|p| StarPoint { line_of_sight: wrong.pinhole.line_of_sight(p.pixel), ..*p })
            .collect();
        let options = SolverOptions { focal_ratio: [1.0, 1.0], ..SolverOptions::default() };
        StarSolver::new(&wrong, options).solve(&points, Some(&observer()))
    };
    assert!(seen_with(1.0).is_ok());
    let refusal = seen_with(1.003).unwrap_err();
    assert_eq!(refusal.reason(), "focal_length", "{refusal}");
    assert!(refusal.to_string().contains("-0.30 % off, and +0.00 to +0.00 % was allowed"), "{refusal}");
}

#[test]
fn a_mirrored_image_is_said_to_be_one() {
    let camera = wide();
    let (truth, points) = field(&camera.pinhole, &PointNoise::default(), 6);
    let flip = |p: &StarPoint| {
        let pixel = DVec2::new(2048.0 - p.pixel.x, p.pixel.y);
        StarPoint { pixel, line_of_sight: camera.pinhole.line_of_sight(pixel), ..*p }
    };
    let mirrored: Vec<StarPoint> = points.iter().map(flip).collect();
    let refusal = solved(&mirrored, &camera).unwrap_err();
    assert_eq!(refusal.reason(), "mirrored");
    assert!(refusal.to_string().contains("mirrored left to right"), "{refusal}");
    // Told so, it is solved.
    let Refusal::Mirrored { flipped } = refusal else { unreachable!() };
    assert!(error_arcsec(flipped.camera_from_inertial(), truth)[0] < 10.0);
}

#[test]
fn radial_distortion_that_nobody_knew_is_fitted() {
    let camera = wide();
    let (truth, points) =
        field(&camera.pinhole, &PointNoise { systematic_px: 0.05, ..PointNoise::default() }, 7);
    let k1 = -0.08;
    let distorted: Vec<StarPoint> = points
        .iter()
        .map(|p| {
            let m = p.line_of_sight * (1.0 + k1 * p.line_of_sight.length_squared());
            StarPoint { pixel: camera.pinhole.pixel(m), line_of_sight: m, ..*p }
        })
        .collect();
    let found = solved(&distorted, &camera).unwrap();
    let sigma = found.k1_sigma.unwrap();
    assert!((found.fit.k1 - k1).abs() < 4.0 * sigma && sigma < 0.02, "{} +- {sigma}", found.fit.k1);
    assert!(error_arcsec(found.camera_from_inertial(), truth)[0] < 10.0);
}

#[test]
fn the_distortion_that_left_out_stars_ask_for_is_fitted_and_no_more() {
    let camera = wide();
    let noise = PointNoise { systematic_px: 0.05, limiting_magnitude: 7.5, ..PointNoise::default() };
    // Brown's model written out: k1, k2, p1, p2. 12 px at the corner, of which k1 alone would leave 1.4 px.
    let brown = |p: DVec2, [k1, k2, p1, p2]: [f64; 4]| {
        let r2 = p.length_squared();
        let radial = 1.0 + k1 * r2 + k2 * r2 * r2;
        DVec2::new(
            p.x * radial + 2.0 * p1 * p.x * p.y + p2 * (r2 + 2.0 * p.x * p.x),
            p.y * radial + p1 * (r2 + 2.0 * p.y * p.y) + 2.0 * p2 * p.x * p.y,
        )
    };
    for (coefficients, rich) in [([-0.3, 0.0, 0.0, 0.0], false), ([-0.3, 2.0, 0.01, -0.015], true)] {
        for seed in [7, 8, 9] {
            let (truth, points) = field(&camera.pinhole, &noise, seed);
            let distorted: Vec<StarPoint> = points
                .iter()
                .map(|p| {
                    let m = brown(p.line_of_sight, coefficients);
                    StarPoint { pixel: camera.pinhole.pixel(m), line_of_sight: m, ..*p }
                })
                .collect();
            let found = solved(&distorted, &camera).unwrap();
            assert_eq!(found.higher_sigma.is_some(), rich, "{seed}: {:?}", found.fit);
            assert!(error_arcsec(found.camera_from_inertial(), truth)[0] < 15.0, "{seed}: {:?}", found.fit);
            // 28.5 arcsec a pixel: 0.05 px systematic, and the faint stars' noise.
            assert!(found.rms_rad / ARCSEC < 8.0, "{seed}: {}", found.rms_rad / ARCSEC);
        }
    }
}

#[test]
fn the_shape_of_pixels_is_found_from_about_it() {
    let aspect = 1.93;
    let truth_camera = wide().with_pixel_aspect(aspect);
    let square = StarSolver::new(&wide(), SolverOptions::default());
    let about = wide().with_pixel_aspect(1.95);
    let near = square.of_pixel_aspect(&about);
    let seen_with = |points: &[StarPoint], camera: &StarCamera| -> Vec<StarPoint> {
        points
            .iter()
            .map(|p| StarPoint { line_of_sight: camera.pinhole.line_of_sight(p.pixel), ..*p })
            .collect()
    };
    let noise = PointNoise { false_points: 0.0, ..PointNoise::default() };
    let mut solved = 0;
    for seed in 0..20 {
        let (truth, points) = field(&truth_camera.pinhole, &noise, seed);
        // Square pixels do not explain it.
        assert!(square.solve(&seen_with(&points, &wide()), Some(&observer())).is_err());
        let Ok(found) = near.solve(&seen_with(&points, &about), Some(&observer())) else { continue };
        let (fitted, sigma) = (1.95 / found.fit.aspect, 1.95 * found.aspect_sigma.unwrap());
        assert!((fitted - aspect).abs() < 4.5 * sigma && sigma < 3e-3, "{seed}: {fitted} +- {sigma}");
        assert!(error_arcsec(found.camera_from_inertial(), truth)[0] < 20.0, "{seed}");
        solved += 1;
    }
    assert!(solved >= 14, "{solved} of 20");
}
