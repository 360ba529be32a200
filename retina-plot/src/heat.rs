//! Values on a regular grid, drawn as coloured cells with a colour bar.

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;

use crate::axis::Axis;
use crate::colour::{Colour, ColourMap};
use crate::draw::{LABEL_SIZE, Map, TICK_SIZE, width};
use crate::panel::Anchor;
use crate::picture::{self, SHADES};
use crate::svg::Svg;

/// Values on a regular grid.
#[derive(Debug, Clone, PartialEq)]
pub struct HeatMap {
    /// Centre of the first cell, data coordinates.
    pub origin: [f64; 2],
    /// Cell size, data coordinates.
    pub pitch: [f64; 2],
    /// Cells a row.
    pub columns: usize,
    /// Row by row; NaN stays free.
    pub values: Vec<f64>,
    /// Values at the ends of the colour bar.
    pub range: [f64; 2],
    /// Label of the colour bar, with unit; empty for no bar.
    pub label: String,
}

impl HeatMap {
    /// Rows of cells.
    pub(crate) fn rows(&self) -> usize {
        self.values.len() / self.columns.max(1)
    }

    /// First and last edge along an axis.
    pub(crate) fn extent(&self, axis: usize) -> [f64; 2] {
        let count = if axis == 0 { self.columns } else { self.rows() };
        let first = self.origin[axis] - self.pitch[axis] / 2.0;
        [first, first + count as f64 * self.pitch[axis]]
    }

    /// Two opposite corners of the cells `from..to` of a row, px.
    fn corners(&self, map: &Map<'_>, row: usize, from: usize, to: usize) -> Option<[[f64; 2]; 2]> {
        let x = |i: usize| self.origin[0] + (i as f64 - 0.5) * self.pitch[0];
        let y = |j: usize| self.origin[1] + (j as f64 - 0.5) * self.pitch[1];
        let (a, b) = (map.point([x(from), y(row)])?, map.point([x(to), y(row + 1)])?);
        Some([[a[0].min(b[0]), a[1].min(b[1])], [a[0].max(b[0]), a[1].max(b[1])]])
    }
}

pub(crate) fn draw_picture(svg: &mut Svg, map: &Map<'_>, heat: &HeatMap, colours: ColourMap) {
    let (x, y) = (heat.extent(0), heat.extent(1));
    let corners = (map.point([x[0], y[1]]), map.point([x[1], y[0]]));
    if let ((Some(a), Some(b)), Some(png)) = (corners, picture::png(heat, colours)) {
        svg.image([a[0], a[1], b[0] - a[0], b[1] - a[1]], &BASE64_STANDARD.encode(&png));
    }
}

/// Cells of one colour in a row become one rectangle.
pub(crate) fn draw_heat(svg: &mut Svg, map: &Map<'_>, heat: &HeatMap, colours: ColourMap) {
    let level = |value: f64| value.is_finite().then(|| picture::shade(value, heat.range));
    for (row, values) in heat.values.chunks(heat.columns.max(1)).enumerate() {
        let mut start = 0;
        while start < values.len() {
            let colour = level(values[start]);
            let end = (start..values.len()).find(|&i| level(values[i]) != colour).unwrap_or(values.len());
            if let (Some(level), Some([a, b])) = (colour, heat.corners(map, row, start, end)) {
                let colour = colours.colour(f64::from(level) / (SHADES - 1) as f64);
                // A little overlap hides the seams that renderers leave between neighbours.
                svg.rect(a[0], a[1], b[0] - a[0] + 0.3, b[1] - a[1] + 0.3, colour);
            }
            start = end;
        }
    }
}

/// A stroke across each cell without a value.
pub(crate) fn draw_hatch(svg: &mut Svg, map: &Map<'_>, heat: &HeatMap) {
    let columns = heat.columns.max(1);
    let empty = (0..heat.values.len()).filter(|&i| heat.values[i].is_nan());
    let strokes: Vec<[[f64; 2]; 2]> = empty
        .filter_map(|i| heat.corners(map, i / columns, i % columns, i % columns + 1))
        .map(|[a, b]| [[a[0], b[1]], [b[0], a[1]]])
        .collect();
    svg.segments(&strokes, Colour::GREY, 0.9);
}

