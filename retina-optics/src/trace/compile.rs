//! A system made ready for tracing at one wavelength, and the scalar trace.

use glam::{DMat3, DVec3};

use super::step::{
    Asphere, Conic, Figure, Hit, MAX_ASPHERIC_TERMS, Plane, Sphere, State, ideal_lens, reflect, refract,
};
use super::{Crossing, Ray, RayFailure};
use crate::OpticsError;
use crate::surface::Shape;
use crate::system::{OpticalSystem, Pose};

/// Whether clear apertures stop rays.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Clipping {
    /// They do: radii are the surfaces' own, outer ones of lenses times the system's `clear_fraction`.
    #[default]
    On,
    /// They do not: every ray that the figures and Snell's law let through arrives.
    Off,
}

/// From the axes of one surface to those of the next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Step {
    /// z' = z + dz.
    Axial(f64),
    /// p' = R p + t.
    Full(DMat3, DVec3),
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum ElementShape {
    Plane,
    Sphere(f64),
    Conic { c: f64, k: f64 },
    Asphere { c: f64, k: f64, terms: [f64; MAX_ASPHERIC_TERMS] },
    IdealLens(f64),
}

/// What happens to the light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Action {
    /// The same index on both sides.
    Pass,
    Refract,
    Reflect,
}

#[derive(Debug, Clone)]
pub(super) struct Element {
    pub(super) surface: usize,
    pub(super) step: Step,
    pub(super) shape: ElementShape,
    pub(super) action: Action,
    /// Index of the medium in which the ray arrives.
    pub(super) n_before: f64,
    /// n_before / n_after.
    pub(super) mu: f64,
    pub(super) inner2_mm2: f64,
    pub(super) outer2_mm2: f64,
    pub(super) pose: Pose,
}

/// A system compiled for one wavelength.
#[derive(Debug, Clone)]
pub struct Tracer {
    pub(super) elements: Vec<Element>,
}

fn element_shape(shape: &Shape) -> ElementShape {
    match shape {
        Shape::Conic { curvature_per_mm: 0.0, .. } => ElementShape::Plane,
        Shape::Conic { curvature_per_mm, conic: 0.0 } => ElementShape::Sphere(*curvature_per_mm),
        Shape::Conic { curvature_per_mm, conic } => ElementShape::Conic { c: *curvature_per_mm, k: *conic },
        Shape::EvenAsphere { curvature_per_mm, conic, coefficients } => {
            let mut terms = [0.0; MAX_ASPHERIC_TERMS];
            for (term, a) in terms.iter_mut().zip(coefficients) {
                *term = *a;
            }
            ElementShape::Asphere { c: *curvature_per_mm, k: *conic, terms }
        }
        Shape::IdealLens { focal_mm } => ElementShape::IdealLens(1.0 / focal_mm),
    }
}

impl Tracer {
    /// Compiles a system that has passed [`OpticalSystem::check`].
    ///
    /// # Errors
    /// A wavelength at which a glass has no index.
    pub fn new(system: &OpticalSystem, wavelength_nm: f64, clipping: Clipping) -> Result<Self, OpticsError> {
        let order: Vec<usize> = (0..system.surfaces.len()).collect();
        Ok(build(system, &indices_behind(system, wavelength_nm)?, clipping, &order, &[]))
    }

    /// As [`Tracer::new`], with the index behind each surface handed over: for media at another
    /// temperature, perturbed indices, or another program's glass data.
    ///
    /// # Panics
    /// `indices` does not hold one number for each surface.
    pub fn with_indices(system: &OpticalSystem, indices: &[f64], clipping: Clipping) -> Self {
        assert_eq!(indices.len(), system.surfaces.len(), "one index for each surface");
        let order: Vec<usize> = (0..system.surfaces.len()).collect();
        build(system, indices, clipping, &order, &[])
    }

    /// The ghost that is reflected at surface `second` back to surface `first` and there forward
    /// again (indices from 0, `first` < `second`, the image excluded).
    ///
    /// # Errors
    /// As [`Tracer::new`].
    pub fn ghost(
        system: &OpticalSystem,
        wavelength_nm: f64,
        clipping: Clipping,
        first: usize,
        second: usize,
    ) -> Result<Self, OpticsError> {
        let image = system.image();
        let order: Vec<usize> = (0..=second).chain((first..second).rev()).chain(first + 1..=image).collect();
        let turns = [second, second + (second - first)];
        Ok(build(system, &indices_behind(system, wavelength_nm)?, clipping, &order, &turns))
    }

