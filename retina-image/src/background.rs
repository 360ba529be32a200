//! Level and noise of an image where nothing shines, on a mesh.

use std::ops::Range;

use rayon::prelude::*;
use retina_simd::{Kernel, Level};

use crate::CameraImage;
use crate::alike::alike;
use crate::matched::Local;

/// Samples along each side of a cell.
const SAMPLES: usize = 12;
/// A cell of fewer pixels has no value of its own: its level would be uncertain by a tenth of the noise and more.
const FEWEST_IN_CELL: usize = 100;
/// Samples are kept within this many standard deviations of the level.
const CLIP: f64 = 3.0;
/// Steps of the digital numbers that are kept on either side of the level, whatever the noise.
const CLIP_STEPS: f64 = 1.5;
/// Standard deviation of a normal distribution cut off at 3 sigma, in sigmas:
/// sqrt(1 - 2 * 3 * phi(3) / (2 Phi(3) - 1)).
const CLIPPED_SIGMA: f64 = 0.986_58;

/// Background level and noise: clipped means of square cells, linear in between and towards the edges.
#[derive(Debug, Clone, PartialEq)]
pub struct Background {
    mesh: Mesh,
    /// (level, noise) of each cell, DN, row by row.
    nodes: Vec<[f32; 2]>,
    /// See [`Background::alike`].
    alike: f64,
    /// What is added to the mesh's level where the image was looked at pixel by pixel.
    local: Option<Local>,
}

/// Cells that cover an image, nearly square and nearly of one size.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Mesh {
    size_px: [usize; 2],
    columns: usize,
    rows: usize,
    /// Width and height of a cell, px.
    cell_px: [f64; 2],
}

impl Mesh {
    /// Cells of about `mesh_px` pixels a side, at least 8.
    fn of(image: &CameraImage, mesh_px: usize) -> Self {
        let mesh_px = mesh_px.max(8);
        let size_px = [image.width_px as usize, image.height_px as usize];
        let [columns, rows] = size_px.map(|size| ((size + mesh_px / 2) / mesh_px).max(1));
        let cell_px = [size_px[0] as f64 / columns as f64, size_px[1] as f64 / rows as f64];
        Self { size_px, columns, rows, cell_px }
    }

    /// (level, noise) of each cell and the number of its samples, row by row. `fill` gives the samples of a cell's columns
    /// and rows.
    fn each(
        &self,
        image: &CameraImage,
        fill: impl Fn(Range<usize>, Range<usize>, &mut Vec<f32>) + Sync,
    ) -> Vec<([f32; 2], usize)> {
        let [width, height] = self.size_px;
        let level = Level::detect();
        let cell = |(sample, deviation): &mut (Vec<f32>, Vec<f32>), cell: usize| {
            let (row, column) = (cell / self.columns, cell % self.columns);
            sample.clear();
            fill(
                column * width / self.columns..(column + 1) * width / self.columns,
                row * height / self.rows..(row + 1) * height / self.rows,
                sample,
            );
            let node = level.run(Clipped { sample, deviation, step_dn: |level_dn| image.step_dn(level_dn) });
            (node, sample.len())
        };
        let cells = (0..self.rows * self.columns).into_par_iter().with_min_len(16);
        cells.map_with((Vec::new(), Vec::new()), cell).collect()
    }

    /// Node before a position along an axis (0: x, 1: y), and the fraction of a cell beyond it.
    fn place(&self, at_px: f64, axis: usize) -> (usize, f64) {
        let count = [self.columns, self.rows][axis];
        let cells = at_px / self.cell_px[axis] - 0.5;
        let before = (cells.floor().max(0.0) as usize).min(count.saturating_sub(2));
        (before, if count > 1 { cells - before as f64 } else { 0.0 })
    }
}

impl Background {
    /// Estimates it with cells of about `mesh_px` pixels a side (at least 8), from a regular sample of
    /// their pixels. Points of light that cover less than a third of a cell do not lift it.
    pub fn estimate(image: &CameraImage, mesh_px: usize) -> Self {
        let mesh = Mesh::of(image, mesh_px);
        let step = (mesh_px.max(8) / SAMPLES).max(1);
        let raw = mesh.each(image, |columns, rows, sample| {
            for y in rows.step_by(step) {
                // Rows are sampled at shifted columns, so that no fixed column pattern is taken for the level.
                let shift = (y / step) % step;
                sample.extend(image.row(y)[columns.clone()].iter().skip(shift).step_by(step));
            }
        });
        let raw: Vec<[f32; 2]> = raw.into_iter().map(|(node, _)| node).collect();
        let nodes = median_of_neighbours(&raw, mesh.columns, mesh.rows);
        let mut background = Self { mesh, nodes, alike: 1.0, local: None };
        background.alike = alike(image, &background);
        background
    }

