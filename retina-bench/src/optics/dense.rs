//! Full scenes: light that quintic B-splines have laid on the pixel grid is convolved with each node's kernel, tile by
//! tile, by Fourier transforms.
//!
//! Source: M. Unser, "Splines: a perfect fit for signal and image processing", IEEE Signal Proc. Mag. 16(6),
//! 22 (1999). A source between pixels takes B-spline weights; the kernel takes its spline coefficients (its
//! transform over that of the sampled B-spline), so that their product interpolates the kernel's samples
//! at whole pixels. Between nodes, the light and not the kernel is parted, by the same bilinear shares
//! that points take.

use std::f32::consts::TAU;
use std::sync::Arc;

use rayon::prelude::*;
use retina_fourier::{Complex32, ComplexPlanner, ComplexToReal, Fft, RealToComplex, real_pair};
use retina_simd::{Kernel, Level};

use super::kernels::Kernels;
use super::patches::{Patch, Patches};
use super::scene::{SceneLight, margin};
use crate::buffers::Buffers;

/// Rows that go into columns together: these are as many numbers as one line of the processor's cache holds.
const BLOCK_ROWS: usize = 8;

/// Transforms and the kernels' spectra.
pub(super) struct Dense {
    size_px: [usize; 2],
    /// Columns and rows of a tile.
    tile: [usize; 2],
    rows_forward: Arc<dyn RealToComplex<f32>>,
    rows_back: Arc<dyn ComplexToReal<f32>>,
    columns_forward: Arc<dyn Fft<f32>>,
    columns_back: Arc<dyn Fft<f32>>,
    /// Node * 3 + channel: spectra, column by column.
    spectra: Vec<Vec<Complex32>>,
}

/// Work space of one thread.
#[derive(Default)]
struct Scratch {
    row: Vec<f32>,
    /// Spectra of some rows.
    lines: [Vec<Complex32>; BLOCK_ROWS],
    work: Vec<Complex32>,
}

/// The smallest size not below `least` whose prime factors are 2, 3 and 5.
fn smooth_size(least: usize) -> usize {
    let smooth = |mut n: usize| {
        for p in [2, 3, 5] {
            while n.is_multiple_of(p) {
                n /= p;
            }
        }
        n == 1
    };
    (least.next_multiple_of(2)..).step_by(2).find(|&n| smooth(n)).unwrap_or(least)
}

impl Dense {
    pub(super) fn new(kernels: &Kernels, size_px: [usize; 2]) -> Self {
        let nodes = kernels.nodes();
        // What the widest node serves, and the kernel's reach on both sides.
        let tile = [0, 1].map(|k| {
            let served = (0..nodes[k]).map(|at| Served::along(kernels, k, at, size_px[k]).shares.len());
            smooth_size(served.max().unwrap_or(0) + 2 * kernels.half_px())
        });
        let (rows_forward, rows_back) = real_pair(tile[0]);
        let mut complex = ComplexPlanner::new();
        let mut dense = Self {
            size_px,
            tile,
            rows_forward,
            rows_back,
            columns_forward: complex.forward(tile[1]),
            columns_back: complex.inverse(tile[1]),
            spectra: Vec::new(),
        };
        dense.spectra = (0..3 * nodes[0] * nodes[1])
            .into_par_iter()
            .map(|i| dense.kernel_spectrum(kernels, i / 3, i % 3))
            .collect();
        dense
    }

    /// Columns of a half spectrum.
    fn columns(&self) -> usize {
        self.tile[0] / 2 + 1
    }

    /// Spline coefficients of a kernel, its middle at (0, 0), transformed; divided by the transform's size.
    fn kernel_spectrum(&self, kernels: &Kernels, node: usize, channel: usize) -> Vec<Complex32> {
        let plane = kernels.plane();
        let half = kernels.half_px();
        let [width, height] = self.tile;
        let mut image = vec![0f32; width * height];
        for (at, value) in kernels.phases(node, channel).whole_pixels(plane).enumerate() {
            let wrap = |v: usize, size: usize| (v + size - half) % size;
            image[wrap(at / plane, height) * width + wrap(at % plane, width)] = value;
        }
        let mut scratch = Scratch::default();
        let mut spectrum = Vec::new();
        self.rows_to_columns(&mut spectrum, &mut scratch, |y, row| {
            row.copy_from_slice(&image[y * width..(y + 1) * width]);
            row.iter().any(|v| *v != 0.0)
        });
        self.columns_forward.process_with_scratch(&mut spectrum, &mut scratch.work);
        // A quintic B-spline at whole numbers is (1, 26, 66, 26, 1) / 120.
        let spline = |k: usize, size: usize| {
            let angle = TAU * k as f32 / size as f32;
            (66.0 + 52.0 * angle.cos() + 2.0 * (2.0 * angle).cos()) / 120.0
        };
        let size = (width * height) as f32;
        for (column, values) in spectrum.chunks_exact_mut(height).enumerate() {
            for (row, value) in values.iter_mut().enumerate() {
                *value /= spline(column, width) * spline(row, height) * size;
            }
        }
        spectrum
    }

