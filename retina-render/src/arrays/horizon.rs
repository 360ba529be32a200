//! Where no shadow rays are needed: for each patch of 8 triangles a bound on the elevation at
//! which the rest of the body can hide the Sun.
//!
//! The bound holds for every point of the patch. With `up` the patch's mean normal:
//! - Something farther than `near` from the patch: it rises at most H above the patch's lowest
//!   point at a distance of at least D, so it hides nothing above asin(H / D).
//! - The surroundings up to `near`: a surface whose slope against `up` nowhere exceeds s cannot
//!   rise above elevation s as seen from any of its points; with an overhang there is no bound.

use std::ops::Range;

use glam::Vec3A;
use rayon::prelude::*;

use super::bvh::Node;

/// Triangles in a patch; the shader divides triangle indices by it.
pub(crate) const PATCH: usize = 8;
/// Nodes beyond this many patch radii are bounded by height over distance.
const NEAR_RADII: f32 = 3.0;

/// Triangles before and after a patch that are looked at first.
const SURROUNDINGS: usize = 16;

/// For each patch its mean normal, and the sine of the Sun's elevation over it above which the Sun is in sight; 2 where
/// nothing is known. `corners` and `nodes` are one body's, the triangles in the order of the hierarchy.
pub(crate) fn horizons(corners: &[[Vec3A; 3]], nodes: &[Node]) -> Vec<[f32; 4]> {
    let discs = discs(corners, nodes);
    let body = BodyView { corners, nodes, discs: &discs };
    corners
        .par_chunks(PATCH)
        .enumerate()
        .map(|(number, patch)| {
            let first = number * PATCH;
            let (up, sine) = body.bound(first..first + patch.len());
            up.extend(if sine > 1.0 { UNKNOWN } else { sine }).to_array()
        })
        .collect()
}

struct BodyView<'a> {
    /// Of each triangle, in the order of the hierarchy.
    corners: &'a [[Vec3A; 3]],
    nodes: &'a [Node],
    /// Of each node.
    discs: &'a [Disc],
}

const UNKNOWN: f32 = 2.0;

/// A flat cylinder around all corners below a node: on a body's surface it is far thinner than the
/// node's box, whose corners stand out over a patch that lies askew to the axes.
#[derive(Clone, Copy)]
struct Disc {
    centre: Vec3A,
    /// Mean normal of the triangles.
    normal: Vec3A,
    radius: f32,
    half_thickness: f32,
    /// Cosine and sine of the largest angle between a triangle's normal and the mean.
    spread: [f32; 2],
}

/// Below this cosine between two normals a surface has no slope that bounds anything.
const STEEPEST: f32 = 0.1;

/// Nodes of more triangles than this are so large that only what is below them is of use.
const LARGEST_DISC: usize = 1 << 14;
/// What rounding may take off a disc's size.
const SLACK: f32 = 1.0 + 1e-5;

fn discs(corners: &[[Vec3A; 3]], nodes: &[Node]) -> Vec<Disc> {
    // The hierarchy is depth-first: below a node are the triangles from its first leaf's to the
    // next node's.
    let mut starts = vec![corners.len(); nodes.len() + 1];
    for (index, node) in nodes.iter().enumerate().rev() {
        starts[index] = if node.count > 0 { node.first as usize } else { starts[index + 1] };
    }
    nodes
        .par_iter()
        .enumerate()
        .map(|(index, node)| {
            let end = if node.count > 0 {
                starts[index] + node.count as usize
            } else {
                starts[node.escape as usize]
            };
            Disc::around(&corners[starts[index]..end])
        })
        .collect()
}

