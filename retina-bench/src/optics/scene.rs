//! Full scenes: the light of all lit sub-pixels, laid on the grid of camera pixels by quintic B-splines.
//!
//! Rows of the screen land nearly along rows of the sensor. A band of the sensor's rows goes through the rows of the screen
//! whose light it receives, so that bands need nothing of each other, and sums do not depend on threads.

use glam::{DAffine2, DVec2};
use rayon::prelude::*;
use retina_simd::{Kernel, Level, floor, whole_number};

use super::kernels::Kernels;
use super::{BenchOptics, ExposurePose, MAP_STEP_PX};
use crate::buffers::Buffers;
use crate::{Display, ScreenImage};

/// Rows of the sensor that one task lays.
const BAND_ROWS: usize = 128;
/// Sub-pixels at once.
const LANES: usize = 16;
/// Pixels that a quintic B-spline reaches: from two before the one that it lies in to three after it.
const SPLINE: usize = 6;
const BEFORE: usize = 2;
/// Numbers that are added at once: the spline's, and zeros.
const WIDE: usize = 8;

/// What a screen shows in an exposure.
#[derive(Clone, Copy)]
pub(crate) struct Shown<'a> {
    pub display: &'a Display,
    pub screen: &'a ScreenImage,
    /// Light of each sub-pixel over the mean, row by row; nothing where all are equal.
    pub mura: Option<&'a [[f32; 3]]>,
    /// Electrons that a sub-pixel at count 255 on the axis makes, by channel.
    pub full_electrons: [f64; 3],
}

/// The light of a scene on the grid of camera pixels, with a margin about it.
pub struct SceneLight {
    pub(crate) planes: [Vec<f32>; 3],
    /// Electrons in all.
    pub(super) total_e: f64,
    pub(super) wide: [usize; 2],
    pub(super) margin: usize,
}

/// Where a row of the screen lands, at each step of the map.
#[derive(Default)]
struct Line {
    x: Vec<f32>,
    y: Vec<f32>,
    light: Vec<f32>,
}

impl SceneLight {
    pub(super) fn lay(
        optics: &BenchOptics,
        shown: Shown<'_>,
        pose: &ExposurePose,
        buffers: &Buffers,
    ) -> Self {
        let margin = margin(&optics.kernels);
        let wide = optics.size_px.map(|size| size + 2 * margin);
        let level = Level::detect();
        let moved = pose.map(&optics.camera);
        let mut total_e = 0.0;
        let planes = [0, 1, 2].map(|channel| {
            let rows = Rows { optics, shown, moved, channel, margin: margin as f32 };
            let reaches = rows.reaches();
            let mut plane = buffers.take(wide[0] * wide[1]);
            let lay = |(band, values): (usize, &mut [f32])| {
                values.fill(0.0);
                let first = band * BAND_ROWS;
                level.run(Band { rows: &rows, reaches: &reaches, first, wide, values: &mut *values });
                values.chunks(wide[0]).map(row_sum).sum::<f64>()
            };
            let sums: Vec<f64> = plane.par_chunks_mut(BAND_ROWS * wide[0]).enumerate().map(lay).collect();
            total_e += sums.iter().sum::<f64>();
            plane
        });
        Self { planes, total_e, wide, margin }
    }

    /// Electrons on the sensor in cells of `cell_px` pixels, row by row.
    pub(super) fn binned(&self, [width, height]: [usize; 2], cell_px: usize) -> Vec<f64> {
        let columns = width.div_ceil(cell_px);
        let mut cells = vec![0f64; columns * height.div_ceil(cell_px)];
        cells.par_chunks_mut(columns).enumerate().for_each(|(cell_row, cells)| {
            for y in cell_row * cell_px..((cell_row + 1) * cell_px).min(height) {
                for plane in &self.planes {
                    let row = &plane[(y + self.margin) * self.wide[0] + self.margin..][..width];
                    for (cell, values) in cells.iter_mut().zip(row.chunks(cell_px)) {
                        *cell += row_sum(values);
                    }
                }
            }
        });
        cells
    }
}

/// Light is kept this far beyond the sensor's edge, pixels.
pub(super) fn margin(kernels: &Kernels) -> usize {
    kernels.half_px() + BEFORE + 1
}

