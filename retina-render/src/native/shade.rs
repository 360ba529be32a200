//! What is seen of a triangle within a pixel, and how it is lit (shaders/shared/surface.wgsl has the same for a sample).

use glam::{Vec2, Vec3};

use super::coverage::Square;
use super::frame::{Placed, Prepared};
use super::law::Law;
use super::texture::{Footprint, Grid, Taps};
use super::visibility::Setup;
use crate::arrays::{FLAT, NONE, PATCH, TWO_SIDED};

/// How the Sun lights a fragment.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Light {
    /// Nothing can stand before the Sun.
    Free,
    /// It faces away from the Sun.
    Away,
    /// The body's own relief may stand before the Sun, or another body, or both; the Sun may be rising.
    Doubt { own_relief: bool },
}

/// What a triangle's fragments have in common.
#[derive(Clone, Copy)]
pub(crate) struct Facet {
    pub body: u32,
    origin: Vec3,
    ab: Vec3,
    ac: Vec3,
    /// Unit; of a surface with two sides the one that is seen.
    geometric: Vec3,
    /// At the first corner, and what it grows by to the others. Of a flat surface the triangle's own.
    normal: Vec3,
    normal_ab: Vec3,
    normal_ac: Vec3,
    /// A move m in the plane changes the weights of b and c by m . to_b and m . to_c.
    to_b: Vec3,
    to_c: Vec3,
    uv: Vec2,
    uv_ab: Vec2,
    uv_ac: Vec2,
    /// Mean normal of the surroundings, and the sine of the Sun's elevation over it above which the body's own relief
    /// cannot hide it.
    horizon: (Vec3, f32),
    albedo_map: u32,
    slope_map: u32,
    albedo_factor: f32,
}

impl Facet {
    pub(crate) fn new(frame: &Prepared<'_>, triangle: u32) -> Self {
        let arrays = frame.arrays;
        let [a, b, c, surface] = arrays.triangles[triangle as usize];
        let surface = &arrays.surfaces[surface as usize];
        let [a, b, c] = [a, b, c].map(|vertex| &arrays.vertices[vertex as usize]);
        let [origin, at_b, at_c] = [a, b, c].map(|vertex| Vec3::from_array(vertex.position));
        let (ab, ac) = (at_b - origin, at_c - origin);
        let area_vector = ab.cross(ac);
        let area = area_vector.length().max(f32::MIN_POSITIVE);
        let mut geometric = area_vector / area;
        let (to_b, to_c) = (ac.cross(geometric) / area, geometric.cross(ab) / area);
        let mut normals = [a, b, c].map(|vertex| Vec3::from_array(vertex.normal));
        if surface.flags & FLAT != 0 {
            normals = [geometric; 3];
        }
        if surface.flags & TWO_SIDED != 0 && !frame.faces_camera(triangle) {
            geometric = -geometric;
            normals = normals.map(|normal| -normal);
        }
        let uv = Vec2::new(a.u, a.v);
        let [up_x, up_y, up_z, sine] = arrays.horizons[triangle as usize / PATCH];
        Self {
            body: surface.body,
            origin,
            ab,
            ac,
            geometric,
            normal: normals[0],
            normal_ab: normals[1] - normals[0],
            normal_ac: normals[2] - normals[0],
            to_b,
            to_c,
            uv,
            uv_ab: Vec2::new(b.u, b.v) - uv,
            uv_ac: Vec2::new(c.u, c.v) - uv,
            horizon: (Vec3::new(up_x, up_y, up_z), sine),
            albedo_map: surface.albedo_map,
            slope_map: surface.slope_map,
            albedo_factor: surface.albedo_factor,
        }
    }

    /// The point with these weights of the corners.
    pub(crate) fn point(&self, [_, weight_b, weight_c]: [f32; 3]) -> Vec3 {
        self.origin + self.ab * weight_b + self.ac * weight_c
    }