    /// Transforms the rows of a tile, and turns them: the spectrum, column by column. `fill` makes row `y` whole and
    /// returns whether it has light; so does this of all rows.
    fn rows_to_columns(
        &self,
        spectrum: &mut Vec<Complex32>,
        scratch: &mut Scratch,
        fill: impl Fn(usize, &mut [f32]) -> bool,
    ) -> bool {
        let (columns, height) = (self.columns(), self.tile[1]);
        self.fit(scratch);
        spectrum.resize(columns * height, Complex32::default());
        let mut any = false;
        for first in (0..height).step_by(BLOCK_ROWS) {
            let rows = BLOCK_ROWS.min(height - first);
            for (k, line) in scratch.lines.iter_mut().take(rows).enumerate() {
                let row = &mut scratch.row[..];
                if !fill(first + k, row) {
                    line.fill(Complex32::default());
                    continue;
                }
                any = true;
                // Lengths are those that the plan was made for.
                let done = self.rows_forward.process_with_scratch(row, line, &mut scratch.work);
                debug_assert!(done.is_ok());
            }
            let lines = scratch.lines.each_ref().map(|line| &line[..columns]);
            for (column, to) in spectrum.chunks_exact_mut(height).enumerate() {
                let values = lines.map(|line| line[column]);
                match to[first..].first_chunk_mut() {
                    Some(to) => *to = values,
                    None => to[first..].iter_mut().zip(values).for_each(|(to, value)| *to = value),
                }
            }
        }
        any
    }

    /// Turns columns of a spectrum into rows, and transforms these: the tile, row by row.
    fn columns_to_rows(&self, spectrum: &[Complex32], scratch: &mut Scratch, image: &mut [f32]) {
        let (columns, [width, height]) = (self.columns(), self.tile);
        for (block, image) in image.chunks_mut(BLOCK_ROWS * width).enumerate() {
            let (first, rows) = (block * BLOCK_ROWS, image.len() / width);
            let mut lines = scratch.lines.each_mut().map(|line| &mut line[..columns]);
            for (column, from) in spectrum.chunks_exact(height).enumerate() {
                lines
                    .iter_mut()
                    .zip(&from[first..first + rows])
                    .for_each(|(line, from)| line[column] = *from);
            }
            for (line, row) in lines.into_iter().zip(image.chunks_exact_mut(width)) {
                // The spectrum of a real image is real there; rounding is not.
                line[0].im = 0.0;
                line[columns - 1].im = 0.0;
                let done = self.rows_back.process_with_scratch(line, row, &mut scratch.work);
                debug_assert!(done.is_ok());
            }
        }
    }

    /// Gives work space its size.
    fn fit(&self, scratch: &mut Scratch) {
        let rows = self.rows_forward.get_scratch_len().max(self.rows_back.get_scratch_len());
        let columns = |plan: &Arc<dyn Fft<f32>>| plan.get_inplace_scratch_len();
        let work = rows.max(columns(&self.columns_forward)).max(columns(&self.columns_back));
        scratch.row.resize(self.tile[0], 0.0);
        scratch.lines.iter_mut().for_each(|line| line.resize(self.columns(), Complex32::default()));
        scratch.work.resize(work, Complex32::default());
    }

    /// The image of a scene.
    pub(super) fn image(&self, kernels: &Kernels, light: &SceneLight, buffers: &Buffers) -> Patches {
        let nodes = kernels.nodes();
        let tiles: Vec<Option<Patch>> = (0..nodes[0] * nodes[1])
            .into_par_iter()
            .map_init(Default::default, |space, node| self.tile_of(kernels, node, light, space, buffers))
            .collect();
        Patches::new(self.size_px[1], tiles.into_iter().flatten().collect())
    }

