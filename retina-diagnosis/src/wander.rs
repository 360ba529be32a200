//! A mount that wanders: exposures' common errors that follow each other.
//!
//! Such errors are noise, and they look like drifts, knocks and slow swings to whoever takes them for independent. Their
//! correlation from group to group, rho, is estimated beside whatever the catalogue could explain in time (a smooth drift, the other
//! columns' means, a step), since those correlate as well. What that takes off the correlation is told by simulation. Under an
//! autoregression of first order the groups' levels less rho times the level before are independent again (D. Cochrane,
//! G. H. Orcutt, JASA 44, 1949): levels, and all columns, are taken so.

use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, StandardNormal};
use rayon::prelude::*;

use crate::data::Dataset;
use crate::linear::{Basis, dot};
use crate::noise::Weights;
use crate::screens::{legendre, screened};
use crate::units::in_time;

/// With fewer groups no correlation is told.
const FEWEST_GROUPS: usize = 12;
/// Degree in time of what is no noise.
const DEGREE: usize = 3;
/// Most columns of which the groups' means are taken out.
const MOST_COLUMNS: usize = 5;
/// Steps that are tried.
const MOST_STEPS: usize = 40;
const SIMULATIONS: usize = 400;
/// Level at which groups are said to follow each other: to miss it costs false alarms, a little of it where there is none
/// costs next to nothing.
const LEVEL: f64 = 0.2;
/// Correlations that are tried. Beyond the last a wandering of some dozen groups is a drift.
const TRIED: [f64; 9] = [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8];

/// Correlation of a group's whitened level with the next one's; 0 where there is none that could be told.
pub(crate) fn correlation(data: &Dataset, residual: &[f64], weights: &Weights) -> f64 {
    let neighbours = Neighbours::of(data, residual, weights).filter(Neighbours::follow);
    neighbours.map_or(0.0, |neighbours| neighbours.likeliest())
}

/// The likeliest correlation, whether it could be told from none or not: for tests that must not take a wandering of a few
/// dozen groups for an effect.
pub(crate) fn likeliest(data: &Dataset, residual: &[f64], weights: &Weights) -> f64 {
    Neighbours::of(data, residual, weights).map_or(0.0, |neighbours| neighbours.likeliest())
}

/// How levels of groups that follow each other agree.
struct Neighbours {
    look: Look,
    groups: usize,
    axes: usize,
    /// Their correlation beside what `look` takes out.
    found: f64,
}

impl Neighbours {
    /// `None` where no correlation can be told.
    fn of(data: &Dataset, residual: &[f64], weights: &Weights) -> Option<Self> {
        let order = in_time(data);
        if !data.jitters || order.len() < FEWEST_GROUPS {
            return None;
        }
        let levels = levels(data, residual, weights, &order);
        let look = Look::new(data, &order);
        let found = look.correlation(&levels)?;
        Some(Self { look, groups: order.len(), axes: levels.len(), found })
    }

    /// The same of levels that have a correlation of `rho`.
    fn simulated(&self, rho: f64, seed: u64, count: usize) -> Vec<f64> {
        (0..count)
            .into_par_iter()
            .filter_map(|k| {
                let mut random = ChaCha8Rng::seed_from_u64(seed);
                random.set_stream(k as u64);
                let drawn: Vec<Vec<f64>> =
                    (0..self.axes).map(|_| autoregression(&mut random, self.groups, rho)).collect();
                self.look.correlation(&drawn)
            })
            .collect()
    }

    /// Whether they agree more than independent levels do.
    fn follow(&self) -> bool {
        let beyond = self.simulated(0.0, 1, SIMULATIONS).iter().filter(|r| **r >= self.found).count();
        (1 + beyond) as f64 <= LEVEL * (1 + SIMULATIONS) as f64
    }

    /// The correlation whose levels agree as these do.
    fn likeliest(&self) -> f64 {
        let off = |rho: f64| {
            let all = self.simulated(rho, 2, SIMULATIONS / 4);
            (all.iter().sum::<f64>() / all.len().max(1) as f64 - self.found).abs()
        };
        TRIED
            .into_iter()
            .map(|rho| (off(rho), rho))
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .map_or(0.0, |best| best.1)
    }
}

/// Whitened level of each group along each axis, in the order of time.
fn levels(data: &Dataset, residual: &[f64], weights: &Weights, order: &[usize]) -> Vec<Vec<f64>> {
    let n = data.components();
    (0..n)
        .map(|axis| {
            order
                .iter()
                .map(|&g| {
                    let rows = data.groups[g].rows.clone();
                    let sum: f64 = weights.weight[rows.clone()].iter().sum();
                    let along: f64 = rows.map(|row| weights.weight[row] * residual[row * n + axis]).sum();
                    if sum > 0.0 { along / sum / (1.0 / sum + weights.jitter_variance).sqrt() } else { 0.0 }
                })
                .collect()
        })
        .collect()
}

