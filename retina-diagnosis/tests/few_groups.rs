//! Tables of a dozen exposures: what can be said of them, and their noise.

mod common;

use common::{ARCSEC, Campaign, setup};
use glam::DVec2;
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

/// A mount that wanders as far, each exposure from where the last one ended, is not mistaken for the channels.
#[test]
fn a_mount_that_wanders_is_no_channel() {
    let mut alarms = 0;
    for seed in 1..=12u64 {
        // Steps of ten times the noise, in directions that no channel follows.
        let at = |exposure: usize| {
            (0..exposure)
                .map(|k| DVec2::from_angle(2.4 * (k as f64 + 1.0) * (seed as f64 + 0.3)))
                .sum::<DVec2>()
        };
        let table = campaign(seed).table(&setup(), &|p| p.r + at(p.exposure) * 15.0 * ARCSEC);
        let data = common::dataset(&setup(), &coloured(&table));
        let found = diagnose(&data, &[], &DiagnoseOptions { flips: 999, seed: 1 });
        alarms += usize::from(
            found
                .accepted
                .iter()
                .any(|id| ["subpixel_offset", "colour_wedge", "thermal_boresight"].contains(id)),
        );
    }
    assert!(alarms <= 1, "{alarms}");
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