    /// Follows one ray through all surfaces; the last crossing is on the image.
    ///
    /// # Errors
    /// The first failure, with its surface.
    pub fn trace(&self, ray: &Ray) -> Result<Vec<Crossing>, RayFailure> {
        let mut crossings = Vec::with_capacity(self.elements.len());
        self.follow(ray, |crossing| crossings.push(crossing))?;
        Ok(crossings)
    }

    /// As [`Tracer::trace`], for the crossing with the image alone.
    ///
    /// # Errors
    /// As [`Tracer::trace`].
    pub fn trace_to_image(&self, ray: &Ray) -> Result<Crossing, RayFailure> {
        let mut last = None;
        self.follow(ray, |crossing| last = Some(crossing))?;
        Ok(last.expect("a compiled system has an image"))
    }

    /// Follows one ray until it has met element `count - 1`.
    pub(crate) fn trace_first(&self, ray: &Ray, count: usize) -> Result<Crossing, RayFailure> {
        let mut last = None;
        follow(&self.elements[..count], ray, |crossing| last = Some(crossing))?;
        Ok(last.expect("count is at least 1"))
    }

    fn follow(&self, ray: &Ray, visit: impl FnMut(Crossing)) -> Result<(), RayFailure> {
        follow(&self.elements, ray, visit)
    }
}

fn follow(elements: &[Element], ray: &Ray, mut visit: impl FnMut(Crossing)) -> Result<(), RayFailure> {
    let mut state = enter(ray);
    for element in elements {
        shift(element, &mut state);
        let (hit, turned) = meet(element, &state);
        let surface = element.surface;
        if !hit.met {
            return Err(RayFailure::Missed { surface });
        }
        let r2 = hit.at[0] * hit.at[0] + hit.at[1] * hit.at[1];
        if r2 > element.outer2_mm2 || r2 < element.inner2_mm2 {
            return Err(RayFailure::Vignetted { surface });
        }
        if !turned.passes {
            return Err(RayFailure::TotalReflection { surface });
        }
        let incidence_cos = state.l * hit.normal[0] + state.m * hit.normal[1] + state.n * hit.normal[2];
        settle(&mut state, &hit, &turned, element.n_before);
        let (local_mm, local_direction) = (DVec3::from(hit.at), DVec3::from(turned.direction));
        visit(Crossing {
            surface,
            local_mm,
            position_mm: element.pose.rotation * local_mm + element.pose.vertex_mm,
            direction: element.pose.rotation * local_direction,
            local_direction,
            incidence_cos: incidence_cos.abs(),
            path_mm: state.path,
        });
    }
    Ok(())
}

pub(super) fn enter(ray: &Ray) -> State {
    let ([x, y, z], [l, m, n]) = (ray.position_mm.to_array(), ray.direction.to_array());
    State { x, y, z, l, m, n, path: ray.path_mm }
}

/// The index behind each surface.
pub(crate) fn indices_behind(system: &OpticalSystem, wavelength_nm: f64) -> Result<Vec<f64>, OpticsError> {
    system.surfaces.iter().map(|surface| Ok(surface.medium.index(wavelength_nm)?)).collect()
}

fn build(
    system: &OpticalSystem,
    indices: &[f64],
    clipping: Clipping,
    order: &[usize],
    turns: &[usize],
) -> Tracer {
    let poses = system.poses();
    let mut from = Pose { rotation: DMat3::IDENTITY, vertex_mm: DVec3::ZERO };
    let mut forward = true;
    let elements = order
        .iter()
        .enumerate()
        .map(|(place, &i)| {
            let surface = &system.surfaces[i];
            let pose = poses[i];
            let step = step_between(&from, &pose);
            from = pose;
            let (left, right) = (if i == 0 { 1.0 } else { indices[i - 1] }, indices[i]);
            let (n_before, n_after) = if forward { (left, right) } else { (right, left) };
            let action = if turns.contains(&place) {
                forward = !forward;
                Action::Reflect
            } else if n_before == n_after {
                Action::Pass
            } else {
                Action::Refract
            };
            let (inner, outer) = match clipping {
                // Only glass is mounted by its rim: a stop, a mask or the image is as large as it says.
                Clipping::On if left == right && !matches!(surface.shape, Shape::IdealLens { .. }) => {
                    (surface.aperture.inner_mm, surface.aperture.outer_mm)
                }
                Clipping::On => {
                    (surface.aperture.inner_mm, surface.aperture.outer_mm * system.clear_fraction)
                }
                Clipping::Off => (0.0, f64::INFINITY),
            };
            Element {
                surface: i,
                step,
                shape: element_shape(&surface.shape),
                action,
                n_before,
                mu: n_before / n_after,
                inner2_mm2: inner * inner,
                outer2_mm2: outer * outer,
                pose,
            }
        })
        .collect();
    Tracer { elements }
}

