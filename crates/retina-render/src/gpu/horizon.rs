//! Where no shadow rays are needed: for each patch of 8 triangles a bound on the elevation at
//! which the rest of the body can hide the Sun.
//!
//! The bound holds for every point of the patch. With `up` the patch's mean normal:
//! - Something farther than `near` from the patch: it rises at most H above the patch's lowest
//!   point at a distance of at least D, so it hides nothing above asin(H / D).
//! - The surroundings up to `near`: a surface whose slope against `up` nowhere exceeds s cannot
//!   rise above elevation s as seen from any of its points; with an overhang there is no bound.

use glam::Vec3A;
use rayon::prelude::*;

use super::bvh::Node;
use super::layout::Vertex;

/// Triangles in a patch; the shader divides triangle indices by it.
pub(crate) const PATCH: usize = 8;
/// Nodes beyond this many patch radii are bounded by height over distance.
const NEAR_RADII: f32 = 3.0;

/// For each patch the sine of the Sun's elevation over the local normal (of the facets, and of the
/// vertices where they are smooth) above which it is in sight; 2 where nothing is known.
/// `triangles` and `nodes` are one body's, `first_triangle` where its triangles start.
pub(crate) fn horizons(
    vertices: &[Vertex],
    triangles: &[[u32; 4]],
    nodes: &[Node],
    first_triangle: u32,
) -> Vec<f32> {
    let corner = |index: u32| Vec3A::from_array(vertices[index as usize].position);
    let body =
        BodyView { corners: &|t: &[u32; 4]| [corner(t[0]), corner(t[1]), corner(t[2])], triangles, nodes };
    triangles
        .par_chunks(PATCH)
        .map(|patch| {
            let (up, sine) = body.bound(patch, first_triangle);
            if sine > 1.0 {
                return UNKNOWN;
            }
            // Elevations over `up` become elevations over the normals that shading has.
            let mut deviation = 0.0f32;
            for triangle in patch {
                let [a, b, c] = (body.corners)(triangle);
                let facet = (b - a).cross(c - a).normalize_or_zero();
                deviation = deviation.max(facet.angle_between(up));
                for &index in &triangle[..3] {
                    let normal = Vec3A::from_array(vertices[index as usize].normal);
                    deviation = deviation.max(normal.angle_between(up));
                }
            }
            let elevation = sine.asin() + deviation;
            if elevation < std::f32::consts::FRAC_PI_2 { elevation.sin() } else { UNKNOWN }
        })
        .collect()
}

struct BodyView<'a> {
    corners: &'a (dyn Fn(&[u32; 4]) -> [Vec3A; 3] + Sync),
    triangles: &'a [[u32; 4]],
    nodes: &'a [Node],
}

const UNKNOWN: f32 = 2.0;

impl BodyView<'_> {
    fn bound(&self, patch: &[[u32; 4]], first_triangle: u32) -> (Vec3A, f32) {
        let (mut up, mut centre, mut count) = (Vec3A::ZERO, Vec3A::ZERO, 0.0);
        for triangle in patch {
            let [a, b, c] = (self.corners)(triangle);
            up += (b - a).cross(c - a);
            centre += a + b + c;
            count += 3.0;
        }
        centre /= count;
        let Some(up) = up.try_normalize() else { return (Vec3A::Z, UNKNOWN) };
        let (mut radius, mut lowest) = (0.0f32, 0.0f32);
        for triangle in patch {
            for corner in (self.corners)(triangle) {
                radius = radius.max((corner - centre).length());
                lowest = lowest.min((corner - centre).dot(up));
            }
        }
        let near = NEAR_RADII * radius;
        let mut sine = 0.0f32;
        let mut index = 0;
        while index < self.nodes.len() {
            let node = &self.nodes[index];
            let (low, high) = (Vec3A::from_array(node.low), Vec3A::from_array(node.high));
            let (middle, half) = ((low + high) * 0.5 - centre, (high - low) * 0.5);
            let height = middle.dot(up) + half.dot(up.abs()) - lowest;
            let distance = (middle.abs() - half).max(Vec3A::ZERO).length();
            let beyond_near = distance > 1.5 * near;
            let harmless = height <= 0.0 || height <= sine * (distance - radius);
            if beyond_near && harmless {
                index = node.escape as usize;
                continue;
            }
            if node.count > 0 {
                let first = (node.first - first_triangle) as usize;
                for triangle in &self.triangles[first..first + node.count as usize] {
                    sine = sine.max(self.triangle_bound(triangle, centre, up, radius, lowest, near));
                    if sine > 1.0 {
                        return (up, UNKNOWN);
                    }
                }
            }
            index += 1;
        }
        (up, sine)
    }

    fn triangle_bound(
        &self,
        triangle: &[u32; 4],
        centre: Vec3A,
        up: Vec3A,
        radius: f32,
        lowest: f32,
        near: f32,
    ) -> f32 {
        let corners = (self.corners)(triangle);
        let (mut low, mut high) = (Vec3A::INFINITY, Vec3A::NEG_INFINITY);
        let mut height = f32::NEG_INFINITY;
        for corner in corners {
            low = low.min(corner - centre);
            high = high.max(corner - centre);
            height = height.max((corner - centre).dot(up) - lowest);
        }
        let distance = low.max(-high).max(Vec3A::ZERO).length();
        let mut sine = 0.0f32;
        if distance <= 1.5 * near {
            let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero();
            let cosine = normal.dot(up);
            if cosine < 0.1 {
                return UNKNOWN;
            }
            sine = (1.0 - cosine * cosine).max(0.0).sqrt();
        }
        if distance > near && height > 0.0 {
            sine = sine.max(height / (distance - radius));
        }
        sine
    }
}
