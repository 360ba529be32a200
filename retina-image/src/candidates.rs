//! Where an image stands out of its background: 3 x 3 sums, and single pixels that are no light.

use std::ops::Range;

use rayon::prelude::*;
use retina_simd::{Kernel, Level};

use crate::detect::Peak;
use crate::{Background, CameraImage};

/// Pixels of a row that are looked at together.
const BLOCK: usize = 16;
/// Rows that share a lower bound of the threshold.
const BOUND_ROWS: usize = 16;
/// Rows of a task.
const BAND_ROWS: usize = 32;
/// Of single-precision sums: a bound is lowered by this share of itself.
const ROUNDING: f32 = 1e-6;

/// Sum of the 3 x 3 pixels about one that is not on the border, DN.
pub(crate) fn nine(image: &CameraImage, x: usize, y: usize) -> f64 {
    (y - 1..=y + 1).map(|row| image.row(row)[x - 1..=x + 1].iter().map(|&v| f64::from(v)).sum::<f64>()).sum()
}

/// Places whose 3 x 3 sum is above the threshold and a maximum among its neighbours: (column, row).
///
/// Of three sums of three pixels in a column one is at least a third of what they are together. So single columns against
/// a third of the threshold's lower bound exclude nearly all of an image at two additions and a comparison a pixel, and
/// the threshold itself is only found where a sum is above the bound.
pub(crate) fn candidates(
    image: &CameraImage,
    background: &Background,
    threshold_sigma: f64,
) -> Vec<[usize; 2]> {
    let (width, height) = (image.width_px as usize, image.height_px as usize);
    if width < 3 || height < 3 {
        return Vec::new();
    }
    let level = Level::detect();
    let bands: Vec<Vec<[usize; 2]>> = (0..(height - 2).div_ceil(BAND_ROWS))
        .into_par_iter()
        .map(|band| {
            let (mut found, mut blocks) = (Vec::new(), Vec::new());
            let mut bound = Bound::new(width);
            let last = (1 + (band + 1) * BAND_ROWS).min(height - 1);
            for first in (1 + band * BAND_ROWS..last).step_by(BOUND_ROWS) {
                let rows = first..(first + BOUND_ROWS).min(last);
                bound.set(background, rows.clone(), threshold_sigma);
                for y in rows {
                    bound.each_exceeded(image, y, level, &mut blocks, |x| {
                        if is_candidate(image, background, threshold_sigma, x, y) {
                            found.push([x, y]);
                        }
                    });
                }
            }
            found.sort_unstable_by_key(|[x, y]| (*y, *x));
            found.dedup();
            found
        })
        .collect();
    bands.concat()
}

/// Finds the blocks of a row that have a column whose sum over three rows is above its bound.
struct Bright<'a> {
    rows: [&'a [f32]; 3],
    bounds: &'a [f32],
    blocks: &'a mut Vec<usize>,
}

impl Kernel for Bright<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.blocks.clear();
        let [(above, _), (own, _), (below, _)] = self.rows.map(|row| row.as_chunks::<BLOCK>());
        let (bounds, _) = self.bounds.as_chunks::<BLOCK>();
        for (block, (((a, b), c), bound)) in above.iter().zip(own).zip(below).zip(bounds).enumerate() {
            // Without branches, so that several columns are compared at once.
            let mut any = 0;
            for k in 0..BLOCK {
                any |= u32::from(a[k] + b[k] + c[k] > bound[k]);
            }
            if any != 0 {
                self.blocks.push(block);
            }
        }
    }
}

/// Lower bounds for some rows, column by column, DN.
struct Bound {
    /// Of the threshold of a 3 x 3 sum about a pixel of the column.
    nine: Vec<f32>,
    /// Of the largest of the three columns of a sum above its threshold.
    three: Vec<f32>,
}

impl Bound {
    fn new(width: usize) -> Self {
        Self { nine: vec![0.0; width], three: vec![0.0; width] }
    }

    fn set(&mut self, background: &Background, rows: Range<usize>, threshold_sigma: f64) {
        background.fill_least(rows, 9.0, 3.0 * threshold_sigma as f32, &mut self.nine);
        self.nine.iter_mut().for_each(|bound| *bound -= ROUNDING * bound.abs());
        // Edge columns are in one sum alone, those next to them in two: all are among the bounds of the sums inside.
        let nine = &self.nine[1..self.nine.len() - 1];
        let inside = nine.len();
        let of = |x: usize| {
            nine[x.saturating_sub(2)..(x + 1).min(inside)].iter().copied().fold(f32::MAX, f32::min)
        };
        let three_of = |least: f32| least / 3.0 - ROUNDING * least.abs();
        let triples = nine.iter().zip(&nine[1.min(inside)..]).zip(&nine[2.min(inside)..]);
        let least = |a: f32, b: f32| if a < b { a } else { b };
        for (three, ((a, b), c)) in self.three[2..].iter_mut().zip(triples) {
            *three = three_of(least(least(*a, *b), *c));
        }
        for x in [0, 1, inside, inside + 1] {
            self.three[x] = three_of(of(x));
        }
    }

