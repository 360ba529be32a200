//! Diffraction: point spread function, modulation transfer, encircled energy.
//!
//! The pupil is sampled on a square grid; each ray brings its optical path difference on the reference
//! sphere, and direction cosines on the image are taken as linear in pupil position (Abbe's sine
//! condition), with the half ranges of the rim's own rays, so that the pupil may be foreshortened off
//! the axis. [`psf_huygens`] assumes neither: it sums every ray's own plane wave.

use std::f64::consts::TAU;

use rustfft::FftPlanner;
use rustfft::num_complex::Complex64;
use serde::Serialize;

use super::to_image;
use super::wavefront::Reference;
use crate::OpticsError;
use crate::launch::Launcher;
use crate::paraxial::Paraxial;
use crate::pupil::gaussian;
use crate::system::OpticalSystem;
use crate::trace::{Clipping, Crossing, Tracer};

/// A point spread function on a square grid about the primary chief ray's image point.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Psf {
    /// The field: tangents or mm.
    pub field: [f64; 2],
    /// nm; `None` for a polychromatic one.
    pub wavelength_nm: Option<f64>,
    /// Pixels a side; the centre is pixel side / 2 (from 0).
    pub side: usize,
    /// Pixel pitch along x and y, um.
    pub pitch_um: [f64; 2],
    /// Row by row (y upwards from the first row), relative to the peak without aberration.
    pub values: Vec<f64>,
    /// Share of the energy that lies on the grid.
    pub energy_on_grid: f64,
}

impl Psf {
    /// The largest value: the Strehl ratio where the grid samples the peak.
    pub fn peak(&self) -> f64 {
        self.values.iter().copied().fold(0.0, f64::max)
    }

    /// Position of a pixel's centre relative to the chief ray, um.
    pub fn at_um(&self, column: usize, row: usize) -> [f64; 2] {
        let half = (self.side / 2) as f64;
        [(column as f64 - half) * self.pitch_um[0], (row as f64 - half) * self.pitch_um[1]]
    }
}

/// The pupil of one field and wavelength on a grid, ready for Fourier sums.
struct PupilGrid {
    side: usize,
    /// Coverage of each cell by the clear pupil.
    amplitude: Vec<f64>,
    /// In waves.
    opd_waves: Vec<f64>,
    /// Direction cosine times index over wavelength, per unit of pupil, signed, 1/um.
    cosine_per_um: [f64; 2],
}

/// The chief ray and reference sphere of a field at the primary wavelength.
fn primary_reference(
    system: &OpticalSystem,
    launcher: &Launcher,
    field: [f64; 2],
) -> Result<Reference, OpticsError> {
    let open = Tracer::new(system, system.primary_nm(), Clipping::Off)?;
    let chief = to_image(launcher, &open, field, [0.0, 0.0])?;
    Ok(Reference::new(system, &Paraxial::primary(system)?, &chief))
}

impl PupilGrid {
    fn new(
        system: &OpticalSystem,
        launcher: &Launcher,
        reference: &Reference,
        field: [f64; 2],
        wavelength_nm: f64,
        side: usize,
        clipping: Clipping,
    ) -> Result<Self, OpticsError> {
        let open = Tracer::new(system, wavelength_nm, Clipping::Off)?;
        let tracer = Tracer::new(system, wavelength_nm, clipping)?;
        let index = system.surfaces[system.image() - 1].medium.index(wavelength_nm)?;
        let rim = |x: f64, y: f64| to_image(launcher, &open, field, [x, y]).map(|hit| hit.local_direction);
        let scale = index / (wavelength_nm * 1e-3);
        let cosine_per_um = [
            (rim(1.0, 0.0)?.x - rim(-1.0, 0.0)?.x) / 2.0 * scale,
            (rim(0.0, 1.0)?.y - rim(0.0, -1.0)?.y) / 2.0 * scale,
        ];
        let mut amplitude = vec![0.0; side * side];
        let mut opd_waves = vec![0.0; side * side];
        let waves = 1e6 / wavelength_nm;
        for row in 0..side {
            for column in 0..side {
                let at = |i: usize| 2.0 * (i as f64 + 0.5) / side as f64 - 1.0;
                let (x, y) = (at(column), at(row));
                let coverage = disc_coverage(x, y, 2.0 / side as f64);
                if coverage == 0.0 {
                    continue;
                }
                // A cell that the rim cuts may have its centre outside: its ray is that at the rim.
                let inside = (1.0 / x.hypot(y)).min(1.0);
                let ray = launcher.ray(field, [x * inside, y * inside])?;
                if let Ok(hit) = tracer.trace_to_image(&ray) {
                    amplitude[row * side + column] = coverage;
                    opd_waves[row * side + column] = reference.opd_mm(&hit) * waves;
                }
            }
        }
        let grid = Self { side, amplitude, opd_waves, cosine_per_um };
        grid.check_sampling(field)?;
        Ok(grid)
    }

