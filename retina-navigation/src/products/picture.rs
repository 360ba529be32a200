//! A solved image with its stars, planets and coordinates.

use glam::{DVec2, DVec3};
use retina_image::{Background, CameraImage};
use retina_plot::{Anchor, Axis, ColourMap, Figure, HeatMap, PALETTE, Panel, Style};
use retina_sky::catalogue::StarId;

use crate::image::ImageResult;

/// Longer side of the drawing, px.
const SIDE_PX: f64 = 1400.0;
/// Cells along the longer side.
const MOST_CELLS: usize = 700;
/// Standard deviations of the noise from which a pixel is drawn, and over which it becomes black, in so many shades.
const FAINTEST_SIGMAS: f64 = 3.0;
const BLACK_SIGMAS: f64 = 60.0;
const SHADES: f64 = 8.0;
/// Stars that are named, brightest first.
const NAMED: usize = 25;
/// Steps of the grid, deg: the first that gives few enough lines.
const STEPS_DEG: [f64; 9] = [0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 15.0, 30.0];
const MOST_LINES: f64 = 7.0;
/// The grid ends this many times half of the diagonal field from the boresight.
const GRID_REACH: f64 = 1.05;

/// The image as a negative, with matched stars circled and named, planets, and a grid of right ascension and declination;
/// `title` stands above it.
pub fn annotated(result: &ImageResult, image: &CameraImage, title: &str) -> Figure {
    let size = DVec2::new(f64::from(image.width_px), f64::from(image.height_px));
    let mut panel = Panel::new(
        Axis::linear("x (px)").range(0.0, size.x),
        Axis::linear("y (px)").range(0.0, size.y).reversed(),
    )
    .equal_aspect();
    panel.cells(negative(image), ColourMap::Grey);
    let radius_px = 0.008 * size.length();
    if let Ok(solution) = &result.solution {
        grid(&mut panel, result, size);
        for (rank, matched) in solution.matches.iter().enumerate() {
            let at = result.points[matched.point].pixel;
            panel.circle("star", at.to_array(), radius_px, Style::line(PALETTE[0]));
            if rank < NAMED {
                name(&mut panel, at, proper_name(&matched.star.id).unwrap_or(&matched.star.id.to_string()));
            }
        }
    }
    for sight in &result.planets {
        let at = result.points[sight.point].pixel;
        panel.circle("planet", at.to_array(), 1.6 * radius_px, Style::line(PALETTE[1]).width(2.0));
        name(&mut panel, at, sight.planet.name());
    }
    let scale = SIDE_PX / size.max_element();
    let mut figure = Figure::new(title, 1, 1, [scale * size.x + 120.0, scale * size.y + 120.0]);
    figure.put(0, 0, panel);
    figure
}

fn name(panel: &mut Panel, at: DVec2, text: &str) {
    panel.text(at.to_array(), [14.0, -8.0], text, 12.0, Anchor::Start);
}

/// Light above its surroundings' level, dark on white: what is less than the noise stays free.
fn negative(image: &CameraImage) -> HeatMap {
    let [width, height] = [image.width_px as usize, image.height_px as usize];
    let background = Background::estimate(image, 64);
    let cell = width.max(height).div_ceil(MOST_CELLS).max(1);
    let (columns, rows) = (width.div_ceil(cell), height.div_ceil(cell));
    let shade = |at: usize| {
        let (left, top) = (at % columns * cell, at / columns * cell);
        let [x, y] = [left, top].map(|first| first as f64 + 0.5 * cell as f64);
        let brightest = (top..(top + cell).min(height))
            .flat_map(|row| &image.row(row)[left..(left + cell).min(width)])
            .copied()
            .fold(f32::NEG_INFINITY, f32::max);
        let sigmas = (f64::from(brightest) - background.level_dn(x, y)) / background.noise_dn(x, y);
        // The root shows faint stars beside bright ones.
        let share = ((sigmas - FAINTEST_SIGMAS) / BLACK_SIGMAS).clamp(0.0, 1.0).sqrt();
        if share > 0.0 { 1.0 - (SHADES * share).ceil() / SHADES } else { f64::NAN }
    };
    HeatMap {
        origin: [0.5 * cell as f64; 2],
        pitch: [cell as f64; 2],
        columns,
        values: (0..columns * rows).map(shade).collect(),
        range: [0.0, 1.0],
        label: String::new(),
    }
}

