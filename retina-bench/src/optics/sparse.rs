//! Few sources: each one's kernel is laid on the image where its light lands.

use rayon::prelude::*;

use super::Source;
use super::kernels::{Kernels, PER_PX};

/// What is left out of a kernel makes less than this in any pixel, electrons.
const NEGLIGIBLE_E: f64 = 0.02;

/// Sources that take one blended kernel lie in one cell of this size, pixels.
const CELL_PX: f64 = 16.0;

/// A rectangle of the image with its own electrons.
struct Patch {
    x: i64,
    y: i64,
    side: usize,
    values: Vec<f32>,
}

/// Adds the images of sources to an image of electrons.
pub(super) fn add(image: &mut [f32], size_px: [usize; 2], kernels: &Kernels, sources: &[Source]) {
    // Cells that blend the same kernels follow each other: those are then still in the processor's cache.
    let cell = |source: &Source| {
        let [x, y] = [source.at_px.x, source.at_px.y].map(|v| (v / CELL_PX).floor() as i64);
        let [(node, _), ..] = kernels.blend(source.at_px);
        (source.channel, node, y, x)
    };
    let mut order: Vec<usize> = (0..sources.len()).collect();
    order.sort_by_cached_key(|&i| (cell(&sources[i]), i));
    let groups: Vec<&[usize]> = order.chunk_by(|&a, &b| cell(&sources[a]) == cell(&sources[b])).collect();
    let arch = pulp::Arch::new();
    // In blocks, so that patches do not pile up; added in their order, so that sums do not depend on threads.
    for block in groups.chunks(512) {
        let patches: Vec<Vec<Patch>> =
            block.par_iter().map(|group| arch.dispatch(Group { kernels, sources, group })).collect();
        for patch in patches.iter().flatten() {
            patch.add_to(image, size_px);
        }
    }
}

/// Sources of one cell, to be laid on the image with the processor's widest registers. The sums are the same with narrow
/// ones. This is no closure, for the reason that the sensor's rows give.
struct Group<'a> {
    kernels: &'a Kernels,
    sources: &'a [Source],
    group: &'a [usize],
}

impl pulp::NullaryFnOnce for Group<'_> {
    type Output = Vec<Patch>;

    #[inline(always)]
    fn call(self) -> Vec<Patch> {
        let blended = Blended::new(self.kernels, self.sources, self.group);
        let mut patches = Vec::with_capacity(self.group.len());
        for &i in self.group {
            patches.push(blended.patch(self.kernels, &self.sources[i]));
        }
        patches
    }
}

/// The kernel of a group, blended once as far as its brightest source needs it.
struct Blended {
    values: Vec<f32>,
    reach: usize,
}

/// How far a source's kernel counts, pixels.
fn reach_of(kernels: &Kernels, source: &Source) -> usize {
    let half = kernels.half_px();
    let limit = (NEGLIGIBLE_E / source.electrons.max(1e-30)) as f32;
    kernels.tail.iter().position(|&value| value < limit).unwrap_or(half).clamp(2, half - 2)
}

impl Blended {
    #[inline(always)]
    fn new(kernels: &Kernels, all: &[Source], group: &[usize]) -> Self {
        let (plane, half) = (kernels.plane(), kernels.half_px());
        let reach = group.iter().map(|&i| reach_of(kernels, &all[i])).max().unwrap_or(0);
        let sum: glam::DVec2 = group.iter().map(|&i| all[i].at_px).sum();
        let mut values = vec![0.0; PER_PX * PER_PX * plane * plane];
        // Two rows and columns more: a source stands up to a pixel beside the middle sample.
        let (first, last) = (half - reach - 2, (half + reach + 2).min(plane - 1));
        let blend = kernels.blend(sum / group.len() as f64);
        let nodes = blend.map(|(node, _)| &kernels.phases(node, all[group[0]].channel).values[..]);
        let shares = blend.map(|(_, share)| share);
        for phase in 0..PER_PX * PER_PX {
            for row in first..=last {
                let start = (phase * plane + row) * plane;
                let range = start + first..start + last + 1;
                add_weighted(&mut values[range.clone()], nodes.map(|values| &values[range.clone()]), shares);
            }
        }
        Self { values, reach }
    }

    #[inline(always)]
    fn patch(&self, kernels: &Kernels, source: &Source) -> Patch {
        let (plane, half) = (kernels.plane(), kernels.half_px());
        let reach = reach_of(kernels, source).min(self.reach);
        // Pixel i (centre i + 0.5) lies at i + 0.5 - x from the source: sample 4 (that + half).
        let split = |v: f64| {
            let nearest = v.floor() as i64;
            let sample = (nearest as f64 + 0.5 - v + half as f64) * PER_PX as f64;
            (nearest, sample.floor() as usize, sample - sample.floor())
        };
        let (x, sample_x, fx) = split(source.at_px.x);
        let (y, sample_y, fy) = split(source.at_px.y);
        let (wx, wy) = (cubic(fx), cubic(fy));
        let side = 2 * reach + 1;
        let mut values = vec![0f32; side * side];
        for (b, wy) in wy.into_iter().enumerate() {
            let v = sample_y + b - 1;
            let (row_phase, middle_j) = (v % PER_PX, v / PER_PX);
            let taps = [0, 1, 2, 3].map(|a| {
                let u = sample_x + a - 1;
                let (phase, middle_i) = (row_phase * PER_PX + u % PER_PX, u / PER_PX);
                (phase * plane + middle_j - reach) * plane + middle_i - reach
            });
            let weights = wx.map(|wx| (source.electrons * wx * wy) as f32);
            for (row, to) in values.chunks_exact_mut(side).enumerate() {
                let from = taps.map(|tap| &self.values[tap + row * plane..tap + row * plane + side]);
                add_weighted(to, from, weights);
            }
        }
        Patch { x: x - reach as i64, y: y - reach as i64, side, values }
    }
}

/// Adds four rows of one length with their weights, in one pass.
#[inline(always)]
fn add_weighted(to: &mut [f32], from: [&[f32]; 4], weights: [f32; 4]) {
    let [a, b, c, d] = from;
    for ((((to, a), b), c), d) in to.iter_mut().zip(a).zip(b).zip(c).zip(d) {
        *to += (weights[0] * a + weights[1] * b) + (weights[2] * c + weights[3] * d);
    }
}

/// Lagrange's cubic through samples at -1, 0, 1, 2.
fn cubic(t: f64) -> [f64; 4] {
    [
        -t * (t - 1.0) * (t - 2.0) / 6.0,
        (t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0,
        -(t + 1.0) * t * (t - 2.0) / 2.0,
        (t + 1.0) * t * (t - 1.0) / 6.0,
    ]
}

impl Patch {
    fn add_to(&self, image: &mut [f32], [width, height]: [usize; 2]) {
        let first = (-self.x).clamp(0, self.side as i64) as usize;
        let last = (width as i64 - self.x).clamp(0, self.side as i64) as usize;
        if first >= last {
            return;
        }
        for row in 0..self.side {
            let y = self.y + row as i64;
            if (0..height as i64).contains(&y) {
                let start = y as usize * width + (self.x + first as i64) as usize;
                let to = &mut image[start..start + last - first];
                let from = &self.values[row * self.side + first..row * self.side + last];
                to.iter_mut().zip(from).for_each(|(to, from)| *to += from);
            }
        }
    }
}