/// A sum of light, by as many sums side by side as a register holds.
fn row_sum(values: &[f32]) -> f64 {
    let (lanes, rest) = values.as_chunks::<LANES>();
    let mut sums = [0f32; LANES];
    for lane in lanes {
        for k in 0..LANES {
            sums[k] += lane[k];
        }
    }
    f64::from(sums.iter().chain(rest).sum::<f32>())
}

/// The rows of the screen in one channel.
struct Rows<'a> {
    optics: &'a BenchOptics,
    shown: Shown<'a>,
    moved: DAffine2,
    channel: usize,
    margin: f32,
}

impl Rows<'_> {
    fn counts(&self, row: usize) -> &[[u8; 3]] {
        let width = self.shown.screen.width_px as usize;
        &self.shown.screen.counts[row * width..(row + 1) * width]
    }

    /// For each row of the screen where its light lands along y, in rows of the wide grid; `None` without light.
    fn reaches(&self) -> Vec<Option<[f32; 2]>> {
        let rows = 0..self.shown.screen.height_px as usize;
        let reach = |line: &mut Line, row: usize| {
            let lit = |counts: &[u8; 3]| counts[self.channel] > 0;
            let counts = self.counts(row);
            let first = counts.iter().position(lit)?;
            let last = counts.iter().rposition(lit)?;
            self.line(row, line);
            // Shifts along the row are less than a step of the map.
            let steps =
                (first / MAP_STEP_PX).saturating_sub(1)..=(last / MAP_STEP_PX + 2).min(line.y.len() - 1);
            let places = line.y[steps].iter().filter(|y| !y.is_nan());
            let (low, high) =
                places.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), &y| (low.min(y), high.max(y)));
            (low <= high).then_some([low, high])
        };
        rows.into_par_iter().map_init(Line::default, reach).collect()
    }

    /// Where a row lands, in pixels of the wide grid.
    fn line(&self, row: usize, line: &mut Line) {
        let [columns, rows] = self.optics.grid;
        let grid = &self.optics.map_grid[self.channel];
        let at = (row as f64 + 0.5) / MAP_STEP_PX as f64;
        let above = (at as usize).min(rows - 2);
        let part = (at - above as f64) as f32;
        let [upper, lower] = [above, above + 1].map(|row| &grid[row * columns..(row + 1) * columns]);
        for values in [&mut line.x, &mut line.y, &mut line.light] {
            values.clear();
        }
        for (upper, lower) in upper.iter().zip(lower) {
            let [x, y, light] = [0, 1, 2].map(|k| upper[k] + part * (lower[k] - upper[k]));
            let moved = self.moved.transform_point2(DVec2::new(f64::from(x), f64::from(y)));
            // Pixel i has its centre at i + 0.5.
            line.x.push(moved.x as f32 - 0.5 + self.margin);
            line.y.push(moved.y as f32 - 0.5 + self.margin);
            line.light.push(light);
        }
    }
}

/// A band of rows of the wide grid in one channel.
struct Band<'a> {
    rows: &'a Rows<'a>,
    reaches: &'a [Option<[f32; 2]>],
    first: usize,
    wide: [usize; 2],
    values: &'a mut [f32],
}

impl Kernel for Band<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { rows, reaches, first, wide, values } = self;
        let Shown { display, mura, full_electrons, .. } = rows.shown;
        let channel = rows.channel;
        let full = full_electrons[channel];
        let electrons: Vec<f32> = display.levels[channel].iter().map(|level| (level * full) as f32).collect();
        let (low, high) = (first as f32, (first + values.len() / wide[0]) as f32);
        let mut line = Line::default();
        for (row, reach) in reaches.iter().enumerate() {
            let Some([from, to]) = reach else { continue };
            if to + (SPLINE - BEFORE) as f32 <= low || from - BEFORE as f32 >= high {
                continue;
            }
            rows.line(row, &mut line);
            let counts = rows.counts(row);
            let mura = mura.map(|mura| &mura[row * counts.len()..(row + 1) * counts.len()]);
            let shift = 0.5 + (display.stripe_px[channel] + display.row_shift_px(counts)) as f32;
            for (chunk, counts) in counts.chunks(LANES).enumerate() {
                if counts.iter().fold(0, |any, counts| any | counts[channel]) == 0 {
                    continue;
                }
                let start = chunk * LANES;
                let mut spots = Spots::default();
                for (k, counts) in counts.iter().enumerate() {
                    let pattern = mura.map_or(1.0, |mura| mura[start + k][channel]);
                    spots.electrons[k] = electrons[usize::from(counts[channel])] * pattern;
                }
                spots.place(&line, start / MAP_STEP_PX, shift);
                spots.lay(first, wide, values);
            }
        }
    }
}