/// The colour bar's ticks, and the room that it takes at the right of the plot, px.
pub(crate) fn bar_room(heat: &HeatMap) -> f64 {
    let ticks = bar_ticks(heat);
    let widest = ticks.places.iter().map(|(_, label)| width(label, TICK_SIZE)).fold(0.0, f64::max);
    10.0 + BAR_PX + 5.0 + widest + 6.0 + LABEL_SIZE + 4.0
}

const BAR_PX: f64 = 11.0;

fn bar_ticks(heat: &HeatMap) -> crate::axis::Ticks {
    Axis::linear(heat.label.clone()).ticks(heat.range, 5.0)
}

pub(crate) fn draw_bar(svg: &mut Svg, area: [f64; 4], heat: &HeatMap, colours: ColourMap) {
    let [x, y, w, h] = area;
    let left = x + w + 10.0;
    for i in 0..SHADES {
        let t = i as f64 / (SHADES - 1) as f64;
        let top = y + h * (1.0 - (i + 1) as f64 / SHADES as f64);
        svg.rect(left, top, BAR_PX, h / SHADES as f64 + 0.3, colours.colour(t));
    }
    let ticks = bar_ticks(heat);
    for (place, label) in &ticks.places {
        let at = y + h * (1.0 - (place - heat.range[0]) / (heat.range[1] - heat.range[0]));
        let right = left + BAR_PX;
        svg.path(&[[right, at], [right + 3.0, at]], Some((Colour::INK, 0.8)), None, None);
        svg.text([right + 5.0, at + 3.6], label, TICK_SIZE, Colour::INK, Anchor::Start, false);
    }
    let middle = [left + bar_room(heat) - 14.0, y + h / 2.0];
    svg.text(middle, &ticks.label, LABEL_SIZE, Colour::INK, Anchor::Middle, true);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Figure, Panel};

    /// Of a range that lies more above zero than below, zero is neutral all the same, and -1 and 1 are as strong.
    #[test]
    fn signed_maps_are_symmetric_about_zero() {
        let mut panel = Panel::new(Axis::linear("x"), Axis::linear("y"));
        let map = HeatMap {
            origin: [0.0; 2],
            pitch: [1.0; 2],
            columns: 4,
            values: vec![-1.0, 0.0, 1.0, 4.0],
            range: [-1.0, 4.0],
            label: String::new(),
        };
        panel.signed(map);
        let mut figure = Figure::new("", 1, 1, [300.0, 200.0]);
        figure.put(0, 0, panel);
        let svg = figure.to_svg();
        let fill = |of: Colour| svg.matches(&format!("fill=\"{of}\"")).count();
        let colour = |value: f64| ColourMap::Diverging.colour(0.5 + value / 8.0);
        for value in [-1.0, 0.0, 1.0, 4.0] {
            assert_eq!(fill(colour(value)), 1, "{value}:\n{svg}");
        }
        assert_eq!(colour(0.0), Colour(247, 247, 247));
    }

    /// Cells without a value are struck through, and the legend says so; without such cells there is no legend.
    #[test]
    fn cells_without_a_value_are_hatched() {
        let svg = |values: Vec<f64>| {
            let mut panel = Panel::new(Axis::linear("x"), Axis::linear("y"));
            let label = "points".to_owned();
            let map =
                HeatMap { origin: [0.5; 2], pitch: [1.0; 2], columns: 2, values, range: [0.0, 2.0], label };
            panel.heat(map.clone());
            panel.hatch("none", &map);
            let mut figure = Figure::new("", 1, 1, [300.0, 200.0]);
            figure.put(0, 0, panel);
            figure.to_svg()
        };
        let holes = svg(vec![1.0, f64::NAN, f64::NAN, 2.0]);
        assert!(holes.contains(">none<"));
        assert!(!svg(vec![1.0, 1.0, 1.0, 2.0]).contains(">none<"));
    }
}
