//! Weights: noise as a function of brightness, a common error of each group, outliers.

use std::collections::{BTreeMap, BTreeSet};

use rayon::prelude::*;
use retina_calibration::NoiseGroups;

use faer::linalg::solvers::{DenseSolveCore as _, Solve as _};
use glam::DVec2;

use crate::data::{Dataset, Group};
use crate::field::Field;
use crate::floor;
use crate::linear::{cholesky, dot, gram_lower, least_squares, matrix};
use crate::series::median;

/// Rows further off than this many sigmas are outliers: of a normal error in the plane 4e-5, on a line 7e-6.
pub(crate) const OUTLIER_SIGMAS: f64 = 4.5;
/// Median length of a normal error in sigmas of one axis, for one and two components.
pub(crate) const MEDIAN_LENGTH: [f64; 2] = [0.674_49, 1.177_41];
/// Tukey's constant for 95 % efficiency, for one and two components.
const TUKEY: [f64; 2] = [4.685, 5.1];
const ROUNDS: usize = 8;

/// How each row counts.
#[derive(Debug, Clone)]
pub(crate) struct Weights {
    /// Inverse variance times the robust weight, of each row; 0: outlier.
    pub(crate) weight: Vec<f64>,
    /// Standard deviation of a component without the group's error, the mean of both.
    pub(crate) sigma: Vec<f64>,
    /// Variance of the group's common error per component.
    pub(crate) jitter_variance: f64,
    pub(crate) outlier: Vec<bool>,
    /// Rms of what a calibration that is held fixed cannot follow, in the first degree beyond its own; arcsec.
    pub(crate) field_size: f64,
}

/// A robust fit of columns.
#[derive(Clone)]
pub(crate) struct RobustFit {
    /// y minus the columns.
    pub(crate) residual: Vec<f64>,
    pub(crate) weights: Weights,
}

/// Most values of a column that are looked at one by one for outliers, and fewest rows with such a value.
const MOST_VALUES: usize = 12;
const FEWEST_ALIKE: usize = 5;

impl RobustFit {
    /// Weights and data in which outliers that have a value in common count again: more than half of the rows of a channel,
    /// or of one size of squares, are no accident. Their errors are cut to the largest of rows that are none, so that
    /// they show and do not outweigh the others. `None` where there are none. Groups that are off as a whole stay out.
    pub(crate) fn outliers_cut(&self, data: &Dataset) -> Option<(Weights, Vec<f64>)> {
        let alike = self.alike(data);
        if alike.is_empty() {
            return None;
        }
        let n = data.kind.components();
        let (mut weights, mut y) = (self.weights.clone(), data.y.clone());
        for row in alike {
            let error = &self.residual[row * n..(row + 1) * n];
            let largest = OUTLIER_SIGMAS * weights.sigma[row].hypot(weights.jitter_variance.sqrt());
            cut(&mut y[row * n..(row + 1) * n], error, largest);
            weights.count_again([row]);
        }
        Some((weights, y))
    }

    /// Weights and data in which all rows weigh the same, and errors are cut to the length that this `share` of them
    /// has at most.
    pub(crate) fn cut_alike(&self, data: &Dataset, share: f64) -> (Weights, Vec<f64>) {
        let n = data.kind.components();
        let mut lengths: Vec<f64> = self.residual.chunks_exact(n).map(|e| dot(e, e).sqrt()).collect();
        lengths.sort_by(f64::total_cmp);
        let largest = lengths.get((share * lengths.len() as f64) as usize).copied().unwrap_or(f64::INFINITY);
        let mut y = data.y.clone();
        y.chunks_exact_mut(n).zip(self.residual.chunks_exact(n)).for_each(|(y, e)| cut(y, e, largest));
        let squares: f64 = lengths.iter().map(|length| length.min(largest).powi(2)).sum();
        let mean = squares / self.residual.len().max(1) as f64;
        (Weights::equal(data.len(), mean.sqrt()), y)
    }

