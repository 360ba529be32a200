//! What every stage shares: the frame, the bodies and their geometry. Lengths in metres, angles
//! in radians; body axes unless a name says camera. Each struct has a twin in
//! retina-render/src/gpu/layout.rs whose layout a test checks against naga's.

/// One frame and how it is sampled.
struct Frame {
    /// f_x, f_y, c_x, c_y, pixels.
    intrinsics_px: vec4<f32>,
    size_px: vec2<u32>,
    /// The rectangle that holds all bodies; nothing outside it is computed.
    region_origin_px: vec2<u32>,
    region_size_px: vec2<u32>,
    /// First-pass samples a pixel, along one axis.
    grid: u32,
    body_count: u32,
    /// Degree of the distortion polynomial; 0: none.
    distortion_degree: u32,
    /// Depth of the near plane for the depth buffer, m.
    near_m: f32,
    padding: vec2<u32>,
    /// Coefficients of x^i y^j, ordered by i then j, two (a, b) pairs an entry.
    distortion: array<vec4<f32>, 53>,
}

/// A body in this frame.
struct Body {
    /// Columns of camera_from_body.
    camera_from_body_x: vec3<f32>,
    /// Rays start where they cross this depth: close to the body, so that f32 suffices. 0: the camera.
    reference_depth_m: f32,
    camera_from_body_y: vec3<f32>,
    sun_angular_radius: f32,
    camera_from_body_z: vec3<f32>,
    /// Solar irradiance at the body over pi, W m^-2 nm^-1.
    sun_irradiance_over_pi: f32,
    center_camera_m: vec3<f32>,
    inverse_sun_distance: f32,
    /// Centre relative to the first body's, camera axes.
    center_from_first_m: vec3<f32>,
    /// How far above the surface shadow rays start, m.
    ray_offset_m: f32,
    /// From the body's centre to the Sun, unit; and a direction across it.
    sun_direction: vec3<f32>,
    /// Difference in I/F between first-pass samples above which a pixel is refined.
    contrast: f32,
    sun_across: vec3<f32>,
    node_first: u32,
    /// Boxes of the hierarchy are counted in steps of `box_step_m` from `box_low_m`.
    box_low_m: vec3<f32>,
    node_end: u32,
    box_step_m: vec3<f32>,
    triangle_end: u32,
    /// Projected centre: whole pixels and the rest, so that differences keep their digits.
    center_px_whole: vec2<i32>,
    center_px_part: vec2<f32>,
    center_line_of_sight: vec2<f32>,
    triangle_first: u32,
    /// Bit b set: body b may stand between this one and the Sun.
    shadow_casters: u32,
    /// Indices in the registers of laws and phase functions.
    law: u32,
    phase_law: u32,
    factor: f32,
    bounding_radius_m: f32,
    /// What each law and phase function reads there, its own WGSL says.
    law_parameters: array<vec4<f32>, 3>,
    phase_parameters: vec4<f32>,
    /// Where a body of a few pixels is, x and y, and the radius about it within which every pixel is
    /// sampled by rays; 0 for a larger body.
    small_disc_px: vec4<f32>,
}

/// A node of the bounding volume hierarchy, depth-first; no stack is needed to walk it.
struct Node {
    /// Corners of the box, in the body's box steps, rounded outwards.
    low: vec3<f32>,
    high: vec3<f32>,
    is_leaf: bool,
    /// Inner node: where to go on when the box is missed; its first child is the next node.
    escape: u32,
    /// Leaf: its triangles; the next node follows.
    first: u32,
    count: u32,
}

struct Vertex {
    position: vec3<f32>,
    u: f32,
    normal: vec3<f32>,
    v: f32,
}

struct Surface {
    body: u32,
    /// Index into maps, or NONE.
    albedo_map: u32,
    slope_map: u32,
    /// FLAT: normals from the triangles; TWO_SIDED.
    flags: u32,
    albedo_factor: f32,
}

