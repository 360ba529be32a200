//! The image of a screen point on the camera's sensor: what each pixel receives, by one Fourier sum over
//! the pupil.
//!
//! The amplitude at direction cosines c is U(c) = integral over the pupil of exp(i k (V(p) - c p)) d2p; the
//! share of the light per unit of c is |U|^2 / (lambda^2 A), whose integral is 1 for a clear pupil of area
//! A. The camera's objective is ideal: it takes tangents to pixels. About the reference direction,
//! c = c_0 + J^-1 (pixels / f), J the derivative of tangents by cosines; with q = J^-1 p the sum is
//! a Fourier transform over a grid of (projected) pupil points, whose step is chosen such that the samples
//! of the transform are the grid's.

use std::cell::RefCell;

use retina_fourier::{Complex32, ComplexPlanner};
use retina_simd::{Level, nearest, sine_and_cosine};

use super::zernike::{Polynomial, SIDE, WAVEFRONT_TERMS, horner};
use super::{Imaging, Wavefront};
use crate::OpticsError;
use crate::analysis::disc_coverage;

/// The sensor's grid on which a kernel is sampled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KernelGrid {
    /// Focal length of the camera's objective, pixels.
    pub focal_px: f64,
    /// Samples a pixel.
    pub per_px: usize,
    /// The kernel reaches this far from its reference, pixels.
    pub half_px: usize,
}

impl KernelGrid {
    /// Samples a side; the middle one is at the reference.
    pub fn side(&self) -> usize {
        2 * self.half_px * self.per_px + 1
    }
}

/// Share of a point's light per square pixel, or, after [`Kernel::spread`], per pixel about each sample.
#[derive(Debug, Clone, PartialEq)]
pub struct Kernel {
    /// Where it is sampled.
    pub grid: KernelGrid,
    /// Row by row, y down; the middle is at the reference direction.
    pub values: Vec<f32>,
    /// Share of the light that the pupil passes and that lies beyond the grid.
    pub beyond: f64,
}

/// Where a kernel is centred and how its axes lie.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KernelFrame {
    /// The direction of its middle, tangents in the facility's axes.
    pub reference: [f64; 2],
    /// The camera's turn about the boresight: its axes from the facility's, rad.
    pub roll_rad: f64,
}

/// Cells across the pupil in which apertures cut: the share they leave is good to 0.2 %.
const MASK_SIDE: usize = 96;

/// A wavelength and its share of the light.
pub type SpectralLine = (f64, f64);

impl Imaging {
    /// The image of a screen point that shines in these spectral lines (nm, share), in a camera's frame,
    /// per square pixel. Apertures cut. `objective` gives the wavefront (mm) that the camera's objective
    /// adds at a wavelength.
    ///
    /// # Errors
    /// The grid is too coarse for diffraction; as [`Imaging::pupil_mask`].
    pub fn kernel(
        &self,
        screen_mm: [f64; 2],
        lines: &[SpectralLine],
        defocus_mm: f64,
        frame: KernelFrame,
        grid: KernelGrid,
        objective: impl Fn(f64) -> [f64; WAVEFRONT_TERMS],
    ) -> Result<Kernel, OpticsError> {
        let side = grid.side();
        let mut sum = vec![0f64; side * side];
        let mut passed = 0.0;
        for &(nm, weight) in lines {
            let wavefront = self.wavefront(screen_mm, nm, defocus_mm);
            let mask_of = |side| self.pupil_mask(&wavefront, nm, side);
            let seen = wavefront.plus(&objective(nm));
            passed += weight * add_line(&mut sum, &seen, mask_of, (nm, weight), frame, grid)?;
        }
        Ok(Kernel::of(grid, &sum, passed))
    }
}

/// The image of a point in a camera with an ideal objective and a clear round pupil, of light that enters it with these
/// wavefronts, one a spectral line (nm, share), per square pixel.
///
/// # Errors
/// The grid is too coarse for diffraction.
pub fn clear_kernel(
    waves: &[(Wavefront, SpectralLine)],
    frame: KernelFrame,
    grid: KernelGrid,
) -> Result<Kernel, OpticsError> {
    let mut sum = vec![0f64; grid.side() * grid.side()];
    let mut passed = 0.0;
    for (wavefront, line) in waves {
        passed += line.1 * add_line(&mut sum, wavefront, |_| Ok(None), *line, frame, grid)?;
    }
    Ok(Kernel::of(grid, &sum, passed))
}

