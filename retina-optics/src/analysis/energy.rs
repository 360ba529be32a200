//! Encircled energy.

use serde::Serialize;

use super::Psf;

/// Encircled energy about the centroid.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct EncircledEnergy {
    /// The field: tangents or mm.
    pub field: [f64; 2],
    /// Radii, um.
    pub radius_um: Vec<f64>,
    /// Share inside, of all the light that the clear pupil sends, whatever the grid holds of it.
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
