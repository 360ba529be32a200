//! A frame's state as the shaders read it, computed in f64 and rounded once.

use glam::{DMat3, DVec2, DVec3};
use retina_radiometry::{Photometry, sun_angular_radius_rad, sun_irradiance_w_m2_nm};

use super::layout::{Body, DISTORTION_ENTRIES, Frame};
use super::nodes::box_steps;
use crate::arrays::{BodyRange, PATCH};
use crate::frame::contrast_reference;
use crate::placing::{RAY_OFFSET, Region, shadow_casters};
use crate::small::small_disc;
use crate::{BodyModel, FrameState, Quality};

/// A walk over the triangles of one pixel has to end within llvmpipe's 65 535 loop turns. A body of a
/// few pixels with more triangles than this a pixel is left to the first-pass samples when it is not
/// alone in the frame.
const MOST_TRIANGLES_A_PIXEL: f64 = 8000.0;
/// First-pass samples a pixel along one axis.
pub(crate) const GRID: u32 = 2;

pub(crate) fn frame_uniform(state: &FrameState, region: Region, ranges: &[BodyRange]) -> Frame {
    let k = &state.image;
    let mut out = Frame {
        intrinsics_px: [k.fx_px, k.fy_px, k.cx_px, k.cy_px].map(|v| v as f32),
        size_px: [k.width_px, k.height_px],
        region_origin_px: region.origin,
        region_size_px: region.size,
        grid: GRID,
        body_count: state.bodies.len() as u32,
        distortion_degree: 0,
        near_m: near_m(state, ranges) as f32,
        padding: [0; 2],
        distortion: [[0.0; 4]; DISTORTION_ENTRIES],
    };
    if let Some(distortion) = &state.distortion {
        out.distortion_degree = distortion.degree();
        for (index, c) in distortion.coefficients().iter().enumerate() {
            let pair = &mut out.distortion[index / 2][2 * (index % 2)..];
            pair[0] = c.x as f32;
            pair[1] = c.y as f32;
        }
    }
    out
}

/// Half the distance to the nearest thing; only scales the depth buffer.
fn near_m(state: &FrameState, ranges: &[BodyRange]) -> f64 {
    let nearest = state.bodies.iter().zip(ranges).map(|(body, range)| {
        let distance = body.position_camera_m.length();
        (distance - range.bounding_radius_m).max(1e-4 * range.bounding_radius_m)
    });
    0.5 * nearest.fold(f64::INFINITY, f64::min)
}

pub(crate) fn body_uniforms(
    state: &FrameState,
    models: &[BodyModel],
    ranges: &[BodyRange],
    quality: Quality,
) -> Vec<Body> {
    let first_m = state.bodies.first().map_or(DVec3::ZERO, |body| body.position_camera_m);
    state
        .bodies
        .iter()
        .zip(models.iter().zip(ranges))
        .enumerate()
        .map(|(index, (body, (model, range)))| {
            let small = small_disc(state, index, range.bounding_radius_m)
                .filter(|(_, radius)| {
                    f64::from(range.triangle_count) < MOST_TRIANGLES_A_PIXEL * radius * radius
                })
                .map_or([0.0; 4], |(at, radius)| [at.x as f32, at.y as f32, radius as f32 + 1.0, 0.0]);
            let centre = body.position_camera_m;
            let far = centre.z > range.bounding_radius_m;
            let line_of_sight = if far { DVec2::new(centre.x, centre.y) / centre.z } else { DVec2::ZERO };
            let centre_px = state.image.pixel(line_of_sight);
            let whole = centre_px.round();
            let sun_distance_m = body.sun_position_body_m.length();
            let sun = body.sun_position_body_m / sun_distance_m;
            let across = sun.any_orthonormal_vector();
            let rotation: DMat3 = body.camera_from_body;
            let (box_low_m, box_step_m) = box_steps(range.bounds_m);
            let mut out = Body {
                camera_from_body_x: rotation.x_axis.as_vec3().to_array(),
                reference_depth_m: if far { centre.z as f32 } else { 0.0 },
                camera_from_body_y: rotation.y_axis.as_vec3().to_array(),
                sun_angular_radius: sun_angular_radius_rad(sun_distance_m) as f32,
                camera_from_body_z: rotation.z_axis.as_vec3().to_array(),
                sun_irradiance_over_pi: (sun_irradiance_w_m2_nm(sun_distance_m) / std::f64::consts::PI)
                    as f32,
                center_camera_m: centre.as_vec3().to_array(),
                inverse_sun_distance: (1.0 / sun_distance_m) as f32,
                center_from_first_m: (centre - first_m).as_vec3().to_array(),
                ray_offset_m: (range.bounding_radius_m * RAY_OFFSET) as f32,
                sun_direction: sun.as_vec3().to_array(),
                contrast: (quality.contrast() * contrast_reference(&model.photometry, body.phase_rad()))
                    as f32,
                sun_across: across.as_vec3().to_array(),
                node_first: range.node_first,
                node_end: range.node_end,
                center_px_whole: [whole.x as i32, whole.y as i32],
                center_px_part: (centre_px - whole).as_vec2().to_array(),
                center_line_of_sight: line_of_sight.as_vec2().to_array(),
                triangle_first: range.triangle_first,
                shadow_casters: shadow_casters(state, ranges, index)
                    .iter()
                    .fold(0, |bits, other| bits | 1 << other),
                bounding_radius_m: range.bounding_radius_m as f32,
                box_low_m,
                triangle_end: range.triangle_first + range.triangle_count.next_multiple_of(PATCH as u32),
                box_step_m,
                small_disc_px: small,
                ..Body::default()
            };
            set_photometry(&mut out, &model.photometry);
            out
        })
        .collect()
}

fn set_photometry(out: &mut Body, photometry: &Photometry) {
    out.factor = photometry.factor as f32;
    out.law = photometry.law.index();
    out.law_parameters = bytemuck::cast(photometry.law.shader_parameters());
    out.phase_law = photometry.phase_function.index();
    out.phase_parameters = photometry.phase_function.shader_parameters();
}
