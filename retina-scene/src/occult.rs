//! Which point sources a scene's bodies hide.

use glam::{DVec3, Vec3};
use rayon::prelude::*;
use retina_model::Body;
use retina_render::BodyState;

use crate::inside::{is_inside, meets};

/// A surface hit nearer than this to a place on it, in radii of the body, is the place's own: far above rounding (1e-9 of
/// the camera's distance), far below relief.
const OWN_SURFACE: f64 = 1e-6;
/// Angle by which a ray is turned that passes between triangles, rad: two centimetres on the Moon.
const BESIDE: f64 = 1e-8;

/// The outline of a body, as far as it hides what is behind.
#[derive(Debug, Clone)]
pub(crate) struct Occulter {
    corners_m: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    /// A sphere about the centre that is wholly inside the body, m; 0 where there is none.
    inner_radius_m: f64,
    outer_radius_m: f64,
}

impl Occulter {
    pub(crate) fn of(shape: &Body, outer_radius_m: f64) -> Self {
        // The plane of a triangle is never farther than the triangle: the radius is a safe one.
        let nearest_plane_m = || {
            (0..shape.triangles.len())
                .filter_map(|triangle| {
                    let [a, b, c] = shape.corners_m(triangle);
                    (b - a).cross(c - a).try_normalize().map(|normal| normal.dot(a).abs())
                })
                .fold(f64::INFINITY, f64::min)
        };
        let about_centre = shape.is_closed() && is_inside(shape, DVec3::ZERO);
        Self {
            corners_m: shape.vertices.iter().map(|vertex| vertex.position_m.as_vec3()).collect(),
            triangles: shape.triangles.clone(),
            inner_radius_m: if about_centre { nearest_plane_m() } else { 0.0 },
            outer_radius_m,
        }
    }

    /// Whether the body hides a source in a direction (unit vector, camera axes) at a distance, m.
    pub(crate) fn hides(&self, at: &BodyState, direction_camera: DVec3, distance_m: f64) -> bool {
        let along_m = at.position_camera_m.dot(direction_camera);
        let miss_m = at.position_camera_m.cross(direction_camera).length();
        // The camera is outside the body, so what is nearer than its near side is in front of it.
        if along_m <= -self.outer_radius_m
            || miss_m >= self.outer_radius_m
            || distance_m <= along_m - self.outer_radius_m
        {
            return false;
        }
        if along_m > 0.0 && miss_m < self.inner_radius_m {
            return true;
        }
        let body_from_camera = at.camera_from_body.transpose();
        let camera_m = -(body_from_camera * at.position_camera_m);
        let direction = body_from_camera * direction_camera;
        self.triangles.par_iter().any(|corners| {
            meets(self.corners_of(corners), camera_m, direction).is_some_and(|met| met.distance < distance_m)
        })
    }

    /// Distance from the centre of the outermost surface in a direction (unit vector, body axes), m; `None` where there
    /// is none. A ray through an edge or a corner may pass all triangles by rounding: it is then turned by [`BESIDE`].
    pub(crate) fn surface_m(&self, direction_body: DVec3) -> Option<f64> {
        let outermost = |direction: DVec3| {
            let met = |corners: &[u32; 3]| {
                meets(self.corners_of(corners), DVec3::ZERO, direction).map(|met| met.distance)
            };
            self.triangles.par_iter().filter_map(met).reduce_with(f64::max)
        };
        let (along, across) = direction_body.any_orthonormal_pair();
        let beside = [(1.0, 0.37), (-0.37, 1.0), (-1.0, -0.37), (0.37, -1.0)];
        outermost(direction_body).or_else(|| {
            beside.iter().find_map(|(a, b)| {
                outermost((direction_body + BESIDE * (*a * along + *b * across)).normalize())
            })
        })
    }

    /// Whether the body hides a place on its own surface (body axes, m) from the camera.
    pub(crate) fn hides_own(&self, at: &BodyState, place_body_m: DVec3) -> bool {
        let camera_m = -(at.camera_from_body.transpose() * at.position_camera_m);
        let towards_m = place_body_m - camera_m;
        let distance_m = towards_m.length();
        let direction = towards_m / distance_m;
        // The place itself is on a triangle: what is hit there is no hindrance.
        let until_m = distance_m - OWN_SURFACE * self.outer_radius_m;
        let nearest = camera_m + direction * (-camera_m.dot(direction)).clamp(0.0, until_m.max(0.0));
        if nearest.length() < (1.0 - OWN_SURFACE) * self.inner_radius_m {
            return true;
        }
        self.triangles.par_iter().any(|corners| {
            meets(self.corners_of(corners), camera_m, direction).is_some_and(|met| met.distance < until_m)
        })
    }

    fn corners_of(&self, corners: &[u32; 3]) -> [DVec3; 3] {
        corners.map(|corner| self.corners_m[corner as usize].as_dvec3())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inside::tests::octahedron;
    use glam::DMat3;

    /// Rays from the centre through the corners and the edges of a ball of longitudes and latitudes, to rounding.
    #[test]
    fn rays_through_corners_and_edges_meet_the_surface() {
        let ball = crate::inside::tests::ball(36, 18);
        let occulter = Occulter::of(&ball, 1.0);
        for latitude in (-90..=90).step_by(5) {
            for longitude in (0..360).step_by(5) {
                let ((sin_b, cos_b), (sin_l, cos_l)) =
                    (f64::from(latitude).to_radians().sin_cos(), f64::from(longitude).to_radians().sin_cos());
                let direction = DVec3::new(cos_b * cos_l, cos_b * sin_l, sin_b);
                let distance = occulter.surface_m(direction);
                assert!(
                    distance.is_some_and(|d| (0.95..1.001).contains(&d)),
                    "{latitude} {longitude}: {distance:?}"
                );
            }
        }
    }

    #[test]
    fn an_octahedron_hides_what_is_behind_its_outline() {
        // Corners on the axes at 1 m; from far along z its outline is the square |x| + |y| <= 1.
        let occulter = Occulter::of(&octahedron(), 1.0);
        assert!((occulter.inner_radius_m - 1.0 / 3f64.sqrt()).abs() < 1e-6);
        let distance_m = 1e5;
        let state = BodyState {
            position_camera_m: DVec3::new(0.0, 0.0, distance_m),
            camera_from_body: DMat3::IDENTITY,
            sun_position_body_m: DVec3::X * 1e11,
        };
        let towards = |x: f64, y: f64| DVec3::new(x, y, distance_m).normalize();
        for (x, y) in [(0.0, 0.1), (0.3, 0.6), (0.499, 0.499), (-0.97, 0.01), (0.49, -0.49)] {
            assert!(occulter.hides(&state, towards(x, y), f64::INFINITY), "{x} {y}");
            assert!(!occulter.hides(&state, -towards(x, y), f64::INFINITY), "behind the camera");
            assert!(!occulter.hides(&state, towards(x, y), distance_m - 2.0), "in front of the body");
        }
        for (x, y) in [(0.51, 0.51), (0.9, 0.2), (-0.99, 0.02), (2.0, 0.0)] {
            assert!(!occulter.hides(&state, towards(x, y), f64::INFINITY), "{x} {y}");
        }
    }
}