/// The image of a point at infinity on such a camera's boresight: Airy's pattern in these spectral lines.
///
/// # Errors
/// As [`clear_kernel`].
pub fn airy_kernel(
    pupil_radius_mm: f64,
    lines: &[SpectralLine],
    grid: KernelGrid,
) -> Result<Kernel, OpticsError> {
    let flat = Wavefront { coefficients_mm: [0.0; WAVEFRONT_TERMS], pupil_radius_mm };
    let waves: Vec<_> = lines.iter().map(|line| (flat, *line)).collect();
    clear_kernel(&waves, KernelFrame { reference: [0.0; 2], roll_rad: 0.0 }, grid)
}

/// Adds the image in one line; returns the share that the pupil passes.
fn add_line(
    sum: &mut [f64],
    wavefront: &Wavefront,
    mask_of: impl Fn(usize) -> Result<Option<Vec<bool>>, OpticsError>,
    (nm, weight): SpectralLine,
    frame: KernelFrame,
    grid: KernelGrid,
) -> Result<f64, OpticsError> {
    let radius_mm = wavefront.pupil_radius_mm;
    let lambda_mm = nm * 1e-6;
    // tangents t of cosines c = t / sqrt(1 + t^2): dc/dt = (1 - c c^T) / sqrt(1 + t^2) = J^-1.
    let KernelFrame { reference, roll_rad } = frame;
    let n = 1.0 / (1.0 + reference[0].powi(2) + reference[1].powi(2)).sqrt();
    let c = [reference[0] * n, reference[1] * n];
    let inverse = [[n * (1.0 - c[0] * c[0]), -n * c[0] * c[1]], [-n * c[0] * c[1], n * (1.0 - c[1] * c[1])]];
    let det = inverse[0][0] * inverse[1][1] - inverse[0][1] * inverse[1][0];
    let jacobian = [[inverse[1][1] / det, -inverse[0][1] / det], [-inverse[1][0] / det, inverse[0][0] / det]];
    // In a turned camera's axes, pixels are R d and q is R J^-1 p: p = J R^T q.
    let (sin, cos) = roll_rad.sin_cos();
    let jacobian = jacobian.map(|[a, b]| [a * cos - b * sin, a * sin + b * cos]);
    // The transform's period holds a third more than the grid; its samples are the grid's when the pupil's
    // are lambda f / (samples of a period) apart.
    let period = transform_side(grid);
    let step = lambda_mm * grid.focal_px * grid.per_px as f64 / (period as f64 * radius_mm);
    let pupil_side = (2.0 / step).ceil() as usize + 1;
    if pupil_side > period {
        return Err(OpticsError::Undefined(format!(
            "{} samples a pixel are too few for diffraction at {nm:.0} nm: take more",
            grid.per_px
        )));
    }
    let mask = mask_of(MASK_SIDE)?;
    let mut less_tilt = wavefront.coefficients_mm;
    less_tilt[0] -= c[0] * radius_mm;
    less_tilt[1] -= c[1] * radius_mm;
    let phase = Polynomial::of_terms(&less_tilt.map(|v| v / lambda_mm)).transformed(jacobian);
    let at = |i: usize| (i as f64 - (pupil_side - 1) as f64 / 2.0) * step;
    let mut amplitude = vec![Complex32::default(); pupil_side * period];
    let (mut clear, mut covered) = (0.0, 0.0);
    let level = Level::detect();
    let mut coverages = vec![0f32; pupil_side];
    let in_pupil =
        |u: f64, v: f64| [jacobian[0][0] * u + jacobian[0][1] * v, jacobian[1][0] * u + jacobian[1][1] * v];
    for row in 0..pupil_side {
        let v = at(row);
        level.run(CoverageRow { first: at(0), step, v, jacobian, coverages: &mut coverages });
        clear += coverages.iter().map(|c| f64::from(*c)).sum::<f64>();
        if let Some(mask) = &mask {
            for (column, coverage) in coverages.iter_mut().enumerate() {
                if !passes(mask, MASK_SIDE, in_pupil(at(column), v)) {
                    *coverage = 0.0;
                }
            }
        }
        covered += coverages.iter().map(|c| f64::from(*c)).sum::<f64>();
        level.run(PupilRow {
            waves: phase.on_row(v),
            first: at(0),
            step,
            coverages: &coverages,
            amplitudes: &mut amplitude[row * period..row * period + pupil_side],
        });
    }
    let (side, half) = (grid.side(), grid.side() / 2);
    // The transform's zero is in the corner.
    let wrapped: Vec<usize> = (0..side).map(|k| (k + period - half) % period).collect();
    let columns = transform(&mut amplitude, period, &wrapped);
    let cell = det.recip() * (step * radius_mm).powi(2);
    // The pupil's area as the samples have it.
    let area = clear * cell;
    let scale = weight * (cell / lambda_mm).powi(2) / area * det / grid.focal_px.powi(2);
    for (block, columns) in columns.chunks(BLOCK * period).enumerate() {
        for (line, &y) in sum.chunks_exact_mut(side).zip(&wrapped) {
            for (sum, column) in line[block * BLOCK..].iter_mut().zip(columns.chunks_exact(period)) {
                *sum += scale * f64::from(column[y].norm_sqr());
            }
        }
    }
    Ok(covered / clear)
}

