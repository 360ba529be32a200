//! Relative illumination and vignetting over the field.

use std::f64::consts::TAU;

use serde::Serialize;

use super::clear::clear_pupil;
use super::{largest_field, to_image};
use crate::OpticsError;
use crate::launch::Launcher;
use crate::system::{Object, OpticalSystem};
use crate::trace::{Clipping, Tracer};

/// Light at one field height, primary wavelength.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct IlluminationPoint {
    /// Field radius: tangent or mm.
    pub field: f64,
    /// Share of the beam that apertures let through.
    pub transmitted: f64,
    /// Irradiance of the image of a Lambertian object, relative to the axis.
    pub relative: f64,
}

/// Relative illumination from the axis to the largest field.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Illumination {
    /// The part of each clear semi-diameter that counted as clear.
    pub clear_fraction: f64,
    /// Field points from the axis outwards.
    pub points: Vec<IlluminationPoint>,
}

/// Relative illumination at `count` steps, with apertures clipping.
///
/// Radiance is conserved, so the image's irradiance is the etendue of the beam at the launch divided by
/// the image's area: transmitted share times pupil area times cos^4 (object at infinity; the element of
/// direction cosines is cos^4 times that of tangents) or the solid angle in direction cosines (finite
/// object), over the Jacobian of image position with respect to the field.
///
/// # Errors
/// A chief ray does not reach the image; a ray misses a surface or is totally reflected.
pub fn relative_illumination(system: &OpticalSystem, count: usize) -> Result<Illumination, OpticsError> {
    let (largest, axis) = largest_field(system);
    let launcher = Launcher::new(system)?;
    let open = Tracer::new(system, system.primary_nm(), Clipping::Off)?;
    let clipped = Tracer::new(system, system.primary_nm(), Clipping::On)?;
    let scale = if largest == 0.0 { 1e-4 } else { 1e-4 * largest };
    let at = |radius: f64| -> Result<(f64, f64), OpticsError> {
        let field = [radius * axis[0], radius * axis[1]];
        let pupil = clear_pupil(&launcher, &clipped, field, [16, 64], Clipping::On)?;
        let transmitted: f64 = pupil.points.iter().map(|point| point.weight).sum();
        let rim = (0..256)
            .map(|i| {
                let angle = TAU * f64::from(i) / 256.0;
                let ray = launcher.ray(field, [angle.cos(), angle.sin()])?;
                Ok(match system.object {
                    Object::Infinity => [ray.position_mm.x, ray.position_mm.y],
                    Object::Distance(_) => [ray.direction.x, ray.direction.y],
                })
            })
            .collect::<Result<Vec<_>, OpticsError>>()?;
        let area: f64 = (0..rim.len())
            .map(|i| {
                let (a, b) = (rim[i], rim[(i + 1) % rim.len()]);
                0.5 * (a[0] * b[1] - a[1] * b[0])
            })
            .sum();
        let cos4 = match system.object {
            Object::Infinity => (1.0 + radius * radius).powi(-2),
            Object::Distance(_) => 1.0,
        };
        let image = |dx: f64, dy: f64| {
            to_image(&launcher, &open, [field[0] + dx, field[1] + dy], [0.0, 0.0]).map(|hit| hit.local_mm)
        };
        let by_x = (image(scale, 0.0)? - image(-scale, 0.0)?) / (2.0 * scale);
        let by_y = (image(0.0, scale)? - image(0.0, -scale)?) / (2.0 * scale);
        let jacobian = (by_x.x * by_y.y - by_x.y * by_y.x).abs();
        Ok((transmitted, transmitted * area.abs() * cos4 / jacobian))
    };
    let (_, reference) = at(0.0)?;
    let points = (0..=count)
        .map(|i| {
            let field = largest * i as f64 / count.max(1) as f64;
            let (transmitted, light) = at(field)?;
            Ok(IlluminationPoint { field, transmitted, relative: light / reference })
        })
        .collect::<Result<_, OpticsError>>()?;
    Ok(Illumination { clear_fraction: system.clear_fraction, points })
}
