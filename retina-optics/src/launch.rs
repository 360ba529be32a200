//! Rays for a field and a point of the pupil.

use glam::DVec3;

use crate::OpticsError;
use crate::paraxial::Paraxial;
use crate::system::{Aiming, Object, OpticalSystem};
use crate::trace::{Clipping, Ray, Tracer};

/// Launches rays into a system: field (tangents or mm, as [`Object`] says) and pupil point
/// (unit disc) to [`Ray`]. The pupil is that of the primary wavelength, for all wavelengths.
#[derive(Debug, Clone)]
pub struct Launcher {
    object: Object,
    pupil_z_mm: f64,
    pupil_radius_mm: f64,
    /// For [`Aiming::Stop`]: the trace up to the stop and the radius there, mm.
    stop: Option<(Tracer, usize, f64)>,
}

impl Launcher {
    /// For a system that has passed its check.
    ///
    /// # Errors
    /// As [`Paraxial::new`].
    pub fn new(system: &OpticalSystem) -> Result<Self, OpticsError> {
        let paraxial = Paraxial::primary(system)?;
        let (pupil_z_mm, pupil_radius_mm) = paraxial.entrance_pupil_mm();
        let stop = match system.aiming {
            Aiming::Paraxial => None,
            Aiming::Stop => {
                let tracer = Tracer::with_indices(system, paraxial.indices(), Clipping::Off);
                let radius = paraxial.marginal()[system.stop].y_mm.abs();
                Some((tracer, system.stop + 1, radius))
            }
        };
        Ok(Self { object: system.object, pupil_z_mm, pupil_radius_mm, stop })
    }

    /// The ray of a field through a pupil point. For an object at infinity its optical path counts
    /// from the wavefront through the first vertex; else from the object point.
    ///
    /// # Errors
    /// Aiming at the stop finds no ray.
    pub fn ray(&self, field: [f64; 2], pupil: [f64; 2]) -> Result<Ray, OpticsError> {
        let start = [pupil[0] * self.pupil_radius_mm, pupil[1] * self.pupil_radius_mm];
        match &self.stop {
            None => Ok(self.through(field, start)),
            Some((tracer, count, radius)) => {
                let target = [pupil[0] * radius, pupil[1] * radius];
                self.aim(tracer, *count, field, start, target)
            }
        }
    }

    /// The ray of a field through a point (mm) of the paraxial entrance pupil's plane.
    fn through(&self, field: [f64; 2], point_mm: [f64; 2]) -> Ray {
        let on_pupil = DVec3::new(point_mm[0], point_mm[1], self.pupil_z_mm);
        match self.object {
            Object::Infinity => {
                let direction = DVec3::new(field[0], field[1], 1.0).normalize();
                Ray { position_mm: on_pupil, direction, path_mm: direction.dot(on_pupil) }
            }
            Object::Distance(distance) => {
                let from = DVec3::new(field[0], field[1], -distance);
                let sign = if self.pupil_z_mm < -distance { -1.0 } else { 1.0 };
                Ray { position_mm: from, direction: sign * (on_pupil - from).normalize(), path_mm: 0.0 }
            }
        }
    }

    /// Newton's method on the point in the paraxial pupil, with differences for derivatives.
    fn aim(
        &self,
        tracer: &Tracer,
        count: usize,
        field: [f64; 2],
        start: [f64; 2],
        target: [f64; 2],
    ) -> Result<Ray, OpticsError> {
        let miss = |point: [f64; 2]| {
            let crossing = tracer.trace_first(&self.through(field, point), count).map_err(|failure| {
                OpticsError::Ray {
                    what: format!("aiming field ({}, {}) at the stop", field[0], field[1]),
                    failure,
                }
            })?;
            Ok::<_, OpticsError>([crossing.local_mm.x - target[0], crossing.local_mm.y - target[1]])
        };
        let mut point = start;
        let h = 1e-4 * self.pupil_radius_mm;
        for _ in 0..20 {
            let e = miss(point)?;
            if e[0].hypot(e[1]) < 1e-11 * (1.0 + self.pupil_radius_mm) {
                return Ok(self.through(field, point));
            }
            let ex = miss([point[0] + h, point[1]])?;
            let ey = miss([point[0], point[1] + h])?;
            let (a, b, c, d) =
                ((ex[0] - e[0]) / h, (ey[0] - e[0]) / h, (ex[1] - e[1]) / h, (ey[1] - e[1]) / h);
            let det = a * d - b * c;
            point[0] -= (d * e[0] - b * e[1]) / det;
            point[1] -= (a * e[1] - c * e[0]) / det;
        }
        let e = miss(point)?;
        // Differences leave a linear convergence of about 1e-5 a turn: this is never reached by a
        // system whose pupil is an image of its stop.
        Err(OpticsError::Aiming(format!("the best ray is {:.3e} mm off", e[0].hypot(e[1]))))
    }
}
