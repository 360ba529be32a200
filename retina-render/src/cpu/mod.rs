//! The CPU renderer: an f64 ray caster with its own intersection, textures and sampling. It is the reference that the
//! images of the GPU and of the native renderer are held against; it shares no code with them but the formulas of
//! retina-radiometry.

mod texture;
mod tree;

use glam::{DMat3, DVec2, DVec3};
use rayon::prelude::*;
use retina_radiometry::{Geometry, sun_angular_radius_rad, sun_irradiance_w_m2_nm};

use crate::frame::contrast_reference;
use crate::small::{Window, small_disc};
use crate::{BodyModel, FrameState, Planes, Quality, RadianceImage};
use texture::Pyramid;
use tree::Tree;

/// How finely the CPU renderer samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CpuSampling {
    /// Samples along each axis of every pixel.
    pub grid: u32,
    /// Samples along each axis of a pixel on an edge or of high contrast.
    pub refined_grid: u32,
    /// Points on the Sun's disc for each sample.
    pub sun_points: u32,
    /// Contrast between samples, in the body's mean radiance factor, above which a pixel is refined.
    pub contrast: f64,
}

impl From<Quality> for CpuSampling {
    fn from(quality: Quality) -> Self {
        let contrast = quality.contrast();
        match quality {
            Quality::Draft => Self { grid: 2, refined_grid: 4, sun_points: 1, contrast },
            Quality::Default => Self { grid: 4, refined_grid: 12, sun_points: 1, contrast },
            Quality::Best => Self { grid: 6, refined_grid: 24, sun_points: 2, contrast },
        }
    }
}

/// A renderer of one set of bodies on the CPU.
pub struct CpuRenderer {
    bodies: Vec<CpuBody>,
    sampling: CpuSampling,
    planes: Planes,
}

struct CpuBody {
    model: BodyModel,
    tree: Tree,
    albedo: Vec<Pyramid<f64>>,
    slopes: Vec<Pyramid<DVec2>>,
    bounding_radius_m: f64,
}

/// A body in the frame at hand.
struct Placed<'a> {
    body: &'a CpuBody,
    camera_from_body: DMat3,
    body_from_camera: DMat3,
    position_camera_m: DVec3,
    camera_in_body_m: DVec3,
    sun_in_body_m: DVec3,
    irradiance_w_m2_nm: f64,
    contrast: f64,
}

/// What one ray saw.
#[derive(Clone, Copy, Default)]
struct Seen {
    radiance: f64,
    radiance_factor: f64,
    depth_m: f64,
    normal: DVec3,
    angles_rad: [f64; 3],
    shadow: f64,
    /// Body + 1; 0 is the sky.
    body: usize,
}

impl CpuRenderer {
    /// Prepares the bodies.
    pub fn new(models: Vec<BodyModel>, sampling: CpuSampling, planes: Planes) -> Self {
        let bodies = models
            .into_par_iter()
            .map(|model| {
                let shape = &model.shape;
                let corners: Vec<_> =
                    (0..shape.triangles.len()).map(|triangle| shape.corners_m(triangle)).collect();
                let two_sided = |triangle: usize| {
                    shape.surfaces[usize::from(shape.triangle_surface[triangle])].double_sided
                };
                CpuBody {
                    tree: Tree::new(&corners, two_sided),
                    albedo: shape.albedo_maps.iter().map(Pyramid::of_albedo).collect(),
                    slopes: shape.slope_maps.iter().map(Pyramid::of_slopes).collect(),
                    bounding_radius_m: shape.bounding_radius_m(),
                    model,
                }
            })
            .collect();
        Self { bodies, sampling, planes }
    }

    /// Renders a frame.
    pub fn render(&self, state: &FrameState) -> RadianceImage {
        let radii_m: Vec<f64> = self.bodies.iter().map(|body| body.bounding_radius_m).collect();
        match Window::of(state, &radii_m) {
            Some((window, enlarged)) => window.place(&self.render_as_is(&enlarged, &radii_m)),
            None => self.render_as_is(state, &radii_m),
        }
    }

