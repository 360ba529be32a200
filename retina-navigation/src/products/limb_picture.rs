//! A photograph with the limb that was measured in it.

use glam::DVec2;
use retina_image::CameraImage;
use retina_plot::{Axis, Colour, ColourMap, Figure, HeatMap, PALETTE, Panel, Style};

use crate::limb::{LimbAnswer, LimbSight};

/// Side of the drawing of the body, and size of that of the residuals, px.
const SIDE_PX: f64 = 720.0;
/// Cells along a side, and shades.
const MOST_CELLS: usize = 360;
const SHADES: f64 = 24.0;
/// What is shown about the body, radii.
const ABOUT_RADII: f64 = 1.35;

/// The photograph about the body with the fitted outline, the points of the limb and the Sun's direction, and beside it the
/// points' residuals along the limb. Of a refused photograph the whole, with the circle that a first look saw.
pub fn limb_picture(answer: &LimbAnswer, image: &CameraImage, title: &str) -> Figure {
    let size = DVec2::new(f64::from(image.width_px), f64::from(image.height_px));
    let (low, high) = match &answer.sight {
        Err(_) => (DVec2::ZERO, size),
        Ok(sight) => {
            let extent = |place: &DVec2| place.distance(sight.center_px);
            let radius_px = sight.solution.outline_px.iter().map(extent).fold(0.0, f64::max);
            let reach = DVec2::splat(ABOUT_RADII * radius_px + 6.0);
            ((sight.center_px - reach).max(DVec2::ZERO), (sight.center_px + reach).min(size))
        }
    };
    let (low, high) = (low.floor(), high.ceil());
    let mut seen = Panel::new(
        Axis::linear("x (px)").range(low.x, high.x),
        Axis::linear("y (px)").range(low.y, high.y).reversed(),
    )
    .equal_aspect();
    seen.cells(shades(image, low, high), ColourMap::Grey);
    match &answer.sight {
        Err(_) => {
            if let Some(look) = &answer.look {
                seen.circle(
                    "circle of a first look",
                    look.center_px.to_array(),
                    look.radius_px,
                    Style::line(PALETTE[1]),
                );
            }
        }
        Ok(sight) => outline(&mut seen, sight),
    }
    let columns = if answer.sight.is_ok() { 2 } else { 1 };
    let mut figure = Figure::new(title, 1, columns, [SIDE_PX, SIDE_PX]);
    figure.put(0, 0, seen);
    if let Ok(sight) = &answer.sight {
        figure.put(0, 1, residuals(sight));
    }
    figure
}

/// The light between two corners, dark to bright; by its root, so that a crescent's horns are seen.
fn shades(image: &CameraImage, low: DVec2, high: DVec2) -> HeatMap {
    let [left, top, right, bottom] = [low.x, low.y, high.x, high.y].map(|edge| edge as usize);
    let cell = (right - left).max(bottom - top).div_ceil(MOST_CELLS).max(1);
    let (columns, rows) = ((right - left).div_ceil(cell), (bottom - top).div_ceil(cell));
    let means: Vec<f32> = (0..columns * rows)
        .map(|at| {
            let (x, y) = (left + at % columns * cell, top + at / columns * cell);
            let pixels =
                (y..(y + cell).min(bottom)).flat_map(|row| &image.row(row)[x..(x + cell).min(right)]);
            let (sum, count) = pixels.fold((0.0f32, 0usize), |(sum, count), value| (sum + value, count + 1));
            sum / count.max(1) as f32
        })
        .collect();
    let mut sorted = means.clone();
    sorted.sort_by(f32::total_cmp);
    let at = |share: f64| sorted[((sorted.len() - 1) as f64 * share) as usize];
    let (dark, bright) = (at(0.02), at(0.998).max(at(0.02) + 1e-6));
    let shade = |mean: f32| {
        let share = f64::from((mean - dark) / (bright - dark)).clamp(0.0, 1.0).sqrt();
        (SHADES * share).round() / SHADES
    };
    HeatMap {
        origin: [left as f64 + 0.5 * cell as f64, top as f64 + 0.5 * cell as f64],
        pitch: [cell as f64; 2],
        columns,
        values: means.into_iter().map(shade).collect(),
        range: [0.0, 1.0],
        label: String::new(),
    }
}

fn outline(panel: &mut Panel, sight: &LimbSight) {
    let solution = &sight.solution;
    // Once around.
    let line: Vec<[f64; 2]> =
        solution.outline_px.iter().chain(solution.outline_px.first()).map(|place| place.to_array()).collect();
    panel.line("fitted outline", &line, Style::line(PALETTE[4]));
    let places = |used: bool| -> Vec<[f64; 2]> {
        solution
            .points
            .iter()
            .filter(|point| point.used == used)
            .map(|point| point.pixel.to_array())
            .collect()
    };
    panel.dots("points of the limb", &places(true), Style::line(PALETTE[3]).width(1.8));
    if !places(false).is_empty() {
        panel.dots("rejected", &places(false), Style::line(PALETTE[1]).width(1.8));
    }
    let cross = 0.06 * solution.radius_px[0];
    for step in [DVec2::X, DVec2::Y] {
        let ends = [sight.center_px - step * cross, sight.center_px + step * cross];
        panel.line("", &ends.map(|end| end.to_array()), Style::line(PALETTE[4]));
    }
    if let Some(sun) = solution.sun_direction_px {
        let [from, to] =
            [1.08, 1.26].map(|share| (sight.center_px + sun * share * solution.radius_px[0]).to_array());
        panel.line("towards the Sun", &[from, to], Style::line(PALETTE[3]).width(3.0));
    }
}

/// Residuals with their standard deviations over the place on the limb.
fn residuals(sight: &LimbSight) -> Panel {
    let (zero, label) = match sight.solution.sun_direction_px {
        Some(sun) => {
            (sun.to_angle().to_degrees(), "place on the limb (deg from the Sun's direction, clockwise)")
        }
        None => (0.0, "place on the limb (deg from the right, clockwise)"),
    };
    let [value, sigma] = sight.solution.radius_px;
    let mut panel = Panel::new(Axis::linear(label), Axis::linear("measured less fitted outline (px)"))
        .title(format!("radius {value:.2} +- {sigma:.2} px, residuals {:.3} px rms", sight.solution.rms_px));
    // From -180 to 180 deg.
    let angle = |pixel: DVec2| {
        ((pixel - sight.center_px).to_angle().to_degrees() - zero + 180.0).rem_euclid(360.0) - 180.0
    };
    for (used, label, colour) in [(true, "used", PALETTE[0]), (false, "rejected", PALETTE[1])] {
        let rows: Vec<[f64; 2]> = sight
            .solution
            .points
            .iter()
            .filter(|point| point.used == used)
            .map(|point| [angle(point.pixel), point.residual_px])
            .collect();
        if !rows.is_empty() {
            panel.dots(label, &rows, Style::line(colour).width(2.2));
        }
        if used {
            for point in sight.solution.points.iter().filter(|point| point.used) {
                let x = angle(point.pixel);
                let ends = [-1.0, 1.0].map(|sign| [x, point.residual_px + sign * point.sigma_px]);
                panel.line("", &ends, Style::thin(colour));
            }
        }
    }
    panel.line("", &[[-180.0, 0.0], [180.0, 0.0]], Style::thin(Colour::GREY));
    panel
}
