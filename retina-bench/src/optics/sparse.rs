//! Few sources: each one's kernel is laid on the image where its light lands.

use glam::DVec2;
use rayon::prelude::*;
use retina_simd::{Kernel, Level};

use super::Source;
use super::kernels::{Blend, Kernels, PER_PX};
use super::patches::{Patch, Patches};

/// What is left out of a kernel makes less than this in any pixel, electrons.
const NEGLIGIBLE_E: f64 = 0.02;

/// Sources that take one blended kernel lie in one cell of this size, pixels.
const CELL_PX: f64 = 16.0;

/// Pixels that are computed at once.
const LANES: usize = 16;

/// So many groups of sources at most are made into patches at once, so that patches do not pile up.
const MOST_GROUPS: usize = 1024;

/// Adds the images of sources to an image of electrons.
pub(super) fn add(image: &mut [f32], [width, height]: [usize; 2], kernels: &Kernels, sources: &[Source]) {
    let placed = placed(kernels, sources);
    for groups in groups(&placed).chunks(MOST_GROUPS) {
        patches(height, kernels, groups).add_to(image, width);
    }
}

/// Sources by cell and channel: cells that blend the same kernels follow each other, which are then still in the
/// processor's cache.
fn placed(kernels: &Kernels, sources: &[Source]) -> Vec<Placed> {
    let mut placed: Vec<Placed> = sources.iter().map(|source| Placed::new(kernels, source)).collect();
    placed.sort_by_key(|source| (source.cell, source.channel));
    placed
}

/// The sources of each cell.
fn groups(placed: &[Placed]) -> Vec<&[Placed]> {
    placed.chunk_by(|a, b| a.cell == b.cell).collect()
}

/// The images of sources on an image of so many rows, a patch for those of one cell; `None` where they are so many that
/// they are better laid on it.
pub(super) fn spots(rows: usize, kernels: &Kernels, sources: &[Source]) -> Option<Patches> {
    let placed = placed(kernels, sources);
    let groups = groups(&placed);
    (groups.len() <= MOST_GROUPS).then(|| patches(rows, kernels, &groups))
}

fn patches(rows: usize, kernels: &Kernels, groups: &[&[Placed]]) -> Patches {
    let level = Level::detect();
    let made = groups
        .par_iter()
        .map_init(Vec::new, |scratch, group| level.run(Group { kernels, group, scratch }))
        .collect();
    Patches::new(rows, made)
}

/// A source with what its kernel needs.
struct Placed {
    /// First node of the four that are blended, and the cell's row and column.
    cell: (usize, i64, i64),
    channel: usize,
    at_px: DVec2,
    electrons: f64,
    /// How far its kernel counts, pixels.
    reach: usize,
}

impl Placed {
    fn new(kernels: &Kernels, source: &Source) -> Self {
        let &Source { at_px, channel, electrons } = source;
        let [x, y] = [at_px.x, at_px.y].map(|v| (v / CELL_PX).floor() as i64);
        let blend = kernels.blend(at_px);
        let limit = (NEGLIGIBLE_E / electrons.max(1e-30)) as f32;
        let reach = kernels.reach(&blend, channel, limit).clamp(2, kernels.half_px() - 2);
        Self { cell: (blend[0].0, y, x), channel, at_px, electrons, reach }
    }

    /// The pixel that the source lies in.
    fn pixel(&self) -> [i64; 2] {
        [self.at_px.x.floor() as i64, self.at_px.y.floor() as i64]
    }
}

/// The sources of one cell, sorted by channel, as one patch.
struct Group<'a> {
    kernels: &'a Kernels,
    group: &'a [Placed],
    scratch: &'a mut Vec<f32>,
}

impl Kernel for Group<'_> {
    type Output = Patch;

    #[inline(always)]
    fn run(self) -> Patch {
        let Self { kernels, group, scratch } = self;
        let reach = |sources: &[Placed]| sources.iter().map(|source| source.reach).max().unwrap_or(0);
        let along = |k: usize| group.iter().map(move |source| source.pixel()[k]);
        let least = [0, 1].map(|k| along(k).min().unwrap_or(0));
        let most = [0, 1].map(|k| along(k).max().unwrap_or(0));
        let far = reach(group);
        // Rows are laid by whole registers.
        let width = (most[0] - least[0]) as usize + 2 * far + LANES;
        let height = (most[1] - least[1]) as usize + 2 * far + 1;
        let mut patch = Patch {
            x: least[0] - far as i64,
            y: least[1] - far as i64,
            width,
            values: vec![0.0; width * height],
        };
        let middle = group.iter().map(|source| source.at_px).sum::<DVec2>() / group.len() as f64;
        let blend = kernels.blend(middle);
        for sources in group.chunk_by(|a, b| a.channel == b.channel) {
            let blended = Blended::new(kernels, &blend, sources[0].channel, reach(sources), scratch);
            for source in sources {
                blended.lay(source, &mut patch);
            }
        }
        patch
    }
}

