//! Frames whose bodies are all a few pixels across or less: sample by sample such a body is easily
//! missed or blinks from frame to frame. It is rendered enlarged and averaged down.

use glam::{DVec2, DVec3};
use retina_geometry::Pinhole;

use crate::{FrameState, RadianceImage};

/// Fine pixels along a side of the window that holds the bodies.
const WINDOW: u32 = 128;
/// Bodies farther apart than this are no longer one window, px.
const LARGEST_SIDE_PX: f64 = 12.0;
/// Bodies whose bounding sphere has a larger radius are rendered as they are, px.
const LARGEST_RADIUS_PX: f64 = 4.0;
/// A body no larger than this is a point to the screen, px: what a pixel's mean loses of the place of a
/// larger one is less than what a point's counts do.
const UNRESOLVED_RADIUS_PX: f64 = 0.75;
/// Index of the coverage among the planes; the planes after it are means over what is covered.
const MASK: usize = 2;

/// Projection of a body's bounding sphere where that is small: centre and radius, px.
pub(crate) fn small_disc(state: &FrameState, body: usize, bounding_radius_m: f64) -> Option<(DVec2, f64)> {
    let center_m = state.bodies[body].position_camera_m;
    if center_m.z <= 2.0 * bounding_radius_m {
        return None;
    }
    let sight = DVec2::new(center_m.x, center_m.y) / center_m.z;
    let undistorted = match &state.distortion {
        None => sight,
        Some(distortion) => distortion.undistort(sight).ok()?,
    };
    let k = &state.image;
    // Off the boresight a sphere's image grows by 1 / cos^2 at most; distortion may add some per cent.
    let radius_px =
        1.1 * k.fx_px.max(k.fy_px) * bounding_radius_m / center_m.z * (1.0 + sight.length_squared());
    (radius_px <= LARGEST_RADIUS_PX).then(|| (k.pixel(undistorted), radius_px))
}

/// A window of the image, rendered enlarged.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Window {
    /// Its upper left corner in the image, px.
    corner_px: DVec2,
    /// Side of a fine pixel, px.
    step_px: f64,
    width_px: u32,
    height_px: u32,
    /// There is one body, and it is unresolved.
    unresolved: bool,
}

impl Window {
    /// The window of a frame all of whose bodies before the camera are small and close together,
    /// and the frame as it is to be rendered.
    pub(crate) fn of(state: &FrameState, bounding_radii_m: &[f64]) -> Option<(Self, FrameState)> {
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        let (mut in_front, mut largest_px) = (0, 0.0f64);
        for (body, &radius_m) in bounding_radii_m.iter().enumerate() {
            if state.bodies[body].position_camera_m.z + radius_m <= 0.0 {
                continue;
            }
            let (center, radius_px) = small_disc(state, body, radius_m)?;
            (in_front, largest_px) = (in_front + 1, largest_px.max(radius_px));
            low = low.min(center - radius_px);
            high = high.max(center + radius_px);
        }
        let side_px = (high - low).max_element();
        if !(low.is_finite() && side_px <= LARGEST_SIDE_PX) {
            return None;
        }
        // Some fine pixels are left around the bodies.
        let step_px = side_px / f64::from(WINDOW - 8);
        let corner_px = 0.5 * (low + high) - 0.5 * step_px * f64::from(WINDOW);
        let k = state.image;
        let image = Pinhole {
            fx_px: k.fx_px / step_px,
            fy_px: k.fy_px / step_px,
            cx_px: (k.cx_px - corner_px.x) / step_px,
            cy_px: (k.cy_px - corner_px.y) / step_px,
            width_px: WINDOW,
            height_px: WINDOW,
        };
        let unresolved = in_front == 1 && largest_px <= UNRESOLVED_RADIUS_PX;
        let window = Self { corner_px, step_px, width_px: k.width_px, height_px: k.height_px, unresolved };
        Some((window, FrameState { image, ..state.clone() }))
    }

    /// The whole image from the enlarged window: radiance, I/F and coverage are shared among the
    /// pixels by area, the other planes are means over what is covered.
    pub(crate) fn place(&self, fine: &RadianceImage) -> RadianceImage {
        let (width, height) = (self.width_px as usize, self.height_px as usize);
        let (planes, size) = (fine.plane_count(), width * height);
        let mut data = vec![0f64; planes * size];
        let (columns, rows) = (self.shares(self.corner_px.x, width), self.shares(self.corner_px.y, height));
        for (y, row_shares) in rows.iter().enumerate() {
            for (x, column_shares) in columns.iter().enumerate() {
                let at = y * WINDOW as usize + x;
                let coverage = if planes > MASK { f64::from(fine.plane(MASK)[at]) } else { 0.0 };
                for &(row, high) in row_shares {
                    for &(column, wide) in column_shares {
                        for plane in 0..planes {
                            let weight = high * wide * if plane > MASK { coverage } else { 1.0 };
                            data[plane * size + row * width + column] +=
                                weight * f64::from(fine.plane(plane)[at]);
                        }
                    }
                }
            }
        }
        for pixel in 0..if planes > MASK { size } else { 0 } {
            let coverage = data[MASK * size + pixel];
            if coverage <= 0.0 {
                continue;
            }
            for plane in MASK + 1..planes {
                data[plane * size + pixel] /= coverage;
            }
            let normal = [4, 5, 6].map(|plane| plane * size + pixel);
            let length = DVec3::from_array(normal.map(|at| data[at])).length().max(1e-20);
            for at in normal {
                data[at] /= length;
            }
        }
        let data = data.into_iter().map(|value| value as f32).collect();
        let photocentre_px = self.unresolved.then(|| self.photocentre_px(fine)).flatten();
        RadianceImage { width_px: self.width_px, height_px: self.height_px, data, photocentre_px }
    }

    /// Centroid of the light in the image; `None` where there is none.
    fn photocentre_px(&self, fine: &RadianceImage) -> Option<DVec2> {
        let (mut light, mut moment) = (0.0, DVec2::ZERO);
        for (at, &value) in fine.radiance().iter().enumerate() {
            let place = DVec2::new((at % WINDOW as usize) as f64, (at / WINDOW as usize) as f64) + 0.5;
            light += f64::from(value);
            moment += f64::from(value) * place;
        }
        (light > 0.0).then(|| self.corner_px + moment / light * self.step_px)
    }

    /// For each fine pixel along an axis the pixels that it lies in, and how much of each it covers.
    fn shares(&self, corner_px: f64, length: usize) -> Vec<Vec<(usize, f64)>> {
        (0..WINDOW)
            .map(|fine| {
                let from = corner_px + f64::from(fine) * self.step_px;
                let to = from + self.step_px;
                let pixels = from.floor() as i64..=to.floor() as i64;
                pixels
                    .filter(|&pixel| pixel >= 0 && pixel < length as i64)
                    .map(|pixel| {
                        (pixel as usize, (to.min(pixel as f64 + 1.0) - from.max(pixel as f64)).max(0.0))
                    })
                    .collect()
            })
            .collect()
    }
}