    /// How texture coordinates change with a move in the plane.
    fn uv_along(&self, moved: Vec3) -> Vec2 {
        self.uv_ab * moved.dot(self.to_b) + self.uv_ac * moved.dot(self.to_c)
    }

    /// A normal turned by a relief's slopes: tangent along growing u, bitangent along falling v (glTF), by the
    /// triangle's own texture coordinates.
    fn tilted(&self, normal: Vec3, tilt: Vec2) -> Vec3 {
        let turn_sign = self.uv_ab.perp_dot(self.uv_ac).signum();
        let along_u = (self.ab * self.uv_ac.y - self.ac * self.uv_ab.y) * turn_sign;
        let tangent = (along_u - normal * normal.dot(along_u)).normalize();
        let bitangent = -normal.cross(tangent) * turn_sign;
        (normal + tangent * tilt.x + bitangent * tilt.y).normalize()
    }
}

impl Texture {
    /// Where it is read within a pixel, and as what; `None` at the map's edge.
    #[inline(always)]
    fn grid(&self, square: &Square, factor: f32) -> Option<Grid> {
        let [x, y] = [0, 1].map(|k| square.middle[k] - self.middle[k]);
        let uv = self.uv + self.uv_x * x + self.uv_y * y;
        let along = square.steps.map(|[x, y]| self.uv_x * x + self.uv_y * y);
        self.taps.grid(&self.footprint, uv, along, factor)
    }
}

/// What a fragment's reads in a pixel have in common.
pub(crate) struct FragmentMap {
    /// `None` without a map, and at a map's edge.
    pub grid: Option<Grid>,
    /// Radiance of I/F 1.
    pub irradiance: f32,
}

/// The part of a triangle that a pixel sees, shaded in its middle.
#[derive(Clone, Copy)]
pub(crate) struct Fragment {
    /// Index of the tile's triangle.
    pub number: u32,
    pub body: u32,
    /// Its part of the pixel, by samples or measured.
    pub share: f32,
    /// Its part of the pixel's area, where that was measured.
    pub area: Option<f32>,
    pub geometric: Vec3,
    pub normal: Vec3,
    pub sun: Vec3,
    pub mu: f32,
    /// Cosine of the incidence angle of the Sun's middle.
    pub elevation: f32,
    pub cos_phase: f32,
    pub depth_m: f32,
    pub light: Light,
    /// I/F without the texture, if nothing stands before the Sun.
    pub value: f32,
    law: Law,
    albedo_factor: f32,
    texture: Option<Texture>,
}

#[derive(Clone, Copy)]
struct Texture {
    taps: Taps,
    footprint: Footprint,
    /// Texture coordinates in the middle of the fragment, and how they grow with the line of sight.
    uv: Vec2,
    uv_x: Vec2,
    uv_y: Vec2,
    middle: [f32; 2],
}

