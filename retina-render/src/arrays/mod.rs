//! Body models as flat arrays, with a hierarchy to walk and bounds on the relief: what the shaders and the native
//! renderer read.

pub(crate) mod bvh;
pub(crate) mod horizon;
mod prepared;
mod types;

use rayon::prelude::*;
use retina_model::{AlbedoMap, SlopeMap, Wrap};

pub(crate) use horizon::PATCH;
pub use prepared::keep_bodies_in;
pub(crate) use types::{FLAT, Map, NONE, Surface, TWO_SIDED, Vertex};

use crate::BodyModel;
use bvh::Node;
use prepared::Prepared;

/// All bodies of a scene, one after the other.
#[derive(Default)]
pub(crate) struct SceneArrays {
    /// Links count from a body's first node.
    pub nodes: Vec<Node>,
    /// Vertex indices and surface; 8-aligned for each body by repeating its last triangle.
    pub triangles: Vec<[u32; 4]>,
    pub vertices: Vec<Vertex>,
    /// Corners of each triangle; the first one's last number is 1 where both sides are seen.
    pub corners: Vec<[[f32; 4]; 3]>,
    /// For each patch of triangles: see `horizon`.
    pub horizons: Vec<[f32; 4]>,
    pub surfaces: Vec<Surface>,
    pub maps: Vec<Map>,
    pub texels: Vec<u32>,
    pub ranges: Vec<BodyRange>,
}

/// Where a body's parts lie in the arrays.
#[derive(Clone, Copy)]
pub(crate) struct BodyRange {
    pub vertex_first: u32,
    pub vertex_end: u32,
    pub node_first: u32,
    pub node_end: u32,
    pub triangle_first: u32,
    pub triangle_count: u32,
    pub bounding_radius_m: f64,
    /// Lowest and highest corner of its box, m.
    pub bounds_m: [[f32; 3]; 2],
    pub double_sided: bool,
}

impl SceneArrays {
    pub(crate) fn new(models: &[BodyModel]) -> Self {
        let mut out = Self::default();
        for (index, model) in models.iter().enumerate() {
            out.add(model, index as u32);
        }
        // Bindings may not be empty.
        if out.maps.is_empty() {
            out.maps.push(Map::default());
            out.texels.push(0);
        }
        out
    }

    fn add(&mut self, model: &BodyModel, body: u32) {
        let shape = &model.shape;
        let surface_first = self.surfaces.len() as u32;
        let albedo_first = self.maps.len() as u32;
        let slope_first = albedo_first + shape.albedo_maps.len() as u32;
        for map in &shape.albedo_maps {
            self.add_albedo(map);
        }
        for map in &shape.slope_maps {
            self.add_slopes(map);
        }
        self.surfaces.extend(shape.surfaces.iter().map(|surface| Surface {
            body,
            albedo_map: surface.albedo_map.map_or(NONE, |map| albedo_first + map as u32),
            slope_map: surface.slope_map.map_or(NONE, |map| slope_first + map as u32),
            flags: if surface.flat { FLAT } else { 0 } | if surface.double_sided { TWO_SIDED } else { 0 },
            albedo_factor: surface.albedo_factor,
            padding: [0; 3],
        }));

        let vertex_first = self.vertices.len() as u32;
        self.vertices.extend(shape.vertices.iter().map(|vertex| Vertex {
            position: vertex.position_m.as_vec3().to_array(),
            u: vertex.uv.x,
            normal: vertex.normal.to_array(),
            v: vertex.uv.y,
        }));
        let positions: Vec<[f32; 3]> =
            self.vertices[vertex_first as usize..].iter().map(|v| v.position).collect();
        let (node_first, triangle_first) = (self.nodes.len() as u32, self.triangles.len() as u32);
        let Prepared { nodes, order, horizons } = Prepared::of(&positions, &shape.triangles);
        let bounds_m = nodes.first().map_or([[0.0; 3]; 2], |root| [root.low, root.high]);
        self.nodes.extend(nodes.into_iter().map(|node| match node.count {
            0 => node,
            _ => Node { first: triangle_first + node.first, ..node },
        }));
        self.horizons.extend(horizons);
        self.triangles.extend(order.iter().map(|&triangle| {
            let [a, b, c] = shape.triangles[triangle as usize].map(|corner| vertex_first + corner);
            [a, b, c, surface_first + u32::from(shape.triangle_surface[triangle as usize])]
        }));
        let triangle_count = self.triangles.len() as u32 - triangle_first;
        if let Some(&last) = self.triangles.last() {
            self.triangles.resize(self.triangles.len().next_multiple_of(PATCH), last);
        }
        let own_triangles = &self.triangles[triangle_first as usize..];
        let (vertices, surfaces) = (&self.vertices, &self.surfaces);
        self.corners.par_extend(own_triangles.par_iter().map(|triangle| {
            let two_sided = surfaces[triangle[3] as usize].flags & TWO_SIDED != 0;
            let corner = |k: usize, w: f32| {
                let [x, y, z] = vertices[triangle[k] as usize].position;
                [x, y, z, w]
            };
            [corner(0, f32::from(u8::from(two_sided))), corner(1, 0.0), corner(2, 0.0)]
        }));
        self.ranges.push(BodyRange {
            vertex_first,
            vertex_end: self.vertices.len() as u32,
            node_first,
            node_end: self.nodes.len() as u32,
            triangle_first,
            triangle_count,
            bounding_radius_m: shape.bounding_radius_m(),
            bounds_m,
            double_sided: shape.surfaces.iter().any(|surface| surface.double_sided),
        });
    }

