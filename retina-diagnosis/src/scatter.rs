//! What a measurement scatters by, apart from any model: one number for a table, whatever is fitted to it.
//!
//! A flexible regression takes out what is smooth in the field, the light and the colour, and whatever the screens find.
//! What is left is not yet noise, since structure may be finer than that. So neighbours are compared: half the mean
//! square of the difference of two rows that lie side by side is the noise alone, as far as structure is wider than
//! their distance (J. von Neumann, Annals of Mathematical Statistics 12, 1941). Two neighbours of one exposure share what
//! the exposure has in common, air for example; two of different exposures do not: the difference between the two is the exposures' own.
//! What the model leaves beyond that is structured and unexplained.

use std::collections::HashMap;

use glam::DVec2;
use retina_formats::TableKind;

use crate::data::{Baseline, Dataset};
use crate::edge::Edge;
use crate::flips::Flips;
use crate::noise::{RobustFit, Weights, robust_fit};
use crate::pixel_noise;
use crate::score::Frame;
use crate::screens::{columns_of, screen_p_values, screens};
use crate::units::flip_of;
use crate::wander;

/// Rows that are looked at.
const MOST_ROWS: usize = 20_000;
/// Degrees of the regression over the field: the first that the rows allow.
const FIELD_DEGREES: [i32; 2] = [5, 3];
/// Screens significant at this level are taken out.
const LEVEL: f64 = 0.01;
/// Most of them.
const MOST_SCREENS: usize = 5;
const FLIPS: usize = 499;
/// A regression takes a part of the errors with it: numbers measured for each of its columns, and for each group's own
/// level.
const SPARE: usize = 4;
/// Fewest pairs of neighbours that tell a scatter.
const FEWEST_PAIRS: usize = 60;
/// Standard errors by which two estimates have to differ before the difference is told.
const CLEARLY: f64 = 3.0;

/// Noise per component, in the table's unit.
#[derive(Debug, Clone)]
pub struct Noise {
    /// Of a row by itself.
    pub white: f64,
    /// That rows of a group share.
    pub group: f64,
    /// What the model leaves beyond both: structured and unexplained.
    pub structured: f64,
    /// Where the figures come from.
    pub source: Vec<String>,
    /// Whether rows of one group share more than one common error: air, for example.
    pub(crate) shared_within: bool,
    /// Correlation of a group's common error with that of the next one in time.
    pub wander: f64,
    /// How it changes over the field beyond what is stated, and along which direction (points).
    pub(crate) edge: Option<Edge>,
}

impl Noise {
    /// What no model can undercut for an unseen group.
    pub fn floor(&self) -> f64 {
        self.white.hypot(self.group)
    }

    /// How the table is weighed, whitened and what is flipped follow from its noise.
    pub(crate) fn apply(&self, data: &mut Dataset) {
        self.weigh(data);
        data.wander = self.wander;
        data.flip = flip_of(data, self);
    }

    /// How its rows are weighed.
    pub(crate) fn weigh(&self, data: &mut Dataset) {
        if let Some(edge) = &self.edge {
            edge.tell(data);
        }
    }

    /// The noise of a table where it is `known`, else that of the pixels; with what the fit leaves beyond it.
    pub(crate) fn beside(known: Option<Self>, data: &Dataset, fit: &RobustFit) -> Self {
        let noise = known.unwrap_or_else(|| {
            pixel_noise::noise(data.pixels().and_then(|pixels| pixels.white.as_ref()), fit)
        });
        let rms = fit.weights.floor();
        let structured = (rms * rms - noise.floor().powi(2)).max(0.0).sqrt();
        Self { structured, ..noise }
    }
}

