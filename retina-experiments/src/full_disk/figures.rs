//! Figures of the experiment.

use glam::DVec3;
use retina_plot::{Axis, Colour, Figure, PALETTE, Panel, Style};

use super::filter::{FilterResult, FilterStep};
use super::sequence::{CHI2_3_99, FrameResult};

/// A sequence with what was made of it.
#[derive(Clone, Copy)]
pub struct Shown<'a> {
    /// Its name in legends.
    pub label: &'a str,
    /// Its frames.
    pub frames: &'a [FrameResult],
    /// The filter over them.
    pub filter: Option<&'a FilterResult>,
}

const AXES: [&str; 3] = ["X", "Y", "Z"];
/// Points of a density's curve.
const CURVE: usize = 240;

fn colour(at: usize) -> Colour {
    PALETTE[at % PALETTE.len()]
}

/// Errors along a camera axis: of the filter after it has settled where there is one, of single frames otherwise, km.
fn errors(shown: &Shown<'_>, axis: usize, filtered: bool) -> Vec<f64> {
    match (filtered, shown.filter) {
        (true, Some(filter)) => {
            let settle_s = 3600.0 * filter.options.settle_h;
            let settled = filter.steps.iter().filter(|step| step.elapsed_s >= settle_s);
            settled.map(|step| step.error_m[axis] * 1e-3).collect()
        }
        (true, None) => Vec::new(),
        (false, _) => shown
            .frames
            .iter()
            .filter_map(|frame| frame.position.as_ref())
            .map(|position| position.error_m[axis] * 1e-3)
            .collect(),
    }
}