    /// Neighbouring samples must differ by less than half a wave, or the sums alias.
    fn check_sampling(&self, field: [f64; 2]) -> Result<(), OpticsError> {
        let mut steepest: f64 = 0.0;
        // Cells that the rim cuts have their ray moved inwards: their steps are no longer whole ones.
        let whole = |i: usize| self.amplitude[i] > 0.5;
        for row in 0..self.side {
            for column in 1..self.side {
                for (i, j) in [
                    (row * self.side + column, row * self.side + column - 1),
                    (column * self.side + row, (column - 1) * self.side + row),
                ] {
                    if whole(i) && whole(j) {
                        steepest = steepest.max((self.opd_waves[i] - self.opd_waves[j]).abs());
                    }
                }
            }
        }
        if !self.amplitude.iter().any(|&a| a > 0.0) {
            return Err(OpticsError::Undefined("no ray of the field reaches the image".into()));
        }
        if steepest < 0.5 {
            return Ok(());
        }
        let needed = (self.side as f64 * steepest / 0.4).ceil();
        Err(OpticsError::Undefined(format!(
            "field ({}, {}): the wavefront changes by {steepest:.2} waves between pupil samples, more than half a \
             wave: sample the pupil with {needed} points a side or more, not {}",
            field[0], field[1], self.side
        )))
    }

    fn value(&self, i: usize) -> Complex64 {
        Complex64::from_polar(self.amplitude[i], -TAU * self.opd_waves[i])
    }

    fn amplitude_sum(&self) -> f64 {
        self.amplitude.iter().sum()
    }

    /// Spacing of the image after which the sampled sums repeat, um, signed.
    fn period_um(&self) -> [f64; 2] {
        self.cosine_per_um.map(|c| self.side as f64 / (2.0 * c))
    }

    /// Integral of the PSF (peak 1 without aberration) over the image, um^2.
    fn energy_um2(&self) -> f64 {
        let square: f64 = self.amplitude.iter().map(|a| a * a).sum();
        let period = self.period_um();
        square * (period[0] * period[1]).abs() / self.amplitude_sum().powi(2)
    }

    /// The PSF at the nodes x by y (um), by separable Fourier sums; row by row of y.
    fn fourier_sum(&self, x_um: &[f64], y_um: &[f64]) -> Vec<f64> {
        let phases = |axis: usize, at: f64| -> Vec<Complex64> {
            let step = |i: usize| 2.0 * (i as f64 + 0.5) / self.side as f64 - 1.0;
            (0..self.side).map(|i| Complex64::cis(TAU * self.cosine_per_um[axis] * step(i) * at)).collect()
        };
        let by_x: Vec<Vec<Complex64>> = x_um.iter().map(|&x| phases(0, x)).collect();
        // rows[k][row]: the sum over columns for image column k.
        let pupil: Vec<Complex64> = (0..self.amplitude.len()).map(|i| self.value(i)).collect();
        let rows: Vec<Vec<Complex64>> = by_x
            .iter()
            .map(|phase| {
                pupil
                    .chunks_exact(self.side)
                    .map(|row| row.iter().zip(phase).map(|(a, b)| a * b).sum())
                    .collect()
            })
            .collect();
        let norm = self.amplitude_sum().powi(-2);
        let mut values = Vec::with_capacity(x_um.len() * y_um.len());
        for &y in y_um {
            let phase = phases(1, y);
            for sums in &rows {
                let field: Complex64 = sums.iter().zip(&phase).map(|(a, b)| a * b).sum();
                values.push(field.norm_sqr() * norm);
            }
        }
        values
    }
}