    fn render_as_is(&self, state: &FrameState, radii_m: &[f64]) -> RadianceImage {
        let small: Vec<(DVec2, f64)> = radii_m
            .iter()
            .enumerate()
            .filter_map(|(body, &radius_m)| small_disc(state, body, radius_m))
            .collect();
        let placed: Vec<Placed<'_>> = self
            .bodies
            .iter()
            .zip(&state.bodies)
            .map(|(body, at)| {
                let body_from_camera = at.camera_from_body.transpose();
                let distance_m = at.sun_position_body_m.length();
                Placed {
                    body,
                    camera_from_body: at.camera_from_body,
                    body_from_camera,
                    position_camera_m: at.position_camera_m,
                    camera_in_body_m: -(body_from_camera * at.position_camera_m),
                    sun_in_body_m: at.sun_position_body_m,
                    irradiance_w_m2_nm: sun_irradiance_w_m2_nm(distance_m),
                    contrast: self.sampling.contrast
                        * contrast_reference(&body.model.photometry, at.phase_rad()),
                }
            })
            .collect();
        let (width, height) = (state.image.width_px as usize, state.image.height_px as usize);
        let planes = self.planes.count();
        let rows: Vec<Vec<f32>> = (0..height)
            .into_par_iter()
            .map(|y| {
                let mut row = vec![0f32; width * planes];
                for x in 0..width {
                    let values = self.pixel(state, &placed, &small, DVec2::new(x as f64, y as f64));
                    for (plane, value) in values.iter().take(planes).enumerate() {
                        row[plane * width + x] = *value as f32;
                    }
                }
                row
            })
            .collect();
        let mut data = vec![0f32; width * height * planes];
        for (y, row) in rows.iter().enumerate() {
            for plane in 0..planes {
                let at = plane * width * height + y * width;
                data[at..at + width].copy_from_slice(&row[plane * width..(plane + 1) * width]);
            }
        }
        RadianceImage {
            width_px: state.image.width_px,
            height_px: state.image.height_px,
            data,
            photocentre_px: None,
        }
    }

