//! Every group that has its focal length, and every pair of groups ranked by third-order spots.

use std::collections::BTreeSet;
use std::sync::atomic::{AtomicU64, Ordering};

use rayon::prelude::*;

use super::candidate::{Group, GroupFigures, Library, MOST_LENSES, layout};
use super::limits::{Limit, Removed};
use super::request::SearchRequest;
use super::third_order::{Ranking, Sums, group_sums};

/// Free gaps at which groups are enumerated, mm beyond the least gap; the refit moves them.
const GAP_SAMPLES_MM: [f64; 7] = [0.0, 1.5, 4.0, 8.0, 14.0, 22.0, 32.0];
/// Relays kept for each collimator.
const RELAYS_PER_COLLIMATOR: usize = 6;
/// Most relays, and most pairs, that are ranked, half a minute's work on two cores: beyond, the groups with
/// the least spots of their own are kept.
const MOST_RELAYS: usize = 3_000;
const MOST_PAIRS: usize = 60_000_000;

/// Largest height of the paraxial rim ray relative to a lens's clear radius: beyond, too much is cut.
/// Paraxial heights are good to a few percent.
const MOST_FILLING: f64 = 1.04;

/// A group that has its focal length, with its sums in each configuration.
struct Ranked {
    group: Group,
    sums: Vec<Sums>,
}

/// What the ranking of all pairs gives.
pub(crate) struct RankedPairs {
    /// Collimator and relay of the pairs with the least third-order spots, best first.
    pub(crate) pairs: Vec<[Group; 2]>,
    /// Collimators and relays that have their focal lengths and their room.
    pub(crate) counts: [usize; 2],
    /// Collimators and relays that limits ruled out.
    pub(crate) removed: [Vec<Removed>; 2],
}

/// Ranks all pairs of groups.
pub(crate) fn ranked_pairs(library: &Library, request: &SearchRequest) -> RankedPairs {
    let rankings: Vec<Ranking> =
        request.configurations.iter().map(|configuration| Ranking::new(request, configuration)).collect();
    let kinds = [
        (request.collimator_lenses, request.collimator_focal_mm),
        (request.relay_lenses, request.relay_focal_mm),
    ];
    let [(mut collimators, without_collimators), (mut relays, without_relays)] = [0, 1].map(|kind| {
        let (count, focal_mm) = kinds[kind];
        groups(library, request, count, focal_mm, kind, &rankings)
    });
    let counts = [collimators.len(), relays.len()];
    keep_best(&mut relays, MOST_RELAYS, &rankings);
    keep_best(&mut collimators, MOST_PAIRS / relays.len().max(1), &rankings);
    let mut pairs: Vec<(f64, usize, usize)> = (0..collimators.len())
        .into_par_iter()
        .flat_map_iter(|c| {
            let mut best: Vec<(f64, usize, usize)> = relays
                .iter()
                .enumerate()
                .map(|(r, relay)| {
                    let worst = rankings
                        .iter()
                        .zip(collimators[c].sums.iter().zip(&relay.sums))
                        .map(|(ranking, (a, b))| ranking.worst_um(&a.plus(b)))
                        .fold(0.0, f64::max);
                    (worst, c, r)
                })
                .collect();
            let order =
                |a: &(f64, usize, usize), b: &(f64, usize, usize)| a.0.total_cmp(&b.0).then(a.2.cmp(&b.2));
            let kept = RELAYS_PER_COLLIMATOR.min(best.len());
            if kept > 0 && kept < best.len() {
                best.select_nth_unstable_by(kept - 1, order);
                best.truncate(kept);
            }
            best.sort_by(order);
            best
        })
        .collect();
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    // The same lenses at another sample of the gaps lead the refit to the same place.
    let mut seen = BTreeSet::new();
    let pairs = pairs
        .into_iter()
        .map(|(_, c, r)| [collimators[c].group, relays[r].group])
        .filter(|pair| seen.insert(lenses_of(pair)))
        .take(request.exact_candidates)
        .collect();
    RankedPairs { pairs, counts, removed: [without_collimators, without_relays] }
}

/// The lenses of a candidate in order, as a key.
pub(crate) fn lenses_of(groups: &[Group; 2]) -> Vec<u16> {
    groups.iter().flat_map(|group| group.elements().iter().copied().chain([u16::MAX])).collect()
}

/// Whether a group has its room next to the camera or the screen in every configuration.
fn stands(figures: &GroupFigures, kind: usize, request: &SearchRequest) -> bool {
    match kind {
        0 => request.pupil_collimator_mm > figures.front_principal_mm,
        _ => request.configurations.iter().all(|configuration| {
            let screen_mm = layout(request, configuration).screen_relay_mm + figures.rear_principal_mm;
            screen_mm >= request.min_screen_gap_mm
        }),
    }
}

fn keep_best(groups: &mut Vec<Ranked>, most: usize, rankings: &[Ranking]) {
    if groups.len() > most {
        groups.sort_by(|a, b| alone(rankings, &a.sums).total_cmp(&alone(rankings, &b.sums)));
        groups.truncate(most);
    }
}

/// A group's spots without the other's compensation, um.
fn alone(rankings: &[Ranking], sums: &[Sums]) -> f64 {
    rankings.iter().zip(sums).map(|(ranking, sums)| ranking.worst_um(sums)).fold(0.0, f64::max)
}

fn groups(
    library: &Library,
    request: &SearchRequest,
    count: usize,
    focal_mm: f64,
    kind: usize,
    rankings: &[Ranking],
) -> (Vec<Ranked>, Vec<Removed>) {
    let lenses = library.oriented.len();
    let samples: &[f64] = if count > 2 { &GAP_SAMPLES_MM } else { &GAP_SAMPLES_MM[..1] };
    // Sums of whole numbers: the order in which threads add to them does not matter.
    let without = [Limit::FocalLength, Limit::Room, Limit::LensRims].map(|limit| (limit, AtomicU64::new(0)));
    let refuse = |place: usize| {
        without[place].1.fetch_add(1, Ordering::Relaxed);
        None
    };
    let ranked = (0..lenses.pow(count as u32))
        .into_par_iter()
        .flat_map_iter(|number| {
            let mut elements = [0; MOST_LENSES];
            let mut rest = number;
            for element in &mut elements[..count] {
                *element = (rest % lenses) as u16;
                rest /= lenses;
            }
            let refuse = &refuse;
            samples.iter().filter_map(move |gap| {
                let gaps_mm = [request.min_gap_mm + gap; MOST_LENSES - 1];
                let Some(group) = library.solve(Group { elements, count, gaps_mm }, focal_mm, request) else {
                    return refuse(0);
                };
                let figures = library.figures(&group);
                if !stands(&figures, kind, request) {
                    return refuse(1);
                }
                let mut sums = Vec::with_capacity(rankings.len());
                for ranking in rankings {
                    let entry = &ranking.entries[kind];
                    let (share, filling) = group_sums(library, &group, figures.front_principal_mm, entry);
                    if filling > MOST_FILLING * request.clear_fraction {
                        return refuse(2);
                    }
                    sums.push(share);
                }
                Some(Ranked { group, sums })
            })
        })
        .collect();
    let mut removed = Vec::new();
    for (limit, candidates) in without {
        super::limits::count(&mut removed, limit, candidates.into_inner());
    }
    (ranked, removed)
}
