//! Curves over the field: astigmatic foci, distortion, lateral colour.

use serde::Serialize;

use super::{largest_field, to_image, tracers};
use crate::OpticsError;
use crate::launch::Launcher;
use crate::system::OpticalSystem;
use crate::trace::Clipping;

/// Half the separation of the parabasal rays, in pupil radii: the focus is off by its square times
/// the aberration of the beam's rim.
const PARABASAL: f64 = 1e-3;

/// The chief ray's figures at one field height.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FieldPoint {
    /// Field radius: tangent or mm.
    pub field: f64,
    /// Height of the primary chief ray on the image, along the field, mm.
    pub height_mm: f64,
    /// Tangential focus from the image surface, along z, for each wavelength, mm.
    pub tangential_mm: Vec<f64>,
    /// Sagittal focus, likewise.
    pub sagittal_mm: Vec<f64>,
    /// Height over that of a distortion-free system, less 1.
    pub distortion: f64,
    /// Height of each wavelength's chief ray less that of the primary, um.
    pub lateral_colour_um: Vec<f64>,
}

/// Curves from the axis to the largest field.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FieldCurves {
    /// Wavelengths, nm.
    pub wavelengths_nm: Vec<f64>,
    /// Index of the primary.
    pub primary: usize,
    /// Image height per unit of field near the axis, mm: for an object at infinity the focal length that
    /// distortion is measured against (image surface as placed).
    pub scale_mm: f64,
    /// Field points from the axis outwards.
    pub points: Vec<FieldPoint>,
}

/// Field curves at `count` equal steps from the axis to the largest field, by rays close to the chief
/// ray (in the limit Coddington's equations).
///
/// # Errors
/// A chief ray or one close to it does not reach the image; all fields are on the axis.
pub fn field_curves(system: &OpticalSystem, count: usize) -> Result<FieldCurves, OpticsError> {
    let (largest, axis) = largest_field(system);
    if largest == 0.0 {
        return Err(OpticsError::Undefined("field curves need a field off the axis".into()));
    }
    let launcher = Launcher::new(system)?;
    let tracers = tracers(system, Clipping::Off)?;
    let across = [-axis[1], axis[0]];
    let along = |v: glam::DVec3, a: [f64; 2]| v.x * a[0] + v.y * a[1];
    let chief = |radius: f64, w: usize| {
        Ok::<f64, OpticsError>(along(
            to_image(&launcher, &tracers[w], [radius * axis[0], radius * axis[1]], [0.0, 0.0])?.local_mm,
            axis,
        ))
    };
    let focus = |radius: f64, w: usize, a: [f64; 2]| {
        let field = [radius * axis[0], radius * axis[1]];
        let ray = |side: f64| to_image(&launcher, &tracers[w], field, [side * a[0], side * a[1]]);
        let (plus, minus) = (ray(PARABASAL)?, ray(-PARABASAL)?);
        let slope = |hit: &crate::Crossing| along(hit.local_direction, a) / hit.local_direction.z;
        let gap = along(plus.local_mm, a) - along(minus.local_mm, a);
        Ok::<f64, OpticsError>(-gap / (slope(&plus) - slope(&minus)))
    };
    let small = 1e-4 * largest;
    let origin = chief(0.0, system.primary)?;
    let scale_mm = (chief(small, system.primary)? - chief(-small, system.primary)?) / (2.0 * small);
    let waves = 0..system.wavelengths.len();
    let points = (0..=count)
        .map(|i| {
            let field = largest * i as f64 / count.max(1) as f64;
            let height_mm = chief(field, system.primary)?;
            let ideal = scale_mm * field;
            Ok(FieldPoint {
                field,
                height_mm,
                tangential_mm: waves.clone().map(|w| focus(field, w, axis)).collect::<Result<_, _>>()?,
                sagittal_mm: waves.clone().map(|w| focus(field, w, across)).collect::<Result<_, _>>()?,
                distortion: if i == 0 { 0.0 } else { (height_mm - origin) / ideal - 1.0 },
                lateral_colour_um: waves
                    .clone()
                    .map(|w| Ok(1e3 * (chief(field, w)? - height_mm)))
                    .collect::<Result<_, OpticsError>>()?,
            })
        })
        .collect::<Result<_, OpticsError>>()?;
    Ok(FieldCurves {
        wavelengths_nm: system.wavelengths.iter().map(|w| w.nm).collect(),
        primary: system.primary,
        scale_mm,
        points,
    })
}
