//! Series that do not repeat.

#![allow(clippy::unwrap_used, reason = "a test")]

mod common;

use std::path::Path;

use common::{TRUTH, Truth, plan, readings};
use retina_geometry::Setup;
use retina_response::{Calibrated, PowerReadings, Reading};

/// Factors of twelve series, 1 % rms and a mean of 1.
const FACTORS: [f64; 12] =
    [1.011, 0.987, 1.006, 0.994, 1.016, 0.991, 0.982, 1.009, 1.003, 0.996, 1.014, 0.991];

/// A campaign whose readings of each channel come from these series, by turns; their readings have the series' factors.
fn campaign(series: [&[usize]; 3], named: bool) -> PowerReadings {
    let truth = Truth { proportional: 0.001, ..TRUTH };
    let channels = [0, 1, 2].map(|c| {
        // Three times the plan: enough readings for each series.
        let plan = [plan(), plan(), plan()].concat();
        let own = readings(&truth, &plan, 40 + c as u64, true).into_iter().enumerate();
        own.map(|(k, reading)| {
            let of = series[c][k % series[c].len()];
            let light = reading.irradiance_w_m2 - truth.zero_w_m2;
            let irradiance_w_m2 = truth.zero_w_m2 + FACTORS[of] * light;
            Reading { irradiance_w_m2, series: named.then_some(of), ..reading }
        })
        .collect()
    });
    PowerReadings { files: Vec::new(), channels, white: Vec::new() }
}

fn fitted(readings: PowerReadings) -> Calibrated {
    let setup = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/setups/wide-fov.toml");
    Calibrated::fit(&Setup::read(&setup).unwrap(), readings).unwrap()
}

fn ratio(found: &Calibrated, c: usize) -> f64 {
    found.fits[c].full_w_m2.value / found.fits[0].full_w_m2.value
}

/// Each channel in four series of its own: the channels' ratio is known to half of 1 %, and is said to be; gamma is
/// right. Without the series' names the light's sigma is what the readings' noise alone would leave.
#[test]
fn channels_in_series_of_their_own_are_known_to_the_series_scatter() {
    let found = fitted(campaign([&[0, 1, 2, 3], &[4, 5, 6, 7], &[8, 9, 10, 11]], true));
    let series = found.series.unwrap();
    let relative = series.relative.unwrap();
    assert!(series.series == 12 && (0.005..0.02).contains(&relative), "{series:?}");
    for (c, fit) in found.fits.iter().enumerate() {
        let sigma = fit.full_w_m2.sigma / fit.full_w_m2.value;
        assert!((0.003..0.012).contains(&sigma), "{c}: {sigma}");
        assert!((fit.gamma.value - TRUTH.gamma).abs() < 3.0 * fit.gamma.sigma, "{c}: {:?}", fit.gamma);
        assert!((ratio(&found, c) - 1.0).abs() < 3.0 * sigma, "{c}: {}", ratio(&found, c));
    }
    let nameless = fitted(campaign([&[0, 1, 2, 3], &[4, 5, 6, 7], &[8, 9, 10, 11]], false));
    assert!(nameless.series.is_none());
    assert!(nameless.fits[0].full_w_m2.sigma < 0.002 * nameless.fits[0].full_w_m2.value);
}

/// All channels in each series: their ratio is free of the series' factors, and known to what readings scatter by.
#[test]
fn channels_that_share_series_share_their_factors() {
    let all: Vec<usize> = (0..12).collect();
    let found = fitted(campaign([&all, &all, &all], true));
    assert_eq!(found.series.unwrap().channel_relative, [0.0; 3]);
    for c in 1..3 {
        let sigma = found.fits[c].full_w_m2.sigma / found.fits[c].full_w_m2.value;
        assert!(
            sigma < 5e-4 && (ratio(&found, c) - 1.0).abs() < 5.0 * sigma,
            "{c}: {} {sigma}",
            ratio(&found, c)
        );
    }
}

/// A meter that repeats is not given a scatter, and each channel in a single series is warned of.
#[test]
fn no_scatter_where_none_shows_and_none_told_from_single_series() {
    let single = fitted(campaign([&[8], &[8], &[8]], true));
    assert_eq!(single.series.unwrap().relative, None);
    assert!(single.fits[0].warnings.iter().all(|warning| !warning.contains("series")));
    let apart = fitted(campaign([&[0], &[4], &[8]], true));
    assert_eq!(apart.series.unwrap().relative, None);
    assert!(apart.fits[0].warnings.iter().any(|warning| warning.contains("one series of its own")));
    let mut same = campaign([&[8, 9], &[8, 9], &[8, 9]], true);
    for reading in same.channels.iter_mut().flatten() {
        let light = reading.irradiance_w_m2 - TRUTH.zero_w_m2;
        reading.irradiance_w_m2 = TRUTH.zero_w_m2 + light / FACTORS[reading.series.unwrap()];
    }
    assert_eq!(fitted(same).series.unwrap().relative, Some(0.0));
}
