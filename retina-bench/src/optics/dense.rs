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

use super::kernels::Kernels;
use super::scene::{SceneLight, margin};

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
    image: Vec<f32>,
    spectra: [Vec<Complex32>; 2],
    line: Vec<Complex32>,
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
        let mut spectrum = Vec::new();
        self.forward(&mut image, &mut spectrum, &mut Scratch::default());
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

    fn forward(&self, image: &mut [f32], spectrum: &mut Vec<Complex32>, scratch: &mut Scratch) {
        let (columns, [width, height]) = (self.columns(), self.tile);
        spectrum.clear();
        spectrum.resize(columns * height, Complex32::default());
        scratch.line.resize(columns, Complex32::default());
        let work = self.rows_forward.get_scratch_len().max(self.columns_forward.get_inplace_scratch_len());
        scratch.work.resize(work, Complex32::default());
        for (row, values) in image.chunks_exact_mut(width).enumerate() {
            if values.iter().all(|v| *v == 0.0) {
                continue;
            }
            // Lengths are those that the plan was made for.
            let done = self.rows_forward.process_with_scratch(values, &mut scratch.line, &mut scratch.work);
            debug_assert!(done.is_ok());
            for (column, value) in scratch.line.iter().enumerate() {
                spectrum[column * height + row] = *value;
            }
        }
        self.columns_forward.process_with_scratch(spectrum, &mut scratch.work);
    }

    fn back(&self, spectrum: &mut [Complex32], scratch: &mut Scratch) -> Vec<f32> {
        let (columns, [width, height]) = (self.columns(), self.tile);
        let work = self.rows_back.get_scratch_len().max(self.columns_back.get_inplace_scratch_len());
        scratch.work.resize(work, Complex32::default());
        scratch.line.resize(columns, Complex32::default());
        self.columns_back.process_with_scratch(spectrum, &mut scratch.work);
        let mut image = vec![0f32; width * height];
        for (row, values) in image.chunks_exact_mut(width).enumerate() {
            for (column, value) in scratch.line.iter_mut().enumerate() {
                *value = spectrum[column * height + row];
            }
            // The spectrum of a real image is real there; rounding is not.
            scratch.line[0].im = 0.0;
            scratch.line[columns - 1].im = 0.0;
            let done = self.rows_back.process_with_scratch(&mut scratch.line, values, &mut scratch.work);
            debug_assert!(done.is_ok());
        }
        image
    }

    /// Adds the image of a scene to an image of electrons.
    pub(super) fn add(&self, image: &mut [f32], kernels: &Kernels, light: &SceneLight) {
        let [width, height] = self.size_px;
        let nodes = kernels.nodes();
        let tiles: Vec<Option<([i64; 2], Vec<f32>)>> = (0..nodes[0] * nodes[1])
            .into_par_iter()
            .map_init(Scratch::default, |scratch, node| self.tile_of(kernels, nodes, node, light, scratch))
            .collect();
        // In the nodes' order, so that sums do not depend on threads.
        for (first, values) in tiles.into_iter().flatten() {
            for (row, values) in values.chunks_exact(self.tile[0]).enumerate() {
                let y = first[1] + row as i64;
                if !(0..height as i64).contains(&y) {
                    continue;
                }
                let from = (-first[0]).clamp(0, self.tile[0] as i64) as usize;
                let to = (width as i64 - first[0]).clamp(0, self.tile[0] as i64) as usize;
                if from < to {
                    let start = y as usize * width + (first[0] + from as i64) as usize;
                    let target = &mut image[start..start + to - from];
                    target.iter_mut().zip(&values[from..to]).for_each(|(t, v)| *t += v);
                }
            }
        }
    }

    /// A node's share of the light, convolved: where its first pixel lies, and its values.
    fn tile_of(
        &self,
        kernels: &Kernels,
        nodes: [usize; 2],
        node: usize,
        light: &SceneLight,
        scratch: &mut Scratch,
    ) -> Option<([i64; 2], Vec<f32>)> {
        let [x, y] = [(0, node % nodes[0]), (1, node / nodes[0])]
            .map(|(k, at)| Served::along(kernels, k, at, self.size_px[k]));
        let reach = kernels.half_px();
        let mut spectra = std::mem::take(&mut scratch.spectra);
        let mut image = std::mem::take(&mut scratch.image);
        let [sum, own] = &mut spectra;
        let mut any_light = false;
        for (channel, plane) in light.planes.iter().enumerate() {
            image.clear();
            image.resize(self.tile[0] * self.tile[1], 0.0);
            let mut any = false;
            for (row, share_y) in y.shares.iter().enumerate() {
                let from = &plane[(y.first + row) * light.wide[0] + x.first..][..x.shares.len()];
                let to = &mut image[(row + reach) * self.tile[0] + reach..][..x.shares.len()];
                for ((to, from), share) in to.iter_mut().zip(from).zip(&x.shares) {
                    *to = from * share * share_y;
                    any |= *to != 0.0;
                }
            }
            if !any {
                continue;
            }
            self.forward(&mut image, own, scratch);
            let kernel = &self.spectra[3 * node + channel];
            if any_light {
                for ((sum, value), kernel) in sum.iter_mut().zip(own.iter()).zip(kernel) {
                    *sum += value * kernel;
                }
            } else {
                own.iter_mut().zip(kernel).for_each(|(value, kernel)| *value *= kernel);
                std::mem::swap(sum, own);
                any_light = true;
            }
        }
        let first = [x.first, y.first].map(|v| v as i64 - (light.margin + reach) as i64);
        let found = any_light.then(|| (first, self.back(sum, scratch)));
        scratch.spectra = spectra;
        scratch.image = image;
        found
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
