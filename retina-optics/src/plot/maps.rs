//! Spot diagrams, maps and histograms.

use retina_plot::{Anchor, Axis, Colour, Figure, HeatMap, PALETTE, Panel, Style, wavelength_colour};

use super::field_label;
use crate::analysis::{Psf, SpotDiagram, ToleranceReport, Wavefront};
use crate::system::OpticalSystem;

/// A configuration of a spot figure.
#[derive(Debug, Clone, Copy)]
pub struct SpotRow<'a> {
    /// The system.
    pub system: &'a OpticalSystem,
    /// What is drawn.
    pub points: &'a SpotDiagram,
    /// Where the figures come from (may be the same).
    pub figures: &'a SpotDiagram,
    /// Drawn size over image size: 1, or the demagnification from screen to sensor.
    pub scale: f64,
}

/// Spot diagrams: a row a configuration, a column a field, one scale; Airy circle, scale bar, RMS.
pub fn spots_figure(title: &str, rows: &[SpotRow<'_>]) -> Figure {
    let columns = rows.iter().map(|row| row.points.fields.len()).max().unwrap_or(1);
    let reach = |row: &SpotRow<'_>| {
        row.points.fields.iter().map(|field| field.largest_um * row.scale).fold(0.0, f64::max)
    };
    let airy = |row: &SpotRow<'_>| row.points.airy_radius_um.unwrap_or(0.0) * row.scale;
    let half = 1.15 * rows.iter().map(|row| reach(row).max(airy(row))).fold(1e-3, f64::max);
    let bar = nice_bar(half);
    let mut figure = Figure::new(title, rows.len(), columns, [250.0, 285.0]);
    for (line, row) in rows.iter().enumerate() {
        for (column, (spot, figures)) in row.points.fields.iter().zip(&row.figures.fields).enumerate() {
            let axis = || Axis::hidden().range(-half, half);
            let mut panel = Panel::new(axis(), Axis::hidden().range(-1.25 * half, 1.05 * half))
                .equal_aspect()
                .title(format!("{}, {}", row.system.name, field_label(row.system.object, spot.field)));
            panel.line("", &[[-half, 0.0], [half, 0.0]], Style::thin(Colour::PALE));
            panel.line("", &[[0.0, -half], [0.0, half]], Style::thin(Colour::PALE));
            for wave in &spot.wavelengths {
                let at = |p: &[f64; 2]| [0, 1].map(|k| 1e3 * row.scale * (p[k] - spot.centroid_mm[k]));
                let points: Vec<[f64; 2]> = wave.points_mm.iter().map(at).collect();
                let label = if column == 0 { format!("{:.0} nm", wave.wavelength_nm) } else { String::new() };
                panel.dots(&label, &points, Style::line(wavelength_colour(wave.wavelength_nm)).width(0.8));
            }
            panel.circle("", [0.0, 0.0], airy(row), Style::line(Colour::BLACK).width(1.0));
            let low = -1.12 * half;
            panel.line(
                "",
                &[[-0.95 * half, low], [-0.95 * half + bar, low]],
                Style::line(Colour::INK).width(2.0),
            );
            panel.text([-0.95 * half, low], [0.0, -5.0], format!("{bar} um"), 9.0, Anchor::Start);
            let mut rms = format!("RMS {:.1} um", figures.rms_um * row.scale);
            if figures.vignetted_fraction > 0.0005 {
                rms += &format!(", {:.1} % vignetted", 100.0 * figures.vignetted_fraction);
            }
            panel.text([0.95 * half, low], [0.0, 3.0], rms, 9.5, Anchor::End);
            figure.put(line, column, panel);
        }
    }
    figure
}

/// About half the drawn radius, as 1, 2 or 5 times a power of ten.
fn nice_bar(half: f64) -> f64 {
    let power = 10f64.powf((half * 0.6).log10().floor());
    [5.0, 2.0, 1.0].into_iter().map(|n| n * power).find(|&bar| bar <= half * 0.6).unwrap_or(power)
}

