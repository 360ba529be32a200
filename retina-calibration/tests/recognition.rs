//! Recognition of patterns among points that are missing, merged and spurious, and in images.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

mod common;

use common::{normal, wide};
use glam::{DMat2, DVec2};
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use retina_calibration::geometry::{Pattern, PatternOptions, recognise};

struct Seen {
    detected: Vec<DVec2>,
    /// Pattern point of each detected one; none of a spurious one.
    truth: Vec<Option<usize>>,
}

/// The pattern through a rotated, mirrored, scaled, shifted camera with 3 % of distortion; some points missing, and
/// spurious ones among them.
fn seen(places: &[DVec2], missing: f64, spurious: f64, seed: u64) -> Seen {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let angle = random.random::<f64>() * std::f64::consts::TAU;
    let mirror = if random.random::<f64>() < 0.5 { -1.0 } else { 1.0 };
    let scale = 0.3 + 2.0 * random.random::<f64>();
    let matrix = DMat2::from_angle(angle) * DMat2::from_diagonal(DVec2::new(scale, scale * mirror));
    let shift = DVec2::new(random.random::<f64>(), random.random::<f64>()) * 3000.0;
    let (mut detected, mut truth) = (Vec::new(), Vec::new());
    for (i, place) in places.iter().enumerate() {
        if random.random::<f64>() < missing {
            continue;
        }
        let u = (*place - DVec2::new(960.0, 600.0)) / 1000.0;
        // 3 % at the corners of the field (r = 1 here).
        let bent = u * (1.0 + 0.03 * u.length_squared()) * 1000.0;
        detected.push(matrix * bent + shift + DVec2::new(normal(&mut random), normal(&mut random)) * 0.1);
        truth.push(Some(i));
    }
    let low = detected.iter().copied().fold(DVec2::INFINITY, DVec2::min);
    let high = detected.iter().copied().fold(DVec2::NEG_INFINITY, DVec2::max);
    for _ in 0..(spurious * places.len() as f64) as usize {
        detected.push(low + (high - low) * DVec2::new(random.random::<f64>(), random.random::<f64>()));
        truth.push(None);
    }
    Seen { detected, truth }
}

fn places(seed: u64, points: usize) -> Vec<DVec2> {
    let options = PatternOptions { points, screens: Some(1), seed, ..PatternOptions::default() };
    let pattern = Pattern::make(&wide(), &options).unwrap();
    pattern.screens[0].points.iter().map(|p| p.screen_px()).collect()
}

#[test]
fn patterns_are_recognised_with_a_third_missing_and_a_third_spurious() {
    let (mut right, mut shown, mut wrong) = (0, 0, 0);
    for seed in 0..60 {
        let places = places(seed, 400);
        let seen = seen(&places, 0.3, 0.3, 1000 + seed);
        let found = recognise(&places, &seen.detected).unwrap_or_else(|| panic!("seed {seed}"));
        shown += seen.truth.iter().flatten().count();
        for (i, j) in &found.pairs {
            match seen.truth[*j] {
                Some(truth) if truth == *i => right += 1,
                _ => wrong += 1,
            }
        }
        assert!(found.log10_chance < -20.0);
    }
    println!("{right} of {shown} right, {wrong} wrong");
    assert!(right as f64 > 0.97 * shown as f64);
    // A spurious point within 0.7 px of a missing one's place: 30 % of 400 points, each with 120 pi 0.7^2 / (1600 x 1200).
    assert!(wrong <= 3, "{wrong}");
}

#[test]
fn another_pattern_is_not_recognised() {
    for seed in 0..40 {
        let seen = seen(&places(seed, 400), 0.1, 0.1, seed);
        assert!(recognise(&places(seed + 500, 400), &seen.detected).is_none(), "seed {seed}");
    }
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let noise: Vec<DVec2> =
        (0..400).map(|_| DVec2::new(random.random::<f64>(), random.random::<f64>()) * 2000.0).collect();
    assert!(recognise(&places(1, 400), &noise).is_none());
}

#[test]
fn few_points_and_many_points() {
    for (points, seed) in [(60, 1), (150, 2), (1500, 3)] {
        let places = places(seed, points);
        let seen = seen(&places, 0.1, 0.1, seed);
        let found = recognise(&places, &seen.detected).unwrap_or_else(|| panic!("{points}"));
        assert!(found.pairs.iter().all(|(i, j)| seen.truth[*j] == Some(*i)));
        assert!(found.pairs.len() as f64 > 0.85 * points as f64, "{points}: {}", found.pairs.len());
    }
}