impl Disc {
    fn around(triangles: &[[Vec3A; 3]]) -> Self {
        let nothing = Self {
            centre: Vec3A::ZERO,
            normal: Vec3A::Z,
            radius: f32::INFINITY,
            half_thickness: f32::INFINITY,
            spread: [-1.0, 0.0],
        };
        if triangles.len() > LARGEST_DISC {
            return nothing;
        }
        let facet = |&[a, b, c]: &[Vec3A; 3]| (b - a).cross(c - a);
        let (mut normal, mut centre) = (Vec3A::ZERO, Vec3A::ZERO);
        for triangle in triangles {
            let [a, b, c] = *triangle;
            normal += facet(triangle);
            centre += a + b + c;
        }
        let Some(normal) = normal.try_normalize() else { return nothing };
        centre /= (3 * triangles.len()) as f32;
        let (mut radius, mut half_thickness) = (0.0f32, 0.0f32);
        for &corner in triangles.iter().flatten() {
            radius = radius.max((corner - centre).length_squared());
            half_thickness = half_thickness.max((corner - centre).dot(normal).abs());
        }
        let mut spread = [1.0f32, 0.0f32];
        for triangle in triangles {
            let facet = facet(triangle).normalize_or_zero();
            spread[0] = spread[0].min(facet.dot(normal));
            spread[1] = spread[1].max(facet.cross(normal).length());
        }
        Self {
            centre,
            normal,
            radius: radius.sqrt() * SLACK,
            half_thickness: half_thickness * SLACK,
            spread: [spread[0], spread[1] * SLACK],
        }
    }

    /// Sine of the steepest slope of its triangles against `up`, or 2 where one may be steeper than
    /// has a bound.
    fn slope(&self, up: Vec3A) -> f32 {
        let (cosine, sine) = (self.normal.dot(up), self.normal.cross(up).length());
        let [spread_cosine, spread_sine] = self.spread;
        // With both angles below a right one their sum's cosine says whether it is.
        let steepest = cosine * spread_cosine - sine * spread_sine;
        if cosine <= 0.0 || spread_cosine <= 0.0 || steepest < STEEPEST + 1e-4 {
            return UNKNOWN;
        }
        (sine * spread_cosine + cosine * spread_sine) * SLACK
    }

    /// The most that its points rise along `up` over `origin`.
    fn height(&self, origin: Vec3A, up: Vec3A) -> f32 {
        let (cosine, sine) = (self.normal.dot(up), self.normal.cross(up).length());
        (self.centre - origin).dot(up) + self.radius * sine + self.half_thickness * cosine.abs()
    }
}

