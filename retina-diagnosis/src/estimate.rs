//! Coefficients of columns with their covariance.

use crate::data::Dataset;
use crate::linear::{Basis, dot};
use crate::noise::Weights;

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

/// Generalised least squares under given weights; the noise's scale from the errors.
pub(crate) fn estimate(data: &Dataset, columns: &[Vec<f64>], weights: &Weights) -> Estimate {
    let mut basis = Basis::spanning(&weights.whitened_field(data));
    for column in columns {
        basis.push(weights.whitened(data, column));
    }
    let y = weights.whitened(data, &data.y);
    let values = basis.coefficients(&y);
    let error = basis.residual(y);
    let observed = weights.kept() * data.kind.components() + data.field_len();
    let free = observed as f64 - basis.q.len() as f64;
    // Tukey's weights take some light off good rows: the scale is that of what counts.
    let scale = (dot(&error, &error) / free.max(1.0)).max(f64::MIN_POSITIVE);
    let covariance =
        basis.covariance().into_iter().map(|row| row.iter().map(|v| v * scale).collect()).collect();
    Estimate { values, covariance }
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
