//! The pupil of a field and wavelength on a square grid, ready for Fourier sums.

use std::f64::consts::TAU;

use retina_fourier::Complex64;

use super::wavefront::Reference;
use super::{to_image, unless_stopped};
use crate::OpticsError;
use crate::launch::Launcher;
use crate::paraxial::Paraxial;
use crate::system::OpticalSystem;
use crate::trace::{Clipping, Tracer};

/// The pupil of one field and wavelength on a grid, ready for Fourier sums.
pub(super) struct PupilGrid {
    pub(super) side: usize,
    /// Coverage of each cell by the clear pupil.
    pub(super) amplitude: Vec<f64>,
    /// In waves.
    pub(super) opd_waves: Vec<f64>,
    /// Direction cosine times index over wavelength, per unit of pupil, signed, 1/um.
    pub(super) cosine_per_um: [f64; 2],
}

/// A beam that is slower than this (f/1e6 at 500 nm) has no focus.
const LEAST_COSINE_PER_UM: f64 = 1e-6;

/// The error of a beam that has no focus.
pub(super) fn not_converging() -> OpticsError {
    OpticsError::Undefined(
        "the beam does not converge to the image: it has no point spread function and no contrast. An afocal system \
         needs a lens behind it"
            .into(),
    )
}

/// The chief ray and reference sphere of a field at the primary wavelength.
pub(super) fn primary_reference(
    system: &OpticalSystem,
    launcher: &Launcher,
    field: [f64; 2],
) -> Result<Reference, OpticsError> {
    let open = Tracer::new(system, system.primary_nm(), Clipping::Off)?;
    let chief = to_image(launcher, &open, field, [0.0, 0.0])?;
    Ok(Reference::new(system, &Paraxial::primary(system)?, &chief))
}

impl PupilGrid {
    pub(super) fn new(
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
        if cosine_per_um.iter().any(|c| !c.is_finite() || c.abs() < LEAST_COSINE_PER_UM) {
            return Err(not_converging());
        }
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
                if let Some(hit) = unless_stopped(launcher, &tracer, field, [x * inside, y * inside])? {
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

    pub(super) fn value(&self, i: usize) -> Complex64 {
        Complex64::from_polar(self.amplitude[i], -TAU * self.opd_waves[i])
    }

    pub(super) fn amplitude_sum(&self) -> f64 {
        self.amplitude.iter().sum()
    }

    /// Spacing of the image after which the sampled sums repeat, um, signed.
    pub(super) fn period_um(&self) -> [f64; 2] {
        self.cosine_per_um.map(|c| self.side as f64 / (2.0 * c))
    }

    /// Coarsest pitch (um) at which a sum over pixels is an integral over the image: the PSF's frequencies
    /// end at twice the pupil's rim.
    pub(super) fn nyquist_um(&self) -> [f64; 2] {
        self.cosine_per_um.map(|c| (1.0 / (2.0 * c)).abs())
    }

    /// Integral of the PSF (peak 1 without aberration) over the image, um^2.
    pub(super) fn energy_um2(&self) -> f64 {
        let square: f64 = self.amplitude.iter().map(|a| a * a).sum();
        let period = self.period_um();
        square * (period[0] * period[1]).abs() / self.amplitude_sum().powi(2)
    }

    /// The PSF at the nodes x by y (um), by separable Fourier sums; row by row of y.
    pub(super) fn fourier_sum(&self, x_um: &[f64], y_um: &[f64]) -> Vec<f64> {
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
#[inline(always)]
pub(crate) fn disc_coverage(x: f64, y: f64, width: f64) -> f64 {
    let reach = width * std::f64::consts::FRAC_1_SQRT_2;
    let r = (x * x + y * y).sqrt();
    if r + reach <= 1.0 {
        return 1.0;
    }
    if r - reach >= 1.0 {
        return 0.0;
    }
    let squares = |centre: f64| -> [f64; 16] {
        std::array::from_fn(|i| (centre + width * ((i as f64 + 0.5) / 16.0 - 0.5)).powi(2))
    };
    let (columns, rows) = (squares(x), squares(y));
    let of_row = |row: f64| columns.iter().map(|column| u32::from(column + row <= 1.0)).sum::<u32>();
    f64::from(rows.into_iter().map(of_row).sum::<u32>()) / 256.0
}
