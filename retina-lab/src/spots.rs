//! The spots of the pattern: where each is and how wide, measured in photographs of the laboratory and of the model alike.

use glam::DVec2;
use retina_bench::{Bench, BenchOptions, Exposure, OpticsDetail, ScreenImage};
use retina_calibration::geometry::{Pattern, match_points};
use retina_campaign::camera_image;
use retina_geometry::Setup;
use retina_image::{CameraImage, DetectOptions, LightPoint, detect_points};

use crate::{LabError, Rig, Turns};

/// For derivatives. The kernels reach far enough for spots with a standard deviation of 8 px.
pub(crate) const COARSE: OpticsDetail = OpticsDetail { nodes: [9, 7], lines: 1, half_px: 32 };
/// For the places themselves: a single line, or fewer nodes, is off by some thousandths of a pixel, which a tilt and a
/// shift together would take up.
pub(crate) const FINE: OpticsDetail = OpticsDetail { nodes: [13, 9], lines: 3, half_px: 32 };

/// A spot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Spot {
    /// Its centroid, camera px.
    pub(crate) at_px: DVec2,
    /// Its variance, camera px^2.
    pub(crate) variance_px2: f64,
    /// Its light, DN.
    pub(crate) flux_dn: f64,
}

/// The spots of the pattern's first screen in an image, by the pattern's points; `None` where the pattern is not
/// recognised.
pub(crate) fn spots_in(image: &CameraImage, pattern: &Pattern, setup: &Setup) -> Option<Vec<Option<Spot>>> {
    let points = detect_points(image, &DetectOptions::default()).points;
    let (rows, recognition) = match_points(0, 0, pattern, setup, &points);
    recognition?;
    let shown = &pattern.screens[0].points;
    let mut spots = vec![None; shown.len()];
    for row in rows.iter().filter(|row| !row.saturated) {
        let place = shown.iter().position(|point| point.screen_px() == row.screen_px)?;
        let same = |point: &&LightPoint| (point.x_px, point.y_px) == (row.camera_px.x, row.camera_px.y);
        let Some(point) = points.iter().find(same) else { continue };
        spots[place] = point.width_px.map(|width| Spot {
            at_px: row.camera_px,
            variance_px2: width * width,
            flux_dn: point.flux_dn,
        });
    }
    Some(spots)
}

/// The pattern's spots as the camera sees them now, each the mean of `exposures` images of `exposure_s`; `None` where no
/// image shows the pattern. `image` is the pattern's first screen.
pub(crate) fn photographed_spots(
    rig: &mut Rig<'_>,
    (pattern, image): (&Pattern, &ScreenImage),
    setup: &Setup,
    (exposures, exposure_s): (usize, f64),
    mut progress: impl FnMut(usize, usize),
) -> Result<Option<Vec<Option<Spot>>>, LabError> {
    rig.show(image)?;
    let mut sums: Vec<(DVec2, f64, f64, usize)> =
        vec![(DVec2::ZERO, 0.0, 0.0, 0); pattern.screens[0].points.len()];
    let mut recognised = 0;
    for exposure in 0..exposures {
        progress(exposure, exposures);
        let image = rig.take(exposure_s)?.image;
        let Some(spots) = spots_in(&image, pattern, setup) else { continue };
        recognised += 1;
        for (sum, spot) in sums.iter_mut().zip(spots) {
            if let Some(spot) = spot {
                let (at, variance, flux, seen) = *sum;
                *sum = (at + spot.at_px, variance + spot.variance_px2, flux + spot.flux_dn, seen + 1);
            }
        }
    }
    // A spot that is seen now and then is one that noise or a neighbour disturbs.
    let mean = |(at, variance, flux, seen): (DVec2, f64, f64, usize)| {
        let all = seen as f64;
        let mean = Spot { at_px: at / all, variance_px2: variance / all, flux_dn: flux / all };
        (2 * seen > recognised).then_some(mean)
    };
    Ok((recognised > 0).then(|| sums.into_iter().map(mean).collect()))
}

/// The spots that the design would show with its screws turned: the virtual bench's photograph, measured as the
/// laboratory's are. So the field's curvature, the cut of the windows and the pixels are in both.
pub(crate) fn model_spots(
    setup: &Setup,
    pattern: &Pattern,
    image: &ScreenImage,
    turns: &Turns,
    detail: OpticsDetail,
) -> Result<Option<Vec<Option<Spot>>>, LabError> {
    let mut options = BenchOptions { detail, ..BenchOptions::default() };
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
