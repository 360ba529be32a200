//! The CPU renderer's own ray search: an f64 tree of boxes split at the median.

use glam::DVec3;

/// Triangles of a body and a tree over them.
pub(crate) struct Tree {
    corners: Vec<[DVec3; 3]>,
    /// Body's triangle index and whether its back is visible, in the tree's order.
    ids: Vec<(u32, bool)>,
    nodes: Vec<Node>,
}

struct Node {
    low: DVec3,
    high: DVec3,
    /// Leaf: range of triangles. Inner: the right child's index, the left one follows the node.
    content: Content,
}

enum Content {
    Leaf(usize, usize),
    Inner(usize),
}

/// Where a ray met a triangle.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Meeting {
    pub distance: f64,
    pub triangle: u32,
    /// Weights of the second and third corner.
    pub weights: [f64; 2],
}

const LEAF: usize = 3;

impl Tree {
    pub(crate) fn new(corners: &[[DVec3; 3]], two_sided: impl Fn(usize) -> bool) -> Self {
        let mut ids: Vec<u32> = (0..corners.len() as u32).collect();
        let middles: Vec<DVec3> = corners.iter().map(|c| (c[0] + c[1] + c[2]) / 3.0).collect();
        let mut nodes = Vec::new();
        let end = ids.len();
        grow(&mut nodes, &mut ids, 0, end, corners, &middles);
        Self {
            corners: ids.iter().map(|&id| corners[id as usize]).collect(),
            ids: ids.iter().map(|&id| (id, two_sided(id as usize))).collect(),
            nodes,
        }
    }

    /// The nearest triangle facing the ray between distances `from` and `to`.
    pub(crate) fn nearest(&self, origin: DVec3, direction: DVec3, from: f64, to: f64) -> Option<Meeting> {
        let mut best: Option<Meeting> = None;
        let mut reach = to;
        self.walk(origin, direction, from, &mut reach, |index, reach| {
            let (id, two_sided) = self.ids[index];
            if let Some((distance, weights)) = meet(&self.corners[index], origin, direction, !two_sided)
                && distance > from
                && distance < *reach
            {
                *reach = distance;
                best = Some(Meeting { distance, triangle: id, weights });
            }
            false
        });
        best
    }

    /// Whether any triangle is in the way.
    pub(crate) fn blocks(&self, origin: DVec3, direction: DVec3) -> bool {
        let mut reach = f64::INFINITY;
        self.walk(origin, direction, 0.0, &mut reach, |index, _| {
            meet(&self.corners[index], origin, direction, false).is_some_and(|(distance, _)| distance > 0.0)
        })
    }

    /// Visits the triangles of every box the ray passes; true as soon as `visit` is.
    fn walk(
        &self,
        origin: DVec3,
        direction: DVec3,
        from: f64,
        reach: &mut f64,
        mut visit: impl FnMut(usize, &mut f64) -> bool,
    ) -> bool {
        let inverse = direction.recip();
        let mut stack = Vec::with_capacity(64);
        if !self.nodes.is_empty() {
            stack.push(0usize);
        }
        while let Some(index) = stack.pop() {
            let node = &self.nodes[index];
            if !crosses(node, origin, inverse, from, *reach) {
                continue;
            }
            match node.content {
                Content::Leaf(first, end) => {
                    for triangle in first..end {
                        if visit(triangle, reach) {
                            return true;
                        }
                    }
                }
                Content::Inner(right) => {
                    stack.push(right);
                    stack.push(index + 1);
                }
            }
        }
        false
    }
}

fn grow(
    nodes: &mut Vec<Node>,
    ids: &mut [u32],
    first: usize,
    end: usize,
    corners: &[[DVec3; 3]],
    middles: &[DVec3],
) {
    let own = &ids[first..end];
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for &id in own {
        for corner in corners[id as usize] {
            low = low.min(corner);
            high = high.max(corner);
        }
    }
    let index = nodes.len();
    nodes.push(Node { low, high, content: Content::Leaf(first, end) });
    if own.len() <= LEAF {
        return;
    }
    let size = high - low;
    let axis = if size.x >= size.y && size.x >= size.z {
        0
    } else if size.y >= size.z {
        1
    } else {
        2
    };
    let middle = own.len() / 2;
    ids[first..end].select_nth_unstable_by(middle, |&a, &b| {
        middles[a as usize][axis].total_cmp(&middles[b as usize][axis])
    });
    grow(nodes, ids, first, first + middle, corners, middles);
    let right = nodes.len();
    grow(nodes, ids, first + middle, end, corners, middles);
    nodes[index].content = Content::Inner(right);
}

fn crosses(node: &Node, origin: DVec3, inverse: DVec3, from: f64, to: f64) -> bool {
    let (mut enter, mut leave) = (from, to);
    for axis in 0..3 {
        let (a, b) = (
            (node.low[axis] - origin[axis]) * inverse[axis],
            (node.high[axis] - origin[axis]) * inverse[axis],
        );
        // A ray within a face gives NaN, which min and max pass over.
        enter = enter.max(a.min(b));
        leave = leave.min(a.max(b));
    }
    enter <= leave * (1.0 + 1e-14)
}

/// Moeller and Trumbore (1997): distance and the weights of the second and third corner.
fn meet(corners: &[DVec3; 3], origin: DVec3, direction: DVec3, front_only: bool) -> Option<(f64, [f64; 2])> {
    let (ab, ac) = (corners[1] - corners[0], corners[2] - corners[0]);
    let p = direction.cross(ac);
    let determinant = ab.dot(p);
    if determinant == 0.0 || (front_only && determinant < 0.0) {
        return None;
    }
    let from_a = origin - corners[0];
    let u = from_a.dot(p) / determinant;
    let q = from_a.cross(ab);
    let v = direction.dot(q) / determinant;
    // Rounding must not open a crack between neighbours.
    const CRACK: f64 = 1e-12;
    if u < -CRACK || v < -CRACK || u + v > 1.0 + CRACK {
        return None;
    }
    Some((ac.dot(q) / determinant, [u, v]))
}
