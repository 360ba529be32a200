//! The search: rank all pairs, refit the best with exact rays, swap lenses of the leaders.

use std::collections::BTreeSet;
use std::path::Path;

use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use retina_files::InputError;

use super::candidate::{Group, Library};
use super::enumerate::{RankedPairs, lenses_of, ranked_pairs};
use super::limits::{Limit, count};
use super::refit::{Candidate, Refitter};
use super::report::SearchReport;
use super::request::SearchRequest;
use super::state::{Scored, State};

/// Pairs refitted between two states.
const CHUNK: usize = 512;
/// Random double swaps tried at once.
const KICK: usize = 256;
/// Designs that are remembered.
const REMEMBERED: usize = 400;
/// Designs that are reported.
pub(super) const REPORTED: usize = 40;

/// What a search is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// Third-order ranking of all pairs.
    Rank,
    /// Exact refit of the ranked pairs.
    Refit,
    /// Single lenses of the leaders swapped.
    Swap,
    /// Random double swaps of the leaders.
    Kick,
}

/// How far a search is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SearchProgress {
    /// What it is doing.
    pub phase: Phase,
    /// Steps done in this phase.
    pub done: usize,
    /// Steps of this phase.
    pub total: usize,
    /// Worst RMS of the best design so far, um.
    pub best_um: Option<f64>,
}

/// Is told of a search's progress.
pub trait SearchObserver {
    /// After each step.
    fn progress(&mut self, progress: SearchProgress);
    /// Something to tell the user.
    fn note(&mut self, text: &str);
}

struct Search<'a> {
    refitter: Refitter<'a>,
    state: State,
    state_file: Option<&'a Path>,
    tried: BTreeSet<Vec<u16>>,
    best: Vec<Candidate>,
}

/// Searches. With `state_file` the search continues from that file where it is there, and keeps it
/// up to date.
///
/// # Errors
/// A request that cannot be met; a state of another search; a state that cannot be written.
pub fn search(
    request: &SearchRequest,
    source: &Path,
    state_file: Option<&Path>,
    observer: &mut dyn SearchObserver,
) -> Result<SearchReport, InputError> {
    request.check(source)?;
    let failed = |error: crate::OpticsError| InputError::new(source, error.to_string());
    let library = Library::new(request, source)?;
    let known = state_file.map(|path| State::read(path, request, &library)).transpose()?.flatten();
    let state = known.map_or_else(|| State::new(request, &library).map_err(failed), Ok)?;
    let mut search = Search {
        refitter: Refitter::new(&library, request),
        state,
        state_file,
        tried: BTreeSet::new(),
        best: Vec::new(),
    };
    search.restore(source)?;
    // Written before the ranking, which may take half a minute: a state that cannot be written is told now.
    search.save()?;
    observer.progress(search.progress(Phase::Rank, 0, 1));
    let RankedPairs { pairs, counts, removed: without } = ranked_pairs(&library, request);
    observer.note(&format!(
        "{} lenses; {} collimators and {} relays have their focal lengths; {} pairs are traced",
        library.oriented.len() / 2,
        counts[0],
        counts[1],
        pairs.len()
    ));
    if pairs.is_empty() {
        let causes = |kind: usize| {
            let causes = without[kind].iter().filter(|entry| entry.candidates > 0);
            let causes = causes.map(|entry| format!("{}: {}", entry.limit.words(), entry.candidates));
            causes.collect::<Vec<_>>().join("; ")
        };
        return Err(InputError::new(source, "no pair of groups reaches the focal lengths")
            .found(format!("{} collimators ({}), {} relays ({})", counts[0], causes(0), counts[1], causes(1)))
            .help("allow larger gaps, more lenses, other parts, or move the pupil (s_cam)"));
    }
    // What had been tried when a state was written is tried: a lens set refitted from another start could
    // end in other gaps.
    search.tried.extend(pairs[..search.state.refitted.min(pairs.len())].iter().map(lenses_of));
    search.tried.extend(search.state.tried.iter().cloned());
    search.refit_all(&pairs, observer)?;
    search.swap_leaders(observer)?;
    search.kick_leaders(observer)?;
    let mut removed = without[0].clone();
    for entry in without[1].iter().chain(&search.state.removed) {
        count(&mut removed, entry.limit, entry.candidates);
    }
    SearchReport::new(&library, request, &search.best, &pairs, removed).map_err(failed)
}