    /// Outliers that share a value of a column with rows of which more than half are outliers: rows of groups that are not
    /// off as a whole, or several groups that are.
    fn alike(&self, data: &Dataset) -> BTreeSet<usize> {
        let out = |row: &usize| self.weights.outlier[*row];
        let mut whole = vec![false; data.len()];
        for group in data.groups.iter().filter(|_| data.jitters) {
            if group.rows.clone().all(|row| out(&row)) {
                whole[group.rows.clone()].fill(true);
            }
        }
        let mut found = BTreeSet::new();
        for covariate in &data.covariates {
            let mut with_value: BTreeMap<u64, Vec<usize>> = BTreeMap::new();
            for row in 0..data.len() {
                with_value.entry(covariate.values[row].to_bits()).or_default().push(row);
                if with_value.len() > MOST_VALUES {
                    break;
                }
            }
            if !(2..=MOST_VALUES).contains(&with_value.len()) {
                continue;
            }
            for rows in with_value.into_values() {
                let off = data
                    .groups
                    .iter()
                    .filter(|group| rows.binary_search(&group.rows.start).is_ok() && whole[group.rows.start]);
                let own: Vec<usize> = match off.count() {
                    0 | 1 => rows.into_iter().filter(|row| !whole[*row]).collect(),
                    _ => rows,
                };
                let outliers: Vec<usize> = own.iter().copied().filter(out).collect();
                if own.len() >= FEWEST_ALIKE && 2 * outliers.len() > own.len() {
                    found.extend(outliers);
                }
            }
        }
        found
    }
}

/// A row's values with its error cut to a length.
fn cut(values: &mut [f64], error: &[f64], largest: f64) {
    let over = 1.0 - (largest / dot(error, error).sqrt()).min(1.0);
    values.iter_mut().zip(error).for_each(|(value, e)| *value -= over * e);
}

impl Weights {
    /// The same standard deviation for all rows, no common errors, no outliers.
    pub(crate) fn equal(rows: usize, sigma: f64) -> Self {
        Self {
            weight: vec![sigma.powi(-2); rows],
            sigma: vec![sigma; rows],
            jitter_variance: 0.0,
            outlier: vec![false; rows],
            field_size: 0.0,
        }
    }

    /// Takes rows for no outliers.
    pub(crate) fn count_again(&mut self, rows: impl IntoIterator<Item = usize>) {
        for row in rows {
            self.weight[row] = self.sigma[row].powi(-2);
            self.outlier[row] = false;
        }
    }

    /// Inverse variance of a row, 0 for an outlier: errors are summed up without Tukey's factor, which would take the
    /// largest of the good ones for less than they are.
    pub(crate) fn inverse_variance(&self, row: usize) -> f64 {
        if self.outlier[row] { 0.0 } else { 1.0 / (self.sigma[row] * self.sigma[row]) }
    }

    /// Root of the weighted mean square of errors per component.
    pub(crate) fn rms(&self, components: usize, residual: &[f64]) -> f64 {
        let (mut squares, mut sum) = (0.0, 0.0);
        for (row, values) in residual.chunks_exact(components).enumerate() {
            squares += self.inverse_variance(row) * dot(values, values);
            sum += self.inverse_variance(row) * components as f64;
        }
        (squares / sum).sqrt()
    }

    /// Root of the mean square of errors per component, outliers left out.
    pub(crate) fn rms_unweighted(&self, components: usize, residual: &[f64]) -> f64 {
        let rows = residual.chunks_exact(components).zip(&self.outlier).filter(|(_, out)| !**out);
        let squares: f64 = rows.map(|(values, _)| dot(values, values)).sum();
        (squares / (self.kept() * components).max(1) as f64).sqrt()
    }

    /// Root of the weighted mean variance, the group's error included: what no model can undercut for an unseen group.
    pub(crate) fn floor(&self) -> f64 {
        let (mut total, mut sum) = (0.0, 0.0);
        for (row, sigma) in self.sigma.iter().enumerate() {
            total += self.inverse_variance(row) * (sigma * sigma + self.jitter_variance);
            sum += self.inverse_variance(row);
        }
        (total / sum).sqrt()
    }

    /// Rows that are not outliers.
    pub(crate) fn kept(&self) -> usize {
        self.outlier.iter().filter(|out| !**out).count()
    }
}

