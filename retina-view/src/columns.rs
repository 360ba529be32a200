//! Rows for the page's plots, in binary: a table of a hundred thousand rows is drawn in a moment, and no number is
//! written as text.
//!
//! A body is the length of a JSON header (u32), the header, spaces up to a multiple of four bytes, and columns of f32,
//! all little-endian.

use retina_diagnosis::{Dataset, Fit, axis_label};
use serde_json::{Value, json};

/// Most rows that are shown. Every n-th is, of more.
const MOST_SHOWN: usize = 50_000;

fn stride(data: &Dataset) -> usize {
    data.len().div_ceil(MOST_SHOWN).max(1)
}

fn body(header: &Value, columns: impl IntoIterator<Item = Vec<f32>>) -> Vec<u8> {
    let mut text = header.to_string();
    while !text.len().is_multiple_of(4) {
        text.push(' ');
    }
    let mut out = u32::try_from(text.len()).unwrap_or(u32::MAX).to_le_bytes().to_vec();
    out.extend_from_slice(text.as_bytes());
    for column in columns {
        column.iter().for_each(|value| out.extend_from_slice(&value.to_le_bytes()));
    }
    out
}

/// One component of values that lie side by side.
fn component(data: &Dataset, values: &[f64], axis: usize) -> Vec<f32> {
    let n = data.kind.components();
    (0..data.len()).step_by(stride(data)).map(|row| values[row * n + axis] as f32).collect()
}

/// What the rows are: their group, their columns, and what was measured beside the fixed part of the model.
pub(crate) fn columns(data: &Dataset) -> Vec<u8> {
    let every = stride(data);
    let mut group = vec![0f32; data.len()];
    for (number, own) in data.groups.iter().enumerate() {
        group[own.rows.clone()].fill(number as f32);
    }
    let names: Vec<Value> =
        data.covariates.iter().map(|c| json!({ "name": c.name, "label": axis_label(&c.name) })).collect();
    let shown = data.len().div_ceil(every);
    let header = json!({
        "rows": data.len(),
        "shown": shown,
        "table": data.kind.name(),
        "components": data.kind.components(),
        "unit": data.kind.unit(),
        "half_height": data.field_half_height(),
        "groups": data.groups.iter().map(|group| &group.name).collect::<Vec<_>>(),
        "columns": names,
    });
    let thin = |values: &[f64]| values.iter().step_by(every).map(|v| *v as f32).collect::<Vec<f32>>();
    let group = group.into_iter().step_by(every).collect();
    body(&header, std::iter::once(group).chain(data.covariates.iter().map(|c| thin(&c.values))))
}

/// Errors that a fit leaves, what its effects add, and which rows are outliers.
pub(crate) fn rows(data: &Dataset, fit: &Fit) -> Vec<u8> {
    let n = data.kind.components();
    let outlier = fit
        .outlier
        .iter()
        .step_by(stride(data))
        .map(|out| if *out { 1.0 } else { 0.0 })
        .collect::<Vec<f32>>();
    let residual = (0..n).map(|axis| component(data, &fit.residual, axis));
    let effect = (0..n).map(|axis| component(data, &fit.effect, axis));
    let header = json!({ "components": n, "shown": outlier.len(), "heldout_rms": fit.heldout_rms });
    body(&header, residual.chain(effect).chain([outlier.clone()]))
}