    /// The spectra of a node's share of the light along the rows, with their channels; of those that have light.
    fn spectra_of<'a>(
        &self,
        kernels: &Kernels,
        served: &[Served; 2],
        light: &SceneLight,
        scratch: &mut Scratch,
        spectra: &'a mut [Vec<Complex32>; 3],
    ) -> Vec<(usize, &'a mut Vec<Complex32>)> {
        let level = Level::detect();
        let ([x, y], reach) = (served, kernels.half_px());
        let mut lit = Vec::new();
        for (channel, (plane, spectrum)) in light.planes.iter().zip(spectra).enumerate() {
            let fill = |row: usize, to: &mut [f32]| {
                let own = row.checked_sub(reach).filter(|own| *own < y.shares.len());
                let Some(own) = own else { return false };
                let from = &plane[(y.first + own) * light.wide[0] + x.first..][..x.shares.len()];
                to.fill(0.0);
                let to = &mut to[reach..reach + from.len()];
                level.run(Shared { to, from, along_x: &x.shares, share: y.shares[own] })
            };
            if self.rows_to_columns(spectrum, scratch, fill) {
                lit.push((channel, spectrum));
            }
        }
        lit
    }

    /// A node's share of the light, convolved; `None` without light.
    fn tile_of(
        &self,
        kernels: &Kernels,
        node: usize,
        light: &SceneLight,
        (scratch, spectra): &mut (Scratch, [Vec<Complex32>; 3]),
        buffers: &Buffers,
    ) -> Option<Patch> {
        let nodes = kernels.nodes();
        let served = [(0, node % nodes[0]), (1, node / nodes[0])]
            .map(|(k, at)| Served::along(kernels, k, at, self.size_px[k]));
        let mut lit = self.spectra_of(kernels, &served, light, scratch, spectra);
        let kernel = |channel: usize| &self.spectra[3 * node + channel];
        let ((channel, sum), others) = lit.split_first_mut()?;
        let (level, [width, height]) = (Level::detect(), self.tile);
        // Column by column, which stays in the processor's cache from one step to the next.
        for (column, sum) in sum.chunks_exact_mut(height).enumerate() {
            let range = column * height..(column + 1) * height;
            self.columns_forward.process_with_scratch(sum, &mut scratch.work);
            level.run(Times { values: sum, kernel: &kernel(*channel)[range.clone()] });
            for (channel, other) in others.iter_mut() {
                let values = &mut other[range.clone()];
                self.columns_forward.process_with_scratch(values, &mut scratch.work);
                level.run(PlusProduct { sum, values, kernel: &kernel(*channel)[range.clone()] });
            }
            self.columns_back.process_with_scratch(sum, &mut scratch.work);
        }
        let mut values = buffers.take(width * height);
        self.columns_to_rows(sum, scratch, &mut values);
        let [x, y] = served.map(|served| served.first as i64 - (light.margin + kernels.half_px()) as i64);
        Some(Patch { x, y, width, values })
    }
}

/// A row of the light, by its shares; whether any is left.
struct Shared<'a> {
    to: &'a mut [f32],
    from: &'a [f32],
    along_x: &'a [f32],
    share: f32,
}

impl Kernel for Shared<'_> {
    type Output = bool;

    #[inline(always)]
    fn run(self) -> bool {
        let mut any = false;
        for ((to, from), along_x) in self.to.iter_mut().zip(self.from).zip(self.along_x) {
            *to = from * along_x * self.share;
            any |= *to != 0.0;
        }
        any
    }
}

/// Values, times those of a kernel.
struct Times<'a> {
    values: &'a mut [Complex32],
    kernel: &'a [Complex32],
}

impl Kernel for Times<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.values.iter_mut().zip(self.kernel).for_each(|(value, kernel)| *value *= kernel);
    }
}

/// A sum, and values times those of a kernel.
struct PlusProduct<'a> {
    sum: &'a mut [Complex32],
    values: &'a [Complex32],
    kernel: &'a [Complex32],
}

impl Kernel for PlusProduct<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for ((sum, value), kernel) in self.sum.iter_mut().zip(self.values).zip(self.kernel) {
            *sum += value * kernel;
        }
    }
}

/// What a node serves of the wide grid along one axis.
struct Served {
    first: usize,
    /// Its share at each pixel from the first one on.
    shares: Vec<f32>,
}

impl Served {
    /// Of node `at` along axis `k`, where the sensor has `size` pixels.
    fn along(kernels: &Kernels, k: usize, at: usize, size: usize) -> Self {
        let (nodes, margin) = (kernels.nodes()[k], margin(kernels));
        let wide = size + 2 * margin;
        let (spacing, start) = (kernels.spacing_px()[k], kernels.origin_px()[k] + margin as f64);
        let middle = at as f64 * spacing + start;
        let first = if at == 0 { 0.0 } else { (middle - spacing - 1.0).floor().max(0.0) } as usize;
        let last = if at + 1 == nodes { wide } else { ((middle + spacing + 1.0).ceil() as usize).min(wide) };
        // Beyond all nodes the outermost ones serve alone.
        let end = start + (nodes - 1) as f64 * spacing;
        let share = |pixel: usize| {
            let place = (pixel as f64 + 0.5).clamp(start, end);
            (1.0 - (place - middle).abs() / spacing).max(0.0) as f32
        };
        Self { first, shares: (first..last).map(share).collect() }
    }
}
