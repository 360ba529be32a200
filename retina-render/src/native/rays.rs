//! Whether rays are blocked: eight at a time through a body's hierarchy.

use glam::{Mat3, Vec3};
use retina_simd::{Kernel, max, min};

use crate::arrays::SceneArrays;
use crate::arrays::bvh::Node;

/// Rays that walk together.
pub(crate) const LANES: usize = 8;

pub(crate) type Lane = [f32; LANES];

/// Rays in a body's axes. Unused lanes hold copies of a used one.
#[derive(Clone, Copy, Default)]
pub(crate) struct Packet {
    pub origin: [Lane; 3],
    pub direction: [Lane; 3],
}

impl Packet {
    /// Sets the ray of lane `k`.
    #[inline(always)]
    pub(crate) fn set(&mut self, k: usize, origin: Vec3, direction: Vec3) {
        for axis in 0..3 {
            self.origin[axis][k] = origin[axis];
            self.direction[axis][k] = direction[axis];
        }
    }

    /// The same rays in another body's axes.
    pub(crate) fn moved(&self, turn: &Mat3, shift: Vec3) -> Self {
        let mut out = Self::default();
        for k in 0..LANES {
            let vector = |axes: &[Lane; 3]| Vec3::new(axes[0][k], axes[1][k], axes[2][k]);
            out.set(k, *turn * vector(&self.origin) + shift, *turn * vector(&self.direction));
        }
        out
    }
}

/// Which of the rays in `open` (one bit a lane) meet something of a body on their way.
pub(crate) struct Blocked<'a> {
    pub arrays: &'a SceneArrays,
    pub body: usize,
    pub rays: &'a Packet,
    pub open: u32,
}

impl Kernel for Blocked<'_> {
    type Output = u32;

    #[inline(always)]
    fn run(self) -> u32 {
        let Self { arrays, body, rays, open } = self;
        let range = &arrays.ranges[body];
        let nodes = &arrays.nodes[range.node_first as usize..range.node_end as usize];
        // Zeros are made tiny, so that a box is never missed for a 0 * inf.
        let inverse = rays.direction.map(|axis| axis.map(|d| 1.0 / if d.abs() < 1e-20 { 1e-20 } else { d }));
        let mut live: [u32; LANES] = std::array::from_fn(|k| 0u32.wrapping_sub(open >> k & 1));
        let mut found = 0;
        let mut at = 0;
        while let Some(node) = nodes.get(at) {
            if !passes(node, rays, &inverse, &live) {
                at = node.escape as usize;
                continue;
            }
            for triangle in node.first..node.first + node.count {
                let met = meets(&arrays.corners[triangle as usize], rays, &live);
                if met != 0 {
                    found |= met;
                    if found == open {
                        return found;
                    }
                    for (k, lane) in live.iter_mut().enumerate() {
                        *lane &= (met >> k & 1).wrapping_sub(1);
                    }
                }
            }
            at += 1;
        }
        found
    }
}

/// Whether a live ray passes a node's box.
#[inline(always)]
fn passes(node: &Node, rays: &Packet, inverse: &[Lane; 3], live: &[u32; LANES]) -> bool {
    let mut hits = [0u32; LANES];
    for k in 0..LANES {
        let (mut near, mut far) = (0.0f32, f32::INFINITY);
        for axis in 0..3 {
            let a = (node.low[axis] - rays.origin[axis][k]) * inverse[axis][k];
            let b = (node.high[axis] - rays.origin[axis][k]) * inverse[axis][k];
            near = max(near, min(a, b));
            far = min(far, max(a, b));
        }
        hits[k] = u32::from(near <= far) & live[k];
    }
    hits.iter().fold(0, |all, hit| all | hit) != 0
}

/// Which live rays meet a triangle, seen from either side, as bits. Edge functions of shared edges are exact negatives
/// of each other, so no ray slips between two triangles.
#[inline(always)]
fn meets(corners: &[[f32; 4]; 3], rays: &Packet, live: &[u32; LANES]) -> u32 {
    let mut hits = [0u32; LANES];
    for k in 0..LANES {
        let at = |corner: usize, axis: usize| corners[corner][axis] - rays.origin[axis][k];
        let a = [at(0, 0), at(0, 1), at(0, 2)];
        let b = [at(1, 0), at(1, 1), at(1, 2)];
        let c = [at(2, 0), at(2, 1), at(2, 2)];
        let d = [rays.direction[0][k], rays.direction[1][k], rays.direction[2][k]];
        let cross = |p: [f32; 3], q: [f32; 3]| {
            [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]]
        };
        let dot = |p: [f32; 3], q: [f32; 3]| p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
        let (u, v, w) = (dot(d, cross(b, c)), dot(d, cross(c, a)), dot(d, cross(a, b)));
        let sum = u + v + w;
        let one_side = (max(u, max(v, w)) <= 0.0) | (min(u, min(v, w)) >= 0.0);
        // The parameter's sign: (u a + v b + w c) . d / (u + v + w).
        let along = u * dot(a, d) + v * dot(b, d) + w * dot(c, d);
        hits[k] = u32::from(one_side & (along * sum > 0.0)) & live[k];
    }
    hits.iter().enumerate().fold(0, |all, (k, hit)| all | hit << k)
}
