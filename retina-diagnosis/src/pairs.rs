//! What neighbours share: a test for structure of any shape, at every scale that the sampling allows.
//!
//! Rows are sorted into cells: squares and stripes of the field, stretches of a column, phases of a pixel grid. With e_i
//! the whitened errors, T = sum over cells of sum e_i e_j over pairs of rows of one cell that lie in different units.
//! Without structure units are independent, and T has mean 0. Structure that is wider than the cells makes it grow. With
//! K_gh the sum over cells of the products of two units' sums, T = sum over g != h of K_gh, and flipping the units' signs
//! gives s^T K s: the distribution of T under the null comes from G x G numbers, whatever the number of rows. Pairs within a
//! unit do not count, so that errors that an exposure's points share (air) are not taken for structure. This is
//! P. Moran's statistic (Biometrika 37, 1950) between groups, on many scales, its largest value compared as by Westfall
//! and Young (Resampling-Based Multiple Testing, 1993).

use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::{Accum, Mat, Par};
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::cells::{Cells, cells, px_of_x};
use crate::data::{Dataset, Flip};
use crate::score::Frame;
use crate::units::Units;

/// Units are joined until there are no more than this: their pairs within one are lost.
const MOST_UNITS: usize = 64;
/// Cells with fewer pairs than this in all have nothing to say.
const FEWEST_PAIRS: f64 = 30.0;
/// Draws from the null.
const DRAWS: usize = 1999;
/// Share of draws beyond which a scale of its own is told.
const TAIL: f64 = 0.01;

/// Structure at one scale.
#[derive(Debug, Clone)]
pub(crate) struct Shared {
    /// The columns that the cells are made of.
    pub(crate) covariates: Vec<String>,
    /// Width of the cells in pixels of the screen, where they are squares or stripes of the field.
    pub(crate) width_px: Option<f64>,
    /// p-value, corrected for the number of cell patterns.
    pub(crate) p_value: f64,
    /// Rms of what neighbours share per component, in units of the noise.
    pub(crate) strength: f64,
    /// T in standard deviations.
    pub(crate) deviate: f64,
}

/// A pattern with the rows that count, by cell and by unit.
struct Pattern {
    cells: Cells,
    order: Vec<usize>,
}

/// One pattern's statistic with its null distribution.
struct Statistic<'p> {
    pattern: &'p Pattern,
    /// K over the joined units below its diagonal; it is symmetric, and its diagonal counts as 0.
    gram: Mat<f64>,
    total: f64,
    sigma: f64,
    pairs: f64,
    /// Variance of the sum over pairs of noise of variance 1 with the errors.
    with_noise: f64,
}

/// The test of what a frame's base leaves.
pub(crate) struct Look {
    /// Structure, most significant first.
    pub(crate) shared: Vec<Shared>,
    /// For each ripple's wavelength (px of the screen) the amplitude that would have been found with 95 %.
    pub(crate) visible: Vec<[f64; 2]>,
}

