//! A figure: a grid of panels.

use crate::colour::Colour;
use crate::panel::{Anchor, Panel};
use crate::svg::Svg;

/// A grid of panels of one size.
#[derive(Debug, Clone)]
pub struct Figure {
    title: String,
    rows: usize,
    columns: usize,
    panel_px: [f64; 2],
    panels: Vec<(usize, usize, Panel)>,
}

const TITLE_PX: f64 = 28.0;

impl Figure {
    /// An empty grid; `panel_px` is the width and height of each panel.
    pub fn new(title: impl Into<String>, rows: usize, columns: usize, panel_px: [f64; 2]) -> Self {
        Self { title: title.into(), rows, columns, panel_px, panels: Vec::new() }
    }

    /// The title of the whole.
    pub fn title(&self) -> &str {
        &self.title
    }

    /// Puts a panel into a cell; one outside the grid is not shown.
    pub fn put(&mut self, row: usize, column: usize, panel: Panel) {
        self.panels.push((row, column, panel));
    }

    /// Each panel as an SVG of its own, row by row: a page lays them out by its width.
    pub fn panel_svgs(&self) -> Vec<String> {
        let mut order: Vec<&(usize, usize, Panel)> = self.panels.iter().collect();
        order.sort_by_key(|(row, column, _)| (*row, *column));
        order.into_iter().map(|(_, _, panel)| panel.to_svg(self.panel_px)).collect()
    }

    /// The figure as SVG text.
    pub fn to_svg(&self) -> String {
        let top = if self.title.is_empty() { 0.0 } else { TITLE_PX };
        let [w, h] = self.panel_px;
        let (width, height) = (w * self.columns as f64, h * self.rows as f64 + top);
        let mut svg = Svg::new(width, height, &self.title);
        if !self.title.is_empty() {
            svg.text([width / 2.0, 19.0], &self.title, 13.0, Colour::BLACK, Anchor::Middle, false);
        }
        for (row, column, panel) in &self.panels {
            if *row < self.rows && *column < self.columns {
                panel.draw(&mut svg, [w * *column as f64, top + h * *row as f64, w, h]);
            }
        }
        svg.finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Axis, HeatMap, PALETTE, Style};

    fn example() -> String {
        let mut panel =
            Panel::new(Axis::linear("x (mm)").range(0.0, 10.0), Axis::linear("y").range(0.0, 1.0))
                .title("a<b");
        panel.line("model", &[[0.0, 0.0], [10.0, 1.0]], Style::line(PALETTE[0]));
        panel.dots("data", &[[5.0, 0.5], [50.0, 0.5]], Style::line(PALETTE[1]).width(2.0));
        panel.heat(HeatMap {
            origin: [1.0, 0.1],
            pitch: [1.0, 0.1],
            columns: 2,
            values: vec![0.0, 0.0, f64::NAN, 1.0],
            range: [0.0, 1.0],
            label: String::new(),
        });
        let mut figure = Figure::new("t & u", 1, 1, [400.0, 300.0]);
        figure.put(0, 0, panel);
        figure.to_svg()
    }

    /// The plot area is 54 px from the left, 28 + 26 + 15 from the top (titles, legend), 332 x 217: worked out by hand.
    #[test]
    fn data_stand_where_the_axes_say() {
        let svg = example();
        assert!(svg.contains("M54 286L386 69"), "the diagonal:\n{svg}");
        assert!(svg.contains("M220 177.5h0\""), "the dot in the middle, the one outside left out");
        assert!(svg.contains("t &amp; u") && svg.contains("a&lt;b"));
        // Two cells of one colour are one rectangle; NaN is none.
        assert_eq!(svg.matches("fill=\"#440154\"").count(), 1);
        assert_eq!(svg.matches("fill=\"#fde725\"").count(), 1);
        assert_eq!(svg, example(), "the same bytes");
    }
}