fn autoregression(random: &mut ChaCha8Rng, length: usize, rho: f64) -> Vec<f64> {
    let mut normal = || -> f64 { StandardNormal.sample(random) };
    let mut now = normal();
    (0..length)
        .map(|_| {
            let value = now;
            now = rho * now + (1.0 - rho * rho).sqrt() * normal();
            value
        })
        .collect()
}

/// What is taken out of levels before their correlation is told.
struct Look {
    smooth: Basis,
    /// Steps beside that, of unit length.
    steps: Vec<Vec<f64>>,
}

impl Look {
    fn new(data: &Dataset, order: &[usize]) -> Self {
        let count = order.len();
        let place = |k: usize| 2.0 * k as f64 / (count - 1) as f64 - 1.0;
        let mut columns = vec![vec![1.0; count]];
        for degree in 0..DEGREE {
            columns.push((0..count).map(|k| legendre(place(k), DEGREE)[degree]).collect());
        }
        // What varies within an exposure averages out.
        let steady = |name: &&str| {
            let values = data.values(name);
            data.groups
                .iter()
                .all(|group| values[group.rows.clone()].iter().all(|v| *v == values[group.rows.start]))
        };
        let named = screened(data).into_iter().filter(|name| *name != "time_s").filter(steady);
        for name in named.take(MOST_COLUMNS) {
            let values = data.values(name);
            let mean = |&g: &usize| {
                let rows = data.groups[g].rows.clone();
                let sum: f64 = values[rows.clone()].iter().filter(|v| !v.is_nan()).sum();
                sum / rows.len().max(1) as f64
            };
            let means: Vec<f64> = order.iter().map(mean).collect();
            // As they are, and as a slow part of the mount follows them.
            for lag in [1.0, 0.5, 0.15] {
                let mut state = means[0];
                columns.push(
                    means
                        .iter()
                        .map(|value| {
                            state += lag * (value - state);
                            state
                        })
                        .collect(),
                );
            }
        }
        let smooth = Basis::of(columns);
        let stride = count.div_ceil(MOST_STEPS);
        let steps = (2..count - 1)
            .step_by(stride)
            .filter_map(|at| {
                let step = (0..count).map(|k| f64::from(u8::from(k >= at))).collect();
                let mut beside = smooth.residual(step);
                let length = dot(&beside, &beside).sqrt();
                beside.iter_mut().for_each(|v| *v /= length);
                (length > 1e-3).then_some(beside)
            })
            .collect();
        Self { smooth, steps }
    }

    /// Correlation of neighbours in what is left of the levels.
    fn correlation(&self, levels: &[Vec<f64>]) -> Option<f64> {
        let mut left: Vec<Vec<f64>> =
            levels.iter().map(|level| self.smooth.residual(level.clone())).collect();
        let gain = |step: &&Vec<f64>| left.iter().map(|level| dot(step, level).powi(2)).sum::<f64>();
        if let Some(step) = self.steps.iter().max_by(|a, b| gain(a).total_cmp(&gain(b))) {
            for level in &mut left {
                let along = dot(step, level);
                level.iter_mut().zip(step).for_each(|(v, s)| *v -= along * s);
            }
        }
        let squares: f64 = left.iter().flatten().map(|v| v * v).sum();
        let products: f64 =
            left.iter().flat_map(|level| level.windows(2)).map(|pair| pair[0] * pair[1]).sum();
        (squares > 0.0).then(|| products / squares)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Levels that agree as those of a correlation do have that one most likely.
    #[test]
    fn the_likeliest_correlation_is_that_of_levels_which_agree_so() {
        let of = |found: f64| {
            let look = Look {
                smooth: Basis::of([vec![1.0; 60], (0..60).map(f64::from).collect()]),
                steps: Vec::new(),
            };
            Neighbours { look, groups: 60, axes: 2, found }
        };
        for rho in [0.0, 0.4, 0.7] {
            let all = of(0.0).simulated(rho, 7, 200);
            let mean = all.iter().sum::<f64>() / all.len() as f64;
            let likeliest = of(mean).likeliest();
            assert!((likeliest - rho).abs() < 0.11, "{rho}: {likeliest}");
        }
        assert!(of(0.6).follow() && !of(0.0).follow());
    }

    /// Of 60 levels with a correlation of 0.7 most of it is found beside a drift and a step; of none, none.
    #[test]
    fn a_wandering_is_told_from_none() {
        let smooth = Basis::of([vec![1.0; 60], (0..60).map(f64::from).collect()]);
        let step: Vec<f64> =
            (0..60).map(|k| if k < 30 { -(60f64.sqrt()).recip() } else { 60f64.sqrt().recip() }).collect();
        let look = Look { smooth, steps: vec![step] };
        let mean = |rho: f64| {
            let of = |seed: u64| {
                let mut random = ChaCha8Rng::seed_from_u64(seed);
                look.correlation(&[autoregression(&mut random, 60, rho)]).unwrap()
            };
            (0..200).map(of).sum::<f64>() / 200.0
        };
        assert!(mean(0.0).abs() < 0.1 && (0.45..0.75).contains(&mean(0.7)), "{} {}", mean(0.0), mean(0.7));
    }
}
