//! Tolerance Monte Carlo: tilts, decentres, gaps and indices, on spot and boresight.

use glam::DVec3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::Serialize;

use super::{launch, refuse_strays};
use crate::OpticsError;
use crate::glass::Medium;
use crate::launch::Launcher;
use crate::pupil::{PupilPoint, gaussian};
use crate::system::{Group, OpticalSystem};
use crate::trace::{Clipping, RayBatch, Tracer, indices_behind};

/// What may be wrong with each lens; every number is drawn uniformly between minus and plus the tolerance.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Tolerances {
    /// Turn of each lens about x and about y, through the middle of its thickness, rad.
    pub tilt_rad: f64,
    /// Displacement of each lens along x and along y, mm.
    pub decentre_mm: f64,
    /// Error of each air gap between lenses, mm.
    pub gap_mm: f64,
    /// Error of each glass's index, the same at all wavelengths.
    pub index: f64,
    /// Whether the image is refocused in each trial.
    pub refocus: bool,
}

/// One perturbed system.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ToleranceTrial {
    /// Polychromatic RMS radius of each field, um.
    pub rms_um: Vec<f64>,
    /// Shift of the first field's centroid from where it is in the nominal system, mm.
    pub boresight_mm: [f64; 2],
    /// Displacement of the image that the trial chose, mm; 0 without refocusing.
    pub refocus_mm: f64,
}

/// Order statistics over the trials.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Percentiles {
    /// Median.
    pub p50: f64,
    /// 80 % of the trials are not above.
    pub p80: f64,
    /// 90 %.
    pub p90: f64,
    /// 98 %.
    pub p98: f64,
}

/// Result of a Monte Carlo.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ToleranceReport {
    /// The tolerances.
    pub tolerances: Tolerances,
    /// The seed.
    pub seed: u64,
    /// The nominal system, likewise refocused.
    pub nominal: ToleranceTrial,
    /// The worst field's RMS, um.
    pub worst_rms_um: Percentiles,
    /// Length of the boresight shift, mm.
    pub boresight_mm: Percentiles,
    /// Trials in which a field's beam did not arrive at all, or one of its rays missed a surface or was
    /// totally reflected; left out of the percentiles.
    pub failed: usize,
    /// All others, in the order drawn.
    pub trials: Vec<ToleranceTrial>,
}

/// First and last surface of each lens: neighbours with glass between them.
pub fn lens_elements(system: &OpticalSystem) -> Vec<(usize, usize)> {
    let mut elements = Vec::new();
    let mut start = None;
    for i in 0..system.image() {
        match (&system.surfaces[i].medium, start) {
            (Medium::Air, Some(first)) => {
                elements.push((first, i));
                start = None;
            }
            (Medium::Air, None) => {}
            (_, None) => start = Some(i),
            (_, Some(_)) => {}
        }
    }
    elements
}

/// `trials` perturbed systems from one seed; a trial's numbers depend on the seed and its number alone.
///
/// # Errors
/// The nominal system has no spot; a system without lenses.
pub fn tolerance_monte_carlo(
    system: &OpticalSystem,
    tolerances: &Tolerances,
    trials: usize,
    seed: u64,
    clipping: Clipping,
) -> Result<ToleranceReport, OpticsError> {
    let elements = lens_elements(system);
    if elements.is_empty() {
        return Err(OpticsError::Undefined("tolerances need at least one lens".into()));
    }
    let points = gaussian(6, 12, 0.0);
    let launcher = Launcher::new(system)?;
    let launched = system
        .fields
        .iter()
        .map(|field| launch(&launcher, field.at, &points))
        .collect::<Result<Vec<_>, _>>()?;
    let indices =
        system.wavelengths.iter().map(|w| indices_behind(system, w.nm)).collect::<Result<Vec<_>, _>>()?;
    let evaluate = |system: &OpticalSystem, indices: &[Vec<f64>]| {
        evaluate(system, indices, &points, &launched, clipping, tolerances.refocus)
    };
    let (nominal, origin) = evaluate(system, &indices).ok_or_else(|| {
        OpticsError::Undefined("a field of the nominal system does not reach the image".into())
    })?;
    let all: Vec<Option<ToleranceTrial>> = (0..trials)
        .into_par_iter()
        .map(|number| {
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            random.set_stream(number as u64);
            let (perturbed, indices) = perturb(system, &elements, &indices, tolerances, &mut random);
            evaluate(&perturbed, &indices).map(|(mut trial, at)| {
                trial.boresight_mm = [at[0] - origin[0], at[1] - origin[1]];
                trial
            })
        })
        .collect();
    let failed = all.iter().filter(|trial| trial.is_none()).count();
    let trials: Vec<ToleranceTrial> = all.into_iter().flatten().collect();
    let worst = |trial: &ToleranceTrial| trial.rms_um.iter().copied().fold(0.0, f64::max);
    if trials.is_empty() {
        return Err(OpticsError::Undefined("no trial's beam reaches the image".into()));
    }
    Ok(ToleranceReport {
        tolerances: *tolerances,
        seed,
        nominal,
        worst_rms_um: percentiles(trials.iter().map(worst).collect()),
        boresight_mm: percentiles(
            trials.iter().map(|t| t.boresight_mm[0].hypot(t.boresight_mm[1])).collect(),
        ),
        failed,
        trials,
    })
}