    /// Mean over a pixel of the planes of [`crate::PLANE_NAMES`].
    fn pixel(
        &self,
        state: &FrameState,
        placed: &[Placed<'_>],
        small: &[(DVec2, f64)],
        corner: DVec2,
    ) -> [f64; 11] {
        // The corners are looked at too: an edge that only clips the pixel counts.
        let sight = |offset: DVec2| {
            let undistorted = state.image.line_of_sight(corner + offset);
            state.distortion.as_ref().map_or(undistorted, |d| d.distort(undistorted))
        };
        let corner_body = |offset: DVec2| trace(placed, sight(offset)).map_or(0, |(body, _)| body + 1);
        let first = corner_body(DVec2::new(0.5, 0.5));
        let edge = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)]
            .iter()
            .any(|&(x, y)| corner_body(DVec2::new(x, y)) != first)
            // A body of a few pixels may slip between all of them.
            || small.iter().any(|(at, radius_px)| at.distance(corner + 0.5) < radius_px + 1.0);
        if !edge && first == 0 {
            return [0.0; 11];
        }
        let sample = |grid: u32| -> Vec<Seen> {
            (0..grid * grid)
                .map(|k| {
                    let offset =
                        (DVec2::new(f64::from(k % grid), f64::from(k / grid)) + 0.5) / f64::from(grid);
                    self.see(state, placed, sight(offset), grid, k)
                })
                .collect()
        };
        let mut seen = sample(if edge { self.sampling.refined_grid } else { self.sampling.grid });
        if !edge {
            let values = seen.iter().map(|s| s.radiance_factor);
            let (least, most) = values.fold((f64::INFINITY, 0.0f64), |(a, b), v| (a.min(v), b.max(v)));
            if most - least > placed[first - 1].contrast {
                seen = sample(self.sampling.refined_grid);
            }
        }
        average(&seen)
    }

    /// What one line of sight sees. `grid` and `k` say which of a pixel's samples it is.
    fn see(&self, state: &FrameState, placed: &[Placed<'_>], sight: DVec2, grid: u32, k: u32) -> Seen {
        let Some((index, meeting)) = trace(placed, sight) else { return Seen::default() };
        let at = &placed[index];
        let shape = &at.body.model.shape;
        let direction_camera = sight.extend(1.0);
        let direction = at.body_from_camera * direction_camera;
        let corners = shape.triangles[meeting.triangle as usize];
        let [a, b, c] = corners.map(|vertex| &shape.vertices[vertex as usize]);
        let [wb, wc] = meeting.weights;
        let wa = 1.0 - wb - wc;
        let surface = &shape.surfaces[usize::from(shape.triangle_surface[meeting.triangle as usize])];
        let (ab, ac) = (b.position_m - a.position_m, c.position_m - a.position_m);
        let area_vector = ab.cross(ac);
        let mut geometric = area_vector.normalize();
        let to_observer = -direction.normalize();
        let mut normal = if surface.flat {
            geometric
        } else {
            (a.normal.as_dvec3() * wa + b.normal.as_dvec3() * wb + c.normal.as_dvec3() * wc).normalize()
        };
        if surface.double_sided && geometric.dot(to_observer) < 0.0 {
            (geometric, normal) = (-geometric, -normal);
        }
        let point = at.camera_in_body_m + direction * meeting.distance;

        let mut map_factor = f64::from(surface.albedo_factor);
        let uv = (a.uv.as_dvec2() * wa) + (b.uv.as_dvec2() * wb) + (c.uv.as_dvec2() * wc);
        let (uv_ab, uv_ac) = ((b.uv - a.uv).as_dvec2(), (c.uv - a.uv).as_dvec2());
        let sample_m = meeting.distance / state.image.fx_px / f64::from(grid);
        let slant = geometric.dot(to_observer).abs().max(0.02);
        let uv_per_m2 = uv_ab.perp_dot(uv_ac).abs() / area_vector.length();
        let footprint_uv2 =
            (sample_m * direction_camera.length()).powi(2) / slant * uv_per_m2 / direction_camera.length();
        if let Some(map) = surface.albedo_map {
            map_factor *= at.body.albedo[map].value(uv, footprint_uv2);
        }
        if let Some(map) = surface.slope_map {
            let slope = at.body.slopes[map].value(uv, footprint_uv2);
            // Tangent and bitangent along growing u and falling v (glTF), solved from the triangle.
            let determinant = uv_ab.perp_dot(uv_ac);
            let along_u = (ab * uv_ac.y - ac * uv_ab.y) / determinant;
            let along_v = (ac * uv_ab.x - ab * uv_ac.x) / determinant;
            let tangent = along_u.reject_from_normalized(normal).normalize();
            let down = normal.cross(tangent);
            let bitangent = if down.dot(along_v) > 0.0 { -down } else { down };
            normal = (normal + tangent * slope.x + bitangent * slope.y).normalize();
        }

        let to_sun = at.sun_in_body_m - point;
        let sun = to_sun.normalize();
        let phase_rad = sun.angle_between(to_observer);
        // A smooth normal at the limb may turn away from an observer who sees its facet.
        let mu = normal.dot(to_observer).max(1e-3);
        let radius = sun_angular_radius_rad(to_sun.length()).tan();
        let (u, v) = sun.any_orthonormal_pair();
        let origin = point + geometric * (1e-8 * at.body.bounding_radius_m);
        let (mut sum, mut lit) = (0.0, 0.0);
        let n = self.sampling.sun_points;
        for j in 0..n {
            // Equal areas of the disc: rings by the fine index, angles spread by the golden section.
            let index = f64::from(k * n + j) + 0.5;
            let total = f64::from(grid * grid * n);
            let ring = (index * 0.754_877_666_246_692_7).fract();
            let angle = std::f64::consts::TAU * (index / total);
            let offset = ring.sqrt() * radius;
            let towards = (sun + u * (offset * angle.cos()) + v * (offset * angle.sin())).normalize();
            let mu0 = normal.dot(towards);
            if mu0 > 0.0
                && geometric.dot(towards) > 0.0
                && !in_shadow(placed, index_of(placed, at), origin, towards)
            {
                sum += at.body.model.photometry.radiance_factor(Geometry { mu0, mu, phase_rad });
                lit += 1.0;
            }
        }
        let radiance_factor = sum / f64::from(n) * map_factor;
        Seen {
            radiance: radiance_factor * at.irradiance_w_m2_nm / std::f64::consts::PI,
            radiance_factor,
            depth_m: meeting.distance,
            normal: at.camera_from_body * normal,
            angles_rad: [normal.angle_between(sun), normal.angle_between(to_observer), phase_rad],
            shadow: 1.0 - lit / f64::from(n),
            body: index + 1,
        }
    }
}

