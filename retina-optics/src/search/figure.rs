//! Spot against length.

use retina_plot::{Anchor, Axis, Figure, PALETTE, Panel, Style};

use super::SearchReport;

/// The designs of a search with their pareto front.
pub fn pareto_figure(report: &SearchReport) -> Figure {
    let at = |i: usize| [report.designs[i].length_mm, report.designs[i].worst_rms_um];
    let all: Vec<[f64; 2]> = (0..report.designs.len()).map(at).collect();
    let front: Vec<[f64; 2]> = report.pareto().into_iter().map(at).collect();
    let mut panel = Panel::new(
        Axis::linear("length, collimator to screen (mm)"),
        Axis::linear("worst RMS spot on the sensor (um)"),
    )
    .title(format!("{} designs", all.len()));
    panel.dots("designs", &all, Style::line(PALETTE[0]).width(2.2));
    panel.line("not beaten in both", &front, Style::line(PALETTE[1]));
    panel.dots("", &front, Style::line(PALETTE[1]).width(3.0));
    for (i, point) in report.pareto().into_iter().zip(&front) {
        let parts: Vec<&str> = report.designs[i].lenses.iter().map(|lens| lens.part.as_str()).collect();
        panel.text(*point, [6.0, -4.0], parts.join(" "), 7.0, Anchor::Start);
    }
    let mut figure = Figure::new("Stock-lens search: spot against length", 1, 1, [760.0, 460.0]);
    figure.put(0, 0, panel);
    figure
}
