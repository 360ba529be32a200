//! Level and noise of an image where nothing shines, on a mesh.

use rayon::prelude::*;

use crate::CameraImage;

/// Samples along each side of a cell.
const SAMPLES: usize = 12;
/// A cell of fewer pixels has no value of its own: its level would be uncertain by a tenth of the noise and more.
const FEWEST_IN_CELL: usize = 100;
/// Samples are kept within this many standard deviations of the level.
const CLIP: f64 = 3.0;
/// Standard deviation of a normal distribution cut off at 3 sigma, in sigmas:
/// sqrt(1 - 2 * 3 * phi(3) / (2 Phi(3) - 1)).
const CLIPPED_SIGMA: f64 = 0.986_58;

/// Background level and noise: clipped means of square cells, linear in between and towards the edges.
#[derive(Debug, Clone, PartialEq)]
pub struct Background {
    cell_px: [f64; 2],
    columns: usize,
    rows: usize,
    /// (level, noise) of each cell, DN, row by row.
    nodes: Vec<[f32; 2]>,
}

impl Background {
    /// Estimates it with cells of about `mesh_px` pixels a side (at least 8), from a regular sample of
    /// their pixels. Points of light that cover less than a third of a cell do not lift it.
    pub fn estimate(image: &CameraImage, mesh_px: usize) -> Self {
        let (width, height) = (image.width_px as usize, image.height_px as usize);
        let mesh_px = mesh_px.max(8);
        let cells = |size: usize| ((size + mesh_px / 2) / mesh_px).max(1);
        let (columns, rows) = (cells(width), cells(height));
        let step = (mesh_px / SAMPLES).max(1);
        let raw: Vec<[f32; 2]> = (0..rows * columns)
            .into_par_iter()
            .with_min_len(16)
            .map_with((Vec::new(), Vec::new()), |(sample, deviation): &mut (Vec<f32>, Vec<f32>), cell| {
                let (row, column) = (cell / columns, cell % columns);
                sample.clear();
                let (left, right) = (column * width / columns, (column + 1) * width / columns);
                for y in (row * height / rows..(row + 1) * height / rows).step_by(step) {
                    // Rows are sampled at shifted columns, so that no fixed column pattern is taken for the level.
                    let shift = (y / step) % step;
                    sample.extend(image.row(y)[left..right].iter().skip(shift).step_by(step));
                }
                clipped(sample, deviation)
            })
            .collect();
        let nodes = median_of_neighbours(&raw, columns, rows);
        let cell_px = [width as f64 / columns as f64, height as f64 / rows as f64];
        Self { cell_px, columns, rows, nodes }
    }

    /// As [`Background::estimate`], from all pixels where `mask` (row by row) is true, each cell by itself. A cell with
    /// hardly any takes the mean of its neighbours.
    pub fn estimate_in(image: &CameraImage, mask: &[bool], mesh_px: usize) -> Self {
        let (width, height) = (image.width_px as usize, image.height_px as usize);
        let mesh_px = mesh_px.max(8);
        let cells = |size: usize| ((size + mesh_px / 2) / mesh_px).max(1);
        let (columns, rows) = (cells(width), cells(height));
        let raw: Vec<Option<[f32; 2]>> = (0..rows * columns)
            .into_par_iter()
            .map_with((Vec::new(), Vec::new()), |(sample, deviation): &mut (Vec<f32>, Vec<f32>), cell| {
                let (row, column) = (cell / columns, cell % columns);
                sample.clear();
                let (left, right) = (column * width / columns, (column + 1) * width / columns);
                for y in row * height / rows..(row + 1) * height / rows {
                    let own = &mask[y * width + left..y * width + right];
                    let pixels = image.row(y)[left..right].iter().zip(own);
                    sample.extend(pixels.filter(|(_, inside)| **inside).map(|(value, _)| value));
                }
                (sample.len() >= FEWEST_IN_CELL).then(|| clipped(sample, deviation))
            })
            .collect();
        let cell_px = [width as f64 / columns as f64, height as f64 / rows as f64];
        Self { cell_px, columns, rows, nodes: spread_out(raw, columns, rows) }
    }

    /// Level at a position, DN.
    pub fn level_dn(&self, x_px: f64, y_px: f64) -> f64 {
        self.value(x_px, y_px, |node| f64::from(node[0]))
    }

    /// Standard deviation of a pixel about the level, DN.
    pub fn noise_dn(&self, x_px: f64, y_px: f64) -> f64 {
        self.value(x_px, y_px, |node| f64::from(node[1])).max(1e-6)
    }

