//! Optical path difference against a reference sphere.

use glam::DVec3;
use serde::Serialize;

use super::clear::clear_pupil;
use super::{to_image, unless_stopped};
use crate::OpticsError;
use crate::launch::Launcher;
use crate::paraxial::Paraxial;
use crate::system::OpticalSystem;
use crate::trace::{Clipping, Crossing, Tracer};

/// Beyond this radius (mm) the reference sphere is taken as a plane.
const FLAT_MM: f64 = 1e8;

/// The wavefront at a pupil point.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct WavefrontPoint {
    /// On the unit disc.
    pub pupil: [f64; 2],
    /// Optical path of the chief ray less that of this ray, up to the reference sphere, waves; `None`
    /// where an aperture stops the ray.
    pub opd_waves: Option<f64>,
}

/// The wavefront of one field at one wavelength.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Wavefront {
    /// The field: tangents or mm.
    pub field: [f64; 2],
    /// nm.
    pub wavelength_nm: f64,
    /// RMS about its mean, waves, by Gaussian quadrature over the rays that arrive.
    pub rms_waves: f64,
    /// Largest less smallest OPD on the grid, waves.
    pub peak_to_valley_waves: f64,
    /// A square grid over the pupil, the points of the unit disc, row by row from y = -1.
    pub points: Vec<WavefrontPoint>,
}

/// The reference sphere: its centre on the image, and the signed distance of the exit pupil before it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Reference {
    pub(crate) centre_mm: DVec3,
    radius_mm: f64,
    index: f64,
    chief_path_mm: f64,
}

impl Reference {
    /// About the point where `chief` meets the image; the sphere passes through the paraxial exit pupil.
    pub(crate) fn new(system: &OpticalSystem, paraxial: &Paraxial, chief: &Crossing) -> Self {
        let first = paraxial.first_order();
        let index = paraxial.indices()[system.image() - 1];
        let radius_mm = first.exit_pupil_mm.map_or(f64::INFINITY, |exit| {
            let dz = first.image_surface_mm - exit;
            dz.signum() * DVec3::new(chief.local_mm.x, chief.local_mm.y, dz).length()
        });
        let mut reference = Self { centre_mm: chief.local_mm, radius_mm, index, chief_path_mm: 0.0 };
        reference.chief_path_mm = reference.path_mm(chief);
        reference
    }

    /// Path of a ray up to the sphere, mm.
    fn path_mm(&self, hit: &Crossing) -> f64 {
        let offset = hit.local_mm - self.centre_mm;
        let b = offset.dot(hit.local_direction);
        let back = if self.radius_mm.abs() > FLAT_MM {
            b
        } else {
            b + (b * b - offset.length_squared() + self.radius_mm * self.radius_mm)
                .sqrt()
                .copysign(self.radius_mm)
        };
        hit.path_mm - self.index * back
    }

    /// OPD of a ray against another wavelength's or its own chief ray, mm.
    pub(crate) fn opd_mm(&self, hit: &Crossing) -> f64 {
        self.chief_path_mm - self.path_mm(hit)
    }
}

/// The wavefront of a field (tangents or mm) on a grid of `side` x `side` pupil points, against the sphere
/// about the chief ray's image point.
///
/// # Errors
/// The chief ray, or all rays, do not reach the image; a ray misses a surface or is totally reflected.
pub fn wavefront(
    system: &OpticalSystem,
    field: [f64; 2],
    wavelength_nm: f64,
    side: usize,
    clipping: Clipping,
) -> Result<Wavefront, OpticsError> {
    let launcher = Launcher::new(system)?;
    let open = Tracer::new(system, wavelength_nm, Clipping::Off)?;
    let tracer = Tracer::new(system, wavelength_nm, clipping)?;
    let chief = to_image(&launcher, &open, field, [0.0, 0.0])?;
    let reference = Reference::new(system, &Paraxial::new(system, wavelength_nm)?, &chief);
    let waves = 1e6 / wavelength_nm;
    let opd = |pupil: [f64; 2]| -> Result<Option<f64>, OpticsError> {
        Ok(unless_stopped(&launcher, &tracer, field, pupil)?.map(|hit| reference.opd_mm(&hit) * waves))
    };
    let (mut weight, mut sum, mut square) = (0.0, 0.0, 0.0);
    for point in clear_pupil(&launcher, &tracer, field, [12, 24], clipping)?.points {
        if let Some(value) = opd(point.at)? {
            weight += point.weight;
            sum += point.weight * value;
            square += point.weight * value * value;
        }
    }
    if weight == 0.0 {
        return Err(OpticsError::Undefined("no ray of the field reaches the image".into()));
    }
    let mut points = Vec::new();
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for row in 0..side {
        for column in 0..side {
            let at = |i: usize| 2.0 * (i as f64 + 0.5) / side as f64 - 1.0;
            let pupil = [at(column), at(row)];
            if pupil[0] * pupil[0] + pupil[1] * pupil[1] <= 1.0 {
                let opd_waves = opd(pupil)?;
                if let Some(value) = opd_waves {
                    (low, high) = (low.min(value), high.max(value));
                }
                points.push(WavefrontPoint { pupil, opd_waves });
            }
        }
    }
    let mean = sum / weight;
    Ok(Wavefront {
        field,
        wavelength_nm,
        rms_waves: (square / weight - mean * mean).max(0.0).sqrt(),
        peak_to_valley_waves: if high >= low { high - low } else { 0.0 },
        points,
    })
}
