//! Curves: fans, field curves, illumination, transfer, energy, temperature.

use retina_plot::{Anchor, Axis, Colour, Figure, PALETTE, Panel, Style, wavelength_colour};

use super::{field_axis, field_label};
use crate::analysis::{EncircledEnergy, FieldCurves, Ghost, Illumination, Mtf, RayFans, ThermalPoint};
use crate::system::OpticalSystem;

const SIZE: [f64; 2] = [380.0, 280.0];

/// Ray fans: a row a field, y fan left, x fan right, one scale.
pub fn fans_figure(system: &OpticalSystem, fans: &RayFans) -> Figure {
    let all = fans.fields.iter().flat_map(|field| &field.wavelengths);
    let largest = all
        .flat_map(|fan| fan.y_fan.iter().chain(&fan.x_fan))
        .map(|point| point.error_um.abs())
        .fold(1e-3, f64::max);
    let mut figure = Figure::new(format!("{}: ray fans", system.name), fans.fields.len(), 2, SIZE);
    for (row, field) in fans.fields.iter().enumerate() {
        for (column, (axis, error)) in
            [("pupil y", "error along y (um)"), ("pupil x", "error along x (um)")].into_iter().enumerate()
        {
            let mut panel = Panel::new(
                Axis::linear(axis).range(-1.0, 1.0),
                Axis::linear(error).range(-1.1 * largest, 1.1 * largest),
            )
            .title(field_label(system.object, field.field));
            for fan in &field.wavelengths {
                let points = if column == 0 { &fan.y_fan } else { &fan.x_fan };
                let line: Vec<[f64; 2]> = points.iter().map(|point| [point.pupil, point.error_um]).collect();
                let label = if row == 0 && column == 1 {
                    format!("{:.0} nm", fan.wavelength_nm)
                } else {
                    String::new()
                };
                panel.line(&label, &line, Style::line(wavelength_colour(fan.wavelength_nm)));
            }
            figure.put(row, column, panel);
        }
    }
    figure
}

/// Field curvature, distortion and lateral colour side by side, field upwards.
pub fn field_curves_figure(system: &OpticalSystem, curves: &FieldCurves) -> Figure {
    let (label, to_axis) = field_axis(system);
    let field = |i: usize| to_axis(curves.points[i].field);
    let count = curves.points.len();
    let mut foci =
        Panel::new(Axis::linear("focus from the image (mm)"), Axis::linear(label)).title("field curvature");
    let mut colour =
        Panel::new(Axis::linear("chief ray from primary (um)"), Axis::linear(label)).title("lateral colour");
    for (w, &nm) in curves.wavelengths_nm.iter().enumerate() {
        let style = Style::line(wavelength_colour(nm));
        let curve =
            |value: &dyn Fn(usize) -> f64| (0..count).map(|i| [value(i), field(i)]).collect::<Vec<_>>();
        foci.line(&format!("T {nm:.0} nm"), &curve(&|i| curves.points[i].tangential_mm[w]), style);
        foci.line(&format!("S {nm:.0} nm"), &curve(&|i| curves.points[i].sagittal_mm[w]), style.dashed());
        colour.line(&format!("{nm:.0} nm"), &curve(&|i| curves.points[i].lateral_colour_um[w]), style);
    }
    let mut distortion = Panel::new(Axis::linear("distortion (%)"), Axis::linear(label)).title("distortion");
    let line: Vec<[f64; 2]> = (0..count).map(|i| [100.0 * curves.points[i].distortion, field(i)]).collect();
    distortion.line("", &line, Style::line(PALETTE[0]));
    let mut figure = Figure::new(format!("{}: over the field", system.name), 1, 3, [330.0, 340.0]);
    figure.put(0, 0, foci);
    figure.put(0, 1, distortion);
    figure.put(0, 2, colour);
    figure
}

/// Relative illumination and transmitted share over the field.
pub fn illumination_figure(system: &OpticalSystem, illumination: &Illumination) -> Figure {
    let (label, to_axis) = field_axis(system);
    let mut panel = Panel::new(Axis::linear(label), Axis::linear("relative to the axis").range(0.0, 1.08));
    let curve = |value: fn(&crate::analysis::IlluminationPoint) -> f64| {
        illumination.points.iter().map(|point| [to_axis(point.field), value(point)]).collect::<Vec<_>>()
    };
    panel.line("irradiance", &curve(|point| point.relative), Style::line(PALETTE[0]));
    panel.line("unvignetted share", &curve(|point| point.transmitted), Style::line(PALETTE[1]).dashed());
    let clear = 100.0 * illumination.clear_fraction;
    let mut figure =
        Figure::new(format!("{}: illumination, {clear:.0} % clear", system.name), 1, 1, [460.0, 320.0]);
    figure.put(0, 0, panel);
    figure
}

