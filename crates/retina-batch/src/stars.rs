//! Stars and planets drawn into a screen image.

use retina_radiometry::{irradiance_of_magnitude_w_m2_nm, magnitude_of_irradiance};
use retina_scene::{Display, DisplayedPoint, Scene, ShownPoint, SkyPoint};
use retina_screen::{PointPainter, ScreenEncoder};

/// The painter of a scene's point sources; `None` without stars. (A plain image shows none.)
pub(crate) fn painter(scene: &Scene, screen: &ScreenEncoder) -> Option<PointPainter> {
    let drawn = scene.stars.is_some() && matches!(scene.display, Display::Facility(_));
    drawn.then(|| PointPainter::new(scene.image, scene.distortion.clone(), screen.response().clone()))
}

/// Draws a frame's point sources into its counts and says what is shown of each that is on the screen.
pub(crate) fn draw(
    painter: &PointPainter,
    counts: &mut [u8],
    points: Vec<SkyPoint>,
    radiance_scale: f64,
) -> Vec<ShownPoint> {
    let on_screen = |point: SkyPoint| {
        let screen_px = painter.screen_px(point.line_of_sight)?;
        if !painter.contains(screen_px) {
            return None;
        }
        let wanted_w_m2_nm = irradiance_of_magnitude_w_m2_nm(point.magnitude) * radiance_scale;
        let shown = painter.draw(counts, screen_px, wanted_w_m2_nm);
        Some(ShownPoint {
            wanted_magnitude: magnitude_of_irradiance(wanted_w_m2_nm),
            point,
            screen_px,
            displayed: shown.map(|shown| DisplayedPoint {
                barycentre_px: shown.splat.displayed_px,
                magnitude: magnitude_of_irradiance(shown.splat.displayed_w_m2_nm),
                pixels: shown.splat.pixels.len(),
                blended: shown.blended,
            }),
        })
    };
    points.into_iter().filter_map(on_screen).collect()
}
