//! The shape of what no effect explains: means over a column, and a formula to start from.

use std::fmt::Write as _;

use faer::linalg::solvers::Solve as _;
use faer::{Mat, Side};
use retina_files::InputError;
use retina_formats::TableKind;
use retina_plot::{Axis, PALETTE, Panel, Style};

use crate::added::{AddedEffect, adjusted};
use crate::data::Dataset;
use crate::diagnose::Diagnosis;
use crate::figure::{PANEL_PX, axis_label, means};
use crate::linear::least_squares;
use crate::noise::{RobustFit, robust_fit};

/// Degree of the formula.
const DEGREE: i32 = 3;
/// Degree of one whose coefficients are linear over the field.
const DEGREE_PLACED: i32 = 2;

/// A value in each row.
type OfRow<'a> = Box<dyn Fn(usize) -> f64 + 'a>;

/// How errors depend on a column.
#[derive(Debug, Clone)]
pub struct Shape {
    /// The column.
    pub covariate: String,
    /// Means over it, drawn.
    pub svg: String,
    /// A user's effect that follows it: a polynomial of the column, linear over the field where the direction changes
    /// from place to place, as the text of a TOML file.
    pub formula: String,
}

/// The shapes over the columns that a diagnosis names as unexplained, after the effects it accepted.
///
/// # Errors
/// None in practice: accepted effects fit the table.
pub fn unexplained_shapes(
    data: &Dataset,
    added: &[AddedEffect],
    result: &Diagnosis,
) -> Result<Vec<Shape>, InputError> {
    let mut all = added.to_vec();
    for id in &result.accepted {
        all.push(AddedEffect::read(id, data)?);
    }
    let adjusted = adjusted(data, &all);
    let fit = robust_fit(&adjusted.data, &adjusted.base);
    let rows: Vec<usize> = (0..data.len()).filter(|&row| !fit.weights.outlier[row]).collect();
    let named = &result.unexplained.covariates;
    // What depends on a column and points elsewhere from place to place is one formula over both.
    let over_field = ["x", "y"].iter().all(|axis| named.iter().any(|name| name == axis));
    let shape = |name: &String| {
        let values = data.covariate(name)?.values.as_slice();
        let placed = over_field && name != "x" && name != "y";
        let rows: Vec<usize> = rows.iter().copied().filter(|&row| !values[row].is_nan()).collect();
        Some(shape_over(data, name, values, &fit, &rows, placed))
    };
    Ok(named.iter().filter_map(shape).collect())
}

fn shape_over(
    data: &Dataset,
    name: &str,
    values: &[f64],
    fit: &RobustFit,
    rows: &[usize],
    placed: bool,
) -> Shape {
    let n = data.components();
    let y = Axis::linear(format!("error left ({})", data.kind.unit()));
    let mut panel = Panel::new(Axis::linear(axis_label(name)), y);
    for axis in 0..n {
        let label = if n == 2 { ["along x", "along y"][axis] } else { "means" };
        let error = |row: usize| fit.residual[row * n + axis];
        panel.means(
            label,
            &means(data, &fit.weights, rows, |row| values[row], error),
            Style::line(PALETTE[axis]),
        );
    }
    let residual = fit.residual.as_slice();
    Shape {
        covariate: name.to_owned(),
        svg: panel.to_svg(PANEL_PX),
        formula: formula(data, name, values, residual, rows, placed),
    }
}

/// Errors that a model leaves, and `field`, a prediction of them over all components in the table's unit. Over a column
/// (a covariate, or one that lags) means of what both are along the vectors `along`, signed; without one over the
/// prediction's own size, along its own vectors. What the model can be is taken out of both.
pub fn followed_svg(
    data: &Dataset,
    added: &[AddedEffect],
    field: &[f64],
    over: Option<(&str, &[f64])>,
) -> Option<String> {
    let adjusted = adjusted(data, added);
    let fit = robust_fit(&adjusted.data, &adjusted.base);
    let (coefficients, _) = least_squares(&adjusted.base, field);
    let mut own = field.to_vec();
    for (base, c) in adjusted.base.iter().zip(coefficients) {
        own.iter_mut().zip(base).for_each(|(value, base)| *value -= c * base);
    }
    let n = data.components();
    let size = |vectors: &[f64], row: usize| {
        vectors[row * n..(row + 1) * n].iter().map(|v| v * v).sum::<f64>().sqrt()
    };
    let vectors = over.map_or(own.as_slice(), |(_, along)| along);
    let along = |values: &[f64], row: usize| -> f64 {
        let product: f64 = (row * n..(row + 1) * n).map(|at| values[at] * vectors[at]).sum();
        product / size(vectors, row).max(f64::MIN_POSITIVE)
    };
    let values: Vec<f64> = match over {
        Some((name, _)) => data.readable(name)?,
        None => (0..data.len()).map(|row| size(&own, row)).collect(),
    };
    let rows: Vec<usize> =
        (0..data.len()).filter(|&row| !fit.weights.outlier[row] && values[row].is_finite()).collect();
    let unit = data.kind.unit();
    let across = over.map_or_else(|| format!("size of the formula ({unit})"), |(name, _)| axis_label(name));
    let mut panel =
        Panel::new(Axis::linear(across), Axis::linear(format!("error along the formula ({unit})")));
    let of = |error: &dyn Fn(usize) -> f64| means(data, &fit.weights, &rows, |row| values[row], error);
    panel.means("measured", &of(&|row| along(&fit.residual, row)), Style::line(PALETTE[0]));
    let formula: Vec<[f64; 2]> = of(&|row| along(&own, row)).iter().map(|[x, y, _]| [*x, *y]).collect();
    panel.line("formula", &formula, Style::line(PALETTE[1]));
    Some(panel.to_svg(PANEL_PX))
}

