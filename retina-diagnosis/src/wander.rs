//! A mount that wanders: exposures' common errors that follow each other.
//!
//! Such errors are noise, and they look like drifts, knocks and slow swings to whoever takes them for independent. Their
//! correlation from group to group, rho, is estimated beside whatever the catalogue could explain in time (a smooth drift, the other
//! columns' means, a step), since those correlate as well: by the restricted likelihood, which knows what they take. Under
//! an autoregression of first order the groups' levels less rho times the level before are independent again (D. Cochrane,
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
/// Most of what is taken out, of the number of groups: nothing is told of levels of which hardly any are left.
const MOST_TAKEN: f64 = 0.4;
/// Steps that are tried.
const MOST_STEPS: usize = 40;
const SIMULATIONS: usize = 400;
/// Level at which groups are said to follow each other. To miss it costs false alarms, and so does a correlation where there
/// is none: what changes to and fro then looks as if it stood out.
const LEVEL: f64 = 0.05;
/// ln of a ratio of likelihoods within which a correlation may as well be another one: one standard deviation.
const HARDLY_LESS: f64 = 0.5;
/// A correlation by which the levels' changes are larger than their size allows is none: changes to and fro would stand out.
const TOO_LARGE: f64 = 1.25;
/// Correlations that are tried. The last are nearly a random walk.
const TRIED: [f64; 11] = [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.97];

/// Correlation of a group's whitened level with the next one's; 0 where there is none that could be told.
pub(crate) fn correlation(data: &Dataset, residual: &[f64], weights: &Weights) -> f64 {
    let neighbours = Neighbours::of(data, residual, weights).filter(Neighbours::follow);
    neighbours.map_or(0.0, |neighbours| TRIED[neighbours.found.largest()])
}

/// The largest correlation that is hardly less likely than the likeliest, whether it could be told from none or not: for
/// tests that must not take a wandering of a few dozen groups for an effect.
pub(crate) fn possible(data: &Dataset, residual: &[f64], weights: &Weights) -> f64 {
    Neighbours::of(data, residual, weights).map_or(0.0, |neighbours| TRIED[neighbours.found.largest()])
}

/// How levels of groups that follow each other agree.
struct Neighbours {
    look: Look,
    axes: usize,
    /// ln of the likelihood of each correlation that is tried.
    found: Likelihoods,
}

/// What levels say of the correlations that are tried.
#[derive(Clone, Copy)]
struct Likelihoods {
    ln: [f64; TRIED.len()],
    /// Variance of the levels, taken as independent, over that of independent levels.
    variance: [f64; TRIED.len()],
}

impl Likelihoods {
    /// The likeliest of those by which levels become as large as they have to be; of equals the least.
    fn best(&self) -> usize {
        let possible = |k: &usize| *k == 0 || self.variance[*k] <= TOO_LARGE;
        (0..TRIED.len())
            .filter(possible)
            .rev()
            .max_by(|&a, &b| self.ln[a].total_cmp(&self.ln[b]))
            .unwrap_or(0)
    }

    /// ln of the likelihood of the likeliest over that of none.
    fn ratio(&self) -> f64 {
        self.ln[self.best()] - self.ln[0]
    }

    /// The largest that is hardly less likely: to take a correlation for less than it is makes a wandering an effect.
    fn largest(&self) -> usize {
        let least = self.ln[self.best()] - HARDLY_LESS;
        let possible = |k: &usize| self.ln[*k] >= least && self.variance[*k] <= TOO_LARGE;
        (0..TRIED.len()).rev().find(possible).unwrap_or(0)
    }
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
        let found = look.likelihoods(&levels)?;
        Some(Self { look, axes: levels.len(), found })
    }

    /// Whether they agree more than independent levels do: by the ratio of the likelihoods, against simulated ones.
    fn follow(&self) -> bool {
        let found = self.found.ratio();
        let beyond = (0..SIMULATIONS)
            .into_par_iter()
            .filter_map(|k| {
                let mut random = ChaCha8Rng::seed_from_u64(1);
                random.set_stream(k as u64);
                let groups = self.look.groups;
                let drawn: Vec<Vec<f64>> =
                    (0..self.axes).map(|_| autoregression(&mut random, groups, 0.0)).collect();
                self.look.likelihoods(&drawn)
            })
            .filter(|drawn| drawn.ratio() >= found)
            .count();
        found > 0.0 && (1 + beyond) as f64 <= LEVEL * (1 + SIMULATIONS) as f64
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
    groups: usize,
    smooth: Basis,
    /// Steps beside that, of unit length.
    steps: Vec<Vec<f64>>,
    /// The same for levels of each correlation.
    tried: Vec<Tried>,
}

/// What is taken out, under a correlation: levels are made independent first.
struct Tried {
    rho: f64,
    smooth: Basis,
    /// ln of the determinant of the levels' covariance and of X^T V^-1 X, of what is taken out but for the step.
    ln_determinants: f64,
    /// Steps beside that, of unit length, and the lengths that they had.
    steps: Vec<Option<(Vec<f64>, f64)>>,
}

