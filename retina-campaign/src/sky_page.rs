//! The comparison of bench and sky as a page.

use retina_image::CameraImage;
use retina_plot::{Axis, Figure, HeatMap, Panel};
use retina_report::{Page, Section};

use crate::sky::CUT_PX;
use crate::{Comparison, Facility, SkyOptions, SkyResult};

const PANEL_PX: [f64; 2] = [330.0, 290.0];

/// A page with the cut-outs of both images and what makes them differ (the paper's Fig. 8).
pub fn sky_page(result: &SkyResult, options: &SkyOptions, facility: &Facility) -> Page {
    let mut figure = Figure::new("", result.comparisons.len(), 2, PANEL_PX);
    for (row, comparison) in result.comparisons.iter().enumerate() {
        let cuts = [&result.bench, &result.sky].map(|image| cut_out(image, comparison));
        // One scale for both, so that brightness compares.
        let range = [0.0, cuts.iter().flat_map(|cut| cut.values.iter().copied()).fold(1.0, f64::max)];
        for (column, (cut, where_)) in cuts.iter().zip(["bench", "sky"]).enumerate() {
            // y runs down in an image and up in a plot.
            let axis = |at: f64, name: &str| {
                Axis::linear(format!("{name} (camera px)")).range(at - CUT_PX as f64, at + CUT_PX as f64)
            };
            let title = format!("{}, {where_}", comparison.object.name);
            let at = comparison.at_px;
            let mut panel = Panel::new(axis(at.x, "x"), axis(-at.y, "\u{2212}y")).title(title).equal_aspect();
            panel.heat(HeatMap { range, ..cut.clone() });
            figure.put(row, column, panel);
        }
    }
    let number = |value: f64, digits: usize| format!("{value:.digits$}");
    let mut rows = Vec::new();
    for c in &result.comparisons {
        for (name, spot) in [
            ("above the atmosphere", &c.space),
            ("in the sky", &c.sky),
            ("screen through lenses without aberration", &c.ideal_facility),
            ("bench", &c.bench),
        ] {
            rows.push(vec![
                format!("{}, {name}", c.object.name),
                number(-2.5 * (spot.electrons / c.space.electrons).log10(), 3),
                number(spot.peak_e, 0),
                number(spot.half_light_px, 2),
            ]);
        }
    }
    let seen: Vec<Vec<String>> = result
        .comparisons
        .iter()
        .map(|c| {
            vec![
                c.object.name.clone(),
                number(c.object.magnitude, 2),
                number(c.displayed_magnitude, 2),
                c.lit_pixels.to_string(),
                c.seen_px[0].to_string(),
                c.seen_px[1].to_string(),
            ]
        })
        .collect();
    Page::new("simulate sky", &format!("Bench and sky, {}", facility.setup.name))
        .section(
            Section::new("")
                .text(&format!(
                    "The same camera and {:.3e} s for both. Sky: {:.2} mag an air mass, {:.2} air masses, background \
                     {:.2} mag per square arcsec. The objects stand in a row through \
                     the middle of the field, where a facility whose field is curved need not be sharpest.",
                    result.exposure_s, options.extinction_mag, options.airmass, options.background_mag_arcsec2
                ))
                .figure(&figure.to_svg(), "Square roots, so that faint wings are seen; each object has one scale (the paper's Fig. 8)."),
        )
        .section(
            Section::new("As it is seen")
                .text("Pixels above the background by five times its noise.")
                .table(&["object", "mag", "mag shown", "lit screen pixels", "seen on the bench", "in the sky"], &seen),
        )
        .section(
            Section::new("Why they differ")
                .text(
                    "Without noise: light against that above the atmosphere (mag), the brightest pixel, the radius that \
                     holds half of the light. What the atmosphere takes is the first difference; a screen pixel is wider \
                     than a star; the lenses' aberrations and diffraction widen it further.",
                )
                .table(&["", "light (mag)", "peak (electrons)", "half-light radius (px)"], &rows),
        )
}

fn cut_out(image: &CameraImage, comparison: &Comparison) -> HeatMap {
    let first = [comparison.at_px.x, comparison.at_px.y].map(|v| (v as usize).saturating_sub(CUT_PX));
    let columns = (2 * CUT_PX + 1).min(image.width_px as usize - first[0]);
    let rows = (2 * CUT_PX + 1).min(image.height_px as usize - first[1]);
    let at = |i: usize| image.at(first[0] + i % columns, first[1] + i / columns);
    // Upwards.
    let flipped = |i: usize| (rows - 1 - i / columns) * columns + i % columns;
    let counts: Vec<f64> = (0..rows * columns).map(|i| f64::from(at(flipped(i)))).collect();
    let mut sorted = counts.clone();
    sorted.sort_by(f64::total_cmp);
    // Most of a cut-out is dark.
    let background = sorted[sorted.len() / 4];
    HeatMap {
        origin: [first[0] as f64 + 0.5, -((first[1] + rows) as f64 - 0.5)],
        pitch: [1.0, 1.0],
        columns,
        values: counts.iter().map(|count| (count - background).max(0.0).sqrt()).collect(),
        range: [0.0, 1.0],
        label: "sqrt(digital count above background)".into(),
    }
}