/// Shares of a row's cells that lie within the pupil.
struct CoverageRow<'a> {
    /// Place of the first cell, and from cell to cell.
    first: f64,
    step: f64,
    /// The row's place.
    v: f64,
    /// The pupil's points by places.
    jacobian: [[f64; 2]; 2],
    coverages: &'a mut [f32],
}

impl retina_simd::Kernel for CoverageRow<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { first, step, v, jacobian: [x, y], coverages } = self;
        for (column, coverage) in coverages.iter_mut().enumerate() {
            let u = first + column as f64 * step;
            *coverage = disc_coverage(x[0] * u + x[1] * v, y[0] * u + y[1] * v, step) as f32;
        }
    }
}

/// A row of the pupil's amplitude.
struct PupilRow<'a> {
    /// The wavefront along the row, waves, by rising power.
    waves: [f64; SIDE],
    /// Place of the first cell, and from cell to cell.
    first: f64,
    step: f64,
    coverages: &'a [f32],
    amplitudes: &'a mut [Complex32],
}

impl retina_simd::Kernel for PupilRow<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        const LANES: usize = 16;
        let cells = self.coverages.chunks(LANES).zip(self.amplitudes.chunks_mut(LANES));
        for (chunk, (coverages, amplitudes)) in cells.enumerate() {
            let start = (chunk * LANES) as f64;
            let mut part = [0f32; LANES];
            for (k, part) in part.iter_mut().enumerate() {
                let waves = horner(&self.waves, self.first + (start + k as f64) * self.step);
                *part = (waves - nearest(waves)) as f32;
            }
            let (mut sine, mut cosine) = ([0f32; LANES], [0f32; LANES]);
            for k in 0..LANES {
                (sine[k], cosine[k]) = sine_and_cosine(part[k]);
            }
            for (k, (coverage, amplitude)) in coverages.iter().zip(amplitudes).enumerate() {
                *amplitude = Complex32::new(coverage * cosine[k], coverage * sine[k]);
            }
        }
    }
}

/// Whether the cell of a mask that holds a pupil point passes light.
fn passes(mask: &[bool], side: usize, p: [f64; 2]) -> bool {
    let cell = |v: f64| (((v + 1.0) / 2.0 * side as f64) as usize).min(side - 1);
    mask[cell(p[1]) * side + cell(p[0])]
}

/// Samples of the transform's period: a third more than the grid's, a product of small primes.
fn transform_side(grid: KernelGrid) -> usize {
    let least = (grid.side() * 4).div_ceil(3);
    let smooth = |mut n: usize| {
        for p in [2, 3] {
            while n.is_multiple_of(p) {
                n /= p;
            }
        }
        n == 1
    };
    (least..).find(|&n| smooth(n)).unwrap_or(least)
}

thread_local! {
    /// It keeps its plans.
    static PLANNER: RefCell<ComplexPlanner> = RefCell::new(ComplexPlanner::new());
}

/// Columns that are turned into rows side by side: a line of the cache holds as many numbers or fewer.
const BLOCK: usize = 16;

/// Columns of the two-dimensional transform of a square, one after another; its first rows are given, the others are
/// nothing.
fn transform(rows: &mut [Complex32], side: usize, columns: &[usize]) -> Vec<Complex32> {
    let plan = PLANNER.with_borrow_mut(|planner| planner.forward(side));
    plan.process(rows);
    let mut turned = vec![Complex32::default(); columns.len() * side];
    for (columns, turned) in columns.chunks(BLOCK).zip(turned.chunks_mut(BLOCK * side)) {
        for (y, row) in rows.chunks_exact(side).enumerate() {
            for (turned, &x) in turned.chunks_exact_mut(side).zip(columns) {
                turned[y] = row[x];
            }
        }
    }
    plan.process(&mut turned);
    turned
}