impl Fragment {
    /// Shades a triangle at a line of sight, x and y from the tile's reference. Textures are read at places
    /// `read_px` apart.
    pub(crate) fn new(
        frame: &Prepared<'_>,
        setup: &Setup,
        facet: &Facet,
        number: u32,
        sight: [f32; 2],
        [x, y]: [f32; 2],
        share: f32,
        read_px: f32,
    ) -> Self {
        let arrays = frame.arrays;
        let body = facet.body;
        let placed = &frame.placed[body as usize];
        let geometric = facet.geometric;
        let (weights, depth_m) = setup.weights_and_depth(x, y);
        let [_, weight_b, weight_c] = weights;
        let point = facet.point(weights);
        let direction = placed.across * (sight[0] + x) + placed.down * (sight[1] + y) + placed.ahead;
        let to_observer = -direction.normalize();
        let mut normal = (facet.normal + facet.normal_ab * weight_b + facet.normal_ac * weight_c).normalize();
        let depth_m = depth_m + frame.reference_depth_m as f32;
        let mut texture = None;
        if facet.albedo_map != NONE || facet.slope_map != NONE {
            // Where the plane's point moves when the line of sight does.
            let along = direction / direction.dot(geometric);
            let (right, down) = (placed.across * depth_m, placed.down * depth_m);
            let uv_x = facet.uv_along(right - along * right.dot(geometric));
            let uv_y = facet.uv_along(down - along * down.dot(geometric));
            let uv = facet.uv + facet.uv_ab * weight_b + facet.uv_ac * weight_c;
            let footprint = Footprint {
                along_x: uv_x * (read_px * frame.inverse_focal_px[0]),
                along_y: uv_y * (read_px * frame.inverse_focal_px[1]),
            };
            if facet.slope_map != NONE {
                let map = &arrays.maps[facet.slope_map as usize];
                let tilt = Taps::of(map, &footprint).slope(&arrays.texels, &footprint, uv);
                normal = facet.tilted(normal, tilt);
            }
            if facet.albedo_map != NONE {
                let taps = Taps::of(&arrays.maps[facet.albedo_map as usize], &footprint);
                texture = Some(Texture { taps, footprint, uv, uv_x, uv_y, middle: [x, y] });
            }
        }
        // What is seen faces the observer, also where the smooth normal of a facet at the limb does not.
        let mu = normal.dot(to_observer).max(1e-3);
        let sun = (placed.sun_direction - point * placed.inverse_sun_distance).normalize();
        let elevation = normal.dot(sun);
        let radius = placed.sun_angular_radius;
        let light = if elevation > -radius && geometric.dot(sun) > -radius {
            let (up, sine) = facet.horizon;
            let own_relief = up.dot(sun) < sine + radius;
            if own_relief || !placed.casters.is_empty() { Light::Doubt { own_relief } } else { Light::Free }
        } else {
            Light::Away
        };
        let cos_phase = sun.dot(to_observer);
        let law = if light == Light::Away { Law::DARK } else { placed.laws.at(cos_phase) };
        let mut out = Self {
            number,
            body,
            share,
            area: None,
            geometric,
            normal,
            sun,
            mu,
            elevation,
            cos_phase,
            depth_m,
            light,
            value: 0.0,
            law,
            albedo_factor: facet.albedo_factor,
            texture,
        };
        out.value = out.radiance_factor(placed, elevation);
        out
    }

    /// I/F without the texture under light of this incidence.
    pub(crate) fn radiance_factor(&self, placed: &Placed<'_>, mu0: f32) -> f32 {
        self.law.radiance_factor(placed.photometry, mu0, self.mu)
    }

    /// Relative albedo at a line of sight. Within a pixel texture coordinates grow evenly.
    pub(crate) fn albedo(&self, frame: &Prepared<'_>, [x, y]: [f32; 2]) -> f32 {
        match &self.texture {
            None => self.albedo_factor,
            Some(texture) => {
                let uv = texture.uv
                    + texture.uv_x * (x - texture.middle[0])
                    + texture.uv_y * (y - texture.middle[1]);
                self.albedo_factor * texture.taps.albedo(&frame.arrays.texels, &texture.footprint, uv)
            }
        }
    }

    /// What its reads in a pixel need.
    #[inline(always)]
    pub(crate) fn map(&self, square: &Square, irradiance: f32) -> FragmentMap {
        let grid = self.texture.as_ref().and_then(|texture| texture.grid(square, self.albedo_factor));
        FragmentMap { grid, irradiance }
    }

    /// Axes across the Sun's direction, as long as its disc's radius: along the horizon, and away from the surface.
    pub(crate) fn sun_axes(&self, placed: &Placed<'_>) -> [Vec3; 2] {
        let across = self.sun.any_orthonormal_vector();
        let up = (self.normal - self.sun * self.elevation + 1e-6 * across).normalize();
        [self.sun.cross(up) * placed.sun_tangent_radius, up * placed.sun_tangent_radius]
    }
}
