//! Modulation transfer as the pupil's autocorrelation.

use retina_fourier::Complex64;
use serde::Serialize;

use super::pupil_grid::{PupilGrid, primary_reference};
use crate::OpticsError;
use crate::launch::Launcher;
use crate::system::OpticalSystem;
use crate::trace::Clipping;

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
/// As [`psf`](super::psf).
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
                // Beyond the cut-off there is no contrast.
                if place < (correlation.len() - 1) as f64 {
                    let i = place as usize;
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
