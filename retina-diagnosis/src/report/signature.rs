//! What each effect of the catalogue looks like: its leading form on a campaign that was laid out for it.

use std::fmt::Write as _;
use std::path::Path;

use retina_files::{InputError, parse_toml};
use retina_formats::{Measurements, TableKind};
use retina_geometry::Setup;
use retina_plot::{Arrows, Axis, PALETTE, Panel, Style};
use retina_report::{Page, Section};

use crate::catalogue::Effect;
use crate::data::{Baseline, Dataset, Source};
use crate::figure::{axis_label, field_panel, svgs};

/// The facility that signatures are drawn for: the paper's wide configuration.
const SETUP: &str = retina_assets::WIDE_FOV_SETUP;
/// Of an effect with several amplitudes each has one of these, so that none hides another.
const AMPLITUDES: [f64; 4] = [1.0, 0.6, 0.4, 0.3];
const EXPOSURES: usize = 24;
/// Points across and down.
const GRID: [usize; 2] = [13, 10];

/// A campaign whose columns all vary: places on a grid, counts, colours and loads in turn, a chamber that is cycled.
fn points_text(setup: &Setup) -> String {
    let (facility, camera) = (setup.facility_pinhole(), setup.camera_pinhole());
    let mut text = String::from(
        "image,screen_x_px,screen_y_px,digital_count,camera_x_px,camera_y_px,channel,time_s,temperature_c,row_load\n",
    );
    for exposure in 0..EXPOSURES {
        let turn = exposure as f64 / EXPOSURES as f64;
        for point in 0..GRID[0] * GRID[1] {
            let (i, j) = (point % GRID[0], point / GRID[0]);
            let share = |k: usize, of: usize| (k as f64 + 0.5) / of as f64;
            // A quarter of a pixel from exposure to exposure shows what depends on the pixel's own phase.
            let at = glam::DVec2::new(
                share(i, GRID[0]) * f64::from(camera.width_px) + 0.04 * exposure as f64,
                share(j, GRID[1]) * f64::from(camera.height_px) + 0.04 * exposure as f64,
            );
            let screen = facility.pixel(camera.line_of_sight(at));
            let count = [18, 32, 60, 110, 180, 255][(exposure + point) % 6];
            let _ = writeln!(
                text,
                "e{exposure},{},{},{count},{},{},{},{},{:.3},{:.2}",
                screen.x,
                screen.y,
                at.x,
                at.y,
                ["r", "g", "b"][(exposure / 2 + point) % 3],
                3600.0 * turn,
                20.0 + 2.0 * (2.0 * std::f64::consts::TAU * turn).sin(),
                ((7 * point + 3 * exposure) % 20) as f64 / 19.0
            );
        }
    }
    text
}

fn power_text() -> String {
    let mut text =
        String::from("channel,digital_count,square_px,irradiance_w_m2,series,time_s,temperature_c\n");
    for series in 0..12 {
        for (c, channel) in ["r", "g", "b", "w"].into_iter().enumerate() {
            for (k, count) in [8.0f64, 16.0, 32.0, 64.0, 128.0, 255.0].into_iter().enumerate() {
                let side = [20.0, 60.0, 100.0, 200.0][(series + c + k) % 4];
                let share = if channel == "w" { 1.0 } else { 1.0 / 3.0 };
                let light = 2e-9 * side * side * share * (count / 255.0).powf(2.2);
                let time_s = 10.0 * (series * 24 + c * 6 + k) as f64;
                let temperature = 20.0 + 3.0 * (1.0 - (-time_s / 900.0).exp());
                let _ =
                    writeln!(text, "{channel},{count},{side},{light:e},s{series},{time_s},{temperature:.3}");
            }
        }
    }
    text
}

fn phase_text() -> String {
    let mut text = String::from("phase_deg,magnitude,night,airmass\n");
    for step in 0..121 {
        let phase = 2.0 * f64::from(step) - 120.0;
        let _ = writeln!(text, "{phase},{:.4},n{step},{:.3}", -12.7, 1.0 + f64::from((step * 7) % 20) / 15.0);
    }
    text
}

fn campaign(kind: TableKind) -> Result<Option<Dataset>, InputError> {
    let path = Path::new("signature");
    let setup: Setup = parse_toml(path, SETUP)?;
    let text = match kind {
        TableKind::Points => points_text(&setup),
        TableKind::Power => power_text(),
        TableKind::Phase => phase_text(),
        TableKind::Frames => return Ok(None),
    };
    let baseline = Baseline::Physical;
    let tables = Measurements::parse(path, &text)?;
    let source = Source { tables: &tables, setup: &setup, calibration: None, response: None, baseline };
    Dataset::new(&source).map(Some)
}

