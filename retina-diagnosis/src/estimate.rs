//! Coefficients of columns with their covariance.

use faer::Mat;

use crate::data::Dataset;
use crate::linear::{Basis, dot};
use crate::noise::Weights;
use crate::units::Units;
use crate::whitening::Whitening;

/// A parameter's value.
#[derive(Debug, Clone)]
pub struct Parameter {
    /// Its name, with its unit.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// Standard deviation; `None` where it was chosen from a list, not fitted.
    pub sigma: Option<f64>,
}

/// A parameter that is what nothing real has.
#[derive(Debug, Clone, PartialEq)]
pub struct Implausible {
    /// Its name.
    pub name: String,
    /// The values that are plausible.
    pub range: [f64; 2],
}

/// Standard deviations by which a value is beyond a range before it is called so.
const BEYOND_SIGMAS: f64 = 2.0;

/// Whether a value is beyond a range by more than its uncertainty.
pub(crate) fn is_implausible(value: f64, sigma: Option<f64>, [low, high]: [f64; 2]) -> bool {
    let margin = BEYOND_SIGMAS * sigma.unwrap_or(0.0);
    value < low - margin || value > high + margin
}

/// Those of parameters that are beyond their ranges.
pub fn implausible<'a>(
    parameters: impl Iterator<Item = (&'a Parameter, Option<[f64; 2]>)>,
) -> Vec<Implausible> {
    parameters
        .filter_map(|(p, range)| range.map(|range| (p, range)))
        .filter(|(p, range)| is_implausible(p.value, p.sigma, *range))
        .map(|(p, range)| Implausible { name: p.name.clone(), range })
        .collect()
}

pub(crate) struct Estimate {
    pub(crate) values: Vec<f64>,
    /// Covariance, row by row.
    pub(crate) covariance: Vec<Vec<f64>>,
}

/// Fewest units whose differences say how large their errors are.
const FEWEST_UNITS: usize = 12;

/// Columns that several estimates share, under given weights, beside a held calibration's error.
pub(crate) struct Estimator<'a> {
    data: &'a Dataset,
    weights: &'a Weights,
    whitening: Whitening<'a>,
    basis: Basis,
    /// Its directions side by side.
    q: Mat<f64>,
    y: Vec<f64>,
}

impl<'a> Estimator<'a> {
    pub(crate) fn new(data: &'a Dataset, shared: &[Vec<f64>], weights: &'a Weights) -> Self {
        let whitening = weights.whitening(data);
        let mut basis = Basis::spanning(&weights.whitened_field(data));
        let columns: Vec<Vec<f64>> = shared.iter().map(|column| whitening.of(column)).collect();
        let y = whitening.of(&data.y);
        basis.push_all(&basis.side_by_side(y.len()), &columns);
        let q = basis.side_by_side(y.len());
        Self { data, weights, whitening, basis, q, y }
    }

    /// The shared columns' coefficients, then those of `columns`: generalised least squares, the noise's scale from the errors.
    pub(crate) fn with(&self, columns: &[Vec<f64>]) -> Estimate {
        let mut basis = self.basis.clone();
        let whitened: Vec<Vec<f64>> = columns.iter().map(|column| self.whitening.of(column)).collect();
        basis.push_all(&self.q, &whitened);
        let values = basis.coefficients(&self.y);
        let error = basis.residual(self.y.clone());
        let observed = self.weights.kept() * self.data.kind.components() + self.data.field_len();
        let free = observed as f64 - basis.q.len() as f64;
        // Tukey's weights take some light off good rows: the scale is that of what counts.
        let scale = (dot(&error, &error) / free.max(1.0)).max(f64::MIN_POSITIVE);
        let mut covariance: Vec<Vec<f64>> =
            basis.covariance().into_iter().map(|row| row.iter().map(|v| v * scale).collect()).collect();
        let wider = self.excess(&basis, &error, scale);
        for (i, row) in covariance.iter_mut().enumerate() {
            row.iter_mut().zip(&wider).for_each(|(v, other)| *v *= wider[i] * other);
        }
        Estimate { values, covariance }
    }

    /// For each coefficient the factor, 1 or more, by which its error is larger than weights alone have it: from what units
    /// (exposures, series) pull it by, each on its own (K.-Y. Liang, S. L. Zeger, Biometrika 73, 1986). Noise that is longer
    /// along the radius than across, or larger where a column is, is in it. A calibration's error, which all units
    /// share, is not, and stays as it is stated.
    fn excess(&self, basis: &Basis, error: &[f64], scale: f64) -> Vec<f64> {
        let units = Units::of(self.data);
        let n = self.data.kind.components();
        let mut pulls = vec![vec![0.0; basis.q.len()]; units.count];
        for (range, &unit) in units.ranges.iter().zip(&units.unit) {
            let span = range.start * n..range.end * n;
            for (sum, q) in pulls[unit].iter_mut().zip(&basis.q) {
                *sum += dot(&q[span.clone()], &error[span.clone()]);
            }
        }
        let shares: Vec<Vec<f64>> = pulls.into_iter().map(|pull| basis.back_substituted(pull)).collect();
        let count = shares.len() as f64;
        let rows = self.data.y.len();
        basis
            .inverse_rows()
            .iter()
            .enumerate()
            .map(|(i, row)| {
                // What rows alone make of the variance: all of it less the part of the rows that hold the calibration.
                let all: f64 = dot(row, row);
                let mut held = vec![0.0; self.y.len() - rows];
                for (value, q) in row.iter().zip(&basis.q) {
                    held.iter_mut().zip(&q[rows..]).for_each(|(sum, q)| *sum += value * q);
                }
                let by_weights = scale * (all - dot(&held, &held)).max(0.0);
                let by_units =
                    shares.iter().map(|share| share[i] * share[i]).sum::<f64>() * count / (count - 1.0);
                if units.count < FEWEST_UNITS || by_weights <= 0.0 {
                    1.0
                } else {
                    (by_units / by_weights).sqrt().max(1.0)
                }
            })
            .collect()
    }
}

/// Generalised least squares of columns under given weights.
pub(crate) fn estimate(data: &Dataset, columns: &[Vec<f64>], weights: &Weights) -> Estimate {
    Estimator::new(data, columns, weights).with(&[])
}

impl Estimate {
    /// Parameters from a column on.
    pub(crate) fn named(&self, from: usize, names: Vec<String>) -> Vec<Parameter> {
        names
            .into_iter()
            .enumerate()
            .map(|(k, name)| Parameter {
                name,
                value: self.values[from + k],
                sigma: Some(self.covariance[from + k][from + k].sqrt()),
            })
            .collect()
    }
}
