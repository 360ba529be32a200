//! Twins of the structs in shaders/shared/types.wgsl. A test compares every offset with naga's.

use bytemuck::{Pod, Zeroable};
use retina_geometry::{MAX_DEGREE, term_count};
use retina_radiometry::{LAW_PARAMETERS, PHASE_PARAMETERS};

pub(crate) const MOST_BODIES: usize = 32;

/// Two coefficients an entry.
pub(crate) const DISTORTION_ENTRIES: usize = term_count(MAX_DEGREE).div_ceil(2);

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct Frame {
    pub intrinsics_px: [f32; 4],
    pub size_px: [u32; 2],
    pub region_origin_px: [u32; 2],
    pub region_size_px: [u32; 2],
    pub grid: u32,
    pub body_count: u32,
    pub distortion_degree: u32,
    pub near_m: f32,
    pub padding: [u32; 2],
    pub distortion: [[f32; 4]; DISTORTION_ENTRIES],
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(crate) struct Body {
    pub camera_from_body_x: [f32; 3],
    pub reference_depth_m: f32,
    pub camera_from_body_y: [f32; 3],
    pub sun_angular_radius: f32,
    pub camera_from_body_z: [f32; 3],
    pub sun_irradiance_over_pi: f32,
    pub center_camera_m: [f32; 3],
    pub inverse_sun_distance: f32,
    pub center_from_first_m: [f32; 3],
    pub ray_offset_m: f32,
    pub sun_direction: [f32; 3],
    pub contrast: f32,
    pub sun_across: [f32; 3],
    pub node_first: u32,
    pub box_low_m: [f32; 3],
    pub node_end: u32,
    pub box_step_m: [f32; 3],
    pub triangle_end: u32,
    pub center_px_whole: [i32; 2],
    pub center_px_part: [f32; 2],
    pub center_line_of_sight: [f32; 2],
    pub triangle_first: u32,
    pub shadow_casters: u32,
    pub law: u32,
    pub phase_law: u32,
    pub factor: f32,
    pub bounding_radius_m: f32,
    pub law_parameters: [[f32; 4]; LAW_PARAMETERS / 4],
    pub phase_parameters: [f32; PHASE_PARAMETERS],
    pub small_disc_px: [f32; 4],
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(crate) struct Warp {
    pub source_origin_px: [i32; 2],
    pub source_size_px: [u32; 2],
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(crate) struct Chunk {
    pub list: u32,
    pub first: u32,
    pub pixels: u32,
    pub samples_log2: u32,
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(crate) struct Plan {
    pub edge_pixels: u32,
    pub edge_samples_log2: u32,
    pub inner_pixels: u32,
    pub inner_samples_log2: u32,
    pub edge_chunks: u32,
    pub inner_chunks: u32,
    pub run_log2: u32,
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::mem::{offset_of, size_of};

    /// (member offsets, size) of a WGSL struct, as naga lays it out.
    fn naga_layout(module: &naga::Module, name: &str) -> (Vec<(String, u32)>, u32) {
        let (_, found) = module
            .types
            .iter()
            .find(|(_, t)| t.name.as_deref() == Some(name))
            .unwrap_or_else(|| panic!("no struct {name} in the shaders"));
        let naga::TypeInner::Struct { members, span } = &found.inner else { panic!("{name} is no struct") };
        (members.iter().map(|m| (m.name.clone().unwrap(), m.offset)).collect(), *span)
    }

    macro_rules! check {
        ($module:expr, $type:ident { $($field:ident),* $(,)? }) => {
            let (offsets, span) = naga_layout($module, stringify!($type));
            let ours = vec![$((stringify!($field).to_string(), offset_of!($type, $field) as u32)),*];
            assert_eq!(ours, offsets, stringify!($type));
            // An array's stride is the size rounded up to the alignment; Rust's size must be it.
            assert_eq!(size_of::<$type>() as u32, span, stringify!($type));
        };
    }

    #[test]
    fn every_shared_struct_has_nagas_layout() {
        let module =
            naga::front::wgsl::parse_str(&retina_shaders::refine(&retina_shaders::Kinds::all())).unwrap();
        check!(
            &module,
            Frame {
                intrinsics_px,
                size_px,
                region_origin_px,
                region_size_px,
                grid,
                body_count,
                distortion_degree,
                near_m,
                padding,
                distortion,
            }
        );
        check!(
            &module,
            Body {
                camera_from_body_x,
                reference_depth_m,
                camera_from_body_y,
                sun_angular_radius,
                camera_from_body_z,
                sun_irradiance_over_pi,
                center_camera_m,
                inverse_sun_distance,
                center_from_first_m,
                ray_offset_m,
                sun_direction,
                contrast,
                sun_across,
                node_first,
                box_low_m,
                node_end,
                box_step_m,
                triangle_end,
                center_px_whole,
                center_px_part,
                center_line_of_sight,
                triangle_first,
                shadow_casters,
                law,
                phase_law,
                factor,
                bounding_radius_m,
                law_parameters,
                phase_parameters,
                small_disc_px,
            }
        );
        check!(&module, Chunk { list, first, pixels, samples_log2 });
        let module =
            naga::front::wgsl::parse_str(&retina_shaders::refine_plan(&retina_shaders::Kinds::all()))
                .unwrap();
        check!(
            &module,
            Plan {
                edge_pixels,
                edge_samples_log2,
                inner_pixels,
                inner_samples_log2,
                edge_chunks,
                inner_chunks,
                run_log2,
            }
        );
        let module = naga::front::wgsl::parse_str(&retina_shaders::warp()).unwrap();
        check!(&module, Warp { source_origin_px, source_size_px });
    }
}
