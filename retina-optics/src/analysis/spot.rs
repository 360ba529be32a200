//! Spot diagrams and their polychromatic RMS radius.

use serde::Serialize;

use super::clear::clear_pupil;
use super::{launch, refuse_strays, tracers};
use crate::OpticsError;
use crate::launch::Launcher;
use crate::paraxial::Paraxial;
use crate::pupil::PupilPoint;
use crate::system::OpticalSystem;
use crate::trace::{Clipping, RayBatch};

/// How a spot is sampled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpotOptions {
    /// Gauss-Legendre rings of the pupil.
    pub rings: usize,
    /// Arms of the pupil.
    pub arms: usize,
    /// Whether clear apertures stop rays.
    pub clipping: Clipping,
}

impl Default for SpotOptions {
    /// Enough for 0.1 % of the RMS of an unclipped beam. Where apertures cut the beam, the arms are split
    /// at the edge and there are more of them, so that rings and arms mean the same there.
    fn default() -> Self {
        Self { rings: 8, arms: 16, clipping: Clipping::On }
    }
}

/// Spots of all fields.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SpotDiagram {
    /// Radius of the first dark ring, um: 1.22 lambda times the paraxial working f-number, primary
    /// wavelength; `None` where the image is at infinity.
    pub airy_radius_um: Option<f64>,
    /// Whether clear apertures stopped rays.
    pub clipped: bool,
    /// The part of each clear semi-diameter that counted as clear.
    pub clear_fraction: f64,
    /// One for each field.
    pub fields: Vec<FieldSpot>,
}

/// The spot of one field. Positions are in the image surface's axes.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FieldSpot {
    /// The field: tangents or mm.
    pub field: [f64; 2],
    /// Centroid over all wavelengths, mm.
    pub centroid_mm: [f64; 2],
    /// RMS distance from that centroid over all wavelengths, um.
    pub rms_um: f64,
    /// Largest distance of a sampled ray from it, um.
    pub largest_um: f64,
    /// Share of the beam (by pupil area and wavelength weight) that does not arrive.
    pub vignetted_fraction: f64,
    /// One for each wavelength.
    pub wavelengths: Vec<WavelengthSpot>,
}

/// The spot of one field at one wavelength.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct WavelengthSpot {
    /// nm.
    pub wavelength_nm: f64,
    /// Centroid at this wavelength, mm.
    pub centroid_mm: [f64; 2],
    /// RMS distance from this wavelength's own centroid, um.
    pub rms_um: f64,
    /// Where the rays that arrive meet the image, mm.
    pub points_mm: Vec<[f64; 2]>,
}

/// Weighted sums over points: weight, first and second moments about an offset that keeps digits.
#[derive(Clone, Copy, Default)]
struct Moments {
    weight: f64,
    x: f64,
    y: f64,
    square: f64,
}

impl Moments {
    fn add(&mut self, weight: f64, x: f64, y: f64) {
        self.weight += weight;
        self.x += weight * x;
        self.y += weight * y;
        self.square += weight * (x * x + y * y);
    }

    fn join(&mut self, other: &Self, weight: f64) {
        self.weight += weight * other.weight;
        self.x += weight * other.x;
        self.y += weight * other.y;
        self.square += weight * other.square;
    }

    fn mean(&self) -> [f64; 2] {
        [self.x / self.weight, self.y / self.weight]
    }

    fn rms(&self) -> f64 {
        let [x, y] = self.mean();
        (self.square / self.weight - x * x - y * y).max(0.0).sqrt()
    }
}

fn moments(rays: &RayBatch, points: &[PupilPoint], origin: [f64; 2]) -> Moments {
    let mut sums = Moments::default();
    for (i, point) in points.iter().enumerate() {
        if rays.arrived(i) {
            sums.add(point.weight, rays.x_mm[i] - origin[0], rays.y_mm[i] - origin[1]);
        }
    }
    sums
}

/// Spots by Gaussian quadrature over the pupil, or over what apertures leave of it.
///
/// # Errors
/// A field of which no ray arrives; a ray that misses a surface or is totally reflected; as
/// [`Launcher::ray`].
pub fn spots(system: &OpticalSystem, options: &SpotOptions) -> Result<SpotDiagram, OpticsError> {
    let quadrature = [options.rings, options.arms];
    let launcher = Launcher::new(system)?;
    let tracers = tracers(system, options.clipping)?;
    let airy_radius_um = Paraxial::primary(system)?
        .first_order()
        .working_f_number
        .map(|f_number| 1.22 * system.primary_nm() * 1e-3 * f_number);
    let total: f64 = system.wavelengths.iter().map(|wavelength| wavelength.weight).sum();
    let mut fields = Vec::with_capacity(system.fields.len());
    for (number, field) in system.fields.iter().enumerate() {
        let mut sums = Moments::default();
        let mut origin = None;
        let mut wavelengths = Vec::with_capacity(tracers.len());
        let mut failure = None;
        for (tracer, wavelength) in tracers.iter().zip(&system.wavelengths) {
            let pupil = clear_pupil(&launcher, tracer, field.at, quadrature, options.clipping)?;
            failure = failure.or(pupil.failure);
            let points = &pupil.points;
            let mut rays = launch(&launcher, field.at, points)?;
            tracer.trace_batch(&mut rays);
            refuse_strays(&rays, field.at)?;
            // Moments are taken about the first ray that arrives, so that they keep their digits.
            let first = (0..rays.len()).find(|&i| rays.arrived(i)).map(|i| [rays.x_mm[i], rays.y_mm[i]]);
            origin = origin.or(first);
            let (Some(origin), Some(_)) = (origin, first) else { continue };
            let own = moments(&rays, points, origin);
            sums.join(&own, wavelength.weight);
            let mean = own.mean();
            wavelengths.push(WavelengthSpot {
                wavelength_nm: wavelength.nm,
                centroid_mm: [mean[0] + origin[0], mean[1] + origin[1]],
                rms_um: own.rms() * 1e3,
                points_mm: (0..rays.len())
                    .filter(|&i| rays.arrived(i))
                    .map(|i| [rays.x_mm[i], rays.y_mm[i]])
                    .collect(),
            });
        }
        let (Some(origin), true) = (origin, sums.weight > 0.0) else {
            return Err(no_rays(number, options.rings * options.arms, failure));
        };
        let mean = sums.mean();
        let centroid_mm = [mean[0] + origin[0], mean[1] + origin[1]];
        let largest = wavelengths
            .iter()
            .flat_map(|spot| &spot.points_mm)
            .map(|at| (at[0] - centroid_mm[0]).hypot(at[1] - centroid_mm[1]))
            .fold(0.0, f64::max);
        fields.push(FieldSpot {
            field: field.at,
            centroid_mm,
            rms_um: sums.rms() * 1e3,
            largest_um: largest * 1e3,
            vignetted_fraction: (1.0 - sums.weight / total).max(0.0),
            wavelengths,
        });
    }
    Ok(SpotDiagram {
        airy_radius_um,
        clipped: options.clipping == Clipping::On,
        clear_fraction: system.clear_fraction,
        fields,
    })
}

pub(crate) fn no_rays(number: usize, rays: usize, failure: Option<crate::RayFailure>) -> OpticsError {
    match failure {
        Some(failure) => OpticsError::NoRays { field: number + 1, rays, failure },
        None => OpticsError::Undefined(format!("field {}: no ray was launched", number + 1)),
    }
}
