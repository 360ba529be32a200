//! Plots of a calibration, after the paper's Figs. 10 and 11.

use retina_plot::{Axis, Figure, HeatMap, PALETTE, Panel, Style};

use super::calibrate::{GeometryCalibration, PointResult};

const PANEL_PX: [f64; 2] = [400.0, 310.0];
/// Dots are thinned to this number: more are neither seen nor loaded quickly.
const MOST_DOTS: usize = 6000;

/// Names and figures: errors over magnitude with and without irradiance terms, their density and distribution, and
/// residuals over the field. `plain` is the same data's calibration without irradiance terms.
pub fn figures(result: &GeometryCalibration, plain: &GeometryCalibration) -> Vec<(&'static str, Figure)> {
    vec![
        ("error over magnitude", over_magnitude(result, plain)),
        ("density and distribution", distribution(result, plain)),
        ("residuals over the field", over_field(result)),
    ]
}

fn used(result: &GeometryCalibration) -> impl Iterator<Item = &PointResult> {
    result.points.iter().filter(|point| !point.outlier)
}

fn percentile(values: &mut [f64], share: f64) -> f64 {
    let at = ((values.len() as f64 - 1.0) * share).round() as usize;
    *values.select_nth_unstable_by(at, f64::total_cmp).1
}

/// What the chosen form is called beside the plain one.
fn chosen_form(result: &GeometryCalibration) -> &'static str {
    if result.form.irradiance_power == 0 {
        "chosen: no irradiance terms"
    } else {
        "with irradiance terms (Fig. 10a)"
    }
}

fn over_magnitude(result: &GeometryCalibration, plain: &GeometryCalibration) -> Figure {
    let magnitude = |point: &PointResult| result.brightest_magnitude - 2.5 * point.log10_irradiance;
    let largest = {
        let mut errors: Vec<f64> = used(plain).map(|p| p.heldout_arcsec).collect();
        if errors.is_empty() { 1.0 } else { 1.15 * percentile(&mut errors, 0.995) }
    };
    let mut figure = Figure::new("Error of exposures left out", 1, 2, PANEL_PX);
    for (column, (of, title)) in
        [(result, chosen_form(result)), (plain, "plain polynomial (Fig. 10b)")].into_iter().enumerate()
    {
        let y = Axis::linear("line of sight error (arcsec)").range(0.0, largest);
        let mut panel = Panel::new(Axis::linear("magnitude"), y).title(title);
        let every = of.points.len().div_ceil(MOST_DOTS);
        let dots: Vec<[f64; 2]> =
            used(of).step_by(every).map(|point| [magnitude(point), point.heldout_arcsec]).collect();
        panel.dots("", &dots, Style::line(PALETTE[4]).width(1.2));
        let mut groups: Vec<(f64, Vec<f64>)> = Vec::new();
        let mut sorted: Vec<&PointResult> = used(of).collect();
        sorted.sort_by(|a, b| magnitude(a).total_cmp(&magnitude(b)));
        for chunk in sorted.chunks(sorted.len().div_ceil(12).max(1)) {
            let mean = chunk.iter().map(|p| magnitude(p)).sum::<f64>() / chunk.len() as f64;
            groups.push((mean, chunk.iter().map(|p| p.heldout_arcsec).collect()));
        }
        for (label, share, colour) in [("95 %", 0.95, PALETTE[1]), ("median", 0.5, PALETTE[0])] {
            let line: Vec<[f64; 2]> =
                groups.iter_mut().map(|(at, errors)| [*at, percentile(errors, share)]).collect();
            panel.line(label, &line, Style::line(colour));
        }
        figure.put(0, column, panel);
    }
    figure
}

