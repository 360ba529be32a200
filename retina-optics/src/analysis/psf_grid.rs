//! A grid that holds a system's PSFs.

use std::f64::consts::TAU;

use serde::Serialize;

use super::pupil_grid::not_converging;
use super::{launch, refuse_strays, to_image, tracers};
use crate::OpticsError;
use crate::launch::Launcher;
use crate::pupil::{PupilPoint, gaussian};
use crate::system::OpticalSystem;
use crate::trace::{Clipping, Tracer};

/// How PSFs are sampled.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PsfGrid {
    /// Points of the pupil a side.
    pub pupil_side: usize,
    /// Pixels a side, even.
    pub side: usize,
    /// Pitch of the pixels, um.
    pub pitch_um: f64,
}

/// What of a [`PsfGrid`] is given; the rest is chosen.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct PsfGridChoice {
    /// Points of the pupil a side.
    pub pupil_side: Option<usize>,
    /// Pixels a side.
    pub side: Option<usize>,
    /// Pitch of the pixels, um.
    pub pitch_um: Option<f64>,
}

/// Half of the grid beyond the geometric spot, in units of wavelength times f-number: of an Airy pattern
/// 2 / (pi^2 x) lies beyond a radius of x such units, 0.9 % here (from the asymptotic form of
/// 1 - J0^2 - J1^2, Lord Rayleigh's encircled energy).
const DIFFRACTION_REACH: f64 = 22.0;
/// Fewest and most points of the pupil, and most pixels, a side.
const FEWEST_PUPIL: usize = 128;
const MOST: usize = 1024;
/// Pitches that a detector or an analysis may have, um.
const PITCHES_UM: std::ops::RangeInclusive<f64> = 1e-4..=1e4;

/// A grid on which the PSFs of all fields lie with some 99 % of their light: geometric spot and diffraction
/// rings. Where that takes more than 1024 pixels it holds less, as [`Psf::energy_on_grid`] says.
///
/// [`Psf::energy_on_grid`]: super::Psf::energy_on_grid
///
/// # Errors
/// The chief or rim rays do not reach the image; a ray misses a surface or is totally reflected.
pub fn psf_grid(
    system: &OpticalSystem,
    choice: PsfGridChoice,
    clipping: Clipping,
) -> Result<PsfGrid, OpticsError> {
    if let Some(pitch_um) = choice.pitch_um
        && !PITCHES_UM.contains(&pitch_um)
    {
        return Err(OpticsError::Undefined(format!(
            "a pixel pitch of {pitch_um:.3e} um: from {} to {} um are possible",
            PITCHES_UM.start(),
            PITCHES_UM.end()
        )));
    }
    let launcher = Launcher::new(system)?;
    let primary = Tracer::new(system, system.primary_nm(), Clipping::Off)?;
    let rim = (0..32).map(|i| {
        let angle = TAU * f64::from(i) / 32.0;
        PupilPoint { at: [angle.cos(), angle.sin()], weight: 0.0 }
    });
    let points: Vec<PupilPoint> = gaussian(8, 16, 0.0).into_iter().chain(rim).collect();
    let (mut spot_um, mut finest_um, mut coarsest_um): (f64, f64, f64) = (0.0, f64::INFINITY, 0.0);
    let open = tracers(system, Clipping::Off)?;
    let clipped = tracers(system, clipping)?;
    for field in &system.fields {
        let chief = to_image(&launcher, &primary, field.at, [0.0, 0.0])?.local_mm;
        for ((open, clipped), wavelength) in open.iter().zip(&clipped).zip(&system.wavelengths) {
            let mut rays = launch(&launcher, field.at, &points)?;
            clipped.trace_batch(&mut rays);
            refuse_strays(&rays, field.at)?;
            for i in (0..rays.len()).filter(|&i| rays.arrived(i)) {
                let off = (rays.x_mm[i] - chief.x).abs().max((rays.y_mm[i] - chief.y).abs());
                spot_um = spot_um.max(off * 1e3);
            }
            let index = system.surfaces[system.image() - 1].medium.index(wavelength.nm)?;
            for (k, axis) in [[1.0, 0.0], [0.0, 1.0]].into_iter().enumerate() {
                let cosine = |sign: f64| {
                    let hit = to_image(&launcher, open, field.at, axis.map(|a| sign * a))?;
                    Ok::<_, OpticsError>(hit.local_direction[k])
                };
                // Wavelength times f-number.
                let unit_um = wavelength.nm * 1e-3 / (index * (cosine(1.0)? - cosine(-1.0)?).abs());
                finest_um = finest_um.min(unit_um);
                coarsest_um = coarsest_um.max(unit_um);
            }
        }
    }
    if !(coarsest_um.is_finite() && finest_um > 0.0) {
        return Err(not_converging());
    }
    // Far beyond any grid: no more digits are needed.
    let even = |x: f64| 2 * ((x / 2.0).min(1e6).ceil() as usize);
    let wanted_um = 2.0 * (spot_um + DIFFRACTION_REACH * coarsest_um);
    let pitch_um = choice.pitch_um.unwrap_or_else(|| {
        let side = choice.side.unwrap_or(MOST) as f64;
        // Two pixels a unit, fewer where the pixels would not suffice.
        (wanted_um / side).clamp(finest_um / 2.0, 0.999 * finest_um)
    });
    let side = choice.side.unwrap_or_else(|| even(wanted_um / pitch_um).clamp(8, MOST));
    // The sampled pupil repeats after this many units: twice the grid keeps the folded tails out of it.
    let pupil_side = choice
        .pupil_side
        .unwrap_or_else(|| even(2.0 * side as f64 * pitch_um / finest_um).clamp(FEWEST_PUPIL, MOST));
    Ok(PsfGrid { pupil_side, side, pitch_um })
}
