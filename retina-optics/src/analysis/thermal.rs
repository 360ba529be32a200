//! Temperature: dn/dT and expansion.

use serde::Serialize;

use super::{SpotOptions, spots};
use crate::OpticsError;
use crate::glass::Medium;
use crate::paraxial::Paraxial;
use crate::surface::Shape;
use crate::system::OpticalSystem;

/// The system at one temperature.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ThermalPoint {
    /// degC.
    pub temperature_c: f64,
    /// Focal length at the primary wavelength, mm.
    pub efl_mm: Option<f64>,
    /// Paraxial image less the image surface, mm.
    pub defocus_mm: Option<f64>,
    /// Polychromatic RMS radius of each field, um.
    pub rms_um: Vec<f64>,
}

/// The system at a temperature and pressure: indices by dn/dT, relative to the air there; radii,
/// thicknesses, asphere terms and apertures of glass by its expansion; air gaps by `mount_per_k`.
/// Dimensions belong to 20 degC.
///
/// # Errors
/// A glass without dn/dT or expansion in its catalogue.
pub fn at_temperature(
    system: &OpticalSystem,
    temperature_c: f64,
    pressure_atm: f64,
    mount_per_k: f64,
) -> Result<OpticalSystem, OpticsError> {
    let kelvin = temperature_c - 20.0;
    let expansion = |medium: &Medium| match medium {
        Medium::Glass(glass) => glass.expansion_per_k.ok_or_else(|| {
            OpticsError::Undefined(format!("glass {} has no expansion in its catalogue", glass.name))
        }),
        _ => Ok(mount_per_k),
    };
    let mut warm = system.clone();
    for i in 0..system.image() {
        let (ahead, behind) = (
            if i == 0 { Medium::Air } else { system.surfaces[i - 1].medium.clone() },
            &system.surfaces[i].medium,
        );
        // A surface expands with its glass; a cemented one with the mean of the two.
        let figure = match (&ahead, behind) {
            (Medium::Glass(_), Medium::Glass(_)) => (expansion(&ahead)? + expansion(behind)?) / 2.0,
            (Medium::Glass(_), _) => expansion(&ahead)?,
            _ => expansion(behind)?,
        };
        let surface = &mut warm.surfaces[i];
        surface.shape = scaled(&surface.shape, 1.0 + figure * kelvin);
        surface.aperture.inner_mm *= 1.0 + figure * kelvin;
        surface.aperture.outer_mm *= 1.0 + figure * kelvin;
        surface.thickness_mm *= 1.0 + expansion(behind)? * kelvin;
        if let Medium::Glass(glass) = behind {
            // Asked once, so that a glass without dn/dT is refused here and not by a later trace.
            glass.index_at(system.primary_nm() * 1e-3, temperature_c, pressure_atm)?;
            surface.medium = Medium::GlassAt { glass: glass.clone(), temperature_c, pressure_atm };
        }
    }
    Ok(warm)
}

fn scaled(shape: &Shape, scale: f64) -> Shape {
    match shape {
        Shape::Conic { curvature_per_mm, conic } => {
            Shape::Conic { curvature_per_mm: curvature_per_mm / scale, conic: *conic }
        }
        Shape::EvenAsphere { curvature_per_mm, conic, coefficients } => Shape::EvenAsphere {
            curvature_per_mm: curvature_per_mm / scale,
            conic: *conic,
            coefficients: (1i32..).zip(coefficients).map(|(k, a)| a * scale.powi(1 - 2 * k)).collect(),
        },
        Shape::IdealLens { focal_mm } => Shape::IdealLens { focal_mm: *focal_mm },
    }
}

/// Focal length, focus and spots over temperatures (degC), 1 atm, image surface moving with the mount.
///
/// # Errors
/// As [`at_temperature`] and [`spots`].
pub fn thermal_sweep(
    system: &OpticalSystem,
    temperatures_c: &[f64],
    mount_per_k: f64,
    options: &SpotOptions,
) -> Result<Vec<ThermalPoint>, OpticsError> {
    temperatures_c
        .iter()
        .map(|&temperature_c| {
            let warm = at_temperature(system, temperature_c, 1.0, mount_per_k)?;
            let first = Paraxial::primary(&warm)?.first_order();
            Ok(ThermalPoint {
                temperature_c,
                efl_mm: first.efl_mm,
                defocus_mm: first.image_mm.map(|image| image - first.image_surface_mm),
                rms_um: spots(&warm, options)?.fields.iter().map(|field| field.rms_um).collect(),
            })
        })
        .collect()
}
