//! Diffraction: the point spread function.
//!
//! The pupil is sampled on a square grid; each ray brings its optical path difference on the reference
//! sphere, and direction cosines on the image are taken as linear in pupil position (Abbe's sine
//! condition), with the half ranges of the rim's own rays, so that the pupil may be foreshortened off
//! the axis. [`psf_huygens`] assumes neither: it sums every ray's own plane wave.

use std::f64::consts::TAU;

use retina_fourier::{Complex64, forward_f64};
use serde::Serialize;

use super::pupil_grid::{PupilGrid, primary_reference};
use super::to_image;
use crate::OpticsError;
use crate::launch::Launcher;
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
    let fft = forward_f64(side);
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
    let grids = system
        .wavelengths
        .iter()
        .map(|w| PupilGrid::new(system, &launcher, &reference, field, w.nm, pupil_side, clipping))
        .collect::<Result<Vec<_>, _>>()?;
    check_pitch(&grids, field, side, pitch_um)?;
    let mut values = vec![0.0; side * side];
    let (mut ideal, mut energy) = (0.0, 0.0);
    for (wavelength, grid) in system.wavelengths.iter().zip(&grids) {
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

/// Refuses a grid that is larger than what the sampled pupil repeats after, or coarser than the PSF's own
/// frequencies allow: its sums would not be energies.
fn check_pitch(grids: &[PupilGrid], field: [f64; 2], side: usize, pitch_um: f64) -> Result<(), OpticsError> {
    let least = |lengths: fn(&PupilGrid) -> [f64; 2]| {
        grids.iter().flat_map(lengths).map(f64::abs).fold(f64::INFINITY, f64::min)
    };
    let (repeat_um, nyquist_um) = (least(PupilGrid::period_um), least(PupilGrid::nyquist_um));
    let largest_um = nyquist_um.min(repeat_um / side as f64);
    if pitch_um <= largest_um * (1.0 + 1e-12) {
        return Ok(());
    }
    // Rounded down, so that what is printed is allowed.
    let shown = (largest_um * 1e4).floor() / 1e4;
    let why = if nyquist_um <= repeat_um / side as f64 {
        "the finest structure of the PSF".to_owned()
    } else {
        format!("the {repeat_um:.2} um after which the sampled pupil repeats; a finer pupil allows more")
    };
    Err(OpticsError::Undefined(format!(
        "field ({}, {}): {side} pixels of {pitch_um} um are too coarse: at most {shown} um, bound by {why}",
        field[0], field[1]
    )))
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