fn percentiles(mut values: Vec<f64>) -> Percentiles {
    values.sort_by(f64::total_cmp);
    // The smallest value that the stated share of the trials does not exceed.
    let at = |share: f64| values[((share * values.len() as f64).ceil() as usize).clamp(1, values.len()) - 1];
    Percentiles { p50: at(0.5), p80: at(0.8), p90: at(0.9), p98: at(0.98) }
}

fn perturb(
    system: &OpticalSystem,
    elements: &[(usize, usize)],
    indices: &[Vec<f64>],
    tolerances: &Tolerances,
    random: &mut ChaCha8Rng,
) -> (OpticalSystem, Vec<Vec<f64>>) {
    let mut draw = |tolerance: f64| tolerance * (2.0 * random.random::<f64>() - 1.0);
    let mut perturbed = system.clone();
    let mut indices = indices.to_vec();
    // Lens errors come first in the order of groups: an aligned group then carries its crooked lenses.
    let mut groups = Vec::with_capacity(elements.len() + system.groups.len());
    for (k, &(first, last)) in elements.iter().enumerate() {
        let length: f64 = system.surfaces[first..last].iter().map(|surface| surface.thickness_mm).sum();
        groups.push(Group {
            pivot_mm: length / 2.0,
            tilt_rad: DVec3::new(draw(tolerances.tilt_rad), draw(tolerances.tilt_rad), 0.0),
            decentre_mm: DVec3::new(draw(tolerances.decentre_mm), draw(tolerances.decentre_mm), 0.0),
            ..Group::aligned(format!("lens {}", k + 1), first, last)
        });
        for i in first..last {
            let error = draw(tolerances.index);
            for set in &mut indices {
                set[i] += error;
            }
        }
        if k + 1 < elements.len() {
            let gap = &mut perturbed.surfaces[last].thickness_mm;
            *gap = (*gap + draw(tolerances.gap_mm)).max(0.0);
        }
    }
    groups.append(&mut perturbed.groups);
    perturbed.groups = groups;
    (perturbed, indices)
}

/// Weighted sums of position p and tangent q of a field's rays: p, q, p.p, p.q, q.q.
#[derive(Default, Clone, Copy)]
struct Bundle {
    weight: f64,
    p: [f64; 2],
    q: [f64; 2],
    pp: f64,
    pq: f64,
    qq: f64,
}

impl Bundle {
    fn add(&mut self, weight: f64, rays: &RayBatch, i: usize) {
        let p = [rays.x_mm[i], rays.y_mm[i]];
        let q = [rays.l[i] / rays.n[i], rays.m[i] / rays.n[i]];
        self.weight += weight;
        for k in 0..2 {
            self.p[k] += weight * p[k];
            self.q[k] += weight * q[k];
        }
        self.pp += weight * (p[0] * p[0] + p[1] * p[1]);
        self.pq += weight * (p[0] * q[0] + p[1] * q[1]);
        self.qq += weight * (q[0] * q[0] + q[1] * q[1]);
    }

    /// Mean square radius about the centroid at a displacement z: a + 2 b z + c z^2.
    fn parabola(&self) -> [f64; 3] {
        let w = self.weight;
        let dot = |a: [f64; 2], b: [f64; 2]| (a[0] * b[0] + a[1] * b[1]) / (w * w);
        [
            self.pp / w - dot(self.p, self.p),
            self.pq / w - dot(self.p, self.q),
            self.qq / w - dot(self.q, self.q),
        ]
    }
}

/// Spots of all fields, and the first one's centroid; `None` if a field does not arrive, or a ray of it
/// fails otherwise than at an aperture.
fn evaluate(
    system: &OpticalSystem,
    indices: &[Vec<f64>],
    points: &[PupilPoint],
    launched: &[RayBatch],
    clipping: Clipping,
    refocus: bool,
) -> Option<(ToleranceTrial, [f64; 2])> {
    let tracers: Vec<Tracer> =
        indices.iter().map(|set| Tracer::with_indices(system, set, clipping)).collect();
    let mut bundles = Vec::with_capacity(launched.len());
    for (start, field) in launched.iter().zip(&system.fields) {
        let mut bundle = Bundle::default();
        for (tracer, wavelength) in tracers.iter().zip(&system.wavelengths) {
            let mut rays = start.clone();
            tracer.trace_batch(&mut rays);
            refuse_strays(&rays, field.at).ok()?;
            for (i, point) in points.iter().enumerate().filter(|(i, _)| rays.arrived(*i)) {
                bundle.add(point.weight * wavelength.weight, &rays, i);
            }
        }
        if bundle.weight == 0.0 {
            return None;
        }
        bundles.push(bundle);
    }
    let parabolas: Vec<[f64; 3]> = bundles.iter().map(Bundle::parabola).collect();
    let (mut b, mut c) = (0.0, 0.0);
    for (parabola, field) in parabolas.iter().zip(&system.fields) {
        b += field.weight * parabola[1];
        c += field.weight * parabola[2];
    }
    let z = if refocus { -b / c } else { 0.0 };
    let rms_um =
        parabolas.iter().map(|[a, b, c]| 1e3 * (a + 2.0 * b * z + c * z * z).max(0.0).sqrt()).collect();
    let first = &bundles[0];
    let at = |k: usize| (first.p[k] + z * first.q[k]) / first.weight;
    Some((ToleranceTrial { rms_um, boresight_mm: [0.0; 2], refocus_mm: z }, [at(0), at(1)]))
}