/// Looks at neighbours. Ripples of `wavelengths_px` count as visible from `floor` of the noise on.
pub(crate) fn look(frame: &Frame<'_>, seed: u64, wavelengths_px: &[f64], floor: f64) -> Look {
    let data = frame.data;
    let waves: &[f64] = if data.components() == 2 { wavelengths_px } else { &[] };
    let ripples: Vec<Vec<f64>> = waves
        .iter()
        .flat_map(|wavelength| RIPPLES.map(|(along, phase)| ripple(data, *wavelength, along, phase)))
        .collect();
    let mut free = frame.free_of_field(&ripples).into_iter();
    let error = free.next().unwrap_or_default();
    let joined = Joined::of(&frame.units, data);
    let patterns: Vec<Pattern> =
        cells(data).into_par_iter().map(|cells| Pattern::of(frame, cells, &joined)).collect();
    let own: Vec<Statistic<'_>> =
        of_patterns(frame, &error, patterns.iter().collect(), &joined, FEWEST_PAIRS)
            .into_iter()
            .flatten()
            .collect();
    let draws = drawn(&own, seed);
    let n = data.components() as f64;
    let mut shared: Vec<Shared> = own
        .iter()
        .zip(p_values(&own, &draws))
        .map(|(s, p_value)| Shared {
            covariates: s.pattern.cells.covariates.clone(),
            width_px: s.pattern.cells.width_px,
            p_value,
            strength: (s.total.max(0.0) / (n * s.pairs)).sqrt(),
            deviate: s.total / s.sigma,
        })
        .collect();
    shared.sort_by(|a, b| a.p_value.total_cmp(&b.p_value).then(b.deviate.total_cmp(&a.deviate)));
    let needed = deviate_needed(&draws);
    let seen_by = |own: &[&Statistic<'_>], ripple: &[f64]| -> Vec<f64> {
        let patterns = own.iter().map(|s| s.pattern).collect();
        let amplitude = |(own, ripple): (&&Statistic<'_>, Option<Statistic<'_>>)| {
            let wanted = (needed * own.sigma).max(floor * floor * n * own.pairs);
            ripple.map_or(f64::INFINITY, |ripple| amplitude_seen(own, &ripple, wanted))
        };
        own.iter().zip(of_patterns(frame, ripple, patterns, &joined, 0.0)).map(amplitude).collect()
    };
    let least = |amplitudes: &[f64]| amplitudes.iter().copied().fold(f64::INFINITY, f64::min);
    let all: Vec<&Statistic<'_>> = own.iter().collect();
    let free: Vec<Vec<f64>> = free.collect();
    let spacing_px = if waves.is_empty() { 0.0 } else { spacing_px(data) };
    let visible = waves
        .par_iter()
        .zip(free.par_chunks(RIPPLES.len()))
        .map(|(&wavelength, ripples)| {
            // Rows farther apart than a wavelength do not say that nothing lies between them.
            if wavelength < spacing_px {
                return [wavelength, f64::INFINITY];
            }
            let first = seen_by(&all, &ripples[0]);
            // What sees one ripple of a wavelength best is asked for the others.
            let mut order: Vec<usize> = (0..all.len()).collect();
            order.sort_by(|&a, &b| first[a].total_cmp(&first[b]));
            let best: Vec<&Statistic<'_>> = order.iter().take(BEST_PATTERNS).map(|&k| all[k]).collect();
            let others = ripples[1..].iter().map(|ripple| least(&seen_by(&best, ripple)));
            [wavelength, others.fold(least(&first), f64::max)]
        })
        .collect();
    Look { shared, visible }
}

/// Mean distance of rows in the field, px of the screen: the side of a square that holds one.
fn spacing_px(data: &Dataset) -> f64 {
    let extent = |name: &str| data.covariate(name).map_or(0.0, |column| column.range().1 - column.range().0);
    (extent("x") * extent("y") / data.len() as f64).sqrt() * px_of_x(data)
}

/// Directions and phases of ripples; the one that is seen worst speaks. Neither stripes of x nor of y favour them.
const RIPPLES: [([f64; 2], f64); 3] = [([0.6, 0.8], 0.0), ([0.6, 0.8], 1.6), ([0.8, -0.6], 0.8)];

/// Patterns that are asked for further ripples of a wavelength.
const BEST_PATTERNS: usize = 16;

/// The amplitude with which a pattern's sum is beyond `wanted` with 95 %: with an amplitude a the sum grows by
/// a^2 T_ripple, and beside its own it has the scatter of the ripple times the noise, a^2 times a variance.
fn amplitude_seen(own: &Statistic<'_>, ripple: &Statistic<'_>, wanted: f64) -> f64 {
    let mut square = 0.0;
    for _ in 0..20 {
        let scatter = (own.sigma * own.sigma + square * ripple.with_noise).sqrt();
        square = (wanted + NINETY_FIVE * scatter) / ripple.total.max(f64::MIN_POSITIVE);
    }
    square.sqrt()
}