    /// Median over the mesh of (level, noise), DN.
    pub fn median_dn(&self) -> [f64; 2] {
        [0, 1].map(|k| {
            let mut values: Vec<f32> = self.nodes.iter().map(|node| node[k]).collect();
            f64::from(median(&mut values))
        })
    }

    /// `level_factor * level + noise_factor * noise` at the pixel centres of a row, into `out`.
    pub(crate) fn fill_row(&self, row: usize, level_factor: f32, noise_factor: f32, out: &mut [f32]) {
        let (above, down) = self.place(row as f64 + 0.5, 1);
        let mix = |column: usize| {
            let value = |r: usize| {
                let node = self.nodes[r * self.columns + column];
                level_factor * node[0] + noise_factor * node[1]
            };
            let next = if self.rows > 1 { above + 1 } else { above };
            value(above) + down as f32 * (value(next) - value(above))
        };
        if self.columns == 1 {
            out.fill(mix(0));
            return;
        }
        let pitch = self.cell_px[0];
        let mut start = 0;
        for column in 0..self.columns - 1 {
            let last = column + 2 == self.columns;
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

    /// Node before a position along an axis (0: x, 1: y), and the fraction of a cell beyond it.
    fn place(&self, at_px: f64, axis: usize) -> (usize, f64) {
        let count = if axis == 0 { self.columns } else { self.rows };
        let cells = at_px / self.cell_px[axis] - 0.5;
        let before = (cells.floor().max(0.0) as usize).min(count.saturating_sub(2));
        (before, if count > 1 { cells - before as f64 } else { 0.0 })
    }

    fn value(&self, x_px: f64, y_px: f64, of: impl Fn([f32; 2]) -> f64) -> f64 {
        let ((column, right), (row, down)) = (self.place(x_px, 0), self.place(y_px, 1));
        let node = |c: usize, r: usize| {
            of(self.nodes[r.min(self.rows - 1) * self.columns + c.min(self.columns - 1)])
        };
        let top = node(column, row) * (1.0 - right) + node(column + 1, row) * right;
        let bottom = node(column, row + 1) * (1.0 - right) + node(column + 1, row + 1) * right;
        top * (1.0 - down) + bottom * down
    }
}

fn median(values: &mut [f32]) -> f32 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f32::total_cmp).1
}

/// Clipped mean and standard deviation. The median of whole digital numbers is a whole number, too
/// coarse for a level; it only says where to clip.
fn clipped(sample: &mut [f32], deviation: &mut Vec<f32>) -> [f32; 2] {
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
    for _ in 0..3 {
        // Without branches, so that several samples are summed at once.
        let (middle, limit) = (level as f32, (CLIP * sigma) as f32);
        let (mut count, mut sum, mut squares) = (0u32, 0.0f32, 0.0f32);
        for &value in sample.iter() {
            let off = value - middle;
            let kept = off.abs() <= limit;
            let off = if kept { off } else { 0.0 };
            count += u32::from(kept);
            sum += off;
            squares += off * off;
        }
        if count < 2 {
            break;
        }
        let (count, sum, squares) = (f64::from(count), f64::from(sum), f64::from(squares));
        level = f64::from(middle) + sum / count;
        sigma = ((squares - sum * sum / count) / (count - 1.0)).max(0.0).sqrt() / CLIPPED_SIGMA;
    }
    [level as f32, sigma as f32]
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
            let [mut levels, mut noises] = [Vec::with_capacity(9), Vec::with_capacity(9)];
            for r in row.saturating_sub(1)..=(row + 1).min(rows - 1) {
                for c in column.saturating_sub(1)..=(column + 1).min(columns - 1) {
                    levels.push(at(c, r)[0]);
                    noises.push(at(c, r)[1]);
                }
            }
            let (level, noise) = (median(&mut levels), median(&mut noises));
            let mut spread: Vec<f32> = levels.iter().map(|v| (v - level).abs()).collect();
            let allowed = 3.0 * 1.4826 * median(&mut spread) + noise;
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
            background.fill_row(y, 1.0, 0.0, &mut row);
            for x in [2usize, 31, 32, 256, 509] {
                let (cx, cy) = (x as f64 + 0.5, y as f64 + 0.5);
                // A cell's mean of 169 samples has 2.5 / 13 = 0.19 DN; extrapolated to the edge, 1.6 times that.
                assert!((background.level_dn(cx, cy) - truth(cx, cy)).abs() < 0.8, "{x} {y}");
                assert!((f64::from(row[x]) - background.level_dn(cx, cy)).abs() < 1e-3);
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