/// The noise of a table, or `None` of pixels, which have their own. `structured` is 0: it is a model's.
pub(crate) fn noise(data: &Dataset) -> Option<Noise> {
    if data.pixels().is_some() {
        return None;
    }
    let thinned = data.thinned(MOST_ROWS);
    let data = thinned.as_ref().unwrap_or(data);
    let levels = if data.jitters { data.components() * data.groups.len() } else { 0 };
    let spare = |columns: usize| data.len() * data.components() >= SPARE * (columns + levels);
    let regressions = FIELD_DEGREES.into_iter().map(|degree| flexible(data, degree));
    let found = regressions.into_iter().find(|columns| spare(columns.len()));
    let too_flexible = found.is_none();
    let mut columns =
        found.unwrap_or_else(|| data.baseline_terms().iter().map(|term| data.column(term)).collect());
    let mut fit = robust_fit(data, &columns);
    let wander = wander::correlation(data, &fit.residual, &fit.weights);
    let mut shared_within = false;
    let as_given = data.wander == wander;
    let data = &Dataset { wander, ..data.clone() };
    if !as_given {
        fit = robust_fit(data, &columns);
    }
    let flips = Flips::draw(data, FLIPS, 1);
    for _ in 0..if too_flexible { 0 } else { MOST_SCREENS } {
        let frame = Frame::weighted(data, &columns, fit.weights.clone());
        let all = screens(&frame);
        let p = screen_p_values(&all, &flips);
        let strongest = (0..all.len())
            .filter(|&i| p[i] <= LEVEL)
            .max_by(|&a, &b| all[a].score.statistic.total_cmp(&all[b].score.statistic));
        let Some(i) = strongest else { break };
        let further = columns_of(data, &all[i].covariates);
        if !spare(columns.len() + further.len()) {
            break;
        }
        columns.extend(further);
        fit = robust_fit(data, &columns);
    }
    let weights = &fit.weights;
    let mut source = Vec::new();
    let regression = mean_square(weights);
    let [(within, _), (between, differences)] = neighbours(data, &fit.residual, weights);
    let edge = differences.and_then(|(pairs, of)| Edge::of(data, weights, &pairs, &of));
    let jitter2 = weights.jitter_variance;
    let (white2, group2) = match (within, between) {
        (Some(within), Some(between)) => {
            source.push(format!(
                "{} neighbours of one {group}, {} of different ones",
                within.pairs,
                between.pairs,
                group = group_name(data)
            ));
            let beyond = between.ratio - within.ratio;
            shared_within = beyond > CLEARLY * within.error.hypot(between.error);
            let own = if shared_within { beyond } else { 0.0 };
            let pooled = if shared_within { within.ratio } else { within.beside(&between) };
            (pooled.min(1.0) * regression, own * regression + jitter2)
        }
        (Some(one), None) | (None, Some(one)) => {
            source.push(format!("{} pairs of neighbours", one.pairs));
            (one.ratio.min(1.0) * regression, jitter2)
        }
        (None, None) if too_flexible => {
            let stated2 = stated(data, weights).map_or(f64::INFINITY, |sigma| sigma * sigma);
            let what =
                if stated2 < regression { "what the table states" } else { "errors about the baseline" };
            source.push(format!("{what}: rows are too few for more"));
            (stated2.min(regression), jitter2)
        }
        (None, None) => {
            source.push("errors about a flexible regression: neighbours are too few".to_owned());
            (regression, jitter2)
        }
    };
    if jitter2 > 0.0 {
        source.push(format!("{} levels", group_name(data)));
    }
    if wander > 0.0 {
        // The plural of series is series.
        let name = group_name(data).trim_end_matches('s');
        source.push(format!("{name}s follow each other with a correlation of {wander:.2}"));
    }
    if let Some(stated) = stated(data, weights) {
        source.push(format!("the table states {stated:.4} {}", data.kind.unit()));
    }
    Some(Noise {
        white: white2.sqrt(),
        group: group2.sqrt(),
        structured: 0.0,
        source,
        shared_within,
        wander,
        edge,
    })
}

/// What the table states on the rows that count: root of the mean variance.
pub(crate) fn stated(data: &Dataset, weights: &Weights) -> Option<f64> {
    let stated = data.stated.as_ref()?;
    let (mut squares, mut sum) = (0.0, 0.0);
    for (row, sigma) in stated.iter().enumerate() {
        squares += weights.inverse_variance(row) * sigma * sigma;
        sum += weights.inverse_variance(row);
    }
    Some((squares / sum).sqrt())
}

pub(crate) fn group_name(data: &Dataset) -> &'static str {
    match data.kind {
        TableKind::Points => "exposure",
        TableKind::Power => "series",
        TableKind::Phase => "night",
        TableKind::Frames => "tile",
    }
}

