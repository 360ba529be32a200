//! Ray fans: transverse error against pupil height.

use serde::Serialize;

use super::{to_image, tracers, unless_stopped};
use crate::OpticsError;
use crate::launch::Launcher;
use crate::system::OpticalSystem;
use crate::trace::Clipping;

/// A ray of a fan.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FanPoint {
    /// Pupil height, -1 to 1.
    pub pupil: f64,
    /// Error along the fan's own axis, relative to the chief ray of the primary wavelength, um.
    pub error_um: f64,
    /// Error across it, um.
    pub across_um: f64,
}

/// The fans of one wavelength.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct WavelengthFan {
    /// nm.
    pub wavelength_nm: f64,
    /// Rays along the pupil's y axis; those that an aperture stops are left out.
    pub y_fan: Vec<FanPoint>,
    /// Rays along the pupil's x axis.
    pub x_fan: Vec<FanPoint>,
}

/// The fans of one field.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FieldFan {
    /// The field: tangents or mm.
    pub field: [f64; 2],
    /// One for each wavelength.
    pub wavelengths: Vec<WavelengthFan>,
}

/// Ray fans of all fields.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RayFans {
    /// One for each field.
    pub fields: Vec<FieldFan>,
}

/// Ray fans with `2 half + 1` rays each.
///
/// # Errors
/// The chief ray of a field does not reach the image; a ray misses a surface or is totally reflected.
pub fn ray_fans(system: &OpticalSystem, half: usize, clipping: Clipping) -> Result<RayFans, OpticsError> {
    let launcher = Launcher::new(system)?;
    let open = tracers(system, Clipping::Off)?;
    let tracers = tracers(system, clipping)?;
    let steps = half as i32;
    let fields = system
        .fields
        .iter()
        .map(|field| {
            let chief = to_image(&launcher, &open[system.primary], field.at, [0.0, 0.0])?.local_mm;
            let wavelengths = tracers.iter().zip(&system.wavelengths).map(|(tracer, wavelength)| {
                let fan = |axis: [f64; 2]| -> Result<Vec<FanPoint>, OpticsError> {
                    let mut points = Vec::with_capacity(2 * half + 1);
                    for step in -steps..=steps {
                        let pupil = f64::from(step) / f64::from(steps.max(1));
                        let at = [pupil * axis[0], pupil * axis[1]];
                        if let Some(hit) = unless_stopped(&launcher, tracer, field.at, at)? {
                            let (dx, dy) = (hit.local_mm.x - chief.x, hit.local_mm.y - chief.y);
                            points.push(FanPoint {
                                pupil,
                                error_um: 1e3 * (dx * axis[0] + dy * axis[1]),
                                across_um: 1e3 * (dx * axis[1] + dy * axis[0]),
                            });
                        }
                    }
                    Ok(points)
                };
                Ok(WavelengthFan {
                    wavelength_nm: wavelength.nm,
                    y_fan: fan([0.0, 1.0])?,
                    x_fan: fan([1.0, 0.0])?,
                })
            });
            Ok(FieldFan { field: field.at, wavelengths: wavelengths.collect::<Result<_, OpticsError>>()? })
        })
        .collect::<Result<_, OpticsError>>()?;
    Ok(RayFans { fields })
}
