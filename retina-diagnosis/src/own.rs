//! Effects of one's own: what the workbench asks of them.

use std::borrow::Cow;
use std::path::Path;

use crate::data::Dataset;
use crate::following::read_column;

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
    /// (log10 of the irradiance relative to full) and `F` (the irradiance). `lag(temperature_c, 900[s])` is what follows a
    /// column with that time constant.
    fn columns(&self) -> Vec<&str>;

    /// What it adds to a row, from the columns in their order: arcsec along x and y for points; elsewhere the first
    /// number alone, relative or mag.
    fn value(&self, columns: &[f64], parameters: &[f64]) -> [f64; 2];

    /// The same with its derivative by each parameter; by central differences unless given.
    fn value_and_slopes(&self, columns: &[f64], parameters: &[f64]) -> ([f64; 2], Vec<[f64; 2]>) {
        let slopes = (0..parameters.len())
            .map(|k| {
                let step = difference_step(parameters[k]);
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

    /// The same for many rows, in their order: of each column a value for each row, and no value is NaN. Row by row
    /// unless given; an effect that is quicker over whole columns gives its own.
    fn values_and_slopes(&self, columns: &[Vec<f64>], parameters: &[f64]) -> Vec<([f64; 2], Vec<[f64; 2]>)> {
        let rows = columns.first().map_or(0, Vec::len);
        let mut row_values = vec![0.0; columns.len()];
        let of_row = |row: usize| {
            row_values.iter_mut().zip(columns).for_each(|(value, column)| *value = column[row]);
            self.value_and_slopes(&row_values, parameters)
        };
        (0..rows).map(of_row).collect()
    }

    /// Where it comes from, for messages.
    fn source(&self) -> &Path {
        Path::new(self.name())
    }
}

/// The step of a central difference by a parameter: the cube root of the smallest difference from 1 balances rounding
/// and curvature.
pub fn difference_step(parameter: f64) -> f64 {
    f64::EPSILON.cbrt() * parameter.abs().max(1e-3)
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
    // That they are there was checked when the effect was added.
    let columns: Vec<Cow<'_, [f64]>> =
        names.iter().map(|name| read_column(data, name).unwrap_or_default()).collect();
    // Where a column has no value the effect has none.
    let whole: Vec<usize> =
        (0..data.len()).filter(|&row| columns.iter().all(|column| !column[row].is_nan())).collect();
    let of_whole: Vec<Vec<f64>> =
        columns.iter().map(|column| whole.iter().map(|&row| column[row]).collect()).collect();
    // An effect without columns is the same in every row.
    let found = match names.is_empty() {
        true => vec![effect.value_and_slopes(&[], parameters); whole.len()],
        false => effect.values_and_slopes(&of_whole, parameters),
    };
    let n = data.components();
    let mut values = vec![0.0; data.y.len()];
    let mut slopes = vec![vec![0.0; data.y.len()]; parameters.len()];
    for (&row, (value, slope)) in whole.iter().zip(&found) {
        values[n * row..n * (row + 1)].copy_from_slice(&value[..n]);
        for (all, of_row) in slopes.iter_mut().zip(slope) {
            all[n * row..n * (row + 1)].copy_from_slice(&of_row[..n]);
        }
    }
    (values, slopes)
}