/// A ripple of amplitude 1 over the rows, its displacement along a diagonal.
fn ripple(data: &Dataset, wavelength_px: f64, [a, b]: [f64; 2], phase_rad: f64) -> Vec<f64> {
    let k = std::f64::consts::TAU / wavelength_px * px_of_x(data);
    let (x, y) = (data.values("x"), data.values("y"));
    (0..data.len())
        .flat_map(|row| {
            [(k * (a * x[row] + b * y[row]) + phase_rad).sin() * std::f64::consts::FRAC_1_SQRT_2; 2]
        })
        .collect()
}

/// Deviate below which a normal error lies with 95 %.
pub(crate) const NINETY_FIVE: f64 = 1.645;

/// Deviate that the largest of the patterns has to have.
fn deviate_needed(draws: &[Vec<f64>]) -> f64 {
    let mut highest: Vec<f64> =
        draws.iter().map(|draw| draw.iter().copied().fold(f64::NEG_INFINITY, f64::max)).collect();
    highest.sort_unstable_by(f64::total_cmp);
    highest[((highest.len() - 1) as f64 * 0.995).round() as usize]
}

/// The statistics of patterns, of each that has enough pairs.
fn of_patterns<'p>(
    frame: &Frame<'_>,
    error: &[f64],
    patterns: Vec<&'p Pattern>,
    joined: &Joined,
    fewest: f64,
) -> Vec<Option<Statistic<'p>>> {
    let of = |pattern| if joined.count < 2 { None } else { statistic(frame, error, pattern, joined, fewest) };
    patterns.into_par_iter().map(of).collect()
}

impl Pattern {
    fn of(frame: &Frame<'_>, cells: Cells, joined: &Joined) -> Self {
        let counts = |row: &usize| cells.of_row[*row] != Cells::NONE && frame.weights.weight[*row] > 0.0;
        let mut order: Vec<usize> = (0..frame.data.len()).filter(counts).collect();
        order.sort_by_key(|&row| (cells.of_row[row], joined.of_row[row]));
        Self { cells, order }
    }
}

/// Units joined to at most [`MOST_UNITS`] runs.
struct Joined {
    /// Each row's run.
    of_row: Vec<usize>,
    /// The group of each run, where runs are parts of groups: pairs within a group do not count.
    group: Option<Vec<usize>>,
    count: usize,
}

impl Joined {
    fn of(units: &Units, data: &Dataset) -> Self {
        let per_run = units.count.div_ceil(MOST_UNITS).max(1);
        let mut of_row = vec![0; data.len()];
        for (range, unit) in units.ranges.iter().zip(&units.unit) {
            of_row[range.clone()].fill(unit / per_run);
        }
        let group_of = |range: &std::ops::Range<usize>| {
            data.groups.iter().position(|group| group.rows.contains(&range.start)).unwrap_or(0)
        };
        let group = (data.flip == Flip::Rows).then(|| units.ranges.iter().map(group_of).collect());
        Self { of_row, group, count: units.count.div_ceil(per_run) }
    }

    fn apart(&self, a: usize, b: usize) -> bool {
        self.group.as_ref().is_none_or(|group| group[a] != group[b])
    }
}