/// Fits columns robustly: weights and columns in turn.
pub(crate) fn robust_fit(data: &Dataset, columns: &[Vec<f64>]) -> RobustFit {
    let n = data.kind.components();
    let rows = data.len();
    let mut weights = Weights::equal(rows, 1.0);
    let steady = steady_columns(data, columns);
    let mut residual = data.y.clone();
    let size: Vec<f64> = data.y.iter().map(|y| y.abs()).collect();
    weights.sigma = floor::expected(data, &size, &weights.outlier);
    weights.weight = weights.sigma.iter().map(|sigma| sigma.powi(-2)).collect();
    for round in 0..ROUNDS {
        if FIELD_ROUNDS.contains(&round) && data.field().is_some_and(|field| !field.modes.is_empty()) {
            weights.field_size = weights.likeliest_field_size(data, columns);
        }
        let (fitted, free) = match data.field() {
            Some(field) => weights.fitted_beside(data, columns, field),
            None => weights.fitted(data, columns),
        };
        residual.iter_mut().zip(&data.y).zip(&fitted).for_each(|((r, y), f)| *r = y - f);
        if round + 1 < ROUNDS {
            weights.update(data, &residual, n, free, steady, round > 0);
        }
    }
    RobustFit { residual, weights }
}

/// Rounds before which the size of a calibration's own error is estimated: weights have to be known roughly.
const FIELD_ROUNDS: [usize; 2] = [2, 5];
/// Sizes that are tried, in units of the median noise.
const FIELD_SIZES: [f64; 10] = [0.0, 0.03, 0.06, 0.12, 0.25, 0.5, 1.0, 2.0, 5.0, 12.0];
/// The largest size is taken whose -2 ln likelihood is within this of the least: one standard error.
const FIELD_CAUTION: f64 = 1.0;
/// Part of a column's square that is added where columns depend on each other.
const RIDGE: f64 = 1e-11;

impl Weights {
    /// What the columns fit, and how many they are.
    fn fitted(&self, data: &Dataset, columns: &[Vec<f64>]) -> (Vec<f64>, f64) {
        let whitening = self.whitening(data);
        let whitened: Vec<Vec<f64>> = columns.par_iter().map(|column| whitening.of(column)).collect();
        let y = whitening.of(&data.y);
        let (coefficients, free) = least_squares(&whitened, &y);
        let mut out = vec![0.0; data.y.len()];
        for (column, c) in columns.iter().zip(&coefficients) {
            out.iter_mut().zip(column).for_each(|(sum, value)| *sum += c * value);
        }
        (out, free as f64)
    }

    /// The same with a calibration's error; a column of that counts as far as the data determine it.
    fn fitted_beside(&self, data: &Dataset, columns: &[Vec<f64>], field: &Field) -> (Vec<f64>, f64) {
        let mut all = self.whitened_field(data);
        all.extend(columns.iter().map(|column| self.whitened(data, column)));
        let a = matrix(&all);
        let mut normal = gram_lower(&a);
        for k in 0..all.len() {
            normal[(k, k)] *= 1.0 + RIDGE;
        }
        let y = matrix(&[self.whitened(data, &data.y)]);
        let right = a.transpose() * &y;
        let Ok(factor) = normal.llt(faer::Side::Lower) else { return self.fitted(data, columns) };
        let solution = factor.solve(&right);
        let inverse = factor.inverse();
        let free = all.len() as f64 - (0..field.len()).map(|k| inverse[(k, k)]).sum::<f64>();
        let mut out = vec![0.0; data.y.len()];
        let sized = field.columns(self.field_size).chain(columns.iter().map(|column| (column, 1.0)));
        for (k, (column, size)) in sized.enumerate() {
            let c = size * solution[(k, 0)];
            out.iter_mut().zip(column).for_each(|(sum, value)| *sum += c * value);
        }
        (out, free)
    }

