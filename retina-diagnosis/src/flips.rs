//! p-values by flipping the signs of units, for many candidates at once.

use faer::Mat;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, StandardNormal};
use rayon::prelude::*;

use crate::data::Dataset;
use crate::score::{Score, deviate};
use crate::series::two_sided;
use crate::units::Units;

/// Flips that are counted together.
const FLIP_BLOCK: usize = 256;

/// Draws from the null: a row for each, +-1 for each range of rows (one sign a unit), then a normal deviate for each
/// part of the calibration's error.
pub(crate) struct Flips {
    draws: Mat<f64>,
    units: usize,
}

impl Flips {
    pub(crate) fn draw(data: &Dataset, count: usize, seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let (units, field) = (Units::of(data), data.field_len());
        let ranges = units.ranges.len();
        let mut out = Mat::<f64>::zeros(count, ranges + field);
        for draw in 0..count {
            let sign: Vec<f64> =
                (0..units.count).map(|_| if random.random::<bool>() { -1.0 } else { 1.0 }).collect();
            for (range, &unit) in units.unit.iter().enumerate() {
                out[(draw, range)] = sign[unit];
            }
        }
        for draw in 0..count {
            for k in 0..field {
                out[(draw, ranges + k)] = StandardNormal.sample(&mut random);
            }
        }
        Self { draws: out, units: units.count }
    }

    fn count(&self) -> usize {
        self.draws.nrows()
    }
}

/// Share of flips beyond which a candidate's own scale is told.
const TAIL: f64 = 0.01;
/// The distribution of normal errors counts for this many tests: it finds what is far beyond noise, and else leaves the
/// levels to the flips.
pub(crate) const PARAMETRIC: f64 = 10.0;

/// For each candidate (each a list of variants' scores) its p-value, corrected for all that are given.
///
/// By flips: each candidate's best form is measured on the scale of its own flips, so that a form which is searched over
/// many shapes does not set the others' threshold, and the share of flips counts in which any candidate reaches as far
/// (P. H. Westfall, S. S. Young, Resampling-Based Multiple Testing, 1993, sec. 2.5). An effect that few groups carry,
/// a step near the end, can be flipped in few ways only; of such the p-value of normal errors with as many degrees of
/// freedom as groups is taken, times the number of forms and [`PARAMETRIC`], where that is less. Its scale is what the
/// groups scatter by in that form ([`Score::sober_deviate`]): each may have a roll of its own.
pub(crate) fn p_values(candidates: &[Vec<&Score>], flips: &Flips) -> Vec<f64> {
    let scores: Vec<&Score> = candidates.iter().flatten().copied().collect();
    let rank: usize = scores.iter().map(|score| score.rank()).sum();
    let mut contributions = Mat::<f64>::zeros(flips.draws.ncols(), rank);
    let mut first = 0;
    for score in &scores {
        contributions.as_mut().subcols_mut(first, score.rank()).copy_from(&score.contributions);
        first += score.rank();
    }
    let starts: Vec<usize> = (0..flips.count()).step_by(FLIP_BLOCK).collect();
    // For each draw: each candidate's best form.
    let best: Vec<Vec<f64>> = starts
        .par_iter()
        .flat_map_iter(|&start| {
            let count = FLIP_BLOCK.min(flips.count() - start);
            let along = flips.draws.subrows(start, count) * &contributions;
            let mut first = 0;
            let mut best = vec![vec![f64::NEG_INFINITY; candidates.len()]; count];
            for (c, variants) in candidates.iter().enumerate() {
                // Of forms of one rank the largest sum is the largest deviate.
                let mut largest: Vec<(usize, Vec<f64>)> = Vec::new();
                for score in variants {
                    let mut sums = vec![0.0; count];
                    for k in first..first + score.rank() {
                        sums.iter_mut().zip(along.col_as_slice(k)).for_each(|(sum, v)| *sum += v * v);
                    }
                    first += score.rank();
                    match largest.iter_mut().find(|(rank, _)| *rank == score.rank()) {
                        Some((_, most)) => most.iter_mut().zip(&sums).for_each(|(m, s)| *m = m.max(*s)),
                        None => largest.push((score.rank(), sums)),
                    }
                }
                for (rank, most) in &largest {
                    for (draw, sum) in best.iter_mut().zip(most) {
                        draw[c] = draw[c].max(deviate(*sum, *rank));
                    }
                }
            }
            best
        })
        .collect();
    let own: Vec<f64> = candidates
        .iter()
        .map(|variants| variants.iter().map(|score| score.deviate()).fold(f64::NEG_INFINITY, f64::max))
        .collect();
    let sober: Vec<f64> = candidates
        .iter()
        .map(|variants| variants.iter().map(|score| score.sober_deviate()).fold(f64::NEG_INFINITY, f64::max))
        .collect();
    // Middle and tail of each candidate's draws, the data themselves being one of them.
    let scales: Vec<(f64, f64)> = (0..candidates.len())
        .into_par_iter()
        .map(|c| {
            let mut draws: Vec<f64> = best.iter().map(|draw| draw[c]).collect();
            draws.push(own[c]);
            draws.sort_unstable_by(f64::total_cmp);
            let at = |share: f64| draws[((draws.len() - 1) as f64 * share).round() as usize];
            (at(0.5), (at(1.0 - TAIL) - at(0.5)).max(1e-9))
        })
        .collect();
    let scaled = |c: usize, value: f64| {
        if value == f64::NEG_INFINITY { value } else { (value - scales[c].0) / scales[c].1 }
    };
    let highest: Vec<f64> = best
        .iter()
        .map(|draw| draw.iter().enumerate().map(|(c, v)| scaled(c, *v)).fold(f64::NEG_INFINITY, f64::max))
        .collect();
    own.iter()
        .zip(&sober)
        .enumerate()
        .map(|(c, (&own, &sober))| {
            if own == f64::NEG_INFINITY {
                return 1.0;
            }
            // Sums of flipped and unflipped order differ by rounding.
            let height = scaled(c, own);
            let reached = highest.iter().filter(|h| **h >= height - 1e-9 * height.abs()).count();
            let by_flips = (1 + reached) as f64 / (1 + flips.count()) as f64;
            let least = 1.0 / (1 + flips.count()) as f64;
            let normal = if flips.units > 2 && sober > 0.0 {
                PARAMETRIC * scores.len() as f64 * two_sided(sober, flips.units - 2)
            } else {
                1.0
            };
            by_flips.min(normal.max(least))
        })
        .collect()
}