    /// Calls `found` with the columns of a row whose sum is above the bound and not below its neighbours', some of them
    /// twice. `blocks` is work space.
    fn each_exceeded(
        &self,
        image: &CameraImage,
        y: usize,
        level: Level,
        blocks: &mut Vec<usize>,
        mut found: impl FnMut(usize),
    ) {
        let width = self.nine.len();
        let rows = [y - 1, y, y + 1].map(|row| image.row(row));
        // A bright column is in the sums about those beside it, too, which may be in the next block.
        let mut look = |columns: Range<usize>| {
            let near = columns.start.saturating_sub(1).max(1)..(columns.end + 1).min(width - 1);
            self.exceeded(rows, near, &mut found);
        };
        level.run(Bright { rows, bounds: &self.three, blocks });
        blocks.iter().for_each(|block| look(block * BLOCK..(block + 1) * BLOCK));
        let rest = width % BLOCK;
        if rest > 0 {
            look(width - rest..width);
        }
    }

    /// Calls `found` with each of at most `BLOCK + 2` columns, none at the image's edge, whose sum is above the bound and not
    /// below that of the column before or after.
    fn exceeded(&self, rows: [&[f32]; 3], columns: Range<usize>, mut found: impl FnMut(usize)) {
        let mut threes = [0.0f32; BLOCK + 4];
        let around = columns.start - 1..columns.end + 1;
        let [above, own, below] = rows.map(|row| &row[around.clone()]);
        for (((sum, a), b), c) in threes.iter_mut().zip(above).zip(own).zip(below) {
            *sum = a + b + c;
        }
        let mut nines = [0.0f32; BLOCK + 2];
        let thirds = threes.iter().zip(&threes[1..]).zip(&threes[2..]);
        for (sum, ((a, b), c)) in nines.iter_mut().zip(thirds) {
            *sum = a + b + c;
        }
        let nines = &nines[..columns.len()];
        for (k, (sum, bound)) in nines.iter().zip(&self.nine[columns.clone()]).enumerate() {
            // Single precision: nearly equal neighbours are left to the exact comparison.
            let least = *sum + ROUNDING * sum.abs();
            let not_below = |other: Option<&f32>| other.is_none_or(|other| *other <= least);
            if sum > bound && not_below(k.checked_sub(1).map(|k| &nines[k])) && not_below(nines.get(k + 1)) {
                found(columns.start + k);
            }
        }
    }
}

/// Whether the 3 x 3 sum about a pixel that is not on the border is a maximum above the threshold.
fn is_candidate(
    image: &CameraImage,
    background: &Background,
    threshold_sigma: f64,
    x: usize,
    y: usize,
) -> bool {
    let own = nine(image, x, y);
    if !is_highest(image, x, y, own) {
        return false;
    }
    let [at_x, at_y] = [x, y].map(|v| v as f64 + 0.5);
    own > 9.0 * background.level_dn(at_x, at_y) + 3.0 * threshold_sigma * background.noise_dn(at_x, at_y)
}

/// Whether the 3 x 3 sum at a place is at least that of its neighbours; of equal ones the first counts.
fn is_highest(image: &CameraImage, x: usize, y: usize, own: f64) -> bool {
    let (width, height) = (image.width_px as usize, image.height_px as usize);
    let columns = x.max(2) - 1..=(x + 1).min(width - 2);
    let before = x == 1 || nine(image, x - 1, y) < own;
    let after = x + 2 == width || nine(image, x + 1, y) <= own;
    let above = y == 1 || columns.clone().all(|c| nine(image, c, y - 1) < own);
    let below = y + 2 == height || columns.clone().all(|c| nine(image, c, y + 1) <= own);
    before && after && above && below
}

/// Parts the candidates into peaks and single-pixel spikes (row by row), whose neighbours have less than `spike_share` of
/// them.
pub(crate) fn without_spikes(
    image: &CameraImage,
    background: &Background,
    threshold_sigma: f64,
    spike_share: f64,
    candidates: &[[usize; 2]],
) -> (Vec<Peak>, Vec<[usize; 2]>) {
    let (width, height) = (image.width_px as usize, image.height_px as usize);
    let mut hot = Vec::new();
    let mut peaks = Vec::new();
    for &[x, y] in candidates {
        let level = background.level_dn(x as f64 + 0.5, y as f64 + 0.5);
        let noise = background.noise_dn(x as f64 + 0.5, y as f64 + 0.5);
        let light = |c: usize, r: usize| f64::from(image.at(c, r)) - level;
        let mut pixel = [x, y];
        let mut total = 0.0;
        for r in y - 1..=y + 1 {
            for c in x - 1..=x + 1 {
                total += light(c, r);
                if light(c, r) > light(pixel[0], pixel[1]) {
                    pixel = [c, r];
                }
            }
        }
        let [px, py] = pixel;
        let around = [(px.wrapping_sub(1), py), (px + 1, py), (px, py.wrapping_sub(1)), (px, py + 1)];
        let inside: Vec<f64> =
            around.iter().filter(|(c, r)| *c < width && *r < height).map(|&(c, r)| light(c, r)).collect();
        let neighbours = inside.iter().sum::<f64>() / inside.len() as f64;
        let top = light(px, py);
        if neighbours < spike_share * top {
            hot.push(pixel);
            total -= top;
            // Without the spike nothing stands out: it was all there was. Eight pixels are left.
            if total < threshold_sigma * 8f64.sqrt() * noise {
                continue;
            }
        }
        peaks.push(Peak { pixel, light_dn: total, centre: [x, y], blended: false });
    }
    // Several candidates can have the same one.
    hot.sort_unstable_by_key(|[x, y]| (*y, *x));
    hot.dedup();
    (peaks, hot)
}