    /// Size of the calibration's modes by restricted likelihood (D. A. Harville, JASA 72, 1977), the noise's scale
    /// profiled out.
    fn likeliest_field_size(&self, data: &Dataset, columns: &[Vec<f64>]) -> f64 {
        let unit = Self { field_size: 1.0, ..self.clone() };
        let mut all = unit.whitened_field(data);
        let (field, length) = (all.len(), data.y.len());
        let modes = field - data.field().map_or(0, |f| f.modes.len())..field;
        all.extend(columns.iter().map(|column| self.whitened(data, column)));
        all.push(self.whitened(data, &data.y));
        all.iter_mut().for_each(|column| column.truncate(length));
        let a = matrix(&all);
        let gram = gram_lower(&a);
        let last = all.len() - 1;
        let free = (self.kept() * data.kind.components()) as f64 - columns.len() as f64;
        let mut sigmas: Vec<f64> = self.sigma.clone();
        let middle = sigmas.len() / 2;
        let noise = *sigmas.select_nth_unstable_by(middle, f64::total_cmp).1;
        let criterion = |size: f64| {
            let of = |k: usize| if modes.contains(&k) { size } else { 1.0 };
            let normal = faer::Mat::<f64>::from_fn(all.len(), all.len(), |i, j| {
                let held = f64::from(u8::from(i == j && i < field));
                let ridge = if i == j { 1.0 + RIDGE } else { 1.0 };
                of(i) * of(j) * gram[(i.max(j), i.min(j))] * ridge + held
            });
            // The last entry of the factor is what y keeps beside all columns.
            let factor = cholesky(&normal)?;
            let logarithms: f64 = (0..last).map(|k| factor[(k, k)].ln()).sum();
            Some(free * 2.0 * factor[(last, last)].ln() + 2.0 * logarithms)
        };
        let tried: Vec<(f64, f64)> = FIELD_SIZES
            .par_iter()
            .filter_map(|size| criterion(size * noise).map(|c| (size * noise, c)))
            .collect();
        let least = tried.iter().map(|t| t.1).fold(f64::INFINITY, f64::min);
        tried.iter().filter(|t| t.1 <= least + FIELD_CAUTION).map(|t| t.0).fold(0.0, f64::max)
    }
}

/// Columns that are constant within each group: what a common error of groups must be told apart from.
pub(crate) fn steady_columns(data: &Dataset, columns: &[Vec<f64>]) -> usize {
    let n = data.kind.components();
    columns
        .iter()
        .filter(|column| {
            data.groups.iter().all(|group| {
                group
                    .rows
                    .clone()
                    .all(|row| (0..n).all(|a| column[row * n + a] == column[group.rows.start * n + a]))
            })
        })
        .count()
}

/// Fewest rows of a group whose median tells its shift.
const ROWS_OF_MEDIAN: usize = 8;
/// Groups whose median is further from the others' than this many of their standard deviations, and which are no more
/// than this share of all, are outliers as a whole.
const FAR_GROUP: f64 = 6.0;
const FAR_SHARE: f64 = 0.1;

/// Medians of the groups' errors, before any weight is known.
fn first_shifts(data: &Dataset, residual: &[f64], n: usize) -> Vec<[f64; 2]> {
    if !data.jitters {
        return vec![[0.0; 2]; data.groups.len()];
    }
    let told = |group: &Group| group.rows.len() >= ROWS_OF_MEDIAN;
    let mut shifts: Vec<[f64; 2]> = data
        .groups
        .iter()
        .map(|group| {
            let of = |axis: usize| {
                let values = group.rows.clone().map(|row| residual[row * n + axis]);
                if told(group) && axis < n { median(&values.collect::<Vec<f64>>()) } else { 0.0 }
            };
            [of(0), of(1)]
        })
        .collect();
    let mut far = vec![false; shifts.len()];
    for axis in 0..n {
        let along: Vec<f64> =
            data.groups.iter().zip(&shifts).filter(|(g, _)| told(g)).map(|(_, s)| s[axis]).collect();
        if along.is_empty() {
            return shifts;
        }
        let middle = median(&along);
        let off: Vec<f64> = along.iter().map(|v| (v - middle).abs()).collect();
        let sigma = median(&off) / MEDIAN_LENGTH[0];
        for (far, shift) in far.iter_mut().zip(&shifts) {
            *far |= (shift[axis] - middle).abs() > FAR_GROUP * sigma;
        }
    }
    if far.iter().filter(|far| **far).count() as f64 <= FAR_SHARE * shifts.len() as f64 {
        shifts.iter_mut().zip(&far).filter(|(_, far)| **far).for_each(|(shift, _)| *shift = [0.0; 2]);
    }
    shifts
}