/// A texture with its mip levels in `texels`.
struct Map {
    first: u32,
    width: u32,
    height: u32,
    levels: u32,
    /// 0 repeats, 1 clamps, 2 mirrors.
    wrap_u: u32,
    wrap_v: u32,
    scale: f32,
}

const NONE: u32 = 0xffffffffu;
const FLAT: u32 = 1u;
const TWO_SIDED: u32 = 2u;
const MOST_BODIES: u32 = 32u;

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<uniform> bodies: array<Body, MOST_BODIES>;
// Arrays live in textures, 4096 texels a row: Mesa's llvmpipe reads a texture for all lanes at
// once but a storage buffer lane by lane, ten times slower; on a GPU the two are alike.
/// Nodes: three words low | high << 16, and a link.
@group(0) @binding(2) var node_texels: texture_2d<u32>;
/// Vertex indices and surface of each triangle.
@group(0) @binding(3) var triangle_texels: texture_2d<u32>;
/// Vertices, two texels each.
@group(0) @binding(4) var vertex_texels: texture_2d<f32>;
/// Corners of each triangle, three texels; the first one's w is 1 where both sides are seen.
@group(0) @binding(9) var corner_texels: texture_2d<f32>;
/// For each 8 triangles their mean normal, and the sine of the Sun's elevation over it above which
/// nothing of the body itself hides it (retina-render/src/arrays/horizon.rs).
@group(0) @binding(5) var horizon_texels: texture_2d<f32>;
/// Surfaces, then maps, two texels each.
@group(0) @binding(6) var surface_texels: texture_2d<u32>;
@group(0) @binding(7) var map_texels: texture_2d<u32>;
@group(0) @binding(8) var texels: texture_2d<u32>;

/// The body whose triangle it is.
fn body_of(triangle: u32) -> u32 {
    var body = 0u;
    while body + 1u < frame.body_count && triangle >= bodies[body].triangle_end {
        body++;
    }
    return body;
}

fn texel_at(index: u32) -> vec2<u32> {
    return vec2<u32>(index & 4095u, index >> 12u);
}

fn node_at(index: u32) -> Node {
    let words = textureLoad(node_texels, texel_at(index), 0);
    let link = words.w;
    return Node(
        vec3<f32>(words.xyz & vec3<u32>(0xffffu)),
        vec3<f32>(words.xyz >> vec3<u32>(16u)),
        (link >> 31u) == 1u,
        link,
        link & 0x0fffffffu,
        (link >> 28u) & 7u,
    );
}

fn triangle_at(index: u32) -> vec4<u32> {
    return textureLoad(triangle_texels, texel_at(index), 0);
}

fn corner_at(triangle: u32, corner: u32) -> vec4<f32> {
    return textureLoad(corner_texels, texel_at(3u * triangle + corner), 0);
}

fn vertex_at(index: u32) -> Vertex {
    let a = textureLoad(vertex_texels, texel_at(2u * index), 0);
    let b = textureLoad(vertex_texels, texel_at(2u * index + 1u), 0);
    return Vertex(a.xyz, a.w, b.xyz, b.w);
}

fn horizon_at(triangle: u32) -> vec4<f32> {
    return textureLoad(horizon_texels, texel_at(triangle >> 3u), 0);
}

fn surface_at(index: u32) -> Surface {
    let a = textureLoad(surface_texels, texel_at(2u * index), 0);
    let b = textureLoad(surface_texels, texel_at(2u * index + 1u), 0);
    return Surface(a.x, a.y, a.z, a.w, bitcast<f32>(b.x));
}

fn map_at(index: u32) -> Map {
    let a = textureLoad(map_texels, texel_at(2u * index), 0);
    let b = textureLoad(map_texels, texel_at(2u * index + 1u), 0);
    return Map(a.x, a.y, a.z, a.w, b.x, b.y, bitcast<f32>(b.z));
}

fn texel_word(index: u32) -> u32 {
    return textureLoad(texels, texel_at(index), 0).x;
}