/// Neighbouring sub-pixels.
#[derive(Default)]
struct Spots {
    electrons: [f32; LANES],
    x: [f32; LANES],
    y: [f32; LANES],
}

impl Spots {
    /// `shift`: of the sub-pixel from its pixel's left edge.
    #[inline(always)]
    fn place(&mut self, line: &Line, first_step: usize, shift: f32) {
        for half in 0..LANES / MAP_STEP_PX {
            let step = (first_step + half).min(line.x.len() - 2);
            let ends = |values: &[f32]| (values[step], values[step + 1] - values[step]);
            let ((x, dx), (y, dy), (light, dlight)) = (ends(&line.x), ends(&line.y), ends(&line.light));
            for k in 0..MAP_STEP_PX {
                let part = (k as f32 + shift) / MAP_STEP_PX as f32;
                let lane = half * MAP_STEP_PX + k;
                let electrons = self.electrons[lane] * (light + part * dlight);
                let known = !electrons.is_nan();
                self.electrons[lane] = if known { electrons } else { 0.0 };
                self.x[lane] = if known { x + part * dx } else { 0.0 };
                self.y[lane] = if known { y + part * dy } else { 0.0 };
            }
        }
    }

    /// Adds their light to rows of the wide grid from row `first` on.
    #[inline(always)]
    fn lay(&self, first: usize, wide: [usize; 2], values: &mut [f32]) {
        let [width, height] = wide;
        let mut along_x = [[0f32; WIDE]; LANES];
        let mut along_y = [[0f32; SPLINE]; LANES];
        let mut corner = [[0u32; 2]; LANES];
        for k in 0..LANES {
            let (x, y) = (self.x[k], self.y[k]);
            let (whole_x, whole_y) = (floor(x), floor(y));
            let inside = (x >= BEFORE as f32)
                & (y >= BEFORE as f32)
                & (x < (width - WIDE) as f32)
                & (y < (height - WIDE) as f32);
            let electrons = if inside { self.electrons[k] } else { 0.0 };
            let (wx, wy) = (spline(x - whole_x), spline(y - whole_y));
            for i in 0..SPLINE {
                along_x[k][i] = wx[i];
                along_y[k][i] = electrons * wy[i];
            }
            let first = |whole: f32| if inside { whole_number(whole - BEFORE as f32) } else { 0 };
            corner[k] = [first(whole_x), first(whole_y)];
        }
        let last = first + values.len() / width;
        // Neighbours overlap: what has just been written is not read again at once.
        for k in (0..LANES).map(|i| i % 4 * 4 + i / 4) {
            let (x, y) = (corner[k][0] as usize, corner[k][1] as usize);
            let (along_x, along_y) = (along_x[k], along_y[k]);
            for row in y.max(first)..(y + SPLINE).min(last) {
                let weight = along_y[row - y];
                let to = &mut values[(row - first) * width + x..][..WIDE];
                // A sum of its own, so that the compiler knows that nothing else is written meanwhile.
                let mut sum = [0.0; WIDE];
                for lane in 0..WIDE {
                    sum[lane] = to[lane] + weight * along_x[lane];
                }
                to.copy_from_slice(&sum);
            }
        }
    }
}

/// Weights of the quintic B-spline at the pixels -2 to 3 for a place t in [0, 1) after pixel 0.
#[inline(always)]
fn spline(t: f32) -> [f32; SPLINE] {
    let u = 1.0 - t;
    let inner = |t: f32| 66.0 + t * t * (-60.0 + t * t * (30.0 - 10.0 * t));
    let outer = |t: f32| 26.0 + t * (-50.0 + t * (20.0 + t * (20.0 + t * (-20.0 + 5.0 * t))));
    let fifth = |t: f32| t * t * (t * t) * t;
    [fifth(u), outer(t), inner(t), inner(u), outer(u), fifth(t)].map(|w| w * (1.0 / 120.0))
}
