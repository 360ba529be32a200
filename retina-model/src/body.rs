//! A body in memory: mesh, surfaces, maps, and what follows from the mesh alone.

use std::collections::HashMap;

use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;

use crate::maps::{AlbedoMap, SlopeMap};

/// Triangles summed in one go: fixed, so that sums do not depend on the number of threads.
pub(crate) const CHUNK: usize = 8192;

/// A body: one mesh in body-fixed axes (x prime meridian, z north), metres.
#[derive(Debug, Clone, Default)]
pub struct Body {
    /// Vertices; those of different primitives are not shared, even where they coincide.
    pub vertices: Vec<Vertex>,
    /// Vertex indices of each triangle, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// For each triangle, its index into `surfaces`.
    pub triangle_surface: Vec<u16>,
    /// Materials as far as they matter here, shared by the primitives that have the same.
    pub surfaces: Vec<Surface>,
    /// Albedo textures, each decoded once.
    pub albedo_maps: Vec<AlbedoMap>,
    /// Normal textures as slopes, each decoded once for each scale.
    pub slope_maps: Vec<SlopeMap>,
}

/// A vertex of a [`Body`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Vertex {
    /// Position in body-fixed axes, metres. Never holds a negative zero, so equal positions are
    /// equal bit by bit.
    pub position_m: DVec3,
    /// Outward unit normal for smooth shading.
    pub normal: Vec3,
    /// Texture coordinates, v downwards from the image's top; zero where there are none.
    pub uv: Vec2,
}

/// What a part of the mesh is made of.
#[derive(Debug, Clone, PartialEq)]
pub struct Surface {
    /// The material's name, or its number where it has none.
    pub name: String,
    /// The primitive came without normals: the glTF specification has it shaded flat, with each
    /// triangle's own normal. (Its vertices still carry smooth normals.)
    pub flat: bool,
    /// Index into `albedo_maps`.
    pub albedo_map: Option<usize>,
    /// Factor on the map's texel, or the relative albedo itself without a map: base-colour factor
    /// in Rec. 709 luminance, scaled so that map times factor has mean 1 over the body's surface.
    pub albedo_factor: f32,
    /// Index into `slope_maps`.
    pub slope_map: Option<usize>,
    /// Both sides are to be seen.
    pub double_sided: bool,
}

impl Body {
    /// The corners of a triangle, metres.
    pub fn corners_m(&self, triangle: usize) -> [DVec3; 3] {
        self.triangles[triangle].map(|v| self.vertices[v as usize].position_m)
    }

    /// Twice the triangle's area, along its outward normal, square metres.
    pub(crate) fn doubled_area_m2(&self, triangle: usize) -> DVec3 {
        let [a, b, c] = self.corners_m(triangle);
        (b - a).cross(c - a)
    }

    /// A sum over all triangles, the same whatever the number of threads.
    pub(crate) fn sum_triangles(&self, term: impl Fn(usize) -> f64 + Sync) -> f64 {
        let chunks = self.triangles.len().div_ceil(CHUNK);
        let parts: Vec<f64> = (0..chunks)
            .into_par_iter()
            .map(|chunk| {
                let end = ((chunk + 1) * CHUNK).min(self.triangles.len());
                (chunk * CHUNK..end).map(&term).sum()
            })
            .collect();
        parts.iter().sum()
    }

    /// Distance of the farthest used vertex from the origin, metres.
    pub fn bounding_radius_m(&self) -> f64 {
        let farthest = self
            .triangles
            .iter()
            .flatten()
            .map(|&v| self.vertices[v as usize].position_m.length_squared())
            .fold(0.0, f64::max);
        farthest.sqrt()
    }

    /// Area of the mesh, square metres.
    pub fn surface_area_m2(&self) -> f64 {
        0.5 * self.sum_triangles(|t| self.doubled_area_m2(t).length())
    }

    /// Enclosed volume by the divergence theorem, cubic metres; positive where the triangles wind
    /// counter-clockwise seen from outside. Meaningful for a closed mesh only.
    pub fn volume_m3(&self) -> f64 {
        self.sum_triangles(|t| {
            let [a, b, c] = self.corners_m(t);
            a.dot(b.cross(c))
        }) / 6.0
    }

    /// Radius of the sphere of the same volume, metres.
    pub fn volume_equivalent_radius_m(&self) -> f64 {
        (self.volume_m3().abs() * 0.75 / std::f64::consts::PI).cbrt()
    }

    /// For each vertex the first one at the bit-equal position: vertices split at texture seams
    /// and face borders become one.
    fn welded(&self) -> Vec<u32> {
        let mut first: HashMap<[u64; 3], u32> = HashMap::with_capacity(self.vertices.len());
        self.vertices
            .iter()
            .enumerate()
            .map(|(i, v)| {
                let key = v.position_m.to_array().map(f64::to_bits);
                *first.entry(key).or_insert(i as u32)
            })
            .collect()
    }

    /// Whether the mesh is watertight: each undirected edge, welded by position, belongs to
    /// exactly two triangles.
    pub fn is_closed(&self) -> bool {
        let welded = self.welded();
        let mut edges: Vec<u64> = self
            .triangles
            .iter()
            .flat_map(|t| {
                let [a, b, c] = t.map(|v| u64::from(welded[v as usize]));
                [(a, b), (b, c), (c, a)].map(|(p, q)| p.min(q) << 32 | p.max(q))
            })
            .collect();
        edges.par_sort_unstable();
        !edges.is_empty() && edges.chunk_by(|a, b| a == b).all(|same| same.len() == 2)
    }

    /// Replaces all normals by vertex normals weighted with each triangle's area and its angle at
    /// the vertex, welded by bit-equal position; no surface is flat afterwards.
    ///
    /// The angle keeps the result independent of how a face is cut into triangles (Thuermer and
    /// Wuethrich 1998), the area lets large facets outweigh slivers (Max 1999).
    pub fn smooth_normals(&mut self) {
        let welded = self.welded();
        let mut sums = vec![DVec3::ZERO; self.vertices.len()];
        for t in 0..self.triangles.len() {
            self.add_corner_normals(t, |v| welded[v as usize] as usize, &mut sums);
        }
        for (vertex, &first) in self.vertices.iter_mut().zip(&welded) {
            vertex.normal =
                sums[first as usize].normalize_or(vertex.position_m.normalize_or_zero()).as_vec3();
        }
        for surface in &mut self.surfaces {
            surface.flat = false;
        }
    }

    /// Adds a triangle's weighted normal to the sums of its three corners.
    pub(crate) fn add_corner_normals(
        &self,
        triangle: usize,
        slot: impl Fn(u32) -> usize,
        sums: &mut [DVec3],
    ) {
        let corners = self.corners_m(triangle);
        let doubled_area = self.doubled_area_m2(triangle);
        for k in 0..3 {
            let (here, next, last) = (corners[k], corners[(k + 1) % 3], corners[(k + 2) % 3]);
            let angle_rad = (next - here).angle_between(last - here);
            sums[slot(self.triangles[triangle][k])] += doubled_area * angle_rad;
        }
    }
}
