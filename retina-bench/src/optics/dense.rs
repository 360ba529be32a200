//! Full scenes: light is laid on the pixel grid by quintic B-splines and convolved with each node's kernel,
//! tile by tile, by Fourier transforms.
//!
//! Source: M. Unser, "Splines: a perfect fit for signal and image processing", IEEE Signal Proc. Mag. 16(6),
//! 22 (1999). A source between pixels takes B-spline weights; the kernel takes its spline coefficients (its
//! transform over that of the sampled B-spline), so that their product interpolates the kernel's samples
//! at whole pixels. Between nodes, the light and not the kernel is parted, by the same bilinear shares
//! that points take.

use std::f32::consts::TAU;
use std::sync::Arc;

use rayon::prelude::*;
use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};
use rustfft::num_complex::Complex32;
use rustfft::{Fft, FftPlanner};

use super::Source;
use super::kernels::Kernels;

/// Transforms and the kernels' spectra.
pub(super) struct Dense {
    size_px: [usize; 2],
    /// Light is kept this far beyond the sensor's edge.
    margin: usize,
    tile: usize,
    rows_forward: Arc<dyn RealToComplex<f32>>,
    rows_back: Arc<dyn ComplexToReal<f32>>,
    columns_forward: Arc<dyn Fft<f32>>,
    columns_back: Arc<dyn Fft<f32>>,
    /// Node * 3 + channel: spectra, column by column.
    spectra: Vec<Vec<Complex32>>,
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
        let margin = kernels.half_px() + 3;
        let widest = kernels.spacing_px().max_element().ceil() as usize;
        // The light of two cells, the margin of an outer node, and the kernel's reach on both sides.
        let tile = smooth_size(2 * widest + margin + 2 * kernels.half_px() + 4);
        let mut real = RealFftPlanner::new();
        let mut complex = FftPlanner::new();
        let mut dense = Self {
            size_px,
            margin,
            tile,
            rows_forward: real.plan_fft_forward(tile),
            rows_back: real.plan_fft_inverse(tile),
            columns_forward: complex.plan_fft_forward(tile),
            columns_back: complex.plan_fft_inverse(tile),
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
        self.tile / 2 + 1
    }

    /// Spline coefficients of a kernel, its middle at (0, 0), transformed; divided by the transform's size.
    fn kernel_spectrum(&self, kernels: &Kernels, node: usize, channel: usize) -> Vec<Complex32> {
        let plane = kernels.plane();
        let half = kernels.half_px();
        let mut image = vec![0f32; self.tile * self.tile];
        for (at, value) in kernels.phases(node, channel).whole_pixels(plane).iter().enumerate() {
            let wrap = |v: usize| (v + self.tile - half) % self.tile;
            image[wrap(at / plane) * self.tile + wrap(at % plane)] = *value;
        }
        let mut spectrum = self.forward(&mut image);
        // A quintic B-spline at whole numbers is (1, 26, 66, 26, 1) / 120.
        let spline = |k: usize| {
            let angle = TAU * k as f32 / self.tile as f32;
            (66.0 + 52.0 * angle.cos() + 2.0 * (2.0 * angle).cos()) / 120.0
        };
        let size = (self.tile * self.tile) as f32;
        for (column, values) in spectrum.chunks_exact_mut(self.tile).enumerate() {
            for (row, value) in values.iter_mut().enumerate() {
                *value /= spline(column) * spline(row) * size;
            }
        }
        spectrum
    }

    fn forward(&self, image: &mut [f32]) -> Vec<Complex32> {
        let columns = self.columns();
        let mut spectrum = vec![Complex32::default(); columns * self.tile];
        let mut line = self.rows_forward.make_output_vec();
        let mut scratch = self.rows_forward.make_scratch_vec();
        for (row, values) in image.chunks_exact_mut(self.tile).enumerate() {
            if values.iter().all(|v| *v == 0.0) {
                continue;
            }
            // Lengths are those that the plan was made for.
            let done = self.rows_forward.process_with_scratch(values, &mut line, &mut scratch);
            debug_assert!(done.is_ok());
            for (column, value) in line.iter().enumerate() {
                spectrum[column * self.tile + row] = *value;
            }
        }
        self.columns_forward.process(&mut spectrum);
        spectrum
    }

    fn back(&self, mut spectrum: Vec<Complex32>) -> Vec<f32> {
        self.columns_back.process(&mut spectrum);
        let columns = self.columns();
        let mut image = vec![0f32; self.tile * self.tile];
        let mut line = vec![Complex32::default(); columns];
        let mut scratch = self.rows_back.make_scratch_vec();
        for (row, values) in image.chunks_exact_mut(self.tile).enumerate() {
            for (column, value) in line.iter_mut().enumerate() {
                *value = spectrum[column * self.tile + row];
            }
            // The spectrum of a real image is real there; rounding is not.
            line[0].im = 0.0;
            line[columns - 1].im = 0.0;
            let done = self.rows_back.process_with_scratch(&mut line, values, &mut scratch);
            debug_assert!(done.is_ok());
        }
        image
    }

