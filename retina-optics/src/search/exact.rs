//! Spots of a candidate by exact rays, at the best common focus.

use serde::Serialize;

use super::candidate::{FacilityDesign, Group, Library, Placement};
use super::request::{Configuration, SearchRequest};
use crate::analysis::{SpotOptions, spots};
use crate::pupil::{PupilPoint, gaussian};
use crate::{Clipping, Launcher, OpticalSystem, OpticsError, RayBatch, Tracer};

/// A mean square spot radius as a function of defocus s: constant + 2 half_linear s + square s^2.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Quadratic {
    pub(crate) constant: f64,
    pub(crate) half_linear: f64,
    pub(crate) square: f64,
}

impl Quadratic {
    pub(crate) fn at(&self, s: f64) -> f64 {
        self.constant + s * (2.0 * self.half_linear + s * self.square)
    }
}

/// The defocus at which the largest of several convex parabolas is smallest, and that value. It lies
/// at a vertex or where two of them meet.
pub(crate) fn best_common_focus(fields: &[Quadratic]) -> (f64, f64) {
    let worst = |s: f64| fields.iter().map(|field| field.at(s)).fold(f64::NEG_INFINITY, f64::max);
    let mut best = (0.0, f64::INFINITY);
    let mut take = |s: f64| {
        let value = worst(s);
        // Where two parabolas do not meet s is no number.
        if s.is_finite() && value < best.1 {
            best = (s, value);
        }
    };
    for (i, a) in fields.iter().enumerate() {
        take(-a.half_linear / a.square);
        for b in &fields[i + 1..] {
            let (square, half, constant) =
                (a.square - b.square, a.half_linear - b.half_linear, a.constant - b.constant);
            if square.abs() <= 1e-12 * a.square {
                take(-constant / (2.0 * half));
            } else {
                let root = (half * half - square * constant).sqrt();
                take((-half + root) / square);
                take((-half - root) / square);
            }
        }
    }
    best
}

/// Half of the pupil of a system that is symmetric about the plane of its fields (x = 0).
pub(crate) fn half_pupil(rings: usize, arms: usize) -> Vec<PupilPoint> {
    gaussian(rings, arms, 0.0)
        .into_iter()
        .filter(|point| point.at[0] > 0.0)
        .map(|point| PupilPoint { weight: 2.0 * point.weight, ..point })
        .collect()
}

/// Mean square radii (mm^2) of a system's fields about their centroids as functions of defocus,
/// apertures open, and the largest share of a field's beam that the apertures take at the primary
/// wavelength. `None` where a ray fails.
pub(crate) fn trace_fields(
    system: &OpticalSystem,
    indices: &[Vec<f64>],
    points: &[PupilPoint],
) -> Result<Option<(Vec<Quadratic>, f64)>, OpticsError> {
    let launcher = Launcher::new(system)?;
    let tracers: Vec<Tracer> =
        indices.iter().map(|indices| Tracer::with_indices(system, indices, Clipping::Off)).collect();
    let clipped = Tracer::with_indices(system, &indices[system.primary], Clipping::On);
    let mut fields = Vec::with_capacity(system.fields.len());
    let mut vignetted: f64 = 0.0;
    for field in &system.fields {
        let mut launched = RayBatch::with_capacity(points.len());
        for point in points {
            launched.push(&launcher.ray(field.at, point.at)?);
        }
        // Sums of weights and of products of (y, dy/dz) with themselves, and of (x, dx/dz); the mean
        // of x and of its slope vanish by symmetry.
        let (mut weight, mut mean) = (0.0, [0.0; 2]);
        let mut sum = Quadratic::default();
        let mut origin = None;
        for tracer in &tracers {
            let mut rays = launched.clone();
            tracer.trace_batch(&mut rays);
            for (i, point) in points.iter().enumerate() {
                if !rays.arrived(i) {
                    return Ok(None);
                }
                let origin = *origin.get_or_insert(rays.y_mm[i]);
                let (x, y) = (rays.x_mm[i], rays.y_mm[i] - origin);
                let (p, q) = (rays.l[i] / rays.n[i], rays.m[i] / rays.n[i]);
                weight += point.weight;
                mean[0] += point.weight * y;
                mean[1] += point.weight * q;
                sum.constant += point.weight * (x * x + y * y);
                sum.half_linear += point.weight * (x * p + y * q);
                sum.square += point.weight * (p * p + q * q);
            }
        }
        let [y, q] = mean.map(|sum| sum / weight);
        fields.push(Quadratic {
            constant: sum.constant / weight - y * y,
            half_linear: sum.half_linear / weight - y * q,
            square: sum.square / weight - q * q,
        });
        clipped.trace_batch(&mut launched);
        let lost = (0..points.len()).filter(|&i| !launched.arrived(i)).map(|i| points[i].weight).sum();
        vignetted = vignetted.max(lost);
    }
    Ok(Some((fields, vignetted)))
}