/// A PSF, logarithmic.
pub fn psf_figure(system: &OpticalSystem, psfs: &[Psf]) -> Figure {
    let mut figure = Figure::new(format!("{}: PSF", system.name), 1, psfs.len(), [370.0, 330.0]);
    for (column, psf) in psfs.iter().enumerate() {
        let peak = psf.peak();
        let waves = psf.wavelength_nm.map_or("polychromatic".to_owned(), |nm| format!("{nm:.0} nm"));
        let held = 100.0 * psf.energy_on_grid;
        let title = format!(
            "{}, {waves}, peak {peak:.3}, {held:.1} % of the light",
            field_label(system.object, psf.field)
        );
        let axis = |k: usize, label: &str| {
            let first = psf.at_um(0, 0)[k] - psf.pitch_um[k] / 2.0;
            Axis::linear(label).range(first, first + psf.side as f64 * psf.pitch_um[k])
        };
        let mut panel = Panel::new(axis(0, "x (um)"), axis(1, "y (um)")).equal_aspect().title(title);
        panel.heat(HeatMap {
            origin: psf.at_um(0, 0),
            pitch: psf.pitch_um,
            columns: psf.side,
            values: psf.values.iter().map(|value| (value / peak).max(1e-12).log10()).collect(),
            range: [-4.0, 0.0],
            label: "log10 of peak".into(),
        });
        figure.put(0, column, panel);
    }
    figure
}

/// Wavefront maps.
pub fn wavefront_figure(system: &OpticalSystem, wavefronts: &[Wavefront]) -> Figure {
    let mut figure = Figure::new(format!("{}: wavefront", system.name), 1, wavefronts.len(), [370.0, 330.0]);
    for (column, wavefront) in wavefronts.iter().enumerate() {
        let label = field_label(system.object, wavefront.field);
        let title =
            format!("{label}, {:.0} nm, {:.3} waves RMS", wavefront.wavelength_nm, wavefront.rms_waves);
        let mut panel =
            Panel::new(Axis::linear("pupil x").range(-1.0, 1.0), Axis::linear("pupil y").range(-1.0, 1.0))
                .equal_aspect()
                .title(title);
        let values: Vec<f64> = wavefront.points.iter().filter_map(|point| point.opd_waves).collect();
        let low = values.iter().copied().fold(f64::INFINITY, f64::min);
        let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        // The grid's rows have gaps outside the disc: its pitch is the smallest step along x.
        let pitch = wavefront
            .points
            .windows(2)
            .map(|pair| pair[1].pupil[0] - pair[0].pupil[0])
            .filter(|&step| step > 0.0)
            .fold(2.0, f64::min);
        let side = (2.0 / pitch).round() as usize;
        let mut grid = vec![f64::NAN; side * side];
        let cell = |at: f64| (((at + 1.0) / pitch) as usize).min(side - 1);
        for point in &wavefront.points {
            if let Some(value) = point.opd_waves {
                grid[cell(point.pupil[1]) * side + cell(point.pupil[0])] = value;
            }
        }
        panel.signed(HeatMap {
            origin: [pitch / 2.0 - 1.0; 2],
            pitch: [pitch; 2],
            columns: side,
            values: grid,
            range: [low, if high > low { high } else { low + 1e-9 }],
            label: "OPD (waves)".into(),
        });
        figure.put(0, column, panel);
    }
    figure
}

/// Cumulative distributions of the worst RMS and of the boresight shift.
pub fn tolerance_figure(system: &OpticalSystem, report: &ToleranceReport) -> Figure {
    let cumulative = |mut values: Vec<f64>| {
        values.sort_by(f64::total_cmp);
        let count = values.len() as f64;
        values.into_iter().enumerate().map(|(i, value)| [value, (i + 1) as f64 / count]).collect::<Vec<_>>()
    };
    let worst = |rms: &[f64]| rms.iter().copied().fold(0.0, f64::max);
    let mut figure = Figure::new(
        format!(
            "{}: tolerances, {} trials ({} failed), seed {}",
            system.name,
            report.trials.len() + report.failed,
            report.failed,
            report.seed
        ),
        1,
        2,
        [400.0, 300.0],
    );
    let share = || Axis::linear("share of trials").range(0.0, 1.0);
    let mut spot = Panel::new(Axis::linear("worst RMS spot (um)"), share());
    spot.line(
        "trials",
        &cumulative(report.trials.iter().map(|t| worst(&t.rms_um)).collect()),
        Style::line(PALETTE[0]),
    );
    let nominal = worst(&report.nominal.rms_um);
    spot.line("nominal", &[[nominal, 0.0], [nominal, 1.0]], Style::line(PALETTE[1]).dashed());
    let mut boresight = Panel::new(Axis::linear("boresight shift on the image (mm)"), share());
    let shifts = report.trials.iter().map(|t| t.boresight_mm[0].hypot(t.boresight_mm[1])).collect();
    boresight.line("", &cumulative(shifts), Style::line(PALETTE[0]));
    figure.put(0, 0, spot);
    figure.put(0, 1, boresight);
    figure
}