/// What is to be said of groups of which no row counts.
pub(crate) fn lost_groups(data: &Dataset, weights: &Weights) -> Option<String> {
    let lost: Vec<&str> = data
        .groups
        .iter()
        .filter(|group| group.rows.len() >= ROWS_OF_MEDIAN)
        .filter(|group| weights.outlier[group.rows.clone()].iter().all(|out| *out))
        .map(|group| group.name.as_str())
        .collect();
    let more = if lost.len() > 5 { ", ..." } else { "" };
    (!lost.is_empty()).then(|| {
        format!(
            "all rows of {} {} are outliers: {}{more}",
            lost.len(),
            if data.components() == 2 { "exposures" } else { "groups" },
            lost[..lost.len().min(5)].join(", ")
        )
    })
}

impl Weights {
    fn update(
        &mut self,
        data: &Dataset,
        residual: &[f64],
        n: usize,
        columns: f64,
        steady: usize,
        known: bool,
    ) {
        // At first the groups' medians: a shift that many groups share is no outlier.
        let shifts =
            if known { self.shifts(data, residual, n, steady) } else { first_shifts(data, residual, n) };
        let mut length = vec![0.0; data.len()];
        for (group, shift) in data.groups.iter().zip(&shifts) {
            for row in group.rows.clone() {
                let off = |axis: usize| if axis < n { residual[row * n + axis] - shift[axis] } else { 0.0 };
                length[row] = (data.isotropic(row) * DVec2::new(off(0), off(1))).length();
            }
        }
        let free = columns + (n * shifts.iter().filter(|s| **s != [0.0; 2]).count()) as f64;
        let groups = NoiseGroups {
            rows: 120,
            fitted: free / n as f64,
            median_of_normal: MEDIAN_LENGTH[n - 1],
            least: data.least_noise(),
        };
        let expected = floor::expected(data, &length, &self.outlier);
        let scaled: Vec<f64> = length.iter().zip(&expected).map(|(length, e)| length / e).collect();
        self.sigma = groups.sigmas(&data.noise_key, &scaled, &self.outlier);
        self.sigma.iter_mut().zip(&expected).for_each(|(sigma, e)| *sigma *= e);
        for row in 0..length.len() {
            let t = length[row] / self.sigma[row];
            self.outlier[row] = t > OUTLIER_SIGMAS;
            let factor =
                if self.outlier[row] { 0.0 } else { (1.0 - (t / TUKEY[n - 1]).powi(2)).max(0.0).powi(2) };
            self.weight[row] = factor / (self.sigma[row] * self.sigma[row]);
        }
    }

    /// Moment estimate of the variance of the groups' common errors (DerSimonian and Laird, Controlled Clinical Trials
    /// 7, 1986, eq. 8), and each group's, shrunk by what its rows' noise leaves uncertain.
    fn shifts(&mut self, data: &Dataset, residual: &[f64], n: usize, steady: usize) -> Vec<[f64; 2]> {
        if !data.jitters {
            return vec![[0.0; 2]; data.groups.len()];
        }
        let means: Vec<(f64, [f64; 2])> = data
            .groups
            .iter()
            .map(|group| {
                let (mut sum, mut mean) = (0.0, [0.0; 2]);
                for row in group.rows.clone() {
                    sum += self.weight[row];
                    for a in 0..n {
                        mean[a] += self.weight[row] * residual[row * n + a];
                    }
                }
                (sum, mean.map(|m| if sum > 0.0 { m / sum } else { 0.0 }))
            })
            .filter(|(sum, _)| sum.is_finite())
            .collect();
        let free =
            means.iter().filter(|(sum, _)| *sum > 0.0).count() as f64 - (steady as f64 / n as f64).max(1.0);
        let total: f64 = means.iter().map(|(sum, _)| sum).sum();
        let squares: f64 = means.iter().map(|(sum, _)| sum * sum).sum();
        // Tukey's weights of normal errors have a mean below 1: the means' own scatter is larger by that factor.
        let spread: f64 =
            means.iter().map(|(sum, mean)| sum * (mean[0] * mean[0] + mean[1] * mean[1])).sum::<f64>()
                / n as f64;
        let scale = total - squares / total;
        self.jitter_variance =
            if free >= 1.0 && scale > 0.0 { ((spread - free) / scale).max(0.0) } else { 0.0 };
        let variance = self.jitter_variance;
        means.iter().map(|(sum, mean)| mean.map(|m| m * variance * sum / (1.0 + variance * sum))).collect()
    }
}
