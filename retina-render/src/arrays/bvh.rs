//! The bounding volume hierarchy that rays walk.

use bytemuck::{Pod, Zeroable};

/// A node, depth-first: an inner node's first child is the next node.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub(crate) struct Node {
    pub low: [f32; 3],
    pub high: [f32; 3],
    /// Where to go on when the box is missed.
    pub escape: u32,
    /// Triangles of a leaf; none for an inner node.
    pub first: u32,
    pub count: u32,
}

/// A hierarchy in depth-first order, and the order its triangles are to be stored in.
pub(crate) struct Hierarchy {
    pub nodes: Vec<Node>,
    pub order: Vec<u32>,
}

#[derive(Clone, Copy)]
struct Bounds {
    low: [f32; 3],
    high: [f32; 3],
}

impl Bounds {
    const EMPTY: Self = Self { low: [f32::INFINITY; 3], high: [f32::NEG_INFINITY; 3] };

    fn add(&mut self, other: &Self) {
        for k in 0..3 {
            self.low[k] = self.low[k].min(other.low[k]);
            self.high[k] = self.high[k].max(other.high[k]);
        }
    }

    fn half_area(&self) -> f32 {
        let d: [f32; 3] = std::array::from_fn(|k| (self.high[k] - self.low[k]).max(0.0));
        d[0] * d[1] + d[1] * d[2] + d[2] * d[0]
    }
}

#[derive(Clone, Copy)]
struct Item {
    bounds: Bounds,
    centre: [f32; 3],
    triangle: u32,
}

enum Tree {
    Leaf(Bounds, Vec<u32>),
    Inner(Bounds, Box<(Tree, Tree)>),
}

const BINS: usize = 16;
const LEAF_TRIANGLES: usize = 4;
/// Below this many triangles a subtree is not worth another thread.
const PARALLEL_ABOVE: usize = 4096;

/// Builds the hierarchy of `triangles` over `positions` by binned surface-area splits.
pub(crate) fn build(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Hierarchy {
    let mut items: Vec<Item> = triangles
        .iter()
        .enumerate()
        .map(|(index, corners)| {
            let mut bounds = Bounds::EMPTY;
            for &corner in corners {
                let p = positions[corner as usize];
                bounds.add(&Bounds { low: p, high: p });
            }
            // Widened by a few roundings, so that a ray along a face is not lost.
            for k in 0..3 {
                let slack = 4.0 * f32::EPSILON * bounds.low[k].abs().max(bounds.high[k].abs());
                bounds.low[k] -= slack;
                bounds.high[k] += slack;
            }
            let centre = std::array::from_fn(|k| 0.5 * (bounds.low[k] + bounds.high[k]));
            Item { bounds, centre, triangle: index as u32 }
        })
        .collect();
    let mut out = Hierarchy {
        nodes: Vec::with_capacity(triangles.len() / 2),
        order: Vec::with_capacity(triangles.len()),
    };
    if !items.is_empty() {
        flatten(&split(&mut items), &mut out);
    }
    out
}

fn split(items: &mut [Item]) -> Tree {
    let mut bounds = Bounds::EMPTY;
    let mut centres = Bounds::EMPTY;
    for item in items.iter() {
        bounds.add(&item.bounds);
        centres.add(&Bounds { low: item.centre, high: item.centre });
    }
    if items.len() <= LEAF_TRIANGLES {
        return Tree::Leaf(bounds, items.iter().map(|item| item.triangle).collect());
    }
    let middle = partition(items, &centres);
    let (left, right) = items.split_at_mut(middle);
    let children = if left.len().min(right.len()) > PARALLEL_ABOVE {
        rayon::join(|| split(left), || split(right))
    } else {
        (split(left), split(right))
    };
    Tree::Inner(bounds, Box::new(children))
}

/// Reorders the items about the cheapest of the binned planes; the halves' border.
fn partition(items: &mut [Item], centres: &Bounds) -> usize {
    let axis = (0..3)
        .max_by(|&a, &b| (centres.high[a] - centres.low[a]).total_cmp(&(centres.high[b] - centres.low[b])))
        .unwrap_or(0);
    let extent = centres.high[axis] - centres.low[axis];
    let half = items.len() / 2;
    if extent <= 0.0 {
        return half;
    }
    let bin_of = |item: &Item| {
        (((item.centre[axis] - centres.low[axis]) / extent * BINS as f32) as usize).min(BINS - 1)
    };
    let mut bins = [(Bounds::EMPTY, 0usize); BINS];
    for item in items.iter() {
        let bin = &mut bins[bin_of(item)];
        bin.0.add(&item.bounds);
        bin.1 += 1;
    }
    let cost_of = |range: &[(Bounds, usize)]| {
        let mut all = Bounds::EMPTY;
        let mut count = 0;
        for (bounds, n) in range {
            all.add(bounds);
            count += n;
        }
        if count == 0 { f32::INFINITY } else { all.half_area() * count as f32 }
    };
    let cost = |border: usize| cost_of(&bins[..border]) + cost_of(&bins[border..]);
    let border = (1..BINS).min_by(|&a, &b| cost(a).total_cmp(&cost(b))).unwrap_or(BINS / 2);
    // Either half keeps its order, so the tree does not depend on how they are parted.
    let (mut middle, mut upper) = (0, Vec::with_capacity(items.len()));
    for index in 0..items.len() {
        let item = items[index];
        if bin_of(&item) < border {
            items[middle] = item;
            middle += 1;
        } else {
            upper.push(item);
        }
    }
    items[middle..].copy_from_slice(&upper);
    if middle == 0 || middle == items.len() { half } else { middle }
}

fn flatten(tree: &Tree, out: &mut Hierarchy) {
    let index = out.nodes.len();
    let bounds = match tree {
        Tree::Leaf(bounds, _) | Tree::Inner(bounds, _) => bounds,
    };
    out.nodes.push(Node { low: bounds.low, high: bounds.high, escape: 0, first: 0, count: 0 });
    match tree {
        Tree::Leaf(_, triangles) => {
            out.nodes[index].first = out.order.len() as u32;
            out.nodes[index].count = triangles.len() as u32;
            out.order.extend(triangles);
        }
        Tree::Inner(_, children) => {
            flatten(&children.0, out);
            flatten(&children.1, out);
        }
    }
    out.nodes[index].escape = out.nodes.len() as u32;
}