/// Fig. 15: densities (Gaussian kernels, Silverman's width) and cumulative distributions of the position's errors
/// along the camera's axes; of the filter's estimates, or of single frames.
pub fn figure_15(sequences: &[Shown<'_>], filtered: bool) -> String {
    let mut figure = Figure::new("", 2, 3, [340.0, 260.0]);
    for axis in 0..3 {
        let all: Vec<(usize, Vec<f64>)> = sequences
            .iter()
            .enumerate()
            .map(|(at, shown)| (at, errors(shown, axis, filtered)))
            .filter(|(_, values)| values.len() > 1)
            .collect();
        let mut sizes: Vec<f64> = all.iter().flat_map(|(_, v)| v.iter().map(|e| e.abs())).collect();
        sizes.sort_by(f64::total_cmp);
        let reach = rounded_up(1.1 * sizes.get(sizes.len() * 99 / 100).copied().unwrap_or(1.0).max(1e-6));
        let x = || Axis::linear(format!("error along {} (km)", AXES[axis])).range(-reach, reach);
        let mut density = Panel::new(x(), Axis::linear("density (1/km)")).title(AXES[axis]);
        let mut cumulative = Panel::new(x(), Axis::linear("fraction").range(0.0, 1.0));
        for (at, mut values) in all {
            let label = if axis == 0 { sequences[at].label } else { "" };
            density.line(label, &kernel_density(&values, reach), Style::line(colour(at)));
            values.sort_by(f64::total_cmp);
            let count = values.len() as f64;
            let mut steps = vec![[-reach, 0.0]];
            for (k, value) in values.iter().enumerate() {
                let x = value.clamp(-reach, reach);
                steps.extend([[x, k as f64 / count], [x, (k + 1) as f64 / count]]);
            }
            steps.push([reach, 1.0]);
            cumulative.line("", &steps, Style::line(colour(at)));
        }
        figure.put(0, axis, density);
        figure.put(1, axis, cumulative);
    }
    figure.to_svg()
}

/// The next of 1, 2, 3, 5, 10 times a power of ten: a range with ticks at its ends.
fn rounded_up(value: f64) -> f64 {
    let decade = 10f64.powf(value.log10().floor());
    [1.0, 2.0, 3.0, 5.0].into_iter().map(|m| m * decade).find(|v| *v >= value).unwrap_or(10.0 * decade)
}

fn kernel_density(values: &[f64], reach: f64) -> Vec<[f64; 2]> {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let sigma = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / count).sqrt();
    // Silverman (1986), eq. 3.28.
    let width = (1.06 * sigma * count.powf(-0.2)).max(reach / CURVE as f64);
    let bell = |x: f64| (-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt();
    (0..=CURVE)
        .map(|k| {
            let x = reach * (2.0 * k as f64 / CURVE as f64 - 1.0);
            [x, values.iter().map(|v| bell((x - v) / width)).sum::<f64>() / (count * width)]
        })
        .collect()
}

/// Errors of single frames against phase angle and distance: across the line of sight and along it, and their
/// normalised squares.
pub fn figure_errors(sequences: &[Shown<'_>]) -> String {
    let mut figure = Figure::new("", 2, 3, [340.0, 260.0]);
    type Abscissa = fn(&FrameResult) -> f64;
    let abscissas: [(&str, Abscissa); 2] =
        [("phase angle (deg)", |f| f.phase_deg), ("distance (1000 km)", |f| f.distance_m * 1e-6)];
    type Ordinate = fn(&FrameResult) -> Option<f64>;
    let ordinates: [(&str, Ordinate); 3] = [
        ("error across the line of sight (km)", |f| {
            let p = f.position.as_ref()?;
            let (error, found) = (DVec3::from_array(p.error_m), DVec3::from_array(p.position_camera_m));
            Some(1e-3 * error.reject_from(found).length())
        }),
        ("error of the range (km)", |f| {
            let p = f.position.as_ref()?;
            let (error, found) = (DVec3::from_array(p.error_m), DVec3::from_array(p.position_camera_m));
            Some(1e-3 * error.dot(found.normalize()).abs())
        }),
        ("normalised error squared", |f| Some(f.position.as_ref()?.nees)),
    ];
    for (row, (x_label, x)) in abscissas.into_iter().enumerate() {
        for (column, (y_label, y)) in ordinates.into_iter().enumerate() {
            let mut panel = Panel::new(Axis::linear(x_label), Axis::log(y_label));
            for (at, shown) in sequences.iter().enumerate() {
                let dots: Vec<[f64; 2]> =
                    shown.frames.iter().filter_map(|frame| Some([x(frame), y(frame)?.max(1e-3)])).collect();
                let label = if row == 0 && column == 0 { shown.label } else { "" };
                panel.dots(label, &dots, Style::line(colour(at)));
            }
            if column == 2 {
                let ends = x_range(sequences, x);
                let bound = ends.map(|x| [x, CHI2_3_99]);
                panel.line(
                    if row == 0 { "99 % of chi-square" } else { "" },
                    &bound,
                    Style::line(Colour::INK).dashed(),
                );
            }
            figure.put(row, column, panel);
        }
    }
    figure.to_svg()
}

fn x_range(sequences: &[Shown<'_>], x: fn(&FrameResult) -> f64) -> [f64; 2] {
    let values = sequences.iter().flat_map(|shown| shown.frames.iter().map(x));
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    [low, high]
}

/// The filter's errors with their three sigma over time, and its consistency.
pub fn figure_filter(filter: &FilterResult) -> String {
    let mut figure = Figure::new("", 2, 3, [340.0, 240.0]);
    let day = |step: &FilterStep| step.elapsed_s / 86_400.0;
    let curve = |y: &dyn Fn(&FilterStep) -> Option<f64>| -> Vec<[f64; 2]> {
        filter.steps.iter().filter_map(|step| Some([day(step), y(step)?])).collect()
    };
    let settle_s = 3600.0 * filter.options.settle_h;
    let settled = || filter.steps.iter().filter(move |step| step.elapsed_s >= settle_s);
    for axis in 0..3 {
        // The first hours would hide the rest.
        let most =
            settled().map(|s| 1e-3 * s.three_sigma_m[axis].max(s.error_m[axis].abs())).fold(1e-3, f64::max);
        let reach = 1.5 * most;
        let mut panel = Panel::new(
            Axis::linear("day"),
            Axis::linear(format!("error along {} (km)", AXES[axis])).range(-reach, reach),
        )
        .title(AXES[axis]);
        let held = |v: f64| v.clamp(-reach, reach);
        let bound = |sign: f64| curve(&|s| Some(held(sign * 1e-3 * s.three_sigma_m[axis])));
        panel.band("3 sigma", &bound(-1.0), &bound(1.0), Style::thin(PALETTE[1]).filled(0.2));
        panel.line("error", &curve(&|s| Some(held(1e-3 * s.error_m[axis]))), Style::line(PALETTE[0]));
        figure.put(0, axis, panel);
    }
    let mut velocity = Panel::new(Axis::linear("day"), Axis::log("velocity (m/s)")).title("Velocity");
    velocity.line("3 sigma", &curve(&|s| Some(s.velocity_three_sigma_m_s)), Style::line(PALETTE[1]));
    velocity.line("error", &curve(&|s| s.velocity_error_m_s.map(|v| v.max(1e-3))), Style::line(PALETTE[0]));
    figure.put(1, 0, velocity);
    let length = filter.steps.last().map_or(1.0, day);
    let freedom = filter.nees_freedom;
    let bounds = if freedom == 6 { super::filter::CHI2_6 } else { super::filter::CHI2_3 };
    let mut nees =
        Panel::new(Axis::linear("day"), Axis::log("NEES")).title(format!("NEES, {freedom} degrees"));
    nees.line("", &curve(&|s| Some(s.nees.max(1e-2))), Style::line(PALETTE[0]));
    let mut nis = Panel::new(Axis::linear("day"), Axis::log("NIS")).title("NIS, 3 degrees");
    nis.dots("", &curve(&|s| s.nis.map(|v| v.max(1e-2))), Style::line(PALETTE[0]));
    for (panel, bounds) in [(&mut nees, bounds), (&mut nis, super::filter::CHI2_3)] {
        for (at, bound) in bounds.into_iter().enumerate() {
            let label = if at == 0 { "central 99 %" } else { "" };
            panel.line(label, &[[0.0, bound], [length, bound]], Style::line(PALETTE[2]).dashed());
        }
    }
    figure.put(1, 1, nees);
    figure.put(1, 2, nis);
    figure.to_svg()
}