/// Weighted mean of the rows' variances.
fn mean_square(weights: &Weights) -> f64 {
    let (mut total, mut sum) = (0.0, 0.0);
    for (row, sigma) in weights.sigma.iter().enumerate() {
        total += weights.inverse_variance(row) * sigma * sigma;
        sum += weights.inverse_variance(row);
    }
    total / sum
}

/// The baseline with what is smooth in the field, the light and the colour.
fn flexible(data: &Dataset, field_degree: i32) -> Vec<Vec<f64>> {
    let mut out: Vec<Vec<f64>> = data.baseline_terms().iter().map(|term| data.column(term)).collect();
    if data.kind != TableKind::Points {
        return out;
    }
    let (x, y) = (data.values("x"), data.values("y"));
    let mut add = |value: &dyn Fn(usize) -> [f64; 2]| out.push((0..data.len()).flat_map(value).collect());
    if !matches!(data.baseline, Baseline::Polynomial(degree) if degree as i32 >= field_degree) {
        for total in 2..=field_degree {
            for i in 0..=total {
                let value = |row: usize| x[row].powi(i) * y[row].powi(total - i);
                add(&|row| [value(row), 0.0]);
                add(&|row| [0.0, value(row)]);
            }
        }
    }
    let mut along = |g: &[f64]| {
        add(&|row| [g[row], 0.0]);
        add(&|row| [0.0, g[row]]);
        for power in 0..3 {
            let r = |row: usize| x[row].hypot(y[row]).powi(power);
            add(&|row| [g[row] * x[row] * r(row), g[row] * y[row] * r(row)]);
        }
    };
    if let Some((light, _)) = data.scaled("log10_irradiance") {
        along(&light);
        along(&light.iter().map(|l| l * l).collect::<Vec<f64>>());
    }
    for colour in ["channel_r", "channel_b"] {
        if let Some(on) = data.varying(colour) {
            along(on);
        }
    }
    out
}

/// Mean square of neighbours' differences.
#[derive(Clone, Copy)]
struct Difference {
    /// Over twice the variance of the regression's errors.
    ratio: f64,
    /// Its standard error.
    error: f64,
    pairs: usize,
}

impl Difference {
    /// Mean of both, by their pairs.
    fn beside(&self, other: &Self) -> f64 {
        let [own, others] = [self.pairs, other.pairs].map(|pairs| pairs as f64);
        (own * self.ratio + others * other.ratio) / (own + others)
    }
}

/// Pairs of rows, and their differences in sigmas that the weights expect.
type Differences = (Vec<(usize, usize)>, Vec<DVec2>);

/// Neighbours of one group, and of different groups.
fn neighbours(
    data: &Dataset,
    residual: &[f64],
    weights: &Weights,
) -> [(Option<Difference>, Option<Differences>); 2] {
    let n = data.components();
    let mut group_of = vec![0; data.len()];
    let mut level = vec![[0.0; 2]; data.groups.len()];
    // Part of a row's variance that its group's level takes with it.
    let mut taken = vec![0.0; data.len()];
    for (g, group) in data.groups.iter().enumerate() {
        group_of[group.rows.clone()].fill(g);
        let sum: f64 = weights.weight[group.rows.clone()].iter().sum();
        for axis in 0..n {
            let along: f64 =
                group.rows.clone().map(|row| weights.weight[row] * residual[row * n + axis]).sum();
            level[g][axis] = if data.jitters && sum > 0.0 { along / sum } else { 0.0 };
        }
        if data.jitters && sum > 0.0 {
            group.rows.clone().for_each(|row| taken[row] = weights.weight[row] / sum);
        }
    }
    let rows: Vec<usize> = (0..data.len()).filter(|&row| !weights.outlier[row]).collect();
    let pairs = if n == 2 { in_field(data, &rows, &group_of) } else { in_order(data, &rows, &group_of) };
    pairs.map(|pairs| {
        if pairs.len() < FEWEST_PAIRS {
            return (None, None);
        }
        let differences: Vec<DVec2> = pairs
            .iter()
            .map(|&(i, j)| {
                // Rows of one group share its level, which cancels.
                let own = |row: usize| {
                    let left = if group_of[i] == group_of[j] { 1.0 } else { 1.0 - taken[row] };
                    weights.sigma[row] * left.max(0.0).sqrt()
                };
                let sigma = own(i).hypot(own(j));
                let axis = |a: usize| {
                    let own = |row: usize| residual[row * n + a] - level[group_of[row]][a];
                    if a < n { (own(i) - own(j)) / sigma } else { 0.0 }
                };
                DVec2::new(axis(0), axis(1))
            })
            .collect();
        let squares: Vec<f64> = differences.iter().map(|d| d.length_squared() / n as f64).collect();
        let count = squares.len() as f64;
        let ratio = squares.iter().sum::<f64>() / count;
        let scatter = squares.iter().map(|s| (s - ratio).powi(2)).sum::<f64>() / (count - 1.0);
        let difference = Difference { ratio, error: (scatter / count).sqrt(), pairs: pairs.len() };
        (Some(difference), (n == 2).then_some((pairs, differences)))
    })
}

