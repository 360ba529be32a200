//! Changes to a loaded body: a texture laid on it, other units and axes.

use std::collections::HashMap;
use std::f64::consts::{PI, TAU};
use std::path::Path;

use glam::{DMat3, DVec3, Vec2};
use image::ImageFormat;
use retina_files::{InputError, decode_image, read_bytes};

use crate::body::Body;
use crate::maps::{AlbedoMap, Wrap, linear_luminance};
use crate::textures::MAX_PIXELS;

/// How a texture lies on a body.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Layout {
    /// By the vertices' own texture coordinates.
    Coordinates,
    /// As a plate carree map: longitude -180 deg at the left edge, 0 in the middle, east to the right,
    /// north up, of the file's axes (x prime meridian, z north).
    LongitudeLatitude,
}

/// Within this of the axis (sine of the angle) a vertex is a pole and has no longitude of its own.
const POLE: f64 = 1e-9;

impl Body {
    /// Lays an sRGB-encoded image (PNG, JPEG or TIFF) on the whole body in the place of whatever
    /// albedo maps it has. Gives the image's own mean over the surface, linear, 0..1: the albedo
    /// that a renderer takes which uses the texels as they are; the body's becomes 1.
    ///
    /// # Errors
    /// The image cannot be read or decoded, or is black where it meets the body.
    pub fn paint(&mut self, image: &Path, layout: Layout) -> Result<f64, InputError> {
        let bytes = read_bytes(image)?;
        let formats = [ImageFormat::Png, ImageFormat::Jpeg, ImageFormat::Tiff];
        let decoded = decode_image(image, "texture", &bytes, &formats, MAX_PIXELS)?;
        self.albedo_maps = vec![AlbedoMap {
            width: decoded.width() as usize,
            height: decoded.height() as usize,
            wrap_u: Wrap::Repeat,
            wrap_v: if layout == Layout::LongitudeLatitude { Wrap::Clamp } else { Wrap::Repeat },
            texels: linear_luminance(image, "texture", &decoded)?,
        }];
        for surface in &mut self.surfaces {
            (surface.albedo_map, surface.albedo_factor) = (Some(0), 1.0);
        }
        if layout == Layout::LongitudeLatitude {
            // Normal textures lie by the coordinates that are replaced.
            self.slope_maps.clear();
            self.surfaces.iter_mut().for_each(|surface| surface.slope_map = None);
            self.lay_by_longitude();
        }
        let mean = self.mean_albedo();
        self.normalise_albedo(image, "texture")?;
        Ok(mean)
    }

    /// Whether a texture can lie by the vertices' own coordinates.
    pub fn has_texture_coordinates(&self) -> bool {
        self.triangles.iter().flatten().any(|&v| self.vertices[v as usize].uv != Vec2::ZERO)
    }

    /// Texture coordinates from longitude and latitude. A triangle across the map's edge, or at a
    /// pole, gets vertices of its own, with u beyond 0..1 where needed.
    fn lay_by_longitude(&mut self) {
        let old: Vec<(f64, f64, bool)> = self
            .vertices
            .iter()
            .map(|vertex| {
                let p = vertex.position_m.normalize_or(DVec3::X);
                let at_pole = p.x.hypot(p.y) < POLE;
                (0.5 + p.y.atan2(p.x) / TAU, 0.5 - p.z.clamp(-1.0, 1.0).asin() / PI, at_pole)
            })
            .collect();
        let template = std::mem::take(&mut self.vertices);
        let mut known: HashMap<(u32, u32), u32> = HashMap::with_capacity(template.len());
        for triangle in &mut self.triangles {
            let at = triangle.map(|v| old[v as usize]);
            let first = at.iter().find(|(_, _, at_pole)| !at_pole).map_or(0.5, |(u, ..)| *u);
            let mut u = at.map(|(u, _, at_pole)| if at_pole { f64::NAN } else { u - (u - first).round() });
            // A pole lies above the middle of the others.
            let (sum, count) =
                u.iter().filter(|u| !u.is_nan()).fold((0.0, 0u32), |(sum, n), u| (sum + u, n + 1));
            let middle = if count == 0 { first } else { sum / f64::from(count) };
            u.iter_mut().filter(|u| u.is_nan()).for_each(|u| *u = middle);
            for corner in 0..3 {
                let uv = Vec2::new(u[corner] as f32, at[corner].1 as f32);
                let vertex = triangle[corner];
                let next = self.vertices.len() as u32;
                triangle[corner] = *known.entry((vertex, uv.x.to_bits())).or_insert(next);
                if triangle[corner] == next {
                    self.vertices.push(crate::Vertex { uv, ..template[vertex as usize] });
                }
            }
        }
    }

    /// The body with other units and axes: each position p becomes `turn` p, times `scale` along
    /// the new axes. `turn` is a rotation, the scales are above 0.
    pub fn transform(&mut self, turn: DMat3, scale: DVec3) {
        for vertex in &mut self.vertices {
            // Adding zero turns a negative zero into a positive one: see `Vertex::position_m`.
            vertex.position_m = scale * (turn * vertex.position_m) + 0.0;
            // Normals go by the inverse transpose.
            let normal = (turn * vertex.normal.as_dvec3()) / scale;
            vertex.normal = normal.normalize_or(DVec3::Z).as_vec3();
        }
    }
}
