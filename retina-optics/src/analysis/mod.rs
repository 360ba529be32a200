//! The questions of an optical engineer, answered as plain data.
//!
//! Every result is a serialisable structure with units in its names; drawings are in [`crate::plot`].

mod clear;
mod energy;
mod fan;
mod field;
mod ghost;
mod illumination;
mod mtf;
mod psf;
mod psf_grid;
mod pupil_grid;
mod seidel;
mod spot;
mod thermal;
mod tolerance;
mod wavefront;

pub use energy::{EncircledEnergy, encircled_energy};
pub use fan::{FanPoint, FieldFan, RayFans, WavelengthFan, ray_fans};
pub use field::{FieldCurves, FieldPoint, field_curves};
pub use ghost::{Ghost, ghosts};
pub use illumination::{Illumination, IlluminationPoint, relative_illumination};
pub use mtf::{Mtf, mtf};
pub use psf::{Psf, psf, psf_huygens, psf_polychromatic};
pub use psf_grid::{PsfGrid, PsfGridChoice, psf_grid};
pub(crate) use pupil_grid::disc_coverage;
pub use seidel::{Seidel, SeidelTerm, seidel_sums};
pub use spot::{FieldSpot, SpotDiagram, SpotOptions, WavelengthSpot, spots};
pub use thermal::{ThermalPoint, at_temperature, thermal_sweep};
pub use tolerance::{
    Percentiles, ToleranceReport, ToleranceTrial, Tolerances, lens_elements, tolerance_monte_carlo,
};
pub use wavefront::{Wavefront, WavefrontPoint, wavefront};

use crate::OpticsError;
use crate::launch::Launcher;
use crate::pupil::PupilPoint;
use crate::system::OpticalSystem;
use crate::trace::{Clipping, Crossing, RayBatch, RayFailure, Tracer};

/// A tracer for each of the system's wavelengths.
pub(crate) fn tracers(system: &OpticalSystem, clipping: Clipping) -> Result<Vec<Tracer>, OpticsError> {
    system.wavelengths.iter().map(|wavelength| Tracer::new(system, wavelength.nm, clipping)).collect()
}

/// The rays of one field through the points of a pupil, untraced.
pub(crate) fn launch(
    launcher: &Launcher,
    field: [f64; 2],
    points: &[PupilPoint],
) -> Result<RayBatch, OpticsError> {
    let mut rays = RayBatch::with_capacity(points.len());
    for point in points {
        rays.push(&launcher.ray(field, point.at)?);
    }
    Ok(rays)
}

/// One ray to the image, or which one failed.
pub(crate) fn to_image(
    launcher: &Launcher,
    tracer: &Tracer,
    field: [f64; 2],
    pupil: [f64; 2],
) -> Result<Crossing, OpticsError> {
    tracer.trace_to_image(&launcher.ray(field, pupil)?).map_err(|failure| OpticsError::Ray {
        what: format!("field ({}, {}), pupil ({}, {})", field[0], field[1], pupil[0], pupil[1]),
        failure,
    })
}

/// As [`to_image`]; `None` where an aperture stops the ray. One that misses a surface or is totally
/// reflected is not vignetted: the system has no such ray, and figures without it would mislead.
pub(crate) fn unless_stopped(
    launcher: &Launcher,
    tracer: &Tracer,
    field: [f64; 2],
    pupil: [f64; 2],
) -> Result<Option<Crossing>, OpticsError> {
    match to_image(launcher, tracer, field, pupil) {
        Ok(hit) => Ok(Some(hit)),
        Err(OpticsError::Ray { failure: RayFailure::Vignetted { .. }, .. }) => Ok(None),
        Err(error) => Err(error),
    }
}

/// Refuses a traced batch in which rays failed otherwise than at an aperture, as [`unless_stopped`] does
/// for one ray; says how many.
pub(crate) fn refuse_strays(rays: &RayBatch, field: [f64; 2]) -> Result<(), OpticsError> {
    let strays = || {
        (0..rays.len()).filter_map(|i| match rays.failure(i) {
            None | Some(RayFailure::Vignetted { .. }) => None,
            Some(failure) => Some(failure),
        })
    };
    match strays().next() {
        None => Ok(()),
        Some(failure) => Err(OpticsError::Ray {
            what: format!(
                "field ({}, {}): {} of {} rays fail, and not at an aperture",
                field[0],
                field[1],
                strays().count(),
                rays.len()
            ),
            failure,
        }),
    }
}

/// The field farthest from the axis, as radius and unit direction; straight along y where all
/// fields are on the axis.
pub(crate) fn largest_field(system: &OpticalSystem) -> (f64, [f64; 2]) {
    let radius = |at: [f64; 2]| at[0].hypot(at[1]);
    let largest = system
        .fields
        .iter()
        .map(|field| field.at)
        .max_by(|a, b| radius(*a).total_cmp(&radius(*b)))
        .unwrap_or([0.0; 2]);
    match radius(largest) {
        0.0 => (0.0, [0.0, 1.0]),
        r => (r, [largest[0] / r, largest[1] / r]),
    }
}
