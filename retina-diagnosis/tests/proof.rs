//! How often a form that is the best of many in noise is proven.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

mod common;

use common::{Campaign, setup};
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, StandardNormal};
use retina_diagnosis::{Dataset, Halves, Part};

/// Exposures scatter and do not follow each other. The likeliest correlation is often too large, and would
/// bring the errors that the form was fitted to into the proof. The form is the best of 200: the same shift along one axis,
/// drawn for each exposure.
#[test]
fn the_best_shift_in_the_scatter_of_exposures_is_seldom_proven() {
    let setup = setup();
    let drawn: Vec<Vec<f64>> = (0..200)
        .map(|seed| {
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            (0..24).map(|_| StandardNormal.sample(&mut random)).collect()
        })
        .collect();
    let proven = (0..1000u64)
        .filter(|seed| {
            let campaign = Campaign {
                rows: 96,
                exposures: 24,
                noise_arcsec: 0.5,
                jitter_arcsec: 2.0,
                outliers: 0.0,
                ..Campaign::new(500 + seed)
            };
            let data = campaign.data(&setup, &|p| p.r);
            let halves = Halves::new(&data, &[]).unwrap();
            let shift = |data: &Dataset, k: usize| -> Vec<f64> {
                let times = &data.covariate("time_s").unwrap().values;
                let of = |t: &f64| drawn[k][(t / 90.0).round() as usize];
                times
                    .iter()
                    .flat_map(|t| if k.is_multiple_of(2) { [of(t), 0.0] } else { [0.0, of(t)] })
                    .collect()
            };
            let left = halves.left(Part::Half, &[]);
            let score = |k: usize| left.scores(&[vec![shift(halves.data(Part::Half), k)]])[0].statistic;
            let best = (0..200).max_by(|&a, &b| score(a).total_cmp(&score(b))).unwrap();
            halves.prove_columns(&[shift(halves.data(Part::Whole), best)], 1).p_value <= 0.05
        })
        .count();
    println!("{proven} of 1000");
    // Fifty are expected. Some more are found: in a fifth of such tables a correlation is told that is not there. With the
    // likeliest correlation alone there are 85.
    assert!(proven <= 70, "{proven} of 1000");
}
