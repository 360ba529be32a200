//! Stars, planets and flashes drawn into a screen image.

use glam::DVec2;
use retina_radiometry::{irradiance_of_magnitude_w_m2_nm, magnitude_of_irradiance};
use retina_scene::{DisplayedPoint, SeenFlash, ShownFlash, ShownPoint, SkyPoint};
use retina_screen::PointPainter;

/// Draws a frame's point sources into its counts and says what is shown of each that is on the screen.
pub(crate) fn draw(
    painter: &PointPainter,
    counts: &mut [u8],
    points: Vec<SkyPoint>,
    radiance_scale: f64,
) -> Vec<ShownPoint> {
    let on_screen = |point: SkyPoint| {
        let wanted_w_m2_nm = irradiance_of_magnitude_w_m2_nm(point.magnitude) * radiance_scale;
        let screen_px = painter.screen_px(point.line_of_sight, wanted_w_m2_nm)?;
        if !painter.contains(screen_px) {
            return None;
        }
        Some(ShownPoint {
            wanted_magnitude: magnitude_of_irradiance(wanted_w_m2_nm),
            point,
            screen_px,
            displayed: show(painter, counts, screen_px, wanted_w_m2_nm),
        })
    };
    points.into_iter().filter_map(on_screen).collect()
}

/// Draws a frame's flashes into its counts, those that nothing hides.
pub(crate) fn draw_flashes(
    painter: &PointPainter,
    counts: &mut [u8],
    flashes: Vec<SeenFlash>,
    radiance_scale: f64,
) -> Vec<ShownFlash> {
    let drawn = |seen: SeenFlash| {
        let wanted_w_m2_nm = seen.mean_irradiance_w_m2_nm * radiance_scale;
        let screen_px = seen.line_of_sight.and_then(|sight| painter.screen_px(sight, wanted_w_m2_nm));
        let displayed = screen_px
            .filter(|&at_px| !seen.hidden && painter.contains(at_px))
            .and_then(|at_px| show(painter, counts, at_px, wanted_w_m2_nm));
        ShownFlash { seen, screen_px, displayed }
    };
    flashes.into_iter().map(drawn).collect()
}

/// Draws one source of an irradiance, W m^-2 nm^-1 at the pupil.
pub(crate) fn show(
    painter: &PointPainter,
    counts: &mut [u8],
    at_px: DVec2,
    irradiance_w_m2_nm: f64,
) -> Option<DisplayedPoint> {
    let shown = painter.draw(counts, at_px, irradiance_w_m2_nm)?;
    Some(DisplayedPoint {
        barycentre_px: shown.splat.displayed_px,
        magnitude: magnitude_of_irradiance(shown.splat.displayed_w_m2_nm),
        pixels: shown.splat.pixels.len(),
        blended: shown.blended,
    })
}
