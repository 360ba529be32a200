//! The exposure time at which a frame fills a part of the camera's range.

use retina_bench::ScreenImage;
use retina_image::CameraImage;

use crate::{LabError, Rig};

/// Part of the range that the brightest pixel is to fill, and how near is near enough.
const TARGET: f64 = 0.6;
const NEAR: std::ops::RangeInclusive<f64> = 0.45..=0.75;
/// Pixels at the range's end that are no hot pixels.
const SATURATED: f64 = 0.98;
/// A peak below this part of the range is told from noise by more light alone.
const FAINT: f64 = 0.02;
const MOST_TRIALS: usize = 12;
/// The pixel of this rank is the brightest: fewer are hot.
const RANK: usize = 5;

/// Largest differences of two images, as parts of the range: the brightest pixels' light above the dark's.
pub(crate) fn peak(lit: &CameraImage, dark: &CameraImage) -> f64 {
    let mut highest = [0f32; RANK];
    for (lit, dark) in lit.values.iter().zip(&dark.values) {
        let mut value = lit - dark;
        for kept in &mut highest {
            if value > *kept {
                std::mem::swap(kept, &mut value);
            }
        }
    }
    f64::from(highest[RANK - 1] / lit.full_scale_dn)
}

/// Whether a frame saturates pixels that the dark screen does not: stuck ones of the display are no light of the frame.
pub(crate) fn saturates(lit: &CameraImage, dark: &CameraImage) -> bool {
    let limit = SATURATED as f32 * lit.full_scale_dn;
    let new = |(lit, dark): &(&f32, &f32)| **lit >= limit && **dark < limit;
    lit.values.iter().zip(&dark.values).filter(new).count() > RANK
}

/// Looks for the exposure time, s, at which `frame` fills 60 % of the camera's range above its dark image. The first
/// trial is `first_s`.
///
/// # Errors
/// The frame stays dark or saturated whatever the exposure; a device fails.
pub fn find_exposure(rig: &mut Rig<'_>, frame: &ScreenImage, first_s: f64) -> Result<f64, LabError> {
    let dark = ScreenImage::dark(frame.width_px, frame.height_px);
    let mut exposure_s = first_s;
    let mut seen = 0.0;
    for _ in 0..MOST_TRIALS {
        rig.show(frame)?;
        let lit = rig.take(exposure_s)?;
        rig.show(&dark)?;
        let unlit = rig.take(exposure_s)?;
        // Hot pixels of a long exposure are no light of the frame.
        if saturates(&lit.image, &unlit.image) {
            exposure_s /= 4.0;
            seen = 1.0;
            continue;
        }
        seen = peak(&lit.image, &unlit.image);
        if NEAR.contains(&seen) {
            return Ok(exposure_s);
        }
        exposure_s *= if seen < FAINT { 8.0 } else { (TARGET / seen).clamp(0.1, 8.0) };
    }
    Err(LabError::Camera {
        camera: rig.camera.name(),
        problem: format!(
            "finds no exposure for the frame: the last trial filled {:.1} % of its range. Does the camera see the \
             screen? Give --exposure-s to choose it yourself",
            100.0 * seen
        ),
    })
}