/// Share of a square cell (centre, width) inside the unit disc, from 16 x 16 points where the rim cuts it.
pub(crate) fn disc_coverage(x: f64, y: f64, width: f64) -> f64 {
    let reach = width * std::f64::consts::FRAC_1_SQRT_2;
    let r = x.hypot(y);
    if r + reach <= 1.0 {
        return 1.0;
    }
    if r - reach >= 1.0 {
        return 0.0;
    }
    let at = |centre: f64, i: i32| centre + width * ((f64::from(i) + 0.5) / 16.0 - 0.5);
    let inside = (0..256).filter(|i| at(x, i % 16).hypot(at(y, i / 16)) <= 1.0).count();
    inside as f64 / 256.0
}

/// Monochromatic PSF by FFT: the pupil on `pupil_side` points, padded to `side` (even, larger).
///
/// # Errors
/// The chief or rim rays do not reach the image; the wavefront is too steep for the grid.
pub fn psf(
    system: &OpticalSystem,
    field: [f64; 2],
    wavelength_nm: f64,
    pupil_side: usize,
    side: usize,
    clipping: Clipping,
) -> Result<Psf, OpticsError> {
    if side < pupil_side || !side.is_multiple_of(2) {
        return Err(OpticsError::Undefined(format!(
            "a PSF of {side} pixels a side needs an even number, at least the {pupil_side} of the pupil"
        )));
    }
    let launcher = Launcher::new(system)?;
    let reference = primary_reference(system, &launcher, field)?;
    let grid = PupilGrid::new(system, &launcher, &reference, field, wavelength_nm, pupil_side, clipping)?;
    let mut data = vec![Complex64::ZERO; side * side];
    for row in 0..pupil_side {
        for column in 0..pupil_side {
            data[row * side + column] = grid.value(row * pupil_side + column);
        }
    }
    let fft = FftPlanner::new().plan_fft_forward(side);
    fft.process(&mut data);
    let mut columns: Vec<Complex64> = (0..side * side).map(|i| data[(i % side) * side + i / side]).collect();
    fft.process(&mut columns);
    // Frequency u of the forward transform stands at x = -u / (pitch of the phase): with a positive slope
    // of the cosines the axis runs backwards.
    let norm = grid.amplitude_sum().powi(-2);
    let half = side / 2;
    let pick = |i: usize, slope: f64| {
        let u = (i + side - half) % side;
        if slope < 0.0 { u } else { (side - u) % side }
    };
    let mut values = Vec::with_capacity(side * side);
    for row in 0..side {
        for column in 0..side {
            let (u, v) = (pick(column, grid.cosine_per_um[0]), pick(row, grid.cosine_per_um[1]));
            values.push(columns[u * side + v].norm_sqr() * norm);
        }
    }
    let pitch_um = grid.period_um().map(|period| period.abs() / side as f64);
    Ok(Psf { field, wavelength_nm: Some(wavelength_nm), side, pitch_um, values, energy_on_grid: 1.0 })
}

/// Polychromatic PSF on a grid of this pitch, by direct Fourier sums; wavelengths carry energy by weight
/// and keep their places relative to the primary chief ray.
///
/// # Errors
/// As [`psf`].
pub fn psf_polychromatic(
    system: &OpticalSystem,
    field: [f64; 2],
    pupil_side: usize,
    side: usize,
    pitch_um: f64,
    clipping: Clipping,
) -> Result<Psf, OpticsError> {
    let launcher = Launcher::new(system)?;
    let reference = primary_reference(system, &launcher, field)?;
    let axis: Vec<f64> = (0..side).map(|i| (i as f64 - (side / 2) as f64) * pitch_um).collect();
    let mut values = vec![0.0; side * side];
    let (mut ideal, mut energy) = (0.0, 0.0);
    for wavelength in &system.wavelengths {
        let grid = PupilGrid::new(system, &launcher, &reference, field, wavelength.nm, pupil_side, clipping)?;
        // Energy through the pupil is proportional to its clear area.
        let share = wavelength.weight * grid.amplitude.iter().map(|a| a * a).sum::<f64>();
        let density = share / grid.energy_um2();
        for (sum, value) in values.iter_mut().zip(grid.fourier_sum(&axis, &axis)) {
            *sum += density * value;
        }
        ideal += density;
        energy += share;
    }
    let energy_on_grid = values.iter().sum::<f64>() * pitch_um * pitch_um / energy;
    values.iter_mut().for_each(|value| *value /= ideal);
    Ok(Psf { field, wavelength_nm: None, side, pitch_um: [pitch_um; 2], values, energy_on_grid })
}