fn distribution(result: &GeometryCalibration, plain: &GeometryCalibration) -> Figure {
    let mut figure = Figure::new("Error of exposures left out (Fig. 11)", 1, 2, PANEL_PX);
    let mut largest = 1.0f64;
    let sorted = |of: &GeometryCalibration| {
        let mut errors: Vec<f64> = used(of).map(|point| point.heldout_arcsec).collect();
        errors.sort_by(f64::total_cmp);
        errors
    };
    let both = [(chosen_form(result), sorted(result), PALETTE[0]), ("plain", sorted(plain), PALETTE[1])];
    for (_, errors, _) in &both {
        largest = largest.max(errors.get(errors.len() * 995 / 1000).copied().unwrap_or(1.0));
    }
    let x = || Axis::linear("line of sight error (arcsec)").range(0.0, largest);
    let mut density = Panel::new(x(), Axis::linear("density (1/arcsec)")).title("probability density");
    let mut cumulative =
        Panel::new(x(), Axis::linear("share of points").range(0.0, 1.0)).title("distribution");
    const BINS: usize = 60;
    let width = largest / BINS as f64;
    for (label, errors, colour) in &both {
        let count = errors.len().max(1) as f64;
        let at = |limit: f64| errors.partition_point(|&e| e < limit) as f64;
        let bins: Vec<[f64; 2]> = (0..BINS)
            .map(|bin| {
                let low = bin as f64 * width;
                [low + 0.5 * width, (at(low + width) - at(low)) / (count * width)]
            })
            .collect();
        density.line(label, &bins, Style::line(*colour));
        let steps: Vec<[f64; 2]> =
            (0..=200).map(|i| largest * f64::from(i) / 200.0).map(|e| [e, at(e) / count]).collect();
        cumulative.line(label, &steps, Style::line(*colour));
    }
    cumulative.line("", &[[10.0, 0.0], [10.0, 1.0]], Style::thin(PALETTE[6]).dashed());
    figure.put(0, 0, density);
    figure.put(0, 1, cumulative);
    figure
}

/// Median error and mean residual in cells of the field.
fn over_field(result: &GeometryCalibration) -> Figure {
    const CELLS: [usize; 2] = [24, 18];
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for point in used(result) {
        for (k, value) in point.sight.to_array().into_iter().enumerate() {
            let degrees = value.atan().to_degrees();
            low[k] = low[k].min(degrees);
            high[k] = high[k].max(degrees);
        }
    }
    let pitch = [0, 1].map(|k| (high[k] - low[k]).max(1e-9) / CELLS[k] as f64);
    let mut cells: Vec<Vec<[f64; 3]>> = vec![Vec::new(); CELLS[0] * CELLS[1]];
    for point in used(result) {
        let at = [0, 1].map(|k| {
            let degrees = point.sight.to_array()[k].atan().to_degrees();
            (((degrees - low[k]) / pitch[k]) as usize).min(CELLS[k] - 1)
        });
        let arcsec = point.residual.to_array().map(|v| v.to_degrees() * 3600.0);
        cells[at[1] * CELLS[0] + at[0]].push([point.heldout_arcsec, arcsec[0], arcsec[1]]);
    }
    let of = |statistic: &dyn Fn(&[[f64; 3]]) -> f64| -> Vec<f64> {
        cells.iter().map(|cell| if cell.is_empty() { f64::NAN } else { statistic(cell) }).collect()
    };
    let median = of(&|cell| percentile(&mut cell.iter().map(|c| c[0]).collect::<Vec<_>>(), 0.5));
    let mean = |k: usize| of(&move |cell| cell.iter().map(|c| c[k]).sum::<f64>() / cell.len() as f64);
    let (right, down) = (mean(1), mean(2));
    let top = |values: &[f64]| {
        values.iter().filter(|v| v.is_finite()).fold(0.0f64, |a, v| a.max(v.abs())).max(1e-9)
    };
    let both = top(&right).max(top(&down));
    let mut figure = Figure::new("Over the field", 1, 3, PANEL_PX);
    for (column, (title, values, range)) in [
        ("median error", median.clone(), [0.0, top(&median)]),
        ("mean residual along x", right, [-both, both]),
        ("mean residual along y", down, [-both, both]),
    ]
    .into_iter()
    .enumerate()
    {
        let mut panel = Panel::new(
            Axis::linear("x (deg)").range(low[0], high[0]),
            // Downwards, as on the screen.
            Axis::linear("\u{2212}y (deg)").range(-high[1], -low[1]),
        )
        .title(title);
        let flipped: Vec<f64> = values.chunks(CELLS[0]).rev().flatten().copied().collect();
        let map = HeatMap {
            origin: [low[0] + 0.5 * pitch[0], -high[1] + 0.5 * pitch[1]],
            pitch,
            columns: CELLS[0],
            values: flipped,
            range,
            label: "arcsec".into(),
        };
        panel.hatch("no point", &map);
        if range[0] < 0.0 {
            panel.signed(map);
        } else {
            panel.heat(map);
        }
        figure.put(0, column, panel);
    }
    figure
}
