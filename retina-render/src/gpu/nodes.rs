//! The hierarchy's nodes as the shaders read them: boxes in 16-bit steps, rounded outwards, and a link; half the
//! memory of f32 boxes, and memory is what rays wait for on a GPU.

use crate::arrays::bvh::Node;

/// Where the steps of a body's boxes are counted from, and how long one is, m.
pub(crate) fn box_steps([low, high]: [[f32; 3]; 2]) -> ([f32; 3], [f32; 3]) {
    // 65533 steps and one of slack at either end, so that rounding never leaves the range.
    let step: [f32; 3] = std::array::from_fn(|k| {
        let extent = high[k] - low[k];
        (extent / 65_533.0).max(extent.max(1e-30) * 1e-9).max(f32::MIN_POSITIVE)
    });
    (std::array::from_fn(|k| low[k] - step[k]), step)
}

/// Packs a body's nodes, which lie within `bounds`; links count from `first_node`.
pub(crate) fn pack(
    nodes: &[Node],
    bounds: [[f32; 3]; 2],
    first_node: u32,
) -> impl Iterator<Item = [u32; 4]> + '_ {
    let (low, step) = box_steps(bounds);
    nodes.iter().map(move |node| {
        let mut words = [0u32; 4];
        for k in 0..3 {
            let down = (((node.low[k] - low[k]) / step[k]).floor() - 1.0).clamp(0.0, 65_535.0);
            let up = (((node.high[k] - low[k]) / step[k]).ceil() + 1.0).clamp(0.0, 65_535.0);
            words[k] = down as u32 | (up as u32) << 16;
        }
        words[3] =
            if node.count > 0 { 1 << 31 | node.count << 28 | node.first } else { first_node + node.escape };
        words
    })
}