/// Monochromatic PSF by Huygens' principle: each ray is a plane wave of its own direction and path, with
/// Gaussian quadrature over the pupil. Slow; the check of the others.
///
/// # Errors
/// As [`psf`].
pub fn psf_huygens(
    system: &OpticalSystem,
    field: [f64; 2],
    wavelength_nm: f64,
    quadrature: (usize, usize),
    side: usize,
    pitch_um: [f64; 2],
) -> Result<Psf, OpticsError> {
    let launcher = Launcher::new(system)?;
    let reference = primary_reference(system, &launcher, field)?;
    let tracer = Tracer::new(system, wavelength_nm, Clipping::Off)?;
    let index = system.surfaces[system.image() - 1].medium.index(wavelength_nm)?;
    let points = gaussian(quadrature.0, quadrature.1, 0.0);
    let hits = points
        .iter()
        .map(|point| to_image(&launcher, &tracer, field, point.at))
        .collect::<Result<Vec<Crossing>, _>>()?;
    let per_mm = TAU * 1e6 / wavelength_nm;
    let mut psf = Psf {
        field,
        wavelength_nm: Some(wavelength_nm),
        side,
        pitch_um,
        values: Vec::new(),
        energy_on_grid: f64::NAN,
    };
    // Paths are taken relative to the first ray, so that the phase keeps its digits.
    let origin = hits[0].path_mm;
    let mut energy = 0.0;
    for row in 0..side {
        for column in 0..side {
            let [x, y] = psf.at_um(column, row);
            let at = reference.centre_mm + glam::DVec3::new(x, y, 0.0) * 1e-3;
            let field: Complex64 = hits
                .iter()
                .zip(&points)
                .map(|(hit, point)| {
                    let path = hit.path_mm - origin + index * hit.local_direction.dot(at - hit.local_mm);
                    Complex64::from_polar(point.weight, per_mm * path)
                })
                .sum();
            energy += field.norm_sqr();
            psf.values.push(field.norm_sqr());
        }
    }
    // The integral over the plane, from the extent of the pupil in direction cosines (an ellipse).
    let grid = PupilGrid::new(system, &launcher, &reference, field, wavelength_nm, 128, Clipping::Off)?;
    psf.energy_on_grid = energy * pitch_um[0] * pitch_um[1] / grid.energy_um2();
    Ok(psf)
}

/// Modulation transfer, polychromatic.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Mtf {
    /// The field: tangents or mm.
    pub field: [f64; 2],
    /// Spatial frequency, cycles/mm.
    pub frequency_per_mm: Vec<f64>,
    /// Contrast of a pattern that varies along x.
    pub x: Vec<f64>,
    /// Contrast of a pattern that varies along y.
    pub y: Vec<f64>,
    /// The same without aberration, along x.
    pub diffraction_limit: Vec<f64>,
}