    /// As [`Background::estimate`], from all pixels where `mask` (row by row) is true, each cell by itself. A cell with
    /// hardly any takes the mean of its neighbours.
    pub fn estimate_in(image: &CameraImage, mask: &[bool], mesh_px: usize) -> Self {
        let mesh = Mesh::of(image, mesh_px);
        let width = image.width_px as usize;
        let raw = mesh.each(image, |columns, rows, sample| {
            for y in rows {
                let own = &mask[y * width..(y + 1) * width][columns.clone()];
                let pixels = image.row(y)[columns.clone()].iter().zip(own);
                sample.extend(pixels.filter(|(_, inside)| **inside).map(|(value, _)| value));
            }
        });
        let raw = raw.into_iter().map(|(node, count)| (count >= FEWEST_IN_CELL).then_some(node)).collect();
        Self { mesh, nodes: spread_out(raw, mesh.columns, mesh.rows), alike: 1.0, local: None }
    }

    /// Level at a position, DN.
    pub fn level_dn(&self, x_px: f64, y_px: f64) -> f64 {
        let local = self.local.as_ref().and_then(|local| local.level_dn(x_px, y_px)).unwrap_or(0.0);
        self.value(x_px, y_px, |node| f64::from(node[0])) + local
    }

    /// Adds a local level with its noise, and says how alike neighbours are. Bounds ([`Self::fill_least`]) stay the mesh's.
    pub(crate) fn refine(&mut self, local: Local, alike: f64) {
        (self.local, self.alike) = (Some(local), alike);
    }

    /// Standard deviation of a pixel about the level, DN.
    pub fn noise_dn(&self, x_px: f64, y_px: f64) -> f64 {
        let local = self.local.as_ref().and_then(|local| local.noise_dn(x_px, y_px));
        local.unwrap_or_else(|| self.value(x_px, y_px, |node| f64::from(node[1]))).max(1e-6)
    }

    /// How many times the scatter of 3 x 3 sums is what pixels of independent noise would have, 1 to 3: neighbours of an
    /// image that was compressed, interpolated or smoothed err alike.
    pub fn alike(&self) -> f64 {
        self.alike
    }

    /// Median over the mesh of (level, noise), DN.
    pub fn median_dn(&self) -> [f64; 2] {
        [0, 1].map(|k| {
            let mut values: Vec<f32> = self.nodes.iter().map(|node| node[k]).collect();
            f64::from(median(&mut values))
        })
    }

    /// `level_factor * level + noise_factor * noise` at the pixel centres along a horizontal line, into `out`.
    fn fill_line(&self, y_px: f64, level_factor: f32, noise_factor: f32, out: &mut [f32]) {
        let Mesh { columns, rows, .. } = self.mesh;
        let (above, down) = self.mesh.place(y_px, 1);
        let mix = |column: usize| {
            let value = |r: usize| {
                let node = self.nodes[r * columns + column];
                level_factor * node[0] + noise_factor * node[1]
            };
            let next = if rows > 1 { above + 1 } else { above };
            value(above) + down as f32 * (value(next) - value(above))
        };
        if columns == 1 {
            out.fill(mix(0));
            return;
        }
        let pitch = self.mesh.cell_px[0];
        let mut start = 0;
        for column in 0..columns - 1 {
            let last = column + 2 == columns;
            let end = if last {
                out.len()
            } else {
                (((column as f64 + 1.5) * pitch) as usize).clamp(start, out.len())
            };
            let (a, b) = (mix(column), mix(column + 1));
            let slope = (b - a) / pitch as f32;
            let origin = a + slope * (start as f64 + 0.5 - (column as f64 + 0.5) * pitch) as f32;
            // 32-bit integers become floats several at a time, 64-bit ones do not.
            for (x, value) in out[start..end].iter_mut().enumerate() {
                *value = origin + slope * x as i32 as f32;
            }
            start = end;
        }
    }

