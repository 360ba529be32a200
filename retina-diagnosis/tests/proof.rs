//! A form that is the best of many in noise is proven no more often than the level says.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

mod common;

use common::{Campaign, setup};
use retina_diagnosis::Halves;

/// Exposures that scatter and do not follow each other: their correlation is estimated, and half of the estimates are too
/// large. The best of 24 waves in time, shifts along one axis, is fitted to half of the exposures.
#[test]
fn the_best_wave_in_the_scatter_of_exposures_is_seldom_proven() {
    let setup = setup();
    let proven = (0..120u64)
        .filter(|seed| {
            let campaign = Campaign {
                rows: 360,
                exposures: 36,
                noise_arcsec: 0.5,
                jitter_arcsec: 2.0,
                outliers: 0.0,
                ..Campaign::new(500 + seed)
            };
            let data = campaign.data(&setup, &|p| p.r);
            let halves = Halves::new(&data, &[]).unwrap();
            let all = &halves.whole().covariate("time_s").unwrap().values;
            let own = &halves.searched().covariate("time_s").unwrap().values;
            let wave = |times: &[f64], k: usize| -> Vec<f64> {
                let phase = std::f64::consts::FRAC_PI_2 * (k % 2) as f64;
                let of =
                    |t: &f64| (0.5 * std::f64::consts::TAU * (1 + k / 4) as f64 * t / 3240.0 + phase).sin();
                times.iter().flat_map(|t| if k % 4 < 2 { [of(t), 0.0] } else { [0.0, of(t)] }).collect()
            };
            let left = halves.search(&[]);
            let score = |k: usize| left.scores(&[vec![wave(own, k)]])[0].statistic;
            let best = (0..24).max_by(|&a, &b| score(a).total_cmp(&score(b))).unwrap();
            halves.prove_columns(&[wave(all, best)], 1).p_value <= 0.05
        })
        .count();
    println!("{proven} of 120");
    // Six are expected; the binomial's 99.9 % are 15.
    assert!(proven <= 15, "{proven} of 120");
}