/// Polychromatic MTF as the pupil's autocorrelation, at `count` + 1 frequencies up to `highest_per_mm`.
///
/// # Errors
/// As [`psf`].
pub fn mtf(
    system: &OpticalSystem,
    field: [f64; 2],
    pupil_side: usize,
    highest_per_mm: f64,
    count: usize,
    clipping: Clipping,
) -> Result<Mtf, OpticsError> {
    let launcher = Launcher::new(system)?;
    let reference = primary_reference(system, &launcher, field)?;
    let frequency_per_mm: Vec<f64> =
        (0..=count).map(|i| highest_per_mm * i as f64 / count.max(1) as f64).collect();
    let mut sums = vec![[Complex64::ZERO; 3]; count + 1];
    let mut total = 0.0;
    for wavelength in &system.wavelengths {
        let grid = PupilGrid::new(system, &launcher, &reference, field, wavelength.nm, pupil_side, clipping)?;
        let ideal = PupilGrid {
            opd_waves: vec![0.0; grid.opd_waves.len()],
            amplitude: grid.amplitude.clone(),
            ..grid
        };
        let correlations = [correlation(&grid, 0), correlation(&grid, 1), correlation(&ideal, 0)];
        let zero = correlations[2][0].re;
        total += wavelength.weight * zero;
        for (sum, &frequency) in sums.iter_mut().zip(&frequency_per_mm) {
            for (k, correlation) in correlations.iter().enumerate() {
                // One step of the pupil's grid is this frequency.
                let axis = usize::from(k == 1);
                let step = (1e3 / grid.period_um()[axis]).abs();
                let place = frequency / step;
                let i = place as usize;
                if i + 1 < correlation.len() {
                    let t = place - i as f64;
                    sum[k] += wavelength.weight * (correlation[i] * (1.0 - t) + correlation[i + 1] * t);
                }
            }
        }
    }
    let pick = |k: usize| sums.iter().map(|sum| sum[k].norm() / total).collect();
    Ok(Mtf { field, x: pick(0), y: pick(1), diffraction_limit: pick(2), frequency_per_mm })
}

/// The pupil's autocorrelation at shifts of 0, 1, ... cells along an axis (0: x, 1: y).
fn correlation(grid: &PupilGrid, axis: usize) -> Vec<Complex64> {
    let side = grid.side;
    let values: Vec<Complex64> = (0..side * side).map(|i| grid.value(i)).collect();
    let at =
        |line: usize, i: usize| if axis == 0 { values[line * side + i] } else { values[i * side + line] };
    (0..=side)
        .map(|shift| {
            let pairs = (0..side).flat_map(|line| (shift..side).map(move |i| (line, i)));
            pairs.map(|(line, i)| at(line, i) * at(line, i - shift).conj()).sum()
        })
        .collect()
}

/// Encircled energy about the centroid.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct EncircledEnergy {
    /// The field: tangents or mm.
    pub field: [f64; 2],
    /// Radii, um.
    pub radius_um: Vec<f64>,
    /// Share of all the energy of the PSF inside.
    pub fraction: Vec<f64>,
}

/// Encircled energy of a PSF about its centroid at `count` radii up to the grid's inner circle.
pub fn encircled_energy(psf: &Psf, count: usize) -> EncircledEnergy {
    let total: f64 = psf.values.iter().sum();
    let mut mean = [0.0; 2];
    let places = || (0..psf.values.len()).map(|i| (psf.at_um(i % psf.side, i / psf.side), psf.values[i]));
    for (at, value) in places() {
        mean[0] += at[0] * value / total;
        mean[1] += at[1] * value / total;
    }
    let reach =
        (0..2).map(|k| (psf.side / 2) as f64 * psf.pitch_um[k] - mean[k].abs()).fold(f64::INFINITY, f64::min);
    let radius_um: Vec<f64> = (1..=count).map(|i| reach * i as f64 / count as f64).collect();
    let mut rings = vec![0.0; count];
    let pixel = psf.pitch_um[0].max(psf.pitch_um[1]);
    for (at, value) in places() {
        let r = (at[0] - mean[0]).hypot(at[1] - mean[1]);
        // A pixel cut by a circle counts in part: its energy is spread over one pitch of radius.
        for (ring, radius) in rings.iter_mut().zip(&radius_um) {
            *ring += value * ((radius - r) / pixel + 0.5).clamp(0.0, 1.0);
        }
    }
    let fraction = rings.iter().map(|ring| ring / total * psf.energy_on_grid).collect();
    EncircledEnergy { field: psf.field, radius_um, fraction }
}