/// MTF of several fields, with the diffraction limit.
pub fn mtf_figure(system: &OpticalSystem, curves: &[Mtf]) -> Figure {
    let mut panel =
        Panel::new(Axis::linear("spatial frequency (1/mm)"), Axis::linear("contrast").range(0.0, 1.0));
    let line = |mtf: &Mtf, values: &[f64]| {
        mtf.frequency_per_mm.iter().zip(values).map(|(&f, &value)| [f, value]).collect::<Vec<_>>()
    };
    for (i, mtf) in curves.iter().enumerate() {
        let style = Style::line(PALETTE[i % PALETTE.len()]);
        let label = field_label(system.object, mtf.field);
        panel.line(&format!("{label}, y"), &line(mtf, &mtf.y), style);
        panel.line(&format!("{label}, x"), &line(mtf, &mtf.x), style.dashed());
    }
    if let Some(first) = curves.first() {
        panel.line(
            "diffraction limit",
            &line(first, &first.diffraction_limit),
            Style::thin(Colour::GREY).width(1.0),
        );
    }
    let mut figure = Figure::new(format!("{}: polychromatic MTF", system.name), 1, 1, [560.0, 380.0]);
    figure.put(0, 0, panel);
    figure
}

/// Encircled energy of several fields.
pub fn encircled_energy_figure(system: &OpticalSystem, curves: &[EncircledEnergy]) -> Figure {
    let mut panel = Panel::new(
        Axis::linear("radius about the centroid (um)"),
        Axis::linear("share of the light in the pupil").range(0.0, 1.0),
    );
    for (i, curve) in curves.iter().enumerate() {
        let line: Vec<[f64; 2]> =
            curve.radius_um.iter().zip(&curve.fraction).map(|(&r, &e)| [r, e]).collect();
        panel.line(&field_label(system.object, curve.field), &line, Style::line(PALETTE[i % PALETTE.len()]));
    }
    let mut figure = Figure::new(format!("{}: encircled energy", system.name), 1, 1, [460.0, 320.0]);
    figure.put(0, 0, panel);
    figure
}

/// Ghosts: how large each is on the image, and how dense; the surfaces of the densest beside them.
pub fn ghosts_figure(system: &OpticalSystem, ghosts: &[Ghost]) -> Figure {
    const NAMED: usize = 12;
    let mut panel = Panel::new(
        Axis::log("RMS radius on the image (mm)"),
        Axis::log("irradiance for a beam of unit power (1/mm2)"),
    );
    // Ghosts of which no ray arrives, or that meet in a point, have no place on these axes.
    let shown: Vec<([f64; 2], &Ghost)> = ghosts
        .iter()
        .filter_map(|ghost| Some(([ghost.rms_radius_mm?, ghost.irradiance_per_mm2?], ghost)))
        .filter(|(at, _)| at.iter().all(|&value| value > 0.0))
        .collect();
    let points: Vec<[f64; 2]> = shown.iter().map(|(at, _)| *at).collect();
    panel.dots("", &points, Style::line(PALETTE[0]).width(2.4));
    for (at, ghost) in shown.iter().take(NAMED) {
        panel.text(*at, [5.0, -3.0], format!("{}-{}", ghost.first, ghost.second), 8.0, Anchor::Start);
    }
    let title = format!("{}: {} ghosts, {} shown", system.name, ghosts.len(), shown.len());
    let mut figure = Figure::new(title, 1, 1, [560.0, 380.0]);
    figure.put(0, 0, panel);
    figure
}

/// RMS spots and paraxial defocus over temperature.
pub fn thermal_figure(system: &OpticalSystem, points: &[ThermalPoint]) -> Figure {
    let mut spot = Panel::new(Axis::linear("temperature (degC)"), Axis::linear("RMS spot (um)"));
    for (i, field) in system.fields.iter().enumerate() {
        let line: Vec<[f64; 2]> = points.iter().map(|point| [point.temperature_c, point.rms_um[i]]).collect();
        spot.line(&field_label(system.object, field.at), &line, Style::line(PALETTE[i % PALETTE.len()]));
    }
    let mut focus = Panel::new(Axis::linear("temperature (degC)"), Axis::linear("paraxial defocus (mm)"));
    let line: Vec<[f64; 2]> =
        points.iter().filter_map(|point| Some([point.temperature_c, point.defocus_mm?])).collect();
    focus.line("", &line, Style::line(PALETTE[0]));
    let mut figure = Figure::new(format!("{}: temperature", system.name), 1, 2, SIZE);
    figure.put(0, 0, spot);
    figure.put(0, 1, focus);
    figure
}
