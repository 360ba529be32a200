//! Where a frame's bodies are in the image and before the Sun, as far as both fast renderers ask for it.

use glam::{DVec2, DVec3};
use retina_radiometry::sun_angular_radius_rad;

use crate::FrameState;
use crate::arrays::BodyRange;

/// A rectangle of pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Region {
    pub origin: [u32; 2],
    pub size: [u32; 2],
}

/// Shadow rays start this far above the surface, in bounding radii: some five roundings of f32. Where sunlight grazes a
/// slope, a start that is too high loses shadow: 4e-6 brightened a terminator by 3e-4 of its light.
pub(crate) const RAY_OFFSET: f64 = 3e-7;

/// Bodies that may stand between body `own` and the Sun: their bounding sphere meets the cylinder, widening by the
/// Sun's angular radius, from this body towards the Sun.
pub(crate) fn shadow_casters(state: &FrameState, ranges: &[BodyRange], own: usize) -> Vec<usize> {
    let receiver = &state.bodies[own];
    let sun = receiver.camera_from_body * receiver.sun_position_body_m;
    let (towards, spread) = (sun.normalize(), sun_angular_radius_rad(sun.length()).tan());
    let may_cast = |index: usize| {
        let between = state.bodies[index].position_camera_m - receiver.position_camera_m;
        let along = between.dot(towards);
        let radii = ranges[index].bounding_radius_m + ranges[own].bounding_radius_m;
        let aside = (between - along * towards).length();
        index != own && along > -radii && aside < radii + (along + radii) * spread
    };
    (0..state.bodies.len()).filter(|&index| may_cast(index)).collect()
}

/// The rectangle that holds the projections of all bodies' bounding spheres; the whole image
/// where one of them is too near for that.
pub(crate) fn region(state: &FrameState, ranges: &[BodyRange]) -> Option<Region> {
    let image = &state.image;
    let (width, height) = (f64::from(image.width_px), f64::from(image.height_px));
    let whole = Region { origin: [0, 0], size: [image.width_px, image.height_px] };
    let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    for (body, range) in state.bodies.iter().zip(ranges) {
        let (centre, radius) = (body.position_camera_m, range.bounding_radius_m);
        if centre.z + radius <= 0.0 {
            continue;
        }
        // The box about the sphere projects into this rectangle when it is in front as a whole.
        if centre.z - radius <= 0.05 * radius {
            return Some(whole);
        }
        for corner in 0..8 {
            let side = |bit: i32| if corner >> bit & 1 == 1 { radius } else { -radius };
            let point = centre + DVec3::new(side(0), side(1), side(2));
            let mut line_of_sight = DVec2::new(point.x, point.y) / point.z;
            if let Some(distortion) = &state.distortion {
                match distortion.undistort(line_of_sight) {
                    Ok(undistorted) => line_of_sight = undistorted,
                    Err(_) => return Some(whole),
                }
            }
            let pixel = image.pixel(line_of_sight);
            low = low.min(pixel);
            high = high.max(pixel);
        }
    }
    // A distorted rectangle bulges: a margin of 2 % of its size and some pixels.
    let margin = (high - low) * if state.distortion.is_some() { 0.02 } else { 0.0 } + 3.0;
    let low = (low - margin).floor().clamp(DVec2::ZERO, DVec2::new(width, height));
    let high = (high + margin).ceil().clamp(DVec2::ZERO, DVec2::new(width, height));
    let size = high - low;
    if !(size.x >= 1.0 && size.y >= 1.0) {
        return None;
    }
    Some(Region { origin: [low.x as u32, low.y as u32], size: [size.x as u32, size.y as u32] })
}
