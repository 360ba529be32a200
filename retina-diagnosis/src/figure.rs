//! Errors over the field and against the columns, drawn.

use std::path::Path;

use retina_files::{InputError, write_atomic};
use retina_plot::{Axis, Figure, PALETTE, Panel, Style};

use crate::added::{AddedEffect, adjusted};
use crate::data::Dataset;
use crate::noise::robust_fit;
use crate::screens::screened;

/// Panels in a row, and most panels against columns.
const COLUMNS: usize = 3;
const MOST_COLUMNS: usize = 8;
/// Rows drawn at most: more hide each other.
const MOST_ROWS: usize = 1500;

/// Writes the figure: vectors over the field (points), then the errors against each column.
///
/// # Errors
/// The file cannot be written.
pub fn write_figure(path: &Path, data: &Dataset, added: &[AddedEffect]) -> Result<(), InputError> {
    write_atomic(path, figure_svg(data, added).as_bytes())
        .map_err(|error| InputError::new(path, format!("cannot be written: {error}")))
}

/// Vectors over the field (points), then the errors against each column.
pub(crate) fn figure_svg(data: &Dataset, added: &[AddedEffect]) -> String {
    let adjusted = adjusted(data, added);
    let fit = robust_fit(&adjusted.data, &adjusted.base);
    let n = data.components();
    let stride = data.len().div_ceil(MOST_ROWS).max(1);
    let rows: Vec<usize> = (0..data.len()).step_by(stride).filter(|&row| !fit.weights.outlier[row]).collect();
    let mut panels = Vec::new();
    if n == 2 {
        let (x, y) = (data.values("x"), data.values("y"));
        let rms = fit.weights.rms(2, &fit.residual).max(f64::MIN_POSITIVE);
        // Three rms are a tenth of half the field.
        let scale = 0.1 / (3.0 * rms);
        let mut panel = Panel::new(Axis::linear("x / half width"), Axis::linear("y / half width"))
            .title(format!("errors, {rms:.2} arcsec rms, enlarged"))
            .equal_aspect();
        for &row in &rows {
            let end = [x[row] + scale * fit.residual[2 * row], y[row] + scale * fit.residual[2 * row + 1]];
            panel.line("", &[[x[row], y[row]], end], Style::thin(PALETTE[0]));
        }
        panels.push(panel);
    }
    for name in screened(data).into_iter().take(MOST_COLUMNS) {
        let values = data.values(name);
        let mut panel = Panel::new(Axis::linear(name), Axis::linear(format!("error ({})", data.kind.unit())));
        for axis in 0..n {
            let dots: Vec<[f64; 2]> = rows
                .iter()
                .filter(|&&row| !values[row].is_nan())
                .map(|&row| [values[row], fit.residual[row * n + axis]])
                .collect();
            let label = if n == 2 { ["along x", "along y"][axis] } else { "" };
            panel.dots(label, &dots, Style::line(PALETTE[axis]).width(1.5));
        }
        panels.push(panel);
    }
    let mut figure =
        Figure::new("errors of the model", panels.len().div_ceil(COLUMNS), COLUMNS, [420.0, 320.0]);
    for (k, panel) in panels.into_iter().enumerate() {
        figure.put(k / COLUMNS, k % COLUMNS, panel);
    }
    figure.to_svg()
}
