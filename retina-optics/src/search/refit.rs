//! The gaps of a candidate refitted with exact rays.

use super::candidate::{Group, Library};
use super::exact::{best_common_focus, half_pupil, indices, trace_fields};
use super::limits::Limit;
use super::request::SearchRequest;
use crate::pupil::PupilPoint;

/// A candidate: collimator, relay, and its worst RMS with its vignetting counted in, um.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Candidate {
    pub(crate) groups: [Group; 2],
    pub(crate) merit_um: f64,
}

/// um of merit for each unit of beam lost beyond the limit: a percent costs as much as 1 um.
const VIGNETTING_COST_UM: f64 = 100.0;
/// Step of the first simplex, mm.
const FIRST_STEP_MM: f64 = 1.5;
/// The search for gaps ends when the simplex is smaller than this, mm: spots are flat in the gaps there.
const LAST_STEP_MM: f64 = 0.02;
const MOST_TURNS: usize = 60;

pub(crate) struct Refitter<'a> {
    pub(crate) library: &'a Library,
    pub(crate) request: &'a SearchRequest,
    points: Vec<PupilPoint>,
}

impl<'a> Refitter<'a> {
    pub(crate) fn new(library: &'a Library, request: &'a SearchRequest) -> Self {
        // Agrees with finer sampling to 1 %, which a ranking can bear; results are traced anew.
        Self { library, request, points: half_pupil(3, 8) }
    }

    /// The candidate with its last gaps solved for the focal lengths, or what forbids it.
    pub(crate) fn assess(&self, groups: [Group; 2]) -> Result<Candidate, Limit> {
        let (library, request) = (self.library, self.request);
        let solve = |group, focal_mm| library.solve(group, focal_mm, request).ok_or(Limit::FocalLength);
        let groups =
            [solve(groups[0], request.collimator_focal_mm)?, solve(groups[1], request.relay_focal_mm)?];
        let figures = groups.map(|group| library.figures(&group));
        let indices = indices(library, &groups);
        let mut merit_um: f64 = 0.0;
        for configuration in &request.configurations {
            let placement = library.placement(&figures, request, configuration)?;
            // Only distances and rays can fail here: the parts and their glasses were checked.
            let traced = library
                .system(&groups, &placement, 0.0, request, configuration)
                .and_then(|system| trace_fields(&system, &indices, &self.points));
            let (fields, vignetted) = traced.ok().flatten().ok_or(Limit::RaysFail)?;
            let (_, square) = best_common_focus(&fields);
            let scale =
                configuration.camera_focal_mm / configuration.facility_focal_mm(request.collimator_focal_mm);
            let excess = (vignetted - request.max_vignetted).max(0.0);
            merit_um = merit_um.max(square.max(0.0).sqrt() * scale * 1e3 + VIGNETTING_COST_UM * excess);
        }
        Ok(Candidate { groups, merit_um })
    }

    /// The free gaps (all but the last of each group) moved to where the merit is least, by the
    /// simplex method of J. A. Nelder and R. Mead, Computer J. 7, 308 (1965).
    pub(crate) fn refit(&self, groups: [Group; 2]) -> Result<Candidate, Limit> {
        let start = self.assess(groups)?;
        let free: Vec<(usize, usize)> =
            (0..2).flat_map(|g| (0..groups[g].count.saturating_sub(2)).map(move |gap| (g, gap))).collect();
        if free.is_empty() {
            return Ok(start);
        }
        let mut best = start;
        let mut merit = |gaps: &[f64]| {
            let mut moved = groups;
            for (&(group, gap), &value) in free.iter().zip(gaps) {
                moved[group].gaps_mm[gap] = value;
            }
            let Ok(candidate) = self.assess(moved) else { return f64::INFINITY };
            if candidate.merit_um < best.merit_um {
                best = candidate;
            }
            candidate.merit_um
        };
        let at: Vec<f64> = free.iter().map(|&(group, gap)| groups[group].gaps_mm[gap]).collect();
        nelder_mead(at, start.merit_um, &mut merit);
        Ok(best)
    }
}

fn nelder_mead(start: Vec<f64>, value: f64, merit: &mut impl FnMut(&[f64]) -> f64) {
    let count = start.len();
    let mut simplex = vec![(start.clone(), value)];
    for i in 0..count {
        let mut at = start.clone();
        at[i] += FIRST_STEP_MM;
        let mut value = merit(&at);
        if !value.is_finite() {
            at[i] -= 2.0 * FIRST_STEP_MM;
            value = merit(&at);
        }
        simplex.push((at, value));
    }
    for _ in 0..MOST_TURNS {
        simplex.sort_by(|a, b| a.1.total_cmp(&b.1));
        let size = |at: &[f64]| at.iter().zip(&simplex[0].0).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        if simplex.iter().map(|(at, _)| size(at)).fold(0.0, f64::max) < LAST_STEP_MM {
            return;
        }
        let centre: Vec<f64> = (0..count)
            .map(|i| simplex[..count].iter().map(|(at, _)| at[i]).sum::<f64>() / count as f64)
            .collect();
        let worst = simplex[count].clone();
        let mut along = |factor: f64| {
            let at: Vec<f64> = centre.iter().zip(&worst.0).map(|(c, w)| c + factor * (c - w)).collect();
            let value = merit(&at);
            (at, value)
        };
        let reflected = along(1.0);
        let next = if reflected.1 < simplex[0].1 {
            let expanded = along(2.0);
            if expanded.1 < reflected.1 { expanded } else { reflected }
        } else if reflected.1 < simplex[count - 1].1 {
            reflected
        } else {
            let inside = along(if reflected.1 < worst.1 { 0.5 } else { -0.5 });
            if inside.1 < worst.1.min(reflected.1) {
                inside
            } else {
                let first = simplex[0].0.clone();
                for (at, value) in &mut simplex[1..] {
                    at.iter_mut().zip(&first).for_each(|(a, f)| *a = f + 0.5 * (*a - f));
                    *value = merit(at);
                }
                continue;
            }
        };
        simplex[count] = next;
    }
}