/// The kernel of a group, blended once as far as its brightest source needs it.
struct Blended<'a> {
    /// Phase by phase: whole rows of the kernels' planes, so that each phase is one stretch of memory.
    values: &'a [f32],
    plane: usize,
    half: usize,
    /// Of the kernel's plane the first row that is blended, and how many.
    first: usize,
    rows: usize,
}

impl<'a> Blended<'a> {
    #[inline(always)]
    fn new(
        kernels: &Kernels,
        blend: &Blend,
        channel: usize,
        reach: usize,
        scratch: &'a mut Vec<f32>,
    ) -> Self {
        let (plane, half) = (kernels.plane(), kernels.half_px());
        // Two rows more on each side: a source stands up to a pixel beside the middle sample.
        let (first, rows) = (half - reach - 2, 2 * reach + 5);
        let phases = blend.map(|(node, _)| kernels.phases(node, channel));
        let scales: [f32; 4] = std::array::from_fn(|k| blend[k].1 * phases[k].scale);
        let count = rows * plane;
        scratch.resize(PER_PX * PER_PX * count + LANES, 0.0);
        // The last row is read beyond its end.
        scratch[PER_PX * PER_PX * count..].fill(0.0);
        for (phase, to) in scratch.chunks_exact_mut(count).take(PER_PX * PER_PX).enumerate() {
            let start = (phase * plane + first) * plane;
            let [a, b, c, d] = phases.map(|phases| &phases.roots[start..start + count]);
            for ((((to, &a), &b), &c), &d) in to.iter_mut().zip(a).zip(b).zip(c).zip(d) {
                let [a, b, c, d] = [a, b, c, d].map(f32::from);
                *to =
                    (scales[0] * (a * a) + scales[1] * (b * b)) + (scales[2] * (c * c) + scales[3] * (d * d));
            }
        }
        Self { values: scratch, plane, half, first, rows }
    }

    /// Adds a source's image to its group's patch.
    #[inline(always)]
    fn lay(&self, source: &Placed, patch: &mut Patch) {
        let reach = source.reach;
        // Pixel i (centre i + 0.5) lies at i + 0.5 - x from the source: sample 4 (that + half).
        let split = |v: f64| {
            let sample = (v.floor() + 0.5 - v + self.half as f64) * PER_PX as f64;
            (sample.floor() as usize, sample - sample.floor())
        };
        let (sample_x, fx) = split(source.at_px.x);
        let (sample_y, fy) = split(source.at_px.y);
        let (wx, wy) = (cubic(fx), cubic(fy));
        let mut weights = [0.0; 16];
        let mut taps = [0; 16];
        for (k, (weight, tap)) in weights.iter_mut().zip(&mut taps).enumerate() {
            let (u, v) = (sample_x + k % 4 - 1, sample_y + k / 4 - 1);
            *weight = (source.electrons * wx[k % 4] * wy[k / 4]) as f32;
            let phase = v % PER_PX * PER_PX + u % PER_PX;
            let (column, row) = (u / PER_PX - reach, v / PER_PX - reach - self.first);
            *tap = (phase * self.rows + row) * self.plane + column;
        }
        let side = 2 * reach + 1;
        let registers = side.div_ceil(LANES);
        let length = registers * LANES;
        // Of a row's last register what lies within the reach.
        let last: [f32; LANES] = std::array::from_fn(|k| if length - LANES + k < side { 1.0 } else { 0.0 });
        let [x, y] = source.pixel();
        let left = (x - patch.x) as usize - reach;
        let above = (y - patch.y) as usize - reach;
        for row in 0..side {
            let to = &mut patch.values[(above + row) * patch.width + left..][..length];
            let mut from = [&[][..]; 16];
            for (from, tap) in from.iter_mut().zip(taps) {
                *from = self.values[tap + row * self.plane..][..length].as_chunks::<LANES>().0;
            }
            for (i, to) in to.as_chunks_mut::<LANES>().0.iter_mut().enumerate() {
                let mut sum = [0.0; LANES];
                for (from, weight) in from.iter().zip(weights) {
                    let from = &from[i];
                    for k in 0..LANES {
                        sum[k] += weight * from[k];
                    }
                }
                let within = if i + 1 < registers { &[1.0; LANES] } else { &last };
                for k in 0..LANES {
                    to[k] += within[k] * sum[k];
                }
            }
        }
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
