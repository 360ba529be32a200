//! The spots of the pattern: where each is and how wide, measured in photographs of the laboratory and of the model alike.

use glam::DVec2;
use retina_bench::{Bench, BenchOptions, Exposure, OpticsDetail, ScreenImage};
use retina_calibration::geometry::{Pattern, match_points};
use retina_campaign::camera_image;
use retina_geometry::Setup;
use retina_image::{CameraImage, DetectOptions, LightPoint, detect_points};

use crate::{LabError, Turns};

/// The kernels reach far enough for spots with a standard deviation of 8 px.
const DETAIL: OpticsDetail = OpticsDetail { nodes: [9, 7], lines: 1, half_px: 32 };

/// A spot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Spot {
    /// Its centroid, camera px.
    pub(super) at_px: DVec2,
    /// Its variance, camera px^2.
    pub(super) variance_px2: f64,
}

/// The spots of the pattern's first screen in an image, by the pattern's points; `None` where the pattern is not
/// recognised.
pub(super) fn spots_in(image: &CameraImage, pattern: &Pattern, setup: &Setup) -> Option<Vec<Option<Spot>>> {
    let points = detect_points(image, &DetectOptions::default()).points;
    let (rows, recognition) = match_points(0, 0, pattern, setup, &points);
    recognition?;
    let shown = &pattern.screens[0].points;
    let mut spots = vec![None; shown.len()];
    for row in rows.iter().filter(|row| !row.saturated) {
        let place = shown.iter().position(|point| point.screen_px() == row.screen_px)?;
        let same = |point: &&LightPoint| (point.x_px, point.y_px) == (row.camera_px.x, row.camera_px.y);
        let width_px = points.iter().find(same).and_then(|point| point.width_px);
        spots[place] = width_px.map(|width| Spot { at_px: row.camera_px, variance_px2: width * width });
    }
    Some(spots)
}

/// The spots that the design would show with its screws turned: the virtual bench's photograph, measured as the
/// laboratory's are. So the field's curvature, the cut of the windows and the pixels are in both.
pub(super) fn model_spots(
    setup: &Setup,
    pattern: &Pattern,
    image: &ScreenImage,
    turns: &Turns,
) -> Result<Option<Vec<Option<Spot>>>, LabError> {
    let mut options = BenchOptions { detail: DETAIL, ..BenchOptions::default() };
    turns.apply(&mut options.wrong);
    let bench = Bench::new(setup, &options)?;
    let mut light = bench.light_e(image, &Exposure::new(1.0, 0))?;
    let brightest = light.iter().copied().fold(f32::MIN_POSITIVE, f32::max);
    let exposure_s = 0.6 * bench.sensor().full_well_e() / f64::from(brightest);
    light.iter_mut().for_each(|value| *value *= exposure_s as f32);
    // The noise of the dark is the same in every state, and the light has none: differences of states are the screws'.
    let dark = vec![0.0; light.len()];
    let mut frame = camera_image(&bench, bench.read(&dark, &Exposure::new(exposure_s, 0)));
    let per_e = 1.0 / bench.sensor().gain_e_per_dn as f32;
    frame.values.iter_mut().zip(&light).for_each(|(value, light)| *value += light * per_e);
    Ok(spots_in(&frame, pattern, setup))
}
