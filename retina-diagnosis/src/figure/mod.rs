//! Errors over the field and against the columns, drawn; where the table has points, and how sure the model is.

mod cells;
mod means;

use std::path::Path;
use std::sync::Arc;

use retina_files::{InputError, write_atomic};
use retina_formats::TableKind;
use retina_plot::{Arrows, Axis, Figure, HeatMap, PALETTE, Panel, Style};

use crate::added::{AddedEffect, adjusted};
use crate::data::Dataset;
use crate::estimate::estimate;
use crate::following::of_lag_name;
use crate::noise::{RobustFit, robust_fit};
use crate::screens::screened;
use crate::uncertainty::{Spread, correlation_of, independent_errors, spread};
use cells::Cells;
pub(crate) use means::means;

/// Panels in a row, and most panels against columns.
const COLUMNS: usize = 3;
const MOST_COLUMNS: usize = 8;
/// Rows drawn at most: more hide each other.
const MOST_ROWS: usize = 1500;
/// Size of a panel, px: letters keep their size on a telephone of this width.
pub(crate) const PANEL_PX: [f64; 2] = [400.0, 310.0];
/// Share of the rows that the range of a panel against a column holds.
const INSIDE: f64 = 0.99;
/// How strongly a crowd of dots is inked behind its means.
const CROWD: f64 = 0.4;

/// Columns of light begin so: what depends on them moves points along the radius, which along x and y is lost in the mean.
const RADIAL: [&str; 3] = ["log10_irradiance", "exposure_s", "channel_"];

/// An error in each row.
type OfRow<'a> = Arc<dyn Fn(usize) -> f64 + 'a>;

/// A model fitted to a table, to be looked at.
pub(crate) struct View {
    data: Dataset,
    fit: RobustFit,
    /// Rows that are no outliers.
    rows: Vec<usize>,
    /// Tables of points: their field.
    over_field: Option<OverField>,
}

struct OverField {
    cells: Cells,
    /// Rows in each cell, outliers too.
    counts: Vec<usize>,
    /// The model's uncertainty in each cell.
    spread: Option<Spread>,
}

impl OverField {
    /// Points in each cell; cells without one have no value.
    fn coverage(&self) -> HeatMap {
        let seen =
            self.counts.iter().map(|&count| if count == 0 { f64::NAN } else { count as f64 }).collect();
        self.cells.map(seen, 0.0, "points in a cell")
    }
}

/// What a few words on a page say of the field.
pub(crate) struct FieldFigures {
    /// Cells, and those without a point.
    pub(crate) cells: [usize; 2],
    /// The model's standard deviation per axis at the middle of the field and where it is largest, arcsec.
    pub(crate) sigma: Option<[f64; 2]>,
}

impl View {
    /// Fits the baseline with added effects.
    pub(crate) fn of(data: &Dataset, added: &[AddedEffect]) -> Self {
        let part = data.fitted_part();
        let adjusted = adjusted(part.as_ref().unwrap_or(data), added);
        let (data, base) = (adjusted.data, adjusted.base);
        let fit = robust_fit(&data, &base);
        let rows: Vec<usize> = (0..data.len()).filter(|&row| !fit.weights.outlier[row]).collect();
        let over_field = (data.kind == TableKind::Points).then(|| {
            let cells = Cells::of(&data);
            let (sigma, correlation) = correlation_of(&estimate(&data, &base, &fit.weights).covariance);
            let spread = independent_errors(&data, &base, &sigma, &correlation)
                .and_then(|errors| spread(&data, &errors, &cells.centres(), cells.half));
            OverField { counts: cells.counts(0..data.len()), cells, spread }
        });
        Self { data, fit, rows, over_field }
    }

    /// The field in figures; `None` of tables without one.
    pub(crate) fn field_figures(&self) -> Option<FieldFigures> {
        let OverField { cells, counts, spread } = self.over_field.as_ref()?;
        let middle = |at: &[f64; 2]| at[0].hypot(at[1]);
        let centres = cells.centres();
        let nearest =
            (0..centres.len()).min_by(|&a, &b| middle(&centres[a]).total_cmp(&middle(&centres[b])))?;
        Some(FieldFigures {
            cells: [counts.len(), counts.iter().filter(|count| **count == 0).count()],
            sigma: spread
                .as_ref()
                .map(|spread| [spread.sigma[nearest], spread.sigma.iter().copied().fold(0.0, f64::max)]),
        })
    }

    /// Share of the model's uncertainty that is no function of the place.
    pub(crate) fn uncertain_elsewhere(&self) -> f64 {
        self.over_field
            .as_ref()
            .and_then(|field| field.spread.as_ref())
            .map_or(0.0, |spread| spread.elsewhere)
    }

    /// Mean errors of the field's cells along an axis; rows count by their noise.
    fn cell_means(&self, field: &OverField, axis: usize) -> Vec<f64> {
        let weight = |row: usize| 1.0 / self.fit.weights.sigma[row].powi(2);
        field.cells.means(&self.rows, weight, |row| self.fit.residual[2 * row + axis])
    }