/// Levels that have a correlation of `rho` from one to the next, as independent ones of the same variance.
fn independent(rho: f64, levels: &[f64]) -> Vec<f64> {
    let scale = (1.0 - rho * rho).sqrt();
    let first = levels.first().copied();
    first.into_iter().chain(levels.windows(2).map(|pair| (pair[1] - rho * pair[0]) / scale)).collect()
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
        let means: Vec<Vec<f64>> = named
            .take(MOST_COLUMNS)
            .map(|name| {
                let values = data.values(name);
                let mean = |&g: &usize| {
                    let rows = data.groups[g].rows.clone();
                    let sum: f64 = values[rows.clone()].iter().filter(|v| !v.is_nan()).sum();
                    sum / rows.len().max(1) as f64
                };
                order.iter().map(mean).collect()
            })
            .collect();
        // As they are, and then, where there are groups enough, as a slow part of the mount follows them.
        for lag in [1.0, 0.15, 0.5] {
            for means in &means {
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
        columns.truncate((MOST_TAKEN * count as f64) as usize);
        let stride = count.div_ceil(MOST_STEPS);
        let steps = (2..count - 1).step_by(stride);
        let steps = steps.map(|at| (0..count).map(|k| f64::from(u8::from(k >= at))).collect());
        Self::of(count, Basis::of(columns), steps)
    }

    fn of(groups: usize, smooth: Basis, steps: impl Iterator<Item = Vec<f64>>) -> Self {
        let steps: Vec<Vec<f64>> = steps.filter_map(|step| Some(beside(&smooth, step)?.0)).collect();
        let tried = TRIED
            .into_iter()
            .map(|rho| {
                let (mut own, mut ln_determinants) =
                    (Basis::default(), (groups as f64 - 1.0) * (1.0 - rho * rho).ln());
                for column in &smooth.q {
                    let column = independent(rho, column);
                    let left = own.residual(column.clone());
                    ln_determinants += dot(&left, &left).ln();
                    own.push(column);
                }
                let steps = steps.iter().map(|step| beside(&own, independent(rho, step))).collect();
                Tried { rho, smooth: own, ln_determinants, steps }
            })
            .collect();
        Self { groups, smooth, steps, tried }
    }

    /// ln of the restricted likelihood of each correlation (H. D. Patterson, R. Thompson, Biometrika 58, 1971): of what is
    /// left of the levels y beside X, with their common variance at its best,
    /// -1/2 (f ln S + ln|V| + ln|X^T V^-1 X|), S = y^T P y, with f degrees of freedom. The step is the one that takes most.
    fn likelihoods(&self, levels: &[Vec<f64>]) -> Option<Likelihoods> {
        let left: Vec<Vec<f64>> = levels.iter().map(|level| self.smooth.residual(level.clone())).collect();
        let gain = |k: usize| left.iter().map(|level| dot(&self.steps[k], level).powi(2)).sum::<f64>();
        let step = (0..self.steps.len()).max_by(|&a, &b| gain(a).total_cmp(&gain(b)));
        let taken = self.smooth.q.len() + usize::from(step.is_some());
        let free = self.groups.checked_sub(taken).filter(|free| *free > 0)? as f64;
        let (axes, mut ln, mut variance) = (levels.len() as f64, [0.0; TRIED.len()], [0.0; TRIED.len()]);
        for ((ln, variance), tried) in ln.iter_mut().zip(&mut variance).zip(&self.tried) {
            let (mut square, mut determinants) = (0.0, tried.ln_determinants);
            let step = step.and_then(|step| tried.steps[step].as_ref());
            determinants += step.map_or(0.0, |(_, length)| 2.0 * length.ln());
            for level in &left {
                let white = tried.smooth.residual(independent(tried.rho, level));
                let along = step.map_or(0.0, |(step, _)| dot(step, &white));
                square += dot(&white, &white) - along * along;
            }
            *ln = -0.5 * axes * (free * square.ln() + determinants);
            *variance = square / (axes * free);
        }
        ln.iter().all(|own| own.is_finite()).then_some(Likelihoods { ln, variance })
    }
}

/// What of a column lies beside others, of unit length, and the length that it had; `None` of one that depends on them.
fn beside(others: &Basis, column: Vec<f64>) -> Option<(Vec<f64>, f64)> {
    let before = dot(&column, &column).sqrt();
    let mut left = others.residual(column);
    let length = dot(&left, &left).sqrt();
    left.iter_mut().for_each(|v| *v /= length);
    (length > 1e-3 * before).then_some((left, length))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Beside a constant, a drift and any step the likeliest correlation of levels is the one that they have, within what
    /// 60 of them tell; levels without one seldom follow each other.
    #[test]
    fn the_likeliest_correlation_is_the_true_one() {
        let groups = 60;
        let smooth = Basis::of([vec![1.0; groups], (0..groups).map(|k| k as f64).collect()]);
        let step = |at: usize| (0..groups).map(|k| f64::from(u8::from(k >= at))).collect();
        let look = || Look::of(groups, smooth.clone(), (2..groups - 1).map(step));
        for (rho, follow) in [(0.0, 0.2), (0.4, 0.7), (0.7, 0.95), (0.9, 0.95)] {
            let (mut sum, mut told, look) = (0.0, 0, look());
            let mut neighbours = Neighbours {
                look,
                axes: 2,
                found: Likelihoods { ln: [0.0; TRIED.len()], variance: [1.0; TRIED.len()] },
            };
            for seed in 0..100 {
                let mut random = ChaCha8Rng::seed_from_u64(seed);
                let drawn: Vec<Vec<f64>> = (0..2).map(|_| autoregression(&mut random, groups, rho)).collect();
                neighbours.found = neighbours.look.likelihoods(&drawn).unwrap();
                sum += TRIED[neighbours.found.best()] / 100.0;
                told += usize::from(neighbours.follow());
            }
            println!("{rho}: {sum:.2}, told {told}");
            assert!((sum - rho).abs() < 0.12, "{rho}: {sum}");
            let told = told as f64 / 100.0;
            assert!(if rho == 0.0 { told < follow } else { told > follow }, "{rho}: {told}");
        }
    }
}
