//! Fig. 2 of the paper: smallest and largest field over focal lengths.

use retina_plot::{Anchor, Axis, Colour, Figure, HeatMap, PALETTE, Panel, Style};

use super::{FieldGrid, FieldRange, FieldRequirement};

/// Two maps; where a requirement is not met the map is red. `mark` is a pair (f_c, f_r), mm, to show.
pub fn field_range_figure(grid: &FieldGrid, required: &FieldRequirement, mark: Option<[f64; 2]>) -> Figure {
    let mut figure = Figure::new("Fields within all limits; red: requirement not met", 1, 2, [500.0, 400.0]);
    let title = ["(a) smallest diagonal field", "(b) largest diagonal field"];
    for (end, title) in title.into_iter().enumerate() {
        figure.put(0, end, panel(grid, required, mark, title, end));
    }
    figure
}

fn panel(
    grid: &FieldGrid,
    required: &FieldRequirement,
    mark: Option<[f64; 2]>,
    title: &str,
    end: usize,
) -> Panel {
    let pick = |range: &FieldRange| [range.min_rad, range.max_rad][end];
    let pitch = |values: &[f64]| if values.len() > 1 { values[1] - values[0] } else { 1.0 };
    let (columns, rows) = (&grid.collimator_focal_mm, &grid.relay_focal_mm);
    let pitch = [pitch(columns), pitch(rows)];
    let origin = [columns[0], rows[0]];
    let last = [columns[columns.len() - 1], rows[rows.len() - 1]];
    let axis = |k: usize, label: &str| {
        Axis::linear(label).range(origin[k] - 0.5 * pitch[k], last[k] + 0.5 * pitch[k])
    };
    let limit_deg = [required.min_deg, required.max_deg][end];
    let mut panel = Panel::new(axis(0, "f_c (mm)"), axis(1, "f_r (mm)"))
        .title(format!("{title} (required: {limit_deg} deg)"));
    let met = |range: &Option<FieldRange>| required.met_by(*range)[end];
    let values: Vec<f64> = grid
        .ranges
        .iter()
        .map(|range| range.as_ref().filter(|_| met(range)).map_or(f64::NAN, |range| pick(range).to_degrees()))
        .collect();
    let low = values.iter().copied().fold(f64::INFINITY, f64::min);
    let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    // The red ground shows wherever the map leaves it free.
    let [x0, y0] = [0, 1].map(|k| origin[k] - 0.5 * pitch[k]);
    let [x1, y1] = [0, 1].map(|k| last[k] + 0.5 * pitch[k]);
    let red = Style::line(Colour(0xd9, 0x53, 0x4f)).width(0.0).filled(0.75);
    panel.polygon(&[[x0, y0], [x1, y0], [x1, y1], [x0, y1]], red);
    let range = if low < high { [low, high] } else { [0.0, limit_deg] };
    let columns = columns.len();
    panel.heat(HeatMap { origin, pitch, columns, values, range, label: "diagonal field (deg)".into() });
    if let Some(at) = mark {
        panel.dots("", &[at], Style::line(Colour::BLACK).width(5.0));
        panel.dots("", &[at], Style::line(PALETTE[1]).width(3.5));
        panel.text(at, [7.0, -5.0], format!("{} / {} mm", at[0], at[1]), 10.0, Anchor::Start);
    }
    panel
}