fn statistic<'p>(
    frame: &Frame<'_>,
    error: &[f64],
    pattern: &'p Pattern,
    joined: &Joined,
    fewest: f64,
) -> Option<Statistic<'p>> {
    let n = frame.data.components();
    let Pattern { cells, order } = pattern;
    let (unit_of_row, units) = (&joined.of_row, joined.count);
    let mut gram = Mat::<f64>::zeros(units, units);
    let (mut pairs, mut with_noise) = (0.0, 0.0);
    // Each unit's sum in the cell, and its rows.
    let mut sums: Vec<(usize, [f64; 2], f64)> = Vec::new();
    for members in order.chunk_by(|&a, &b| cells.of_row[a] == cells.of_row[b]) {
        sums.clear();
        for &row in members {
            let sign = cells.sign.as_ref().map_or(1.0, |sign| sign[row]);
            if sums.last().is_none_or(|last| last.0 != unit_of_row[row]) {
                sums.push((unit_of_row[row], [0.0; 2], 0.0));
            }
            let at = sums.len() - 1;
            for axis in 0..n {
                sums[at].1[axis] += sign * error[row * n + axis];
            }
            sums[at].2 += 1.0;
        }
        let all = sums.iter().fold([0.0; 2], |all, (_, a, _)| [all[0] + a[0], all[1] + a[1]]);
        for (_, a, count) in &sums {
            with_noise += 4.0 * count * ((all[0] - a[0]).powi(2) + (all[1] - a[1]).powi(2));
        }
        for (i, (g, a, count)) in sums.iter().enumerate() {
            for (h, b, other) in sums[..i].iter().filter(|other| joined.apart(*g, other.0)) {
                gram[(*g, *h)] += a[0] * b[0] + a[1] * b[1];
                pairs += 2.0 * count * other;
            }
        }
    }
    if pairs < 2.0 * fewest || pairs == 0.0 {
        return None;
    }
    let (mut total, mut squares) = (0.0, 0.0);
    for g in 0..units {
        for h in 0..g {
            let value = gram[(g, h)];
            total += 2.0 * value;
            squares += 4.0 * value * value;
        }
    }
    let sigma = squares.sqrt();
    (sigma > 0.0).then_some(Statistic { pattern, gram, total, sigma, pairs, with_noise })
}

/// For each draw the deviate of each pattern.
fn drawn(statistics: &[Statistic<'_>], seed: u64) -> Vec<Vec<f64>> {
    let units = statistics.first().map_or(0, |s| s.gram.nrows());
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let signs = Mat::<f64>::from_fn(DRAWS, units, |_, _| if random.random::<bool>() { -1.0 } else { 1.0 });
    let by_pattern: Vec<Vec<f64>> = statistics
        .par_iter()
        .map(|s| {
            let mut along = Mat::<f64>::zeros(DRAWS, units);
            triangular::matmul(
                along.as_mut(),
                BlockStructure::Rectangular,
                Accum::Replace,
                &signs,
                BlockStructure::Rectangular,
                &s.gram,
                BlockStructure::StrictTriangularLower,
                2.0,
                Par::Seq,
            );
            let mut sums = vec![0.0; DRAWS];
            for g in 0..units {
                let products = along.col_as_slice(g).iter().zip(signs.col_as_slice(g));
                sums.iter_mut().zip(products).for_each(|(sum, (along, sign))| *sum += along * sign);
            }
            sums.iter_mut().for_each(|sum| *sum /= s.sigma);
            sums
        })
        .collect();
    (0..DRAWS).map(|draw| by_pattern.iter().map(|own| own[draw]).collect()).collect()
}

fn p_values(statistics: &[Statistic<'_>], draws: &[Vec<f64>]) -> Vec<f64> {
    // Few cells have heavier tails than many: each pattern is measured on the scale of its own draws.
    let scales: Vec<(f64, f64)> = (0..statistics.len())
        .into_par_iter()
        .map(|k| {
            let mut own: Vec<f64> = draws.iter().map(|draw| draw[k]).collect();
            own.sort_unstable_by(f64::total_cmp);
            let at = |share: f64| own[((own.len() - 1) as f64 * share).round() as usize];
            (at(0.5), (at(1.0 - TAIL) - at(0.5)).max(1e-9))
        })
        .collect();
    let scaled = |k: usize, deviate: f64| (deviate - scales[k].0) / scales[k].1;
    let highest: Vec<f64> = draws
        .iter()
        .map(|draw| draw.iter().enumerate().map(|(k, d)| scaled(k, *d)).fold(f64::NEG_INFINITY, f64::max))
        .collect();
    statistics
        .iter()
        .enumerate()
        .map(|(k, s)| {
            let own = scaled(k, s.total / s.sigma);
            let reached = highest.iter().filter(|h| **h >= own - 1e-9 * own.abs()).count();
            (1 + reached) as f64 / (1 + DRAWS) as f64
        })
        .collect()
}
