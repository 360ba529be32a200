//! Tables of a dozen exposures: what can be said of them, and their noise.

mod common;

use common::{ARCSEC, Campaign, setup};
use glam::DVec2;
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, StandardNormal};
use retina_diagnosis::{DiagnoseOptions, Verdict, compare, diagnose};

/// Channels of twelve exposures, in no order.
const CHANNELS: [&str; 12] = ["b", "r", "b", "b", "g", "g", "g", "g", "r", "r", "g", "b"];

/// The table with each exposure in its channel.
fn coloured(table: &str) -> String {
    let line = |line: &str| match line.strip_prefix('e').and_then(|rest| rest[..3].parse::<usize>().ok()) {
        Some(exposure) => line.replace(",w,", &format!(",{},", CHANNELS[exposure])),
        None => line.to_owned(),
    };
    table.lines().map(|l| line(l) + "\n").collect()
}

fn campaign(seed: u64) -> Campaign {
    Campaign { rows: 360, exposures: 12, ..Campaign::new(seed) }
}

/// Sub-pixels side by side shift whole exposures by ten times the noise. Flips of twelve exposures give 0.1 for that.
#[test]
fn channels_of_a_dozen_exposures_are_seen() {
    let of = |exposure: usize| [("r", 1.0), ("b", -1.0)].iter().find(|c| c.0 == CHANNELS[exposure]);
    for seed in 1..=4 {
        let table = campaign(seed)
            .table(&setup(), &|p| p.r + DVec2::X * 15.0 * ARCSEC * of(p.exposure).map_or(0.0, |c| c.1));
        let data = common::dataset(&setup(), &coloured(&table));
        let found = diagnose(&data, &[], &DiagnoseOptions { flips: 999, seed: 1 });
        println!("{:?} {:?}", found.verdict, found.accepted);
        assert!(["subpixel_offset", "colour_wedge"].contains(&found.accepted[0]), "{:?}", found.accepted);
        assert!(matches!(found.verdict, Verdict::Named | Verdict::Confounded), "{:?}", found.verdict);
    }
}

/// A mount that walks at random, ten times the noise from exposure to exposure, follows no channel, temperature or time.
#[test]
fn a_mount_that_walks_is_no_effect() {
    let mut alarms = Vec::new();
    for seed in 1..=30u64 {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut at = DVec2::ZERO;
        let walk: Vec<DVec2> = (0..12)
            .map(|_| {
                at += DVec2::from_array([0, 1].map(|_| StandardNormal.sample(&mut random)));
                at
            })
            .collect();
        let table = campaign(seed).table(&setup(), &|p| p.r + walk[p.exposure] * 15.0 * ARCSEC);
        let data = common::dataset(&setup(), &coloured(&table));
        let found = diagnose(&data, &[], &DiagnoseOptions { flips: 999, seed: 1 });
        alarms.extend(found.accepted.first().copied());
    }
    println!("{alarms:?}");
    assert!(alarms.len() <= 3, "{alarms:?}");
}

/// 120 rows in twelve exposures: a regression of many columns through them would leave a noise of 0.
#[test]
fn the_noise_of_few_rows_is_theirs() {
    for seed in 1..=20 {
        let few = Campaign { rows: 120, outliers: 0.0, ..campaign(seed) };
        let data = few.data(&setup(), &|p| p.r);
        let noise = compare(&data, &[]).noise;
        // 1.5 arcsec at full light, up to 1.95 where it is faint.
        assert!((1.1..2.3).contains(&noise.white), "{seed}: {noise:?}");
    }
}

/// Ten points in each exposure: what an exposure's level takes of their errors is not missing from the noise.
#[test]
fn levels_of_exposures_take_nothing_from_the_noise() {
    let of = |exposures: usize| {
        let all = (1..=6).map(|seed| {
            let many = Campaign { rows: 1200, exposures, outliers: 0.0, ..Campaign::new(seed) };
            compare(&many.data(&setup(), &|p| p.r), &[]).noise.white
        });
        all.sum::<f64>() / 6.0
    };
    let (small, large) = (of(120), of(12));
    assert!((small / large - 1.0).abs() < 0.03, "{small} {large}");
}