impl Search<'_> {
    fn progress(&self, phase: Phase, done: usize, total: usize) -> SearchProgress {
        SearchProgress { phase, done, total, best_um: self.best.first().map(|candidate| candidate.merit_um) }
    }

    /// The candidates of a state that was read.
    fn restore(&mut self, source: &Path) -> Result<(), InputError> {
        let library = self.refitter.library;
        for scored in self.state.best.clone() {
            let (small, groups) = Library::of_design(&scored.design, self.refitter.request, source)?;
            // From the design's own lenses to the search's.
            let place = |element: u16| {
                let lens = small.lens(element);
                library
                    .oriented
                    .iter()
                    .position(|o| o.lens.part == lens.lens.part && o.reversed == lens.reversed)
            };
            let mut own = groups;
            for group in &mut own {
                for element in &mut group.elements[..group.count] {
                    *element = place(*element).ok_or_else(|| {
                        InputError::new(source, "the state names a lens that this search excludes")
                    })? as u16;
                }
            }
            self.best.push(Candidate { groups: own, merit_um: scored.merit_um });
        }
        Ok(())
    }

    /// Refits the lens sets that are new; returns them.
    fn refit_many(&mut self, starts: &[[Group; 2]]) -> Vec<[Group; 2]> {
        let fresh: Vec<[Group; 2]> =
            starts.iter().filter(|groups| self.tried.insert(lenses_of(groups))).copied().collect();
        let refitter = &self.refitter;
        let found: Vec<Result<Candidate, Limit>> =
            fresh.par_iter().map(|groups| refitter.refit(*groups)).collect();
        for candidate in found {
            match candidate {
                Ok(candidate) => self.best.push(candidate),
                Err(limit) => count(&mut self.state.removed, limit, 1),
            }
        }
        self.best.sort_by(|a, b| {
            a.merit_um.total_cmp(&b.merit_um).then_with(|| lenses_of(&a.groups).cmp(&lenses_of(&b.groups)))
        });
        self.best.dedup_by(|a, b| lenses_of(&a.groups) == lenses_of(&b.groups));
        self.best.truncate(REMEMBERED);
        fresh
    }

    /// As [`Search::refit_many`], for sets that do not follow from the ranking: the state remembers them.
    fn refit_swaps(&mut self, starts: &[[Group; 2]]) {
        let fresh = self.refit_many(starts);
        self.state.tried.extend(fresh.iter().map(lenses_of));
    }

    fn save(&mut self) -> Result<(), InputError> {
        let library = self.refitter.library;
        self.state.best = self
            .best
            .iter()
            .map(|candidate| Scored {
                merit_um: candidate.merit_um,
                design: library.design(&candidate.groups[0], &candidate.groups[1]),
            })
            .collect();
        self.state_file.map_or(Ok(()), |path| self.state.write(path))
    }

    fn refit_all(
        &mut self,
        pairs: &[[Group; 2]],
        observer: &mut dyn SearchObserver,
    ) -> Result<(), InputError> {
        while self.state.refitted < pairs.len() {
            let end = (self.state.refitted + CHUNK).min(pairs.len());
            self.refit_many(&pairs[self.state.refitted..end]);
            self.state.refitted = end;
            self.save()?;
            observer.progress(self.progress(Phase::Refit, end, pairs.len()));
        }
        Ok(())
    }

    /// Every lens of each leader replaced by every other, until no leader's neighbour is better.
    fn swap_leaders(&mut self, observer: &mut dyn SearchObserver) -> Result<(), InputError> {
        let leaders = self.refitter.request.leaders;
        while self.state.swapped < leaders {
            let Some(leader) = self.best.get(self.state.swapped).copied() else { break };
            let before = self.leaders_key(self.state.swapped + 1);
            self.refit_swaps(&self.neighbours(&leader.groups));
            // A better design among the leaders so far: its neighbours come first.
            self.state.swapped = match self.leaders_key(self.state.swapped + 1) == before {
                true => self.state.swapped + 1,
                false => 0,
            };
            self.save()?;
            observer.progress(self.progress(Phase::Swap, self.state.swapped, leaders));
        }
        Ok(())
    }

    fn leaders_key(&self, count: usize) -> Vec<Vec<u16>> {
        self.best.iter().take(count).map(|candidate| lenses_of(&candidate.groups)).collect()
    }

    fn neighbours(&self, groups: &[Group; 2]) -> Vec<[Group; 2]> {
        let lenses = self.refitter.library.oriented.len() as u16;
        let mut found = Vec::new();
        for group in 0..2 {
            for slot in 0..groups[group].count {
                for lens in 0..lenses {
                    let mut other = *groups;
                    other[group].elements[slot] = lens;
                    found.push(other);
                }
            }
        }
        found
    }

    /// Two lenses of random leaders replaced by random ones, `leaders` times a batch.
    fn kick_leaders(&mut self, observer: &mut dyn SearchObserver) -> Result<(), InputError> {
        let request = self.refitter.request;
        let lenses = self.refitter.library.oriented.len() as u16;
        while self.state.kicks < request.leaders && !self.best.is_empty() {
            let mut random = ChaCha8Rng::seed_from_u64(request.seed);
            random.set_stream(self.state.kicks as u64);
            let pool = self.best.len().min(4 * request.leaders);
            let starts: Vec<[Group; 2]> = (0..KICK)
                .map(|_| {
                    let mut groups = self.best[random.random_range(0..pool)].groups;
                    for _ in 0..2 {
                        let group = random.random_range(0..2);
                        let slot = random.random_range(0..groups[group].count);
                        groups[group].elements[slot] = random.random_range(0..lenses);
                    }
                    groups
                })
                .collect();
            let before = self.leaders_key(request.leaders);
            self.refit_swaps(&starts);
            self.state.kicks += 1;
            if self.leaders_key(request.leaders) != before {
                self.state.swapped = 0;
            }
            self.save()?;
            observer.progress(self.progress(Phase::Kick, self.state.kicks, request.leaders));
            self.swap_leaders(observer)?;
        }
        Ok(())
    }
}