/// How the screen stands in a result.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ScreenFocus {
    /// Where the worst RMS of the fields is smallest.
    Best,
    /// This far behind the paraxial image, mm.
    Defocus(f64),
}

/// One configuration of an evaluated design. Spots in um on the camera's sensor.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ConfigurationResult {
    /// Its name.
    pub name: String,
    /// M.
    pub m: f64,
    /// Camera pupil to the collimator's first vertex, mm.
    pub pupil_to_first_vertex_mm: f64,
    /// Last vertex of the collimator to the first of the relay, mm.
    pub collimator_to_relay_mm: f64,
    /// Last vertex of the relay to the screen, defocus included, mm.
    pub relay_to_screen_mm: f64,
    /// The screen behind the paraxial image, mm.
    pub defocus_mm: f64,
    /// Spots, apertures open.
    pub fields: Vec<FieldResult>,
}

/// One field of a configuration.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FieldResult {
    /// Tangent of the field.
    pub tan: f64,
    /// Polychromatic RMS radius about the centroid, um on the sensor, apertures open.
    pub rms_um: f64,
    /// Share of the beam that the apertures take.
    pub vignetted_fraction: f64,
}

/// The configurations of a design in the request's order, finely sampled: 12 x 24 points of the pupil.
/// Also the traced systems, screen in place.
///
/// # Errors
/// An unknown part; distances that the bench forbids; rays that do not arrive.
pub fn evaluate(
    design: &FacilityDesign,
    request: &SearchRequest,
    focus: ScreenFocus,
) -> Result<(Vec<ConfigurationResult>, Vec<OpticalSystem>), OpticsError> {
    let source = std::path::Path::new("the design");
    let (library, groups) = Library::of_design(design, request, source)
        .map_err(|error| OpticsError::Undefined(error.to_string()))?;
    let figures = groups.map(|group| library.figures(&group));
    let mut results = Vec::new();
    let mut systems = Vec::new();
    for configuration in &request.configurations {
        let placement = library
            .placement(&figures, request, configuration)
            .map_err(|limit| OpticsError::Undefined(format!("{}: {}", configuration.name, limit.words())))?;
        let (result, system) = fine(&library, &groups, &placement, request, configuration, focus)?;
        results.push(result);
        systems.push(system);
    }
    Ok((results, systems))
}

fn fine(
    library: &Library,
    groups: &[Group; 2],
    placement: &Placement,
    request: &SearchRequest,
    configuration: &Configuration,
    focus: ScreenFocus,
) -> Result<(ConfigurationResult, OpticalSystem), OpticsError> {
    let (rings, arms) = (12, 24);
    let defocus_mm = match focus {
        ScreenFocus::Defocus(defocus_mm) => defocus_mm,
        ScreenFocus::Best => {
            let system = library.system(groups, placement, 0.0, request, configuration)?;
            let indices = indices(library, groups);
            let traced = trace_fields(&system, &indices, &half_pupil(rings, arms))?;
            let (fields, _) = traced.ok_or_else(|| {
                OpticsError::Undefined(format!(
                    "{}: rays of a field do not reach the screen",
                    configuration.name
                ))
            })?;
            best_common_focus(&fields).0
        }
    };
    let system = library.system(groups, placement, defocus_mm, request, configuration)?;
    let open = spots(&system, &SpotOptions { rings, arms, clipping: Clipping::Off })?;
    let clipped = spots(&system, &SpotOptions { rings: 24, arms: 48, clipping: Clipping::On })?;
    let scale = configuration.camera_focal_mm / configuration.facility_focal_mm(request.collimator_focal_mm);
    let fields = configuration.field_tans.iter().zip(open.fields.iter().zip(&clipped.fields)).map(
        |(&tan, (open, clipped))| FieldResult {
            tan,
            rms_um: open.rms_um * scale,
            vignetted_fraction: clipped.vignetted_fraction,
        },
    );
    let result = ConfigurationResult {
        name: configuration.name.clone(),
        m: configuration.magnification,
        pupil_to_first_vertex_mm: placement.pupil_to_first_vertex_mm,
        collimator_to_relay_mm: placement.collimator_to_relay_mm,
        relay_to_screen_mm: placement.relay_to_screen_mm + defocus_mm,
        defocus_mm,
        fields: fields.collect(),
    };
    Ok((result, system))
}

/// Index behind each surface of a facility system for each wavelength: pupil, groups, screen.
pub(crate) fn indices(library: &Library, groups: &[Group; 2]) -> Vec<Vec<f64>> {
    (0..library.oriented[0].indices.len())
        .map(|wavelength| {
            let mut indices = vec![1.0];
            for group in groups {
                library.walk(group, wavelength, |_, index, _| indices.push(index));
            }
            indices.push(1.0);
            indices
        })
        .collect()
}