impl BodyView<'_> {
    fn bound(&self, patch: Range<usize>) -> (Vec3A, f32) {
        let (mut up, mut centre, mut count) = (Vec3A::ZERO, Vec3A::ZERO, 0.0);
        for &[a, b, c] in &self.corners[patch.clone()] {
            up += (b - a).cross(c - a);
            centre += a + b + c;
            count += 3.0;
        }
        centre /= count;
        let Some(up) = up.try_normalize() else { return (Vec3A::Z, UNKNOWN) };
        let (mut radius, mut lowest) = (0.0f32, 0.0f32);
        for triangle in &self.corners[patch.clone()] {
            for &corner in triangle {
                radius = radius.max((corner - centre).length());
                lowest = lowest.min((corner - centre).dot(up));
            }
        }
        let near = NEAR_RADII * radius;
        let mut sine = 0.0f32;
        // The bound is a maximum over all triangles. Those next to the patch usually have it: with
        // them first, most of the hierarchy is passed over.
        let around =
            patch.start.saturating_sub(SURROUNDINGS)..(patch.end + SURROUNDINGS).min(self.corners.len());
        for triangle in &self.corners[around] {
            sine = sine.max(self.triangle_bound(triangle, centre, up, radius, lowest, near));
            if sine > 1.0 {
                return (up, UNKNOWN);
            }
        }
        let mut index = 0;
        while index < self.nodes.len() {
            let node = &self.nodes[index];
            let (low, high) = (Vec3A::from_array(node.low), Vec3A::from_array(node.high));
            let (middle, half) = ((low + high) * 0.5 - centre, (high - low) * 0.5);
            let height = middle.dot(up) + half.dot(up.abs());
            let height = height.min(self.discs[index].height(centre, up)) - lowest;
            let distance = (middle.abs() - half).max(Vec3A::ZERO).length();
            // Triangles nearer than `near` bound by their slope alone.
            let low_enough = height <= 0.0 || height <= sine * (distance.max(near) - radius);
            if low_enough && (distance > 1.5 * near || self.discs[index].slope(up) <= sine) {
                index = node.escape as usize;
                continue;
            }
            if node.count > 0 {
                let first = node.first as usize;
                for triangle in &self.corners[first..first + node.count as usize] {
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
        corners: &[Vec3A; 3],
        centre: Vec3A,
        up: Vec3A,
        radius: f32,
        lowest: f32,
        near: f32,
    ) -> f32 {
        let (mut low, mut high) = (Vec3A::INFINITY, Vec3A::NEG_INFINITY);
        let mut height = f32::NEG_INFINITY;
        for &corner in corners {
            low = low.min(corner - centre);
            high = high.max(corner - centre);
            height = height.max((corner - centre).dot(up) - lowest);
        }
        let distance = low.max(-high).max(Vec3A::ZERO).length();
        let mut sine = 0.0f32;
        if distance <= 1.5 * near {
            let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero();
            let cosine = normal.dot(up);
            if cosine < STEEPEST {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arrays::bvh;

    #[test]
    fn what_is_passed_over_would_not_raise_the_bound() {
        // A sphere with hills and a hollow, 192 x 96 quads; some bounds against all triangles in turn.
        let (columns, rows) = (192u32, 96u32);
        let position = |i: u32, j: u32| {
            let (longitude, latitude) = (
                i as f32 / columns as f32 * std::f32::consts::TAU,
                (0.02 + 0.96 * j as f32 / rows as f32) * std::f32::consts::PI,
            );
            let hills = 0.03 * (7.0 * longitude).sin() * (9.0 * latitude).cos();
            let hollow = -0.3 * (-20.0 * ((longitude - 2.0).powi(2) + (latitude - 1.2).powi(2))).exp();
            let radius = 1e5 * (1.0 + hills + hollow);
            let (sin, cos) = latitude.sin_cos();
            [radius * sin * longitude.cos(), radius * sin * longitude.sin(), radius * cos]
        };
        let index = |i: u32, j: u32| j * columns + i % columns;
        let positions: Vec<[f32; 3]> =
            (0..=rows).flat_map(|j| (0..columns).map(move |i| position(i, j))).collect();
        let triangles: Vec<[u32; 3]> = (0..rows)
            .flat_map(|j| (0..columns).map(move |i| (i, j)))
            .flat_map(|(i, j)| {
                let [a, b, c, d] = [index(i, j), index(i, j + 1), index(i + 1, j + 1), index(i + 1, j)];
                [[a, b, c], [a, c, d]]
            })
            .collect();
        let hierarchy = bvh::build(&positions, &triangles);
        let corners: Vec<[Vec3A; 3]> = hierarchy
            .order
            .iter()
            .map(|&t| triangles[t as usize].map(|v| Vec3A::from_array(positions[v as usize])))
            .collect();
        let discs = discs(&corners, &hierarchy.nodes);
        let body = BodyView { corners: &corners, nodes: &hierarchy.nodes, discs: &discs };
        // One node that holds everything: nothing can be passed over.
        let whole = [Node { escape: 1, first: 0, count: corners.len() as u32, ..hierarchy.nodes[0] }];
        let plain = BodyView { corners: &corners, nodes: &whole, discs: &discs[..1] };
        let (mut known, mut shadowed) = (0, 0);
        for first in (0..corners.len()).step_by(7 * PATCH) {
            let patch = first..first + PATCH;
            let (up, sine) = body.bound(patch.clone());
            assert_eq!((up, sine), plain.bound(patch));
            known += usize::from(sine <= 1.0);
            shadowed += usize::from(sine > 0.3 && sine <= 1.0);
        }
        assert!(known > 300 && shadowed > 20, "{known} {shadowed}");
    }
}
