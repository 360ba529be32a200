//! Whether a point is inside a closed mesh.

use glam::DVec3;
use retina_model::Body;

/// Whether a ray from `point_m` away from the body's centre leaves the mesh more often than it
/// enters it: then the point is nearer to the centre than the surface above it.
pub(crate) fn is_inside(shape: &Body, point_m: DVec3) -> bool {
    // Slightly off the radius, so that the ray of a camera on an axis misses the mesh's own edges.
    let direction = (point_m.normalize_or(DVec3::Z) + DVec3::new(1.37e-5, -2.11e-5, 0.83e-5)).normalize();
    let net: i64 = (0..shape.triangles.len()).map(|t| crossing(shape.corners_m(t), point_m, direction)).sum();
    net > 0
}

/// Where a ray meets a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Met {
    /// Along the ray, in lengths of its direction; above 0.
    pub(crate) distance: f64,
    /// The ray goes out along the triangle's normal.
    pub(crate) outward: bool,
}

/// Where a ray meets a triangle, if it does (Moeller and Trumbore 1997).
pub(crate) fn meets([a, b, c]: [DVec3; 3], origin: DVec3, direction: DVec3) -> Option<Met> {
    let (ab, ac) = (b - a, c - a);
    let across = direction.cross(ac);
    let determinant = ab.dot(across);
    if determinant == 0.0 {
        return None;
    }
    let from_a = origin - a;
    let u = from_a.dot(across) / determinant;
    let along = from_a.cross(ab);
    let v = direction.dot(along) / determinant;
    let distance = ac.dot(along) / determinant;
    // The determinant is -direction . normal: negative where the ray goes out along the normal.
    let met = u >= 0.0 && v >= 0.0 && u + v <= 1.0 && distance > 0.0;
    met.then_some(Met { distance, outward: determinant < 0.0 })
}

/// +1 where the ray leaves through the triangle, -1 where it enters, 0 where it misses.
fn crossing(corners_m: [DVec3; 3], origin: DVec3, direction: DVec3) -> i64 {
    meets(corners_m, origin, direction).map_or(0, |met| if met.outward { 1 } else { -1 })
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use retina_model::{Surface, Vertex};

    /// An octahedron of radius 1 with outward triangles.
    pub(crate) fn octahedron() -> Body {
        let corners = [DVec3::X, DVec3::Y, DVec3::Z, -DVec3::X, -DVec3::Y, -DVec3::Z];
        body(
            &corners,
            vec![[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]],
        )
    }

    /// A ball of radius 1 by its longitudes and latitudes, with outward triangles.
    pub(crate) fn ball(longitudes: u32, latitudes: u32) -> Body {
        let corner = |row: u32, column: u32| {
            let latitude = (f64::from(row) / f64::from(latitudes) - 0.5) * std::f64::consts::PI;
            let longitude = f64::from(column) / f64::from(longitudes) * std::f64::consts::TAU;
            DVec3::new(latitude.cos() * longitude.cos(), latitude.cos() * longitude.sin(), latitude.sin())
        };
        let corners: Vec<DVec3> =
            (0..=latitudes).flat_map(|row| (0..longitudes).map(move |column| corner(row, column))).collect();
        let triangles = (0..latitudes)
            .flat_map(|row| {
                (0..longitudes).flat_map(move |column| {
                    let at = |up: u32, right: u32| (row + up) * longitudes + (column + right) % longitudes;
                    // At the poles one of the two has no area.
                    let lower = (row > 0).then(|| [at(0, 0), at(0, 1), at(1, 1)]);
                    let upper = (row + 1 < latitudes).then(|| [at(0, 0), at(1, 1), at(1, 0)]);
                    lower.into_iter().chain(upper)
                })
            })
            .collect();
        body(&corners, triangles)
    }

    fn body(corners: &[DVec3], triangles: Vec<[u32; 3]>) -> Body {
        let vertices = corners
            .iter()
            .map(|&position_m| Vertex { position_m, normal: position_m.as_vec3(), uv: glam::Vec2::ZERO })
            .collect();
        let surface = Surface {
            name: String::new(),
            flat: true,
            albedo_map: None,
            albedo_factor: 1.0,
            slope_map: None,
            double_sided: false,
        };
        let triangle_surface = vec![0; triangles.len()];
        Body { vertices, triangles, triangle_surface, surfaces: vec![surface], ..Body::default() }
    }

    #[test]
    fn points_of_an_octahedron() {
        let shape = octahedron();
        for (point, inside) in [
            (DVec3::new(0.3, 0.3, 0.3), true),
            (DVec3::new(0.4, 0.4, 0.4), false),
            (DVec3::new(0.0, 0.0, 0.99), true),
            (DVec3::new(0.0, 0.0, 1.01), false),
            (DVec3::new(-0.6, 0.0, 0.3), true),
            (DVec3::new(-0.8, 0.0, -0.3), false),
            (DVec3::ZERO, true),
        ] {
            assert_eq!(is_inside(&shape, point), inside, "{point}");
        }
    }
}