    /// The least `level_factor * level + noise_factor * noise` that the pixels of each column have in some rows, into
    /// `out` (as wide as the image): between nodes both are linear, so ends and nodes are enough.
    pub(crate) fn fill_least(
        &self,
        rows: Range<usize>,
        level_factor: f32,
        noise_factor: f32,
        out: &mut [f32],
    ) {
        let (first, last) = (rows.start as f64 + 0.5, rows.end as f64 - 0.5);
        let pitch = self.mesh.cell_px[1];
        let nodes = (0..self.mesh.rows).map(|row| (row as f64 + 0.5) * pitch);
        let mut line = vec![0.0; out.len()];
        out.fill(f32::INFINITY);
        for y_px in nodes.filter(|y| *y > first && *y < last).chain([first, last]) {
            self.fill_line(y_px, level_factor, noise_factor, &mut line);
            for (least, value) in out.iter_mut().zip(&line) {
                *least = least.min(*value);
            }
        }
    }

    fn value(&self, x_px: f64, y_px: f64, of: impl Fn([f32; 2]) -> f64) -> f64 {
        let Mesh { columns, rows, .. } = self.mesh;
        let ((column, right), (row, down)) = (self.mesh.place(x_px, 0), self.mesh.place(y_px, 1));
        let node = |c: usize, r: usize| of(self.nodes[r.min(rows - 1) * columns + c.min(columns - 1)]);
        let top = node(column, row) * (1.0 - right) + node(column + 1, row) * right;
        let bottom = node(column, row + 1) * (1.0 - right) + node(column + 1, row + 1) * right;
        top * (1.0 - down) + bottom * down
    }
}

/// Values that are taken at a time: sums and counts are kept for each place in such a block by itself.
const LANES: usize = 8;

/// The value in the middle of the sorted ones. The range it lies in is halved by counting, which takes several values at a
/// time, until few are left to choose from.
#[inline(always)]
fn median(values: &mut [f32]) -> f32 {
    // Whole numbers have many equal ones, which no halving parts.
    const FEW: usize = 48;
    const MOST_HALVINGS: usize = 14;
    let middle = values.len() / 2;
    let (mut low, mut high) = least_and_greatest(values);
    // The middle one is at `low` or above and below `end`; so many are below `low`, and below `end`.
    let (mut end, mut below, mut up_to) = (f32::INFINITY, 0, values.len());
    for _ in 0..MOST_HALVINGS {
        if up_to - below <= FEW {
            break;
        }
        let pivot = 0.5 * (low + high);
        if !(low < pivot && pivot < high) {
            break;
        }
        // No more than an image's pixels: a check for overflow would keep it from counting several at once.
        let mut count = 0u32;
        for &value in values.iter() {
            count = count.wrapping_add(u32::from(value < pivot));
        }
        let count = count as usize;
        if count > middle {
            (high, end, up_to) = (pivot, pivot, count);
        } else {
            (low, below) = (pivot, count);
        }
    }
    if up_to - below == values.len() {
        return *values.select_nth_unstable_by(middle, f32::total_cmp).1;
    }
    let count = up_to - below;
    let inside = |value: f32| value >= low && value < end;
    if count > FEW {
        // Many equal ones.
        let mut left: Vec<f32> = values.iter().copied().filter(|&value| inside(value)).collect();
        return *left.select_nth_unstable_by(middle - below, f32::total_cmp).1;
    }
    // Each is written, and written over if it is outside: no branch that depends on values.
    let (mut left, mut next) = ([0.0; FEW + 1], 0);
    for &value in values.iter() {
        left[next.min(FEW)] = value;
        next += usize::from(inside(value));
    }
    *left[..count].select_nth_unstable_by(middle - below, f32::total_cmp).1
}

#[inline(always)]
fn least_and_greatest(values: &[f32]) -> (f32, f32) {
    let (mut low, mut high) = ([f32::INFINITY; LANES], [f32::NEG_INFINITY; LANES]);
    for block in values.chunks(LANES) {
        for ((low, high), &value) in low.iter_mut().zip(&mut high).zip(block) {
            *low = if value < *low { value } else { *low };
            *high = if value > *high { value } else { *high };
        }
    }
    (low.into_iter().fold(f32::INFINITY, f32::min), high.into_iter().fold(f32::NEG_INFINITY, f32::max))
}

