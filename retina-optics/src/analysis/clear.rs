//! Quadrature over what apertures leave of a pupil.
//!
//! A cut pupil has an edge, on which a quadrature over the whole disc converges only as fast as its rings
//! grow dense. Here each arm is split where rays begin and cease to pass, found by bisection, and the
//! Gaussian nodes lie inside: obscurations and several edges on an arm included.

use std::f64::consts::TAU;

use super::{launch, refuse_strays};
use crate::launch::Launcher;
use crate::pupil::{PupilPoint, gauss_legendre, gaussian};
use crate::trace::{RayBatch, RayFailure, Tracer};
use crate::{Clipping, OpticsError};

/// Steps of a radius between which an edge is looked for: an aperture's shadow narrower than a step may
/// be missed.
const STEPS: usize = 32;
/// Halvings of a step: its edge is then known to the rounding of f64.
const HALVINGS: usize = 46;
/// Arms of a cut pupil for each arm of a whole one: the edge's radius has kinks over the angle, at which the
/// sum over arms converges with the square of their spacing.
const ARMS_OF_CUT: usize = 4;
/// The rim, which the stop's own aperture may touch, is taken this far inside.
const RIM: f64 = 1.0 - 1e-9;

/// The points of a pupil that apertures let through, and their shares of the whole pupil's area.
pub(crate) struct ClearPupil {
    /// Weights sum to the share that is clear.
    pub(crate) points: Vec<PupilPoint>,
    /// An aperture that stops rays, where one does.
    pub(crate) failure: Option<RayFailure>,
}

fn at(radius: f64, angle: f64) -> PupilPoint {
    PupilPoint { at: [radius * angle.cos(), radius * angle.sin()], weight: 0.0 }
}

/// Which points' rays pass, and why the first other one does not.
fn passes(
    launcher: &Launcher,
    tracer: &Tracer,
    field: [f64; 2],
    points: &[PupilPoint],
) -> Result<(RayBatch, Option<RayFailure>), OpticsError> {
    let mut rays = launch(launcher, field, points)?;
    tracer.trace_batch(&mut rays);
    refuse_strays(&rays, field)?;
    let failure = (0..rays.len()).find_map(|i| rays.failure(i));
    Ok((rays, failure))
}

/// The clear part of the pupil of a field for a tracer; the whole pupil's Gaussian quadrature where nothing
/// is cut or `clipping` is off.
///
/// # Errors
/// A ray misses a surface or is totally reflected; as [`Launcher::ray`].
pub(crate) fn clear_pupil(
    launcher: &Launcher,
    tracer: &Tracer,
    field: [f64; 2],
    [rings, arms]: [usize; 2],
    clipping: Clipping,
) -> Result<ClearPupil, OpticsError> {
    let whole = gaussian(rings, arms, 0.0);
    if clipping == Clipping::Off {
        return Ok(ClearPupil { points: whole, failure: None });
    }
    let angle = |arm: usize, arms: usize| TAU * (arm as f64 + 0.5) / arms as f64;
    let looked_at: Vec<PupilPoint> = whole
        .iter()
        .copied()
        .chain((0..ARMS_OF_CUT * arms).map(|arm| at(RIM, angle(arm, ARMS_OF_CUT * arms))))
        // Few rings may all lie outside an obscuration.
        .chain((0..arms).flat_map(|arm| {
            (0..STEPS).step_by(4).map(move |step| at(step as f64 / STEPS as f64, angle(arm, arms)))
        }))
        .collect();
    let (_, failure) = passes(launcher, tracer, field, &looked_at)?;
    if failure.is_none() {
        return Ok(ClearPupil { points: whole, failure: None });
    }
    let arms = ARMS_OF_CUT * arms;
    let radius = |step: usize| RIM * step as f64 / STEPS as f64;
    let scan: Vec<PupilPoint> =
        (0..arms).flat_map(|arm| (0..=STEPS).map(move |step| at(radius(step), angle(arm, arms)))).collect();
    let (scanned, _) = passes(launcher, tracer, field, &scan)?;
    let clear = |arm: usize, step: usize| scanned.arrived(arm * (STEPS + 1) + step);
    // (arm, last radius of the inner kind, first of the outer kind, whether the inner kind passes)
    let mut edges: Vec<(usize, f64, f64, bool)> = (0..arms)
        .flat_map(|arm| (0..STEPS).map(move |step| (arm, step)))
        .filter(|&(arm, step)| clear(arm, step) != clear(arm, step + 1))
        .map(|(arm, step)| (arm, radius(step), radius(step + 1), clear(arm, step)))
        .collect();
    for _ in 0..HALVINGS {
        let middles: Vec<PupilPoint> =
            edges.iter().map(|&(arm, low, high, _)| at(0.5 * (low + high), angle(arm, arms))).collect();
        let (rays, _) = passes(launcher, tracer, field, &middles)?;
        for (i, (_, low, high, inner)) in edges.iter_mut().enumerate() {
            let middle = 0.5 * (*low + *high);
            *(if rays.arrived(i) == *inner { low } else { high }) = middle;
        }
    }
    let nodes = gauss_legendre(rings);
    let mut points = Vec::new();
    let mut edges = edges.into_iter().peekable();
    for arm in 0..arms {
        let mut begin = clear(arm, 0).then_some(0.0);
        let mut interval = |inner: f64, outer: f64| {
            let (low, width) = (inner * inner, outer * outer - inner * inner);
            points.extend(nodes.iter().map(|(u, weight)| PupilPoint {
                weight: weight * width / arms as f64,
                ..at((low + width * u).sqrt(), angle(arm, arms))
            }));
        };
        while let Some((_, low, high, inner)) = edges.next_if(|edge| edge.0 == arm) {
            match (begin.take(), inner) {
                (Some(from), true) => interval(from, low),
                _ => begin = Some(high),
            }
        }
        if let Some(from) = begin {
            interval(from, 1.0);
        }
    }
    Ok(ClearPupil { points, failure })
}