fn index_of(placed: &[Placed<'_>], at: &Placed<'_>) -> usize {
    placed.iter().position(|other| std::ptr::eq(other, at)).unwrap_or(0)
}

/// The nearest body and meeting along a line of sight; distances are depths along the boresight.
fn trace(placed: &[Placed<'_>], sight: DVec2) -> Option<(usize, tree::Meeting)> {
    let mut best: Option<(usize, tree::Meeting)> = None;
    for (index, at) in placed.iter().enumerate() {
        let direction = at.body_from_camera * sight.extend(1.0);
        let reach = best.map_or(f64::INFINITY, |(_, meeting)| meeting.distance);
        if let Some(meeting) = at.body.tree.nearest(at.camera_in_body_m, direction, 0.0, reach) {
            best = Some((index, meeting));
        }
    }
    best
}

/// Whether any body hides the Sun's point in direction `towards` (axes of body `own`).
fn in_shadow(placed: &[Placed<'_>], own: usize, origin: DVec3, towards: DVec3) -> bool {
    let receiver = &placed[own];
    placed.iter().enumerate().any(|(index, other)| {
        if index == own {
            return other.body.tree.blocks(origin, towards);
        }
        let origin_camera = receiver.camera_from_body * origin + receiver.position_camera_m;
        let origin_other = other.body_from_camera * (origin_camera - other.position_camera_m);
        other.body.tree.blocks(origin_other, other.body_from_camera * (receiver.camera_from_body * towards))
    })
}

/// Radiance, I/F and coverage over all samples; the other planes over those that hit.
fn average(seen: &[Seen]) -> [f64; 11] {
    let count = seen.len() as f64;
    let hits = seen.iter().filter(|s| s.body > 0).count() as f64;
    let over = |value: &dyn Fn(&Seen) -> f64| seen.iter().map(value).sum::<f64>();
    let normal = seen.iter().map(|s| s.normal).sum::<DVec3>().normalize_or_zero();
    let per_hit = |value: &dyn Fn(&Seen) -> f64| if hits > 0.0 { over(value) / hits } else { 0.0 };
    [
        over(&|s| s.radiance) / count,
        over(&|s| s.radiance_factor) / count,
        hits / count,
        per_hit(&|s| s.depth_m),
        normal.x,
        normal.y,
        normal.z,
        per_hit(&|s| s.angles_rad[0]).to_degrees(),
        per_hit(&|s| s.angles_rad[1]).to_degrees(),
        per_hit(&|s| s.angles_rad[2]).to_degrees(),
        per_hit(&|s| s.shadow),
    ]
}