/// A polynomial of the column, its middle and half range written out, as a user's effect; where `placed`, of second
/// degree with coefficients that are linear over the field.
fn formula(
    data: &Dataset,
    name: &str,
    values: &[f64],
    residual: &[f64],
    rows: &[usize],
    placed: bool,
) -> String {
    let (low, high) = rows
        .iter()
        .map(|&row| values[row])
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
    let (middle, half) = (0.5 * (low + high), (0.5 * (high - low)).max(f64::MIN_POSITIVE));
    let t = |row: usize| (values[row] - middle) / half;
    let (x, y) = (data.values("x"), data.values("y"));
    // Each term: its text after the parameter, and its value in a row.
    let mut terms: Vec<(String, OfRow<'_>)> = Vec::new();
    let column = format!("(({name} - {middle:?}) / {half:?})");
    for power in 1..=if placed { DEGREE_PLACED } else { DEGREE } {
        let text = if power == 1 { column.clone() } else { format!("{column}^{power}") };
        let value = move |row: usize| t(row).powi(power);
        if placed {
            terms.push((format!("{text} * x"), Box::new(move |row| value(row) * x[row])));
            terms.push((format!("{text} * y"), Box::new(move |row| value(row) * y[row])));
        }
        terms.push((text, Box::new(value)));
    }
    let n = data.components();
    let unit = data.kind.unit();
    let names: &[&str] = if data.kind == TableKind::Points { &["dx", "dy"] } else { &["value"] };
    let mut text = format!("name = \"of_{name}\"\nunit = \"{unit}\"\n");
    let mut parameters = String::from("[parameters]\n");
    let values: Vec<&dyn Fn(usize) -> f64> = terms.iter().map(|(_, value)| value.as_ref()).collect();
    for (axis, quantity) in names.iter().enumerate() {
        let start = amplitudes(rows, &values, |row| residual[row * n + axis]);
        let sum: Vec<String> =
            terms.iter().enumerate().map(|(k, term)| format!("{quantity}{} * {}", k + 1, term.0)).collect();
        let _ = writeln!(text, "{quantity} = \"{}\"", sum.join(" + "));
        for (k, value) in start.iter().enumerate() {
            let _ = writeln!(parameters, "{quantity}{} = {{ start = {value:.4}, unit = \"{unit}\" }}", k + 1);
        }
    }
    text + &parameters
}

/// Least squares of y by the terms and a constant; the terms' amplitudes.
fn amplitudes(rows: &[usize], terms: &[&dyn Fn(usize) -> f64], y: impl Fn(usize) -> f64) -> Vec<f64> {
    let side = terms.len() + 1;
    let mut normal = Mat::<f64>::zeros(side, side);
    let mut right = Mat::<f64>::zeros(side, 1);
    for &row in rows {
        let values: Vec<f64> = terms.iter().map(|term| term(row)).chain([1.0]).collect();
        for i in 0..side {
            right[(i, 0)] += values[i] * y(row);
            for j in 0..side {
                normal[(i, j)] += values[i] * values[j];
            }
        }
    }
    // A trace of ridge: a column of few values has fewer coefficients than asked for.
    for i in 0..side {
        normal[(i, i)] += 1e-6 * rows.len() as f64;
    }
    let Ok(decomposed) = normal.llt(Side::Lower) else { return vec![0.0; terms.len()] };
    let solution = decomposed.solve(&right);
    (0..terms.len()).map(|k| solution[(k, 0)]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cubic_is_found() {
        let rows: Vec<usize> = (0..200).collect();
        let t = |row: usize| row as f64 / 100.0 - 1.0;
        let powers: Vec<OfRow<'_>> =
            (1..=3).map(|power| Box::new(move |row| t(row).powi(power)) as OfRow<'_>).collect();
        let terms: Vec<&dyn Fn(usize) -> f64> = powers.iter().map(AsRef::as_ref).collect();
        let found =
            amplitudes(&rows, &terms, |row| 5.0 + 2.0 * t(row) - t(row).powi(2) + 0.5 * t(row).powi(3));
        for (found, truth) in found.iter().zip([2.0, -1.0, 0.5]) {
            assert!((found - truth).abs() < 1e-3, "{found} {truth}");
        }
    }
}