impl Kernel {
    /// Of sums over spectral lines; `passed`: the share of the light that the pupil passes.
    fn of(grid: KernelGrid, sum: &[f64], passed: f64) -> Self {
        let on_grid: f64 = sum.iter().sum::<f64>() / (grid.per_px * grid.per_px) as f64;
        Self { grid, values: sum.iter().map(|v| *v as f32).collect(), beyond: passed - on_grid }
    }

    /// Spreads each point over a box of these extents (pixels): a pixel's or a source's area.
    pub fn spread(&mut self, [width_px, height_px]: [f64; 2]) {
        let side = self.grid.side();
        let per_px = self.grid.per_px as f64;
        let level = Level::detect();
        for (width, [from_line, from_sample]) in [(width_px, [side, 1]), (height_px, [1, side])] {
            let width = width * per_px;
            level.run(Boxed { values: &mut self.values, side, width, from_line, from_sample });
        }
    }

    /// The share that a pixel on the reference and its whole-pixel neighbours receive together.
    pub fn energy(&self) -> f64 {
        let side = self.grid.side();
        let of_pixels = (0..side).step_by(self.grid.per_px);
        let sum = |y: usize| -> f64 { of_pixels.clone().map(|x| f64::from(self.values[y * side + x])).sum() };
        of_pixels.clone().map(sum).sum()
    }

    /// Direction of the centroid from the reference, pixels.
    pub fn centroid_px(&self) -> [f64; 2] {
        let side = self.grid.side();
        let (mut sum, mut x, mut y) = (0.0, 0.0, 0.0);
        for (at, &value) in self.values.iter().enumerate() {
            let value = f64::from(value);
            sum += value;
            x += value * (at % side) as f64;
            y += value * (at / side) as f64;
        }
        let middle = (side / 2) as f64;
        [x, y].map(|v| (v / sum - middle) / self.grid.per_px as f64)
    }
}

/// The mean over a box of `width` samples about each sample of each line (row or column), of the function that joins
/// the samples by straight lines and is 0 beyond them.
struct Boxed<'a> {
    values: &'a mut [f32],
    /// Samples of a line.
    side: usize,
    width: f64,
    /// From line to line, and from sample to sample of a line, in `values`.
    from_line: usize,
    from_sample: usize,
}

/// Lines that are worked on side by side.
const LINES: usize = 8;

impl retina_simd::Kernel for Boxed<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { values, side, width, from_line, from_sample } = self;
        // Both ends of all boxes stand at the same place between two samples, but for those beyond the ends.
        let half = width / 2.0;
        let (after, before) = (half.floor() as usize, half.ceil() as usize);
        let (share, other) = (half - after as f64, before as f64 - half);
        let inner = before..(side - 1).saturating_sub(after).max(before);
        let held = |x: f64| {
            let x = x.clamp(0.0, (side - 1) as f64);
            let i = (x as usize).min(side - 2);
            (i, x - i as f64)
        };
        let mut from = vec![[0f64; LINES]; side];
        // From the first sample to each.
        let mut integral = vec![[0f64; LINES]; side];
        for first in (0..side).step_by(LINES) {
            let count = LINES.min(side - first);
            for (i, from) in from.iter_mut().enumerate() {
                for (k, from) in from[..count].iter_mut().enumerate() {
                    *from = f64::from(values[(first + k) * from_line + i * from_sample]);
                }
            }
            let mut sum = [0f64; LINES];
            for i in 1..side {
                for (k, sum) in sum.iter_mut().enumerate() {
                    *sum += 0.5 * (from[i - 1][k] + from[i][k]);
                }
                integral[i] = sum;
            }
            for i in 0..side {
                let [(a, a_share), (b, b_share)] = if inner.contains(&i) {
                    [(i - before, other), (i + after, share)]
                } else {
                    [held(i as f64 - half), held(i as f64 + half)]
                };
                let mut mean = [0f32; LINES];
                let ends = [(from[a], from[a + 1], integral[a]), (from[b], from[b + 1], integral[b])];
                for (k, mean) in mean.iter_mut().enumerate() {
                    let up_to = |end: usize, share: f64| {
                        let (own, next, integral) = (ends[end].0[k], ends[end].1[k], ends[end].2[k]);
                        integral + share * (own + 0.5 * share * (next - own))
                    };
                    *mean = ((up_to(1, b_share) - up_to(0, a_share)) / width) as f32;
                }
                for (k, mean) in mean[..count].iter().enumerate() {
                    values[(first + k) * from_line + i * from_sample] = *mean;
                }
            }
        }
    }
}

#[cfg(test)]
#[path = "kernel_tests.rs"]
mod tests;