    /// Adds the images of sources to an image of electrons.
    pub(super) fn add(&self, image: &mut [f32], kernels: &Kernels, sources: &[Source]) {
        let [width, height] = self.size_px;
        let wide = [width + 2 * self.margin, height + 2 * self.margin];
        let light: Vec<Vec<f32>> =
            (0..3).into_par_iter().map(|channel| self.lay(wide, sources, channel)).collect();
        let nodes = kernels.nodes();
        let tiles: Vec<Option<([i64; 2], Vec<f32>)>> = (0..nodes[0] * nodes[1])
            .into_par_iter()
            .map(|node| self.tile_of(kernels, nodes, node, &light, wide))
            .collect();
        // In the nodes' order, so that sums do not depend on threads.
        for (first, values) in tiles.into_iter().flatten() {
            for (row, values) in values.chunks_exact(self.tile).enumerate() {
                let y = first[1] + row as i64;
                if !(0..height as i64).contains(&y) {
                    continue;
                }
                let from = (-first[0]).clamp(0, self.tile as i64) as usize;
                let to = (width as i64 - first[0]).clamp(0, self.tile as i64) as usize;
                if from < to {
                    let start = y as usize * width + (first[0] + from as i64) as usize;
                    let target = &mut image[start..start + to - from];
                    target.iter_mut().zip(&values[from..to]).for_each(|(t, v)| *t += v);
                }
            }
        }
    }

    /// One channel's light on the grid of pixels, B-spline weights.
    fn lay(&self, wide: [usize; 2], sources: &[Source], channel: usize) -> Vec<f32> {
        let mut light = vec![0f32; wide[0] * wide[1]];
        for source in sources.iter().filter(|source| source.channel == channel) {
            // Pixel i has its centre at i + 0.5.
            let x = source.at_px.x - 0.5 + self.margin as f64;
            let y = source.at_px.y - 0.5 + self.margin as f64;
            if !(x >= 2.0 && y >= 2.0 && x < (wide[0] - 4) as f64 && y < (wide[1] - 4) as f64) {
                continue;
            }
            let (wx, wy) = (spline((x - x.floor()) as f32), spline((y - y.floor()) as f32));
            let first = (y as usize - 2) * wide[0] + x as usize - 2;
            for (row, wy) in wy.into_iter().enumerate() {
                let weight = source.electrons as f32 * wy;
                let start = first + row * wide[0];
                light[start..start + 6].iter_mut().zip(wx).for_each(|(to, wx)| *to += weight * wx);
            }
        }
        light
    }

    /// A node's share of the light, convolved: where its first pixel lies, and its values.
    fn tile_of(
        &self,
        kernels: &Kernels,
        nodes: [usize; 2],
        node: usize,
        light: &[Vec<f32>],
        wide: [usize; 2],
    ) -> Option<([i64; 2], Vec<f32>)> {
        let at = [node % nodes[0], node / nodes[0]];
        let margin = self.margin as f64;
        // Pixels of the wide grid that the node serves, and its share at each.
        let along = |k: usize| {
            let (spacing, start) = (kernels.spacing_px()[k], kernels.origin_px()[k] + margin);
            let middle = at[k] as f64 * spacing + start;
            let first = if at[k] == 0 { 0.0 } else { (middle - spacing - 1.0).floor().max(0.0) } as usize;
            let last = if at[k] + 1 == nodes[k] {
                wide[k]
            } else {
                ((middle + spacing + 1.0).ceil() as usize).min(wide[k])
            };
            let shares: Vec<f32> = (first..last)
                .map(|pixel| {
                    // Beyond all nodes the outermost ones serve alone.
                    let end = start + (nodes[k] - 1) as f64 * spacing;
                    let place = (pixel as f64 + 0.5).clamp(start, end);
                    (1.0 - (place - middle).abs() / spacing).max(0.0) as f32
                })
                .collect();
            (first, shares)
        };
        let ((x, shares_x), (y, shares_y)) = (along(0), along(1));
        let reach = kernels.half_px();
        let mut spectrum: Option<Vec<Complex32>> = None;
        for (channel, light) in light.iter().enumerate() {
            let mut image = vec![0f32; self.tile * self.tile];
            let mut any = false;
            for (row, share_y) in shares_y.iter().enumerate() {
                let from = &light[(y + row) * wide[0] + x..][..shares_x.len()];
                let to = &mut image[(row + reach) * self.tile + reach..][..shares_x.len()];
                for ((to, from), share) in to.iter_mut().zip(from).zip(&shares_x) {
                    *to = from * share * share_y;
                    any |= *to != 0.0;
                }
            }
            if !any {
                continue;
            }
            let values = self.forward(&mut image);
            let kernel = &self.spectra[3 * node + channel];
            let sum = spectrum.get_or_insert_with(|| vec![Complex32::default(); values.len()]);
            for ((sum, value), kernel) in sum.iter_mut().zip(values).zip(kernel) {
                *sum += value * kernel;
            }
        }
        let first = [x, y].map(|v| v as i64 - (self.margin + reach) as i64);
        spectrum.map(|spectrum| (first, self.back(spectrum)))
    }
}

/// Weights of the quintic B-spline at the pixels -2 to 3 for a place t in [0, 1) after pixel 0.
fn spline(t: f32) -> [f32; 6] {
    let u = 1.0 - t;
    let inner = |t: f32| 66.0 + t * t * (-60.0 + t * t * (30.0 - 10.0 * t));
    let outer = |t: f32| 26.0 + t * (-50.0 + t * (20.0 + t * (20.0 + t * (-20.0 + 5.0 * t))));
    [u.powi(5), outer(t), inner(t), inner(u), outer(u), t.powi(5)].map(|w| w / 120.0)
}