/// See [`clipped`].
struct Clipped<'a, F> {
    sample: &'a mut [f32],
    deviation: &'a mut Vec<f32>,
    step_dn: F,
}

impl<F: Fn(f32) -> f32> Kernel for Clipped<'_, F> {
    type Output = [f32; 2];

    #[inline(always)]
    fn run(self) -> [f32; 2] {
        clipped(self.sample, self.deviation, self.step_dn)
    }
}

/// Clipped mean and standard deviation, the latter at least that of rounding to steps. The median of whole digital
/// numbers is a whole number, too coarse for a level; it only says where to clip.
#[inline(always)]
fn clipped(sample: &mut [f32], deviation: &mut Vec<f32>, step_dn: impl Fn(f32) -> f32) -> [f32; 2] {
    if sample.is_empty() {
        return [0.0, 0.0];
    }
    let centre = median(sample);
    deviation.clear();
    deviation.extend(sample.iter().map(|v| (v - centre).abs()));
    // 1.4826: median absolute deviation to standard deviation of a normal distribution.
    let mut level = f64::from(centre);
    let mut sigma = 1.4826 * f64::from(median(deviation));
    if sigma == 0.0 {
        sigma = f64::from(deviation.iter().sum::<f32>()) / deviation.len() as f64;
    }
    let step = f64::from(step_dn(centre));
    for _ in 0..3 {
        // Where most values are equal, those a step beside them are their noise.
        let limit = (CLIP * sigma).max(CLIP_STEPS * step);
        let [count, sum, squares] = clipped_sums(sample, level as f32, limit as f32);
        if count < 2.0 {
            break;
        }
        let middle = level as f32;
        level = f64::from(middle) + sum / count;
        sigma = ((squares - sum * sum / count) / (count - 1.0)).max(0.0).sqrt() / CLIPPED_SIGMA;
    }
    [level as f32, sigma.max(step / 12f64.sqrt()) as f32]
}

/// Number of values within a distance of a middle, sum of their offsets from it, and of their squares.
#[inline(always)]
fn clipped_sums(values: &[f32], middle: f32, limit: f32) -> [f64; 3] {
    let mut sums = [[0.0f32; LANES]; 3];
    let (blocks, rest) = values.as_chunks::<LANES>();
    // What is infinitely far is not kept.
    let mut last = [f32::INFINITY; LANES];
    last[..rest.len()].copy_from_slice(rest);
    for block in blocks.iter().chain([&last]) {
        let [counts, offsets, squares] = &mut sums;
        for k in 0..LANES {
            let off = block[k] - middle;
            let kept = off.abs() <= limit;
            let off = if kept { off } else { 0.0 };
            counts[k] += if kept { 1.0 } else { 0.0 };
            offsets[k] += off;
            squares[k] += off * off;
        }
    }
    sums.map(|lanes| lanes.iter().map(|&sum| f64::from(sum)).sum())
}

/// Fills cells without a value from those beside them, ring by ring.
fn spread_out(mut raw: Vec<Option<[f32; 2]>>, columns: usize, rows: usize) -> Vec<[f32; 2]> {
    while raw.iter().any(Option::is_none) && raw.iter().any(Option::is_some) {
        let known = raw.clone();
        for (cell, value) in raw.iter_mut().enumerate().filter(|(_, value)| value.is_none()) {
            let (row, column) = (cell / columns, cell % columns);
            let (mut sum, mut count) = ([0.0; 2], 0.0f32);
            for r in row.saturating_sub(1)..=(row + 1).min(rows - 1) {
                for c in column.saturating_sub(1)..=(column + 1).min(columns - 1) {
                    if let Some(near) = known[r * columns + c] {
                        sum = [sum[0] + near[0], sum[1] + near[1]];
                        count += 1.0;
                    }
                }
            }
            *value = (count > 0.0).then(|| sum.map(|s| s / count));
        }
    }
    raw.into_iter().map(Option::unwrap_or_default).collect()
}

