//! The shape of what no effect explains: means over a column, and a formula to start from.

use std::fmt::Write as _;

use faer::linalg::solvers::Solve as _;
use faer::{Mat, Side};
use retina_files::InputError;
use retina_plot::{Axis, Figure, PALETTE, Panel, Style};

use crate::data::{Dataset, TableKind};
use crate::diagnose::Diagnosis;
use crate::noise::robust_fit;
use crate::user::{AddedEffect, adjusted};

/// Bins of equal numbers of rows.
const BINS: usize = 15;
/// Degree of the formula.
const DEGREE: usize = 3;

/// How errors depend on a column.
#[derive(Debug, Clone)]
pub struct Shape {
    /// The column.
    pub covariate: String,
    /// Means over it, drawn.
    pub svg: String,
    /// A user's effect that follows it: a polynomial of third degree, as the text of a TOML file.
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
    let shape = |name: &String| {
        let values = data.covariate(name)?.values.as_slice();
        Some(shape_over(data, name, values, &fit.residual, &rows))
    };
    Ok(result.unexplained.covariates.iter().filter_map(shape).collect())
}

fn shape_over(data: &Dataset, name: &str, values: &[f64], residual: &[f64], rows: &[usize]) -> Shape {
    let n = data.components();
    let mut order = rows.to_vec();
    order.sort_by(|&a, &b| values[a].total_cmp(&values[b]));
    let mut panel =
        Panel::new(Axis::linear(name), Axis::linear(format!("error left ({})", data.kind.unit())));
    for axis in 0..n {
        let ink = PALETTE[axis];
        let mut means = Vec::new();
        for bin in order.chunks(order.len().div_ceil(BINS).max(2)) {
            let count = bin.len() as f64;
            let mean = |of: &dyn Fn(usize) -> f64| bin.iter().map(|&row| of(row)).sum::<f64>() / count;
            let (x, y) = (mean(&|row| values[row]), mean(&|row| residual[row * n + axis]));
            let sigma = (mean(&|row| (residual[row * n + axis] - y).powi(2)) / count).sqrt();
            panel.line("", &[[x, y - sigma], [x, y + sigma]], Style::thin(ink));
            means.push([x, y]);
        }
        let label = if n == 2 { ["along x", "along y"][axis] } else { "" };
        panel.line(label, &means, Style::line(ink));
        panel.dots("", &means, Style::line(ink).width(2.0));
    }
    let mut figure = Figure::new("", 1, 1, [560.0, 360.0]);
    figure.put(0, 0, panel);
    Shape {
        covariate: name.to_owned(),
        svg: figure.to_svg(),
        formula: formula(data, name, values, residual, rows),
    }
}

/// A polynomial of the column, its middle and half range written out, as a user's effect.
fn formula(data: &Dataset, name: &str, values: &[f64], residual: &[f64], rows: &[usize]) -> String {
    let (low, high) = rows
        .iter()
        .map(|&row| values[row])
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
    let (middle, half) = (0.5 * (low + high), (0.5 * (high - low)).max(f64::MIN_POSITIVE));
    let t = |row: usize| (values[row] - middle) / half;
    let n = data.components();
    let unit = data.kind.unit();
    let names: &[&str] = if data.kind == TableKind::Points { &["dx", "dy"] } else { &["value"] };
    let mut text = format!("name = \"of_{name}\"\nunit = \"{unit}\"\n");
    let mut parameters = String::from("[parameters]\n");
    for (axis, quantity) in names.iter().enumerate() {
        let start = polynomial(rows, &t, |row| residual[row * n + axis]);
        let u = format!("(({name} - {middle:?}) / {half:?})");
        let terms: Vec<String> = (1..=DEGREE)
            .map(|k| if k == 1 { format!("{quantity}1 * {u}") } else { format!("{quantity}{k} * {u}^{k}") })
            .collect();
        let _ = writeln!(text, "{quantity} = \"{}\"", terms.join(" + "));
        for (k, value) in start.iter().enumerate() {
            let _ = writeln!(parameters, "{quantity}{} = {{ start = {value:.4}, unit = \"{unit}\" }}", k + 1);
        }
    }
    text + &parameters
}

/// Coefficients of t, t^2, t^3 of a polynomial with a constant, least squares.
fn polynomial(rows: &[usize], t: &impl Fn(usize) -> f64, y: impl Fn(usize) -> f64) -> [f64; DEGREE] {
    const SIDE: usize = DEGREE + 1;
    let powers = |row: usize| -> [f64; SIDE] { std::array::from_fn(|k| t(row).powi(k as i32)) };
    let mut normal = Mat::<f64>::zeros(SIDE, SIDE);
    let mut right = Mat::<f64>::zeros(SIDE, 1);
    for &row in rows {
        let powers = powers(row);
        for i in 0..SIDE {
            right[(i, 0)] += powers[i] * y(row);
            for j in 0..SIDE {
                normal[(i, j)] += powers[i] * powers[j];
            }
        }
    }
    // A trace of ridge: a column of few values has fewer coefficients than asked for.
    for i in 0..SIDE {
        normal[(i, i)] += 1e-6 * rows.len() as f64;
    }
    let Ok(decomposed) = normal.llt(Side::Lower) else { return [0.0; DEGREE] };
    let solution = decomposed.solve(&right);
    std::array::from_fn(|k| solution[(k + 1, 0)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cubic_is_found() {
        let rows: Vec<usize> = (0..200).collect();
        let t = |row: usize| row as f64 / 100.0 - 1.0;
        let found = polynomial(&rows, &t, |row| 5.0 + 2.0 * t(row) - t(row).powi(2) + 0.5 * t(row).powi(3));
        for (found, truth) in found.iter().zip([2.0, -1.0, 0.5]) {
            assert!((found - truth).abs() < 1e-3, "{found} {truth}");
        }
    }
}