    /// Mean errors of the field's cells as arrows.
    fn arrows(&self, field: &OverField) -> Arrows {
        let along = |axis: usize| self.cell_means(field, axis);
        let values = along(0).into_iter().zip(along(1)).map(|(x, y)| [x, y]).collect();
        Arrows::new(field.cells.centres(), values, self.data.kind.unit(), Style::line(PALETTE[0]).width(1.1))
    }

    /// The value that the longest arrows stand for, to draw another model's on the same scale.
    pub(crate) fn arrow_reference(&self) -> Option<f64> {
        self.over_field.as_ref().map(|field| self.arrows(field).reference_value())
    }

    /// Mean errors of the field's cells as arrows; `reference` draws them on another view's scale. None of tables without
    /// a field, as of all that follow.
    pub(crate) fn arrows_over_field(&self, title: &str, reference: Option<f64>) -> Option<Panel> {
        let field = self.over_field.as_ref()?;
        let arrows = self.arrows(field);
        // Arrows at the edge point beyond it.
        let mut panel = field_panel(title, field.cells.half.map(|half| 1.08 * half));
        panel.arrows(match reference {
            Some(value) => arrows.reference(value),
            None => arrows,
        });
        Some(panel)
    }

    /// Mean errors of the cells along each axis, in colours of one scale.
    pub(crate) fn signed_over_field(&self) -> Vec<Panel> {
        let Some(field) = &self.over_field else { return Vec::new() };
        let means = [0, 1].map(|axis| self.cell_means(field, axis));
        let most = means.iter().flatten().filter(|v| v.is_finite()).fold(0.0f64, |most, v| most.max(v.abs()));
        let panels = means.into_iter().zip(["x", "y"]).map(|(values, name)| {
            let mut map = field.cells.map(values, 0.0, self.data.kind.unit());
            map.range = [-most, most];
            let mut panel = field_panel(&format!("mean error along {name}"), field.cells.half);
            panel.hatch("no point, or outliers alone", &map);
            panel.signed(map);
            panel
        });
        panels.collect()
    }

    /// Where the table has points.
    pub(crate) fn coverage(&self) -> Option<Panel> {
        let field = self.over_field.as_ref()?;
        let map = field.coverage();
        let mut panel = field_panel("where points were measured", field.cells.half);
        panel.hatch("no point", &map);
        panel.heat(map);
        Some(panel)
    }

    /// How sure the model is over the field.
    pub(crate) fn uncertainty(&self) -> Option<Panel> {
        let field = self.over_field.as_ref()?;
        let sigma = field.spread.as_ref()?.sigma.clone();
        let mut panel = field_panel("uncertainty of the model's line of sight", field.cells.half);
        panel.heat(field.cells.map(sigma, 0.0, "sigma per axis (arcsec)"));
        // Over the colours: what the model says there rests on points elsewhere.
        panel.hatch("no point: continued", &field.coverage());
        Some(panel)
    }

    /// Errors against the columns: dots of the rows, means of bins with their standard deviations.
    pub(crate) fn over_columns(&self) -> Vec<Panel> {
        let mut out: Vec<Panel> = self.over_radius().into_iter().collect();
        let n = self.data.components();
        for name in screened(&self.data).into_iter().take(MOST_COLUMNS) {
            let values = self.data.values(name);
            let errors = if n == 2 && RADIAL.iter().any(|light| name.starts_with(light)) {
                self.turned().to_vec()
            } else {
                let labels: &[&str] = if n == 2 { &["along x, means", "along y, means"] } else { &["means"] };
                let error =
                    |axis: usize| -> OfRow<'_> { Arc::new(move |row| self.fit.residual[row * n + axis]) };
                labels.iter().enumerate().map(|(axis, &label)| (label, error(axis))).collect()
            };
            out.push(self.column_panel(&axis_label(name), &|row| values[row], &errors));
        }
        out
    }

    /// From the middle of the field outwards.
    fn over_radius(&self) -> Option<Panel> {
        self.over_field.as_ref()?;
        let radius = self.data.values("r");
        Some(self.column_panel("distance from the middle / half width", &|row| radius[row], &self.turned()))
    }

    /// Errors of points along the radius and across it.
    fn turned(&self) -> [(&'static str, OfRow<'_>); 2] {
        let (x, y, r) = (self.data.values("x"), self.data.values("y"), self.data.values("r"));
        let along = move |row: usize, [a, b]: [f64; 2]| {
            let (dx, dy) = (self.fit.residual[2 * row], self.fit.residual[2 * row + 1]);
            (a * dx + b * dy) / r[row].max(f64::MIN_POSITIVE)
        };
        [
            ("outwards, means", Arc::new(move |row| along(row, [x[row], y[row]]))),
            ("across, means", Arc::new(move |row| along(row, [-y[row], x[row]]))),
        ]
    }