    /// Packs a linear map and its mip levels: each word holds a texel and its right neighbour.
    fn add_albedo(&mut self, map: &AlbedoMap) {
        let scale = map.texels.iter().fold(f32::MIN_POSITIVE, |a, &b| a.max(b));
        let first = self.texels.len() as u32;
        let levels =
            mip_levels(map.width, map.height, map.texels.clone(), |a, b, c, d| 0.25 * (a + b + c + d));
        for (width, _, texels) in &levels {
            let quantise = |value: f32| (value / scale * 65535.0).round().clamp(0.0, 65535.0) as u32;
            self.texels.par_extend(texels.par_iter().enumerate().map(|(index, &value)| {
                let column = index % width;
                let right = map.wrap_u.texel(column as i64 + 1, *width);
                quantise(value) | quantise(texels[index - column + right]) << 16
            }));
        }
        self.maps.push(describe(first, map.width, map.height, levels.len(), (map.wrap_u, map.wrap_v), scale));
    }

    fn add_slopes(&mut self, map: &SlopeMap) {
        let first = self.texels.len() as u32;
        let mean = |a: [f32; 2], b: [f32; 2], c: [f32; 2], d: [f32; 2]| {
            std::array::from_fn(|k| 0.25 * (a[k] + b[k] + c[k] + d[k]))
        };
        let levels = mip_levels(map.width, map.height, map.texels.clone(), mean);
        for (_, _, texels) in &levels {
            self.texels.extend(texels.iter().map(|slope| {
                let [x, y] = slope.map(|s| u32::from(half::f16::from_f32(s).to_bits()));
                x | y << 16
            }));
        }
        self.maps.push(describe(first, map.width, map.height, levels.len(), (map.wrap_u, map.wrap_v), 1.0));
    }
}

fn describe(first: u32, width: usize, height: usize, levels: usize, wrap: (Wrap, Wrap), scale: f32) -> Map {
    let code = |wrap: Wrap| match wrap {
        Wrap::Repeat => 0,
        Wrap::Clamp => 1,
        Wrap::Mirror => 2,
    };
    Map {
        first,
        width: width as u32,
        height: height as u32,
        levels: levels as u32,
        wrap_u: code(wrap.0),
        wrap_v: code(wrap.1),
        scale,
        padding: 0,
    }
}

/// (width, height, texels) of a map and its halvings down to one texel.
fn mip_levels<T: Copy + Send + Sync>(
    width: usize,
    height: usize,
    texels: Vec<T>,
    mean: impl Fn(T, T, T, T) -> T + Sync,
) -> Vec<(usize, usize, Vec<T>)> {
    let mut levels = vec![(width, height, texels)];
    while let Some((w, h, last)) = levels.last()
        && (*w > 1 || *h > 1)
    {
        let (w, h) = (*w, *h);
        let (half_w, half_h) = ((w / 2).max(1), (h / 2).max(1));
        let next: Vec<T> = (0..half_w * half_h)
            .into_par_iter()
            .map(|index| {
                let (x, y) = (index % half_w * 2, index / half_w * 2);
                let (x1, y1) = ((x + 1).min(w - 1), (y + 1).min(h - 1));
                mean(last[y * w + x], last[y * w + x1], last[y1 * w + x], last[y1 * w + x1])
            })
            .collect();
        levels.push((half_w, half_h, next));
    }
    levels
}