fn step_between(from: &Pose, to: &Pose) -> Step {
    let back = to.rotation.transpose();
    let shift = back * (from.vertex_mm - to.vertex_mm);
    if from.rotation == to.rotation && shift.x == 0.0 && shift.y == 0.0 {
        Step::Axial(shift.z)
    } else {
        Step::Full(back * from.rotation, shift)
    }
}

/// The ray in the axes of the element's surface.
#[inline(always)]
pub(super) fn shift(element: &Element, s: &mut State) {
    match &element.step {
        Step::Axial(dz) => s.z += dz,
        Step::Full(r, t) => turn(r, t, s),
    }
}

#[inline(always)]
pub(super) fn turn(r: &DMat3, t: &DVec3, s: &mut State) {
    let (x, y, z, l, m, n) = (s.x, s.y, s.z, s.l, s.m, s.n);
    s.x = r.x_axis.x * x + r.y_axis.x * y + r.z_axis.x * z + t.x;
    s.y = r.x_axis.y * x + r.y_axis.y * y + r.z_axis.y * z + t.y;
    s.z = r.x_axis.z * x + r.y_axis.z * y + r.z_axis.z * z + t.z;
    s.l = r.x_axis.x * l + r.y_axis.x * m + r.z_axis.x * n;
    s.m = r.x_axis.y * l + r.y_axis.y * m + r.z_axis.y * n;
    s.n = r.x_axis.z * l + r.y_axis.z * m + r.z_axis.z * n;
}

/// The light behind a figure.
#[derive(Clone, Copy)]
pub(super) struct Turned {
    pub(super) direction: [f64; 3],
    /// Optical path that an ideal lens adds, mm.
    pub(super) extra: f64,
    /// False at total reflection.
    pub(super) passes: bool,
}

/// Intersection and new direction for one figure: the whole of a block's inner loop.
#[inline(always)]
pub(super) fn meet_figure<F: Figure>(figure: F, action: Action, mu: f64, s: &State) -> (Hit, Turned) {
    let hit = figure.meet(s);
    let turned = match action {
        Action::Pass => Turned { direction: [s.l, s.m, s.n], extra: 0.0, passes: true },
        Action::Refract => {
            let (direction, _, radicand) = refract(s, hit.normal, mu);
            Turned { direction, extra: 0.0, passes: radicand >= 0.0 }
        }
        Action::Reflect => Turned { direction: reflect(s, hit.normal).0, extra: 0.0, passes: true },
    };
    (hit, turned)
}

/// As [`meet_figure`], for an ideal lens of power `p`; its mirror image is not defined, so light
/// that a ghost sends back sees the same tangents change.
#[inline(always)]
pub(super) fn meet_ideal(p: f64, s: &State) -> (Hit, Turned) {
    let hit = Plane.meet(s);
    let (direction, extra) = ideal_lens(s, hit.at[0], hit.at[1], p);
    (hit, Turned { direction, extra, passes: true })
}

fn meet(element: &Element, s: &State) -> (Hit, Turned) {
    let (action, mu) = (element.action, element.mu);
    match element.shape {
        ElementShape::Plane => meet_figure(Plane, action, mu, s),
        ElementShape::Sphere(c) => meet_figure(Sphere { c }, action, mu, s),
        ElementShape::Conic { c, k } => meet_figure(Conic { c, k }, action, mu, s),
        ElementShape::Asphere { c, k, terms } => meet_figure(Asphere { c, k, terms }, action, mu, s),
        ElementShape::IdealLens(p) => meet_ideal(p, s),
    }
}

/// Moves the ray onto the surface and turns it.
#[inline(always)]
pub(super) fn settle(s: &mut State, hit: &Hit, turned: &Turned, n_before: f64) {
    [s.x, s.y, s.z] = hit.at;
    [s.l, s.m, s.n] = turned.direction;
    s.path += n_before * hit.distance + turned.extra;
}