/// An effect's leading form, drawn: for points over the field where it is strongest, and against the columns it names;
/// its largest value is 1. `None` for effects on images, which look as the scene does: the pages of a comparison show them.
///
/// # Errors
/// The campaign that it is drawn on cannot show it.
pub fn signature_svgs(effect: &Effect) -> Result<Option<Vec<String>>, InputError> {
    let Some(data) = campaign(effect.kind())? else { return Ok(None) };
    let variants = effect.build(&data).map_err(|reason| {
        InputError::new("EFFECT", format!("`{}` cannot be drawn: {reason}", effect.name()))
    })?;
    // Of a list of shapes the middle one.
    let variant = &variants[variants.len() / 2];
    let mut values = vec![0.0; data.y.len()];
    for (term, amplitude) in variant.leading.iter().zip(AMPLITUDES) {
        let column = data.column(term);
        let most = column.iter().fold(f64::MIN_POSITIVE, |most, v| most.max(v.abs()));
        values.iter_mut().zip(&column).for_each(|(sum, v)| *sum += amplitude * v / most);
    }
    let most = values.iter().fold(f64::MIN_POSITIVE, |most, v| most.max(v.abs()));
    values.iter_mut().for_each(|v| *v /= most);

    let n = data.components();
    let mut panels = Vec::new();
    if n == 2 {
        panels.push(over_field(&data, &values));
    }
    for name in axes_of(effect) {
        let Some(column) = data.covariate(name) else { continue };
        let mut panel =
            Panel::new(Axis::linear(axis_label(name)), Axis::linear("effect / its largest").range(-1.1, 1.1));
        for axis in 0..n {
            let dots: Vec<[f64; 2]> =
                (0..data.len()).map(|row| [column.values[row], values[row * n + axis]]).collect();
            let label = if n == 2 { ["along x", "along y"][axis] } else { "" };
            panel.dots(label, &dots, Style::line(PALETTE[axis]).width(1.5));
        }
        panels.push(panel);
    }
    Ok(Some(svgs(&panels)))
}

/// Vectors of the exposure in which the effect is strongest.
fn over_field(data: &Dataset, values: &[f64]) -> Panel {
    let (x, y) = (data.values("x"), data.values("y"));
    let strength = |rows: &std::ops::Range<usize>| -> f64 {
        values[2 * rows.start..2 * rows.end].iter().map(|v| v * v).sum()
    };
    let strongest = data.groups.iter().max_by(|a, b| strength(&a.rows).total_cmp(&strength(&b.rows)));
    let rows = strongest.map_or(0..0, |group| group.rows.clone());
    let at = rows.clone().map(|row| [x[row], y[row]]).collect();
    let of = rows.map(|row| [values[2 * row], values[2 * row + 1]]).collect();
    let mut panel = field_panel("", [1.15, 0.9]);
    panel.arrows(Arrows::new(at, of, "(its largest)", Style::line(PALETTE[0]).width(1.2)).reference(1.0));
    panel
}

/// The columns that a signature is drawn against.
fn axes_of(effect: &Effect) -> Vec<&str> {
    let mut out: Vec<&str> = effect
        .covariates()
        .iter()
        .copied()
        .map(|name| match name {
            "channel" if effect.kind() == TableKind::Points => "channel_b",
            "channel" => "channel_w",
            "series" => "time_s",
            other => other,
        })
        .filter(|name| !["x", "y"].contains(name))
        .collect();
    if out.is_empty() {
        out.push("r");
    }
    out.truncate(2);
    out
}

/// The catalogue as a page: what each effect looks like, its form, source and size, what it is taken for and what tells.
///
/// # Errors
/// As [`signature_svgs`].
pub fn effects_page(effects: &[&'static Effect]) -> Result<Page, InputError> {
    let mut page = Page::new("effects", "Catalogue of effects");
    for &effect in effects {
        let mut section = Section::new(effect.name());
        if let Some(svgs) = signature_svgs(effect)? {
            section = section
                .figures(&svgs, "On a campaign laid out for it: the leading form, its largest value 1.");
        }
        page = page.section(section.lines(&crate::output::effects_text(&[effect])[1..]));
    }
    Ok(page)
}

#[cfg(test)]
mod tests {
    use crate::catalogue::effects;
    use retina_formats::TableKind;

    /// Every effect has a picture of its own: none is empty, and no two are the same but for the pairs that are identical
    /// by the table of effects.
    #[test]
    fn signatures_differ() {
        let all: Vec<_> = effects(None).into_iter().filter(|e| e.kind() != TableKind::Frames).collect();
        let drawn: Vec<Vec<String>> =
            all.iter().map(|e| super::signature_svgs(e).ok().flatten().unwrap_or_default()).collect();
        for (i, svg) in drawn.iter().enumerate() {
            let bytes: usize = svg.iter().map(String::len).sum();
            assert!(bytes > 2000, "{}: {bytes} bytes", all[i].name());
            for j in 0..i {
                let class = all[i].class.contains(&all[j].id);
                assert!(class || drawn[j] != *svg, "{} looks like {}", all[i].name(), all[j].name());
            }
        }
    }
}