/// For each row the nearest in the field: one of its group, and one of another. Each pair is there once.
fn in_field(data: &Dataset, rows: &[usize], group_of: &[usize]) -> [Vec<(usize, usize)>; 2] {
    let (x, y) = (data.values("x"), data.values("y"));
    let nearest = |same: bool| -> Vec<(usize, usize)> {
        // Cells of about two candidates.
        let crowd = if same { data.groups.len().max(1) } else { 1 };
        let width = (2.6 / (rows.len() as f64 / crowd as f64)).sqrt().clamp(1e-4, 1.0);
        let cell = |row: usize| ((x[row] / width).floor() as i64, (y[row] / width).floor() as i64);
        let key = |row: usize| {
            let (i, j) = cell(row);
            (if same { group_of[row] } else { data.mounting[row] }, data.channel[row] as u8, i, j)
        };
        let mut grid: HashMap<(usize, u8, i64, i64), Vec<usize>> = HashMap::new();
        for &row in rows {
            grid.entry(key(row)).or_default().push(row);
        }
        let mut out: Vec<(usize, usize)> = rows
            .iter()
            .filter_map(|&row| {
                let (of, channel, i, j) = key(row);
                let mut best: Option<(f64, usize)> = None;
                for di in -1..=1 {
                    for dj in -1..=1 {
                        for &other in grid.get(&(of, channel, i + di, j + dj)).into_iter().flatten() {
                            if other == row || (group_of[other] == group_of[row]) != same {
                                continue;
                            }
                            let distance = (x[row] - x[other]).hypot(y[row] - y[other]);
                            if best.is_none_or(|(least, _)| distance < least) {
                                best = Some((distance, other));
                            }
                        }
                    }
                }
                best.map(|(_, other)| (row.min(other), row.max(other)))
            })
            .collect();
        out.sort_unstable();
        out.dedup();
        out
    };
    [nearest(true), nearest(false)]
}

/// Rows side by side in the order of their settings; of one component.
fn in_order(data: &Dataset, rows: &[usize], group_of: &[usize]) -> [Vec<(usize, usize)>; 2] {
    let names: &[&str] = match data.kind {
        TableKind::Power => &["square_px", "digital_count"],
        _ => &["phase_deg"],
    };
    let values: Vec<&[f64]> = names.iter().map(|name| data.values(name)).filter(|v| !v.is_empty()).collect();
    let sorted = |same: bool| -> Vec<(usize, usize)> {
        let mut order = rows.to_vec();
        order.sort_by(|&a, &b| {
            let group = if same { group_of[a].cmp(&group_of[b]) } else { std::cmp::Ordering::Equal };
            let channel = (data.channel[a] as u8).cmp(&(data.channel[b] as u8));
            let settings = values
                .iter()
                .map(|v| v[a].total_cmp(&v[b]))
                .fold(std::cmp::Ordering::Equal, std::cmp::Ordering::then);
            group.then(channel).then(settings)
        });
        // Every row in one pair: differences are independent.
        order
            .chunks_exact(2)
            .map(|pair| (pair[0], pair[1]))
            .filter(|(a, b)| (group_of[*a] == group_of[*b]) == same && data.channel[*a] == data.channel[*b])
            .collect()
    };
    [sorted(true), sorted(false)]
}
