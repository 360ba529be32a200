//! Elements of the flat arrays. The shaders read the same structs (shaders/shared/types.wgsl).

use bytemuck::{Pod, Zeroable};

/// Index of a map that is not there.
pub(crate) const NONE: u32 = u32::MAX;
/// Flag of a surface: normals from the triangles.
pub(crate) const FLAT: u32 = 1;
/// Flag of a surface: both sides are seen.
pub(crate) const TWO_SIDED: u32 = 2;

#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(crate) struct Vertex {
    pub position: [f32; 3],
    pub u: f32,
    pub normal: [f32; 3],
    pub v: f32,
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(crate) struct Surface {
    pub body: u32,
    pub albedo_map: u32,
    pub slope_map: u32,
    pub flags: u32,
    pub albedo_factor: f32,
    pub padding: [u32; 3],
}

/// A texture with its mip levels in the array of texels.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(crate) struct Map {
    pub first: u32,
    pub width: u32,
    pub height: u32,
    pub levels: u32,
    /// 0 repeats, 1 clamps, 2 mirrors.
    pub wrap_u: u32,
    pub wrap_v: u32,
    pub scale: f32,
    pub padding: u32,
}