/// A cell that a large object fills is outvoted: nodes far from their neighbours' median take it.
fn median_of_neighbours(raw: &[[f32; 2]], columns: usize, rows: usize) -> Vec<[f32; 2]> {
    let at = |column: usize, row: usize| raw[row * columns + column];
    (0..raw.len())
        .map(|cell| {
            let (row, column) = (cell / columns, cell % columns);
            let [mut levels, mut noises] = [[0.0f32; 9]; 2];
            let mut count = 0;
            for r in row.saturating_sub(1)..=(row + 1).min(rows - 1) {
                for c in column.saturating_sub(1)..=(column + 1).min(columns - 1) {
                    [levels[count], noises[count]] = at(c, r);
                    count += 1;
                }
            }
            let [levels, noises] = [&mut levels[..count], &mut noises[..count]];
            let (level, noise) = (median(levels), median(noises));
            levels.iter_mut().for_each(|v| *v = (*v - level).abs());
            let allowed = 3.0 * 1.4826 * median(levels) + noise;
            let own = at(column, row);
            [
                if (own[0] - level).abs() > allowed { level } else { own[0] },
                noise.min(own[1].max(0.5 * noise)),
            ]
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::RngExt as _;
    use rand::SeedableRng as _;

    #[test]
    fn medians_are_those_of_sorting() {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(2);
        for count in [1usize, 2, 9, 48, 49, 50, 64, 169, 500] {
            // Coarse steps make many equal ones; the last kind is one value only, but for the first.
            for steps in [1e6f32, 40.0, 3.0, 0.4] {
                let mut values: Vec<f32> =
                    (0..count).map(|_| (steps * (random.random::<f32>() - 0.5)).round()).collect();
                values[0] = 4000.0;
                let mut sorted = values.clone();
                sorted.sort_by(f32::total_cmp);
                assert_eq!(median(&mut values), sorted[count / 2], "{count} {steps}");
            }
        }
    }

    #[test]
    fn a_gradient_with_points_of_light_and_whole_numbers_is_followed() {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(1);
        let mut image = CameraImage::new(512, 384, 4095.0);
        let truth = |x: f64, y: f64| 100.0 + 0.05 * x - 0.03 * y;
        for y in 0..384 {
            for x in 0..512 {
                let normal: f64 = (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
                let lit = if x % 40 < 6 && y % 40 < 6 { 900.0 } else { 0.0 };
                let value = truth(x as f64 + 0.5, y as f64 + 0.5) + 2.5 * normal + lit;
                image.values[y * 512 + x] = value.round() as f32;
            }
        }
        let background = Background::estimate(&image, 64);
        let mut row = vec![0.0; 512];
        for y in [3usize, 190, 380] {
            background.fill_least(y..y + 1, 1.0, 0.0, &mut row);
            for x in [2usize, 31, 32, 256, 509] {
                let (cx, cy) = (x as f64 + 0.5, y as f64 + 0.5);
                // A cell's mean of 169 samples has 2.5 / 13 = 0.19 DN; extrapolated to the edge, 1.6 times that.
                assert!((background.level_dn(cx, cy) - truth(cx, cy)).abs() < 0.8, "{x} {y}");
                assert!((f64::from(row[x]) - background.level_dn(cx, cy)).abs() < 1e-3);
            }
        }
        // Over some rows, about nodes (y = 32, 96, ...) and between them: the least of what each row has.
        for rows in [28..36usize, 90..98, 200..208, 376..384] {
            background.fill_least(rows.clone(), 9.0, 15.0, &mut row);
            for x in [0usize, 33, 300, 511] {
                let at = |y: usize| {
                    let (cx, cy) = (x as f64 + 0.5, y as f64 + 0.5);
                    9.0 * background.level_dn(cx, cy) + 15.0 * background.noise_dn(cx, cy)
                };
                let least = rows.clone().map(at).fold(f64::INFINITY, f64::min);
                let found = f64::from(row[x]);
                // Nodes between two rows' centres may be lower than both: by less than a row's slope.
                assert!(found < least + 1e-2 && found > least - 0.5, "{x} {rows:?}: {found} {least}");
            }
        }
        // The gradient inside a cell (64 px * 0.05 / sqrt(12) = 0.92 DN) and rounding add to 2.5 DN.
        let noise = background.median_dn()[1];
        assert!(
            (noise - (2.5f64.powi(2) + 0.92f64.powi(2) + 0.55f64.powi(2) + 1.0 / 12.0).sqrt()).abs() < 0.15,
            "{noise}"
        );
    }
}
