//! Effects of one's own: what the workbench asks of them.

use std::path::Path;

use crate::data::Dataset;

/// A parameter of one's own effect.
#[derive(Debug, Clone, PartialEq)]
pub struct OwnParameter {
    /// Its name.
    pub name: String,
    /// Where the fit starts.
    pub start: f64,
    /// Its unit, as text.
    pub unit: String,
}

/// An effect of one's own: a function of a table's columns and of parameters that are fitted. A file of formulas
/// (`--effect FILE`) is one; a program gives another by [`AddedEffect::own`](crate::AddedEffect::own).
///
/// ```
/// use retina_diagnosis::{OwnEffect, OwnParameter};
///
/// /// A focus that settles: the image grows by a (1 - exp(-t / tau)).
/// struct Settling(Vec<OwnParameter>);
///
/// impl OwnEffect for Settling {
///     fn name(&self) -> &str {
///         "settling"
///     }
///     fn parameters(&self) -> &[OwnParameter] {
///         &self.0
///     }
///     fn columns(&self) -> Vec<&str> {
///         vec!["x", "y", "time_s"]
///     }
///     fn value(&self, columns: &[f64], parameters: &[f64]) -> [f64; 2] {
///         let grown = parameters[0] * (1.0 - (-columns[2] / parameters[1]).exp());
///         [grown * columns[0], grown * columns[1]]
///     }
/// }
/// # let of = |name: &str, start| OwnParameter { name: name.into(), start, unit: String::new() };
/// # let (value, slopes) = Settling(vec![of("a", 2.0), of("tau", 10.0)]).value_and_slopes(&[1.0, 0.5, 10.0], &[2.0, 10.0]);
/// # let e = (-1.0f64).exp();
/// # assert!((value[0] - 2.0 * (1.0 - e)).abs() < 1e-12);
/// # assert!((slopes[0][0] - (1.0 - e)).abs() < 1e-8 && (slopes[1][1] + 0.1 * e).abs() < 1e-8);
/// ```
pub trait OwnEffect: Send + Sync {
    /// Its name.
    fn name(&self) -> &str;

    /// Its parameters.
    fn parameters(&self) -> &[OwnParameter];

    /// The columns that it reads: those of the table, and for points `x`, `y`, `r` (1 at half the camera's width), `L`
    /// (log10 of the irradiance relative to full) and `F` (the irradiance).
    fn columns(&self) -> Vec<&str>;

    /// What it adds to a row, from the columns in their order: arcsec along x and y for points; elsewhere the first
    /// number alone, relative or mag.
    fn value(&self, columns: &[f64], parameters: &[f64]) -> [f64; 2];

    /// The same with its derivative by each parameter; by central differences unless given.
    fn value_and_slopes(&self, columns: &[f64], parameters: &[f64]) -> ([f64; 2], Vec<[f64; 2]>) {
        let slopes = (0..parameters.len())
            .map(|k| {
                // The cube root of the smallest difference from 1 balances rounding and curvature.
                let step = f64::EPSILON.cbrt() * parameters[k].abs().max(1e-3);
                let at = |sign: f64| {
                    let mut moved = parameters.to_vec();
                    moved[k] += sign * step;
                    self.value(columns, &moved)
                };
                let (above, below) = (at(1.0), at(-1.0));
                [0, 1].map(|axis| (above[axis] - below[axis]) / (2.0 * step))
            })
            .collect();
        (self.value(columns, parameters), slopes)
    }

    /// Where it comes from, for messages.
    fn source(&self) -> &Path {
        Path::new(self.name())
    }
}

/// Names of the columns that effects may read.
pub(crate) fn readable_columns(data: &Dataset) -> Vec<String> {
    let mut columns: Vec<String> = data.covariates.iter().map(|c| c.name.clone()).collect();
    if data.covariate("log10_irradiance").is_some() {
        columns.extend(["L".to_owned(), "F".to_owned()]);
    }
    columns
}

/// Values over all components, and derivatives by each parameter.
pub(crate) fn evaluate(
    effect: &dyn OwnEffect,
    data: &Dataset,
    parameters: &[f64],
) -> (Vec<f64>, Vec<Vec<f64>>) {
    let names = effect.columns();
    let columns: Vec<&[f64]> = names
        .iter()
        .map(|name| data.values(if ["L", "F"].contains(name) { "log10_irradiance" } else { name }))
        .collect();
    let light = names.iter().position(|name| *name == "F");
    let n = data.components();
    let mut values = Vec::with_capacity(data.y.len());
    let mut slopes = vec![Vec::with_capacity(data.y.len()); parameters.len()];
    let mut row_values = vec![0.0; names.len()];
    for row in 0..data.len() {
        for (value, column) in row_values.iter_mut().zip(&columns) {
            *value = column[row];
        }
        if let Some(light) = light {
            row_values[light] = 10f64.powf(row_values[light]);
        }
        // Where a column has no value the effect has none.
        let (value, slope) = match row_values.iter().any(|value| value.is_nan()) {
            true => ([0.0; 2], vec![[0.0; 2]; parameters.len()]),
            false => effect.value_and_slopes(&row_values, parameters),
        };
        values.extend_from_slice(&value[..n]);
        for (all, s) in slopes.iter_mut().zip(slope) {
            all.extend_from_slice(&s[..n]);
        }
    }
    (values, slopes)
}