/// Meridians and parallels with their values, where they are inside the image.
fn grid(panel: &mut Panel, result: &ImageResult, size: DVec2) {
    let Some(focal_px) = result.focal_px() else { return };
    let field_deg = 2.0 * (0.5 * size.length() / focal_px).atan().to_degrees();
    let step = |cosine: f64| {
        let fits = |step: &&f64| field_deg / (**step * cosine) <= MOST_LINES;
        STEPS_DEG.iter().find(fits).copied().unwrap_or(30.0)
    };
    let Ok(solution) = &result.solution else { return };
    let [_, dec, _] = solution.ra_dec_roll_rad();
    // A fitted distortion is that of the field: far beyond, it folds back into the image.
    let least_cosine = (GRID_REACH * 0.5 * field_deg).to_radians().cos();
    let boresight = solution.camera_from_inertial().inverse() * DVec3::Z;
    let (dec_step, ra_step) = (step(1.0), step(dec.cos().max(0.05)));
    let direction = |ra_deg: f64, dec_deg: f64| {
        let (ra, dec) = (ra_deg.to_radians(), dec_deg.to_radians());
        DVec3::new(dec.cos() * ra.cos(), dec.cos() * ra.sin(), dec.sin())
    };
    let mut draw = |places: Vec<DVec3>, label: String| {
        let mut line: Vec<[f64; 2]> = Vec::new();
        let mut labelled = false;
        // A last place that is nowhere ends the last line.
        for place in places.into_iter().map(Some).chain([None]) {
            let at = place
                .filter(|place| place.dot(boresight) > least_cosine)
                .and_then(|place| result.pixel(place));
            match at.filter(|at| at.cmpge(DVec2::ZERO).all() && at.cmple(size).all()) {
                Some(at) => line.push(at.to_array()),
                None if line.len() > 1 => {
                    if !labelled {
                        panel.text(line[line.len() / 2], [3.0, -3.0], &label, 10.0, Anchor::Start);
                        labelled = true;
                    }
                    panel.line("", &std::mem::take(&mut line), Style::thin(PALETTE[2]));
                }
                None => line.clear(),
            }
        }
    };
    let fine = field_deg / 150.0;
    let count = |span: f64, step: f64| (span / step).round() as i32;
    for k in 0..count(360.0, ra_step) {
        let ra_deg = f64::from(k) * ra_step;
        let places = (0..=count(180.0, fine)).map(|i| direction(ra_deg, -90.0 + f64::from(i) * fine));
        draw(places.collect(), format!("{ra_deg} deg"));
    }
    for k in 1..count(180.0, dec_step) {
        let dec_deg = f64::from(k) * dec_step - 90.0;
        let places = (0..=count(360.0, fine)).map(|i| direction(f64::from(i) * fine, dec_deg));
        draw(places.collect(), format!("{dec_deg:+} deg"));
    }
}

/// Names of bright stars (IAU Catalog of Star Names), by Hipparcos number.
const NAMES: [(u32, &str); 40] = [
    (677, "Alpheratz"),
    (7588, "Achernar"),
    (9884, "Hamal"),
    (11767, "Polaris"),
    (14576, "Algol"),
    (15863, "Mirfak"),
    (21421, "Aldebaran"),
    (24436, "Rigel"),
    (24608, "Capella"),
    (25336, "Bellatrix"),
    (25428, "Elnath"),
    (26311, "Alnilam"),
    (26727, "Alnitak"),
    (27989, "Betelgeuse"),
    (30438, "Canopus"),
    (32349, "Sirius"),
    (33579, "Adhara"),
    (36850, "Castor"),
    (37279, "Procyon"),
    (37826, "Pollux"),
    (45238, "Miaplacidus"),
    (49669, "Regulus"),
    (54061, "Dubhe"),
    (57632, "Denebola"),
    (60718, "Acrux"),
    (61084, "Gacrux"),
    (62434, "Mimosa"),
    (62956, "Alioth"),
    (65474, "Spica"),
    (67301, "Alkaid"),
    (68702, "Hadar"),
    (69673, "Arcturus"),
    (71683, "Rigil Kentaurus"),
    (80763, "Antares"),
    (85927, "Shaula"),
    (91262, "Vega"),
    (95947, "Albireo"),
    (97649, "Altair"),
    (102098, "Deneb"),
    (113368, "Fomalhaut"),
];

fn proper_name(id: &StarId) -> Option<&'static str> {
    let StarId::Hipparcos(number) = id else { return None };
    let at = NAMES.binary_search_by_key(number, |(number, _)| *number).ok()?;
    Some(NAMES[at].1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_found_by_number() {
        assert!(NAMES.is_sorted());
        assert_eq!(proper_name(&StarId::Hipparcos(91262)), Some("Vega"));
        assert_eq!(proper_name(&StarId::Hipparcos(91263)), None);
    }
}