    /// Errors against a value of the rows: a crowd behind its means. The range leaves out the largest hundredth, which
    /// would press all else flat.
    fn column_panel(&self, label: &str, value: &dyn Fn(usize) -> f64, errors: &[(&str, OfRow<'_>)]) -> Panel {
        let stride = self.rows.len().div_ceil(MOST_ROWS).max(1);
        let finite = self.rows.iter().copied().step_by(stride).filter(|&row| value(row).is_finite());
        let rows: Vec<usize> = finite.collect();
        let mut sizes: Vec<f64> =
            errors.iter().flat_map(|(_, error)| rows.iter().map(|&row| error(row).abs())).collect();
        sizes.sort_by(f64::total_cmp);
        let last = sizes.len().saturating_sub(1);
        let mut most = sizes.get((INSIDE * last as f64).round() as usize).map_or(0.0, |size| 1.1 * size);
        let mut all = Vec::new();
        for (_, error) in errors {
            let means = means(&self.data, &self.fit.weights, &self.rows, value, error.as_ref());
            most = means.iter().fold(most, |most, [_, y, sigma]| most.max(1.1 * (y.abs() + sigma)));
            all.push(means);
        }
        let y = Axis::linear(format!("error ({})", self.data.kind.unit()));
        let mut panel = Panel::new(Axis::linear(label), if most > 0.0 { y.range(-most, most) } else { y });
        for ((_, error), ink) in errors.iter().zip(PALETTE) {
            let dots: Vec<[f64; 2]> = rows.iter().map(|&row| [value(row), error(row)]).collect();
            panel.dots("", &dots, Style::line(ink).width(1.2).faint(CROWD));
        }
        for (((label, _), means), ink) in errors.iter().zip(all).zip(PALETTE) {
            panel.means(label, &means, Style::line(ink));
        }
        panel
    }

    /// The model alone: errors over the field, coverage and uncertainty.
    pub(crate) fn field_panels(&self) -> Vec<Panel> {
        let mut out: Vec<Panel> = self.arrows_over_field("mean errors of cells", None).into_iter().collect();
        out.extend(self.signed_over_field());
        out.extend(self.coverage());
        out.extend(self.uncertainty());
        out
    }
}

/// Panels as SVGs.
pub(crate) fn svgs(panels: &[Panel]) -> Vec<String> {
    panels.iter().map(|panel| panel.to_svg(PANEL_PX)).collect()
}

/// A panel over the camera's field, to plus and minus these x and y.
pub(crate) fn field_panel(title: &str, [x, y]: [f64; 2]) -> Panel {
    // Downwards, as the camera's pixels are counted.
    let down = Axis::linear("y / half width").range(-y, y).reversed();
    Panel::new(Axis::linear("x / half width").range(-x, x), down).title(title).equal_aspect()
}

/// A column's name as a label, its unit in brackets.
pub fn axis_label(name: &str) -> String {
    const UNITS: [(&str, &str); 9] = [
        ("_w_m2", "W/m\u{b2}"),
        ("_arcsec", "arcsec"),
        ("_deg", "deg"),
        ("_px", "px"),
        ("_dn", "DN"),
        ("_mag", "mag"),
        ("_nm", "nm"),
        ("_c", "\u{b0}C"),
        ("_s", "s"),
    ];
    if let Some((column, tau_s)) = of_lag_name(name) {
        return format!("{}, {tau_s} s behind", axis_label(column));
    }
    match name {
        "log10_irradiance" => return "log10 of the irradiance (white at full count: 0)".to_owned(),
        "digital_count" => return "digital count (DN)".to_owned(),
        _ => {}
    }
    if name.ends_with("_phase_x") || name.ends_with("_phase_y") {
        return format!("{} (px)", name.replace('_', " "));
    }
    let unit = UNITS.iter().find_map(|(suffix, unit)| Some((name.strip_suffix(suffix)?, unit)));
    match unit {
        Some((quantity, unit)) => format!("{} ({unit})", quantity.replace('_', " ")),
        None => name.replace('_', " "),
    }
}

/// The figure as SVG: errors over the field (points), coverage and uncertainty, then the errors against each column.
pub fn figure_svg(data: &Dataset, added: &[AddedEffect]) -> String {
    let view = View::of(data, added);
    let mut panels = view.field_panels();
    panels.extend(view.over_columns());
    let mut figure = Figure::new("errors of the model", panels.len().div_ceil(COLUMNS), COLUMNS, PANEL_PX);
    for (k, panel) in panels.into_iter().enumerate() {
        figure.put(k / COLUMNS, k % COLUMNS, panel);
    }
    figure.to_svg()
}

/// Writes the figure.
///
/// # Errors
/// The file cannot be written.
pub fn write_figure(path: &Path, data: &Dataset, added: &[AddedEffect]) -> Result<(), InputError> {
    write_atomic(path, figure_svg(data, added).as_bytes())
        .map_err(|error| InputError::new(path, format!("cannot be written: {error}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_have_their_units() {
        for (name, label) in [
            ("time_s", "time (s)"),
            ("temperature_c", "temperature (\u{b0}C)"),
            ("camera_phase_x", "camera phase x (px)"),
            ("irradiance_w_m2", "irradiance (W/m\u{b2})"),
            ("row_load", "row load"),
        ] {
            assert_eq!(axis_label(name), label);
        }
    }
}
