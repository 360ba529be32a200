//! The questions of an optical engineer, answered as plain data.
//!
//! Every result is a serialisable structure with units in its names; drawings are in [`crate::plot`].

mod fan;
mod field;
mod ghost;
mod illumination;
mod psf;
mod seidel;
mod spot;
mod thermal;
mod tolerance;
mod wavefront;

pub use fan::{FanPoint, FieldFan, RayFans, WavelengthFan, ray_fans};
pub use field::{FieldCurves, FieldPoint, field_curves};
pub use ghost::{Ghost, ghosts};
pub use illumination::{Illumination, IlluminationPoint, relative_illumination};
pub(crate) use psf::disc_coverage;
pub use psf::{EncircledEnergy, Mtf, Psf, encircled_energy, mtf, psf, psf_huygens, psf_polychromatic};
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
use crate::trace::{Clipping, Crossing, RayBatch, Tracer};

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
