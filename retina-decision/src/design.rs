//! The search for the exposures that tell rivals apart.

use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use retina_calibration::geometry::MeasurementPlan;
use retina_diagnosis::{Apart, Dataset, DesignRows, Rivals};
use retina_files::InputError;
use retina_formats::PointsTable;
use retina_geometry::Setup;

use crate::conditions::{Freedom, Levels, Setting};
use crate::judge::LN_ODDS;
use crate::light::Light;
use crate::sequence::{Material, Planned, measurement_plan};

/// Makes data of a table, under the model that the measurements were read with.
pub type MakeData<'a> = &'a (dyn Fn(PointsTable) -> Result<Dataset, InputError> + Sync);

/// How a plan is chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Choice {
    /// So that rivals are told apart.
    Separating,
    /// At random from the same conditions.
    Random,
}

/// What a plan is made from.
pub struct Wanted<'a> {
    /// The measurements so far.
    pub table: &'a PointsTable,
    /// The facility.
    pub setup: &'a Setup,
    /// Rivals as fitted to them.
    pub rivals: &'a Rivals<'a>,
    /// Those that are to be told apart: their numbers.
    pub left: &'a [usize],
    /// What may be changed.
    pub freedom: &'a Freedom,
    /// Exposures.
    pub exposures: usize,
    /// Of the search.
    pub seed: u64,
    /// How it is chosen.
    pub choice: Choice,
}

/// A pair of rivals, and how well exposures tell them apart.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Separation {
    /// Numbers of the two.
    pub pair: [usize; 2],
    /// By how many sigma the measurements at hand can tell them apart.
    pub before: f64,
    /// By how many after the planned exposures.
    pub after: f64,
}

/// A plan.
pub struct Design {
    /// The exposures.
    pub planned: Vec<Planned>,
    /// What each pair gains.
    pub separations: Vec<Separation>,
    /// Sequences that were tried.
    pub tried: usize,
    gains: bool,
}

/// Exposures that are looked ahead, of which the first are made: one alone may tell nothing.
const LOOK_AHEAD: usize = 4;
/// Random sequences at the beginning.
const STARTS: usize = 24;
/// Sequences that are changed at once.
const BEST: usize = 4;
/// Rounds of changes.
const ROUNDS: usize = 24;
/// Changes tried in each round.
const CHANGES: usize = 8;
/// One exposure of so many is not chosen by the rivals but for being unlike the others: none of them may be true.
const SPACE_FILLING: usize = 4;
/// Times that places are improved, and places among which each is chosen.
const PASSES: usize = 3;
const POOL: usize = 6;
/// Effort of a turn of the camera, of another temperature, and of any condition that is not as it was.
const EFFORT_OF_ROLL: f64 = 0.05;
const EFFORT_OF_TEMPERATURE: f64 = 0.02;
const EFFORT: f64 = 0.004;
/// Random conditions among which the most unlike are taken.
const UNLIKE: usize = 16;
/// Gain in squared sigma below which exposures tell a pair apart no better than before.
const LEAST_GAIN: f64 = 1.0;
/// Expected squared distance at which a pair counts as decided: ln odds rise by half of it.
const ENOUGH: f64 = 4.0 * LN_ODDS;

impl Design {
    /// Finds the exposures.
    ///
    /// # Errors
    /// The table has no usable points; a column that a rival needs is missing.
    pub fn find(
        wanted: &Wanted<'_>,
        make: MakeData<'_>,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<Self, InputError> {
        let light = Light::of(wanted.table, wanted.setup);
        let levels = Levels::of(wanted.table, &light, wanted.freedom)?;
        let material = Material::new(wanted.table, wanted.setup, light, levels);
        let mut random = ChaCha8Rng::seed_from_u64(wanted.seed);
        let pairs = pairs(wanted.left);
        let search = Search { wanted, material: &material, pairs: &pairs, make };
        let squares = |settings: &[Setting]| search.squares(&material.planned(settings));
        let before = squares(&[])?;
        let random_alone = wanted.choice == Choice::Random;
        let ahead = if random_alone { wanted.exposures } else { wanted.exposures.max(LOOK_AHEAD) };
        let any = |random: &mut ChaCha8Rng| -> Vec<Setting> {
            (0..ahead).map(|_| material.levels.any(random)).collect()
        };
        if random_alone {
            let planned = material.planned(&any(&mut random));
            let after = search.squares(&planned)?;
            return Ok(Self::of(planned, &pairs, [&before, &after, &after], 1));
        }
        let mut tried = 0;
        let mut scored: Vec<(f64, Vec<Setting>, Vec<f64>)> = Vec::new();
        let mut next: Vec<Vec<Setting>> = (0..STARTS).map(|_| any(&mut random)).collect();
        for round in 0..=ROUNDS {
            progress(round as f64 / ROUNDS as f64);
            let found: Vec<(f64, Vec<Setting>, Vec<f64>)> = next
                .into_par_iter()
                .map(|mut settings| {
                    fill_space(&material.levels, &mut settings);
                    let after = squares(&settings)?;
                    // What is told early counts more: a later round plans the rest anew.
                    let early = match settings.len() > wanted.exposures {
                        true => worth(&before, &squares(&settings[..wanted.exposures])?),
                        false => 0.0,
                    };
                    let value = worth(&before, &after) + early - effort(&material.levels, &settings);
                    Ok((value, settings, after))
                })
                .collect::<Result<_, InputError>>()?;
            tried += found.len();
            scored.extend(found);
            // The sort is stable: of equals the first stays.
            scored.sort_by(|a, b| b.0.total_cmp(&a.0));
            scored.truncate(BEST);
            next = (0..CHANGES)
                .map(|change| {
                    let mut settings = scored[change % scored.len()].1.clone();
                    changed(&material.levels, &mut settings, &mut random);
                    settings
                })
                .collect();
        }
        let (_, settings, after) = &scored[0];
        let (planned, after) =
            search.with_better_places(&before, material.planned(settings), after.clone())?;
        let now = match planned.len() > wanted.exposures {
            true => search.squares(&planned[..wanted.exposures])?,
            false => after.clone(),
        };
        let planned = planned.into_iter().take(wanted.exposures).collect();
        Ok(Self::of(planned, &pairs, [&before, &now, &after], tried))
    }

    /// Squared separations: before, after these exposures, and after all that were looked ahead.
    fn of(planned: Vec<Planned>, pairs: &[[usize; 2]], squares: [&[f64]; 3], tried: usize) -> Self {
        let [before, after, reached] = squares;
        let separation = |((pair, before), after): ((&[usize; 2], &f64), &f64)| Separation {
            pair: *pair,
            before: before.sqrt(),
            after: after.sqrt(),
        };
        Self {
            planned,
            gains: before.iter().zip(reached).any(|(before, reached)| reached - before > LEAST_GAIN),
            separations: pairs.iter().zip(before).zip(after).map(separation).collect(),
            tried,
        }
    }

    /// Whether these exposures, or some after them, tell any pair further apart than the measurements at hand do.
    pub fn gains(&self) -> bool {
        self.gains
    }

    /// As screens and exposures.
    pub fn measurement_plan(&self, setup: &Setup) -> MeasurementPlan {
        measurement_plan(&self.planned, setup)
    }
}

/// What sequences are judged with.
struct Search<'a> {
    wanted: &'a Wanted<'a>,
    material: &'a Material<'a>,
    pairs: &'a [[usize; 2]],
    make: MakeData<'a>,
}

impl Search<'_> {
    /// The nearer of both ways of each pair, and the data.
    fn apart(&self, planned: &[Planned], planned_for: f64) -> Result<(Vec<Apart>, Dataset), InputError> {
        let data = (self.make)(self.material.table(planned))?;
        let measured = self.material.measured();
        let mut all = self.wanted.rivals.separations(&DesignRows {
            data: &data,
            measured: &|row| data.order[row] < measured,
            stands_for: self.material.stands_for,
            planned_for,
        });
        let nearer = |&[i, j]: &[usize; 2]| {
            let (a, b) = (std::mem::take(&mut all[i][j]), std::mem::take(&mut all[j][i]));
            if a.square <= b.square { a } else { b }
        };
        Ok((self.pairs.iter().map(nearer).collect(), data))
    }

    fn squares(&self, planned: &[Planned]) -> Result<Vec<f64>, InputError> {
        Ok(self.apart(planned, 1.0)?.0.iter().map(|apart| apart.square).collect())
    }

    /// Moves most points of each exposure to where the rivals differ most, as long as that tells them further apart.
    /// Exposures that fill space keep their places, and so does a share of the points of the others.
    fn with_better_places(
        &self,
        before: &[f64],
        mut planned: Vec<Planned>,
        mut after: Vec<f64>,
    ) -> Result<(Vec<Planned>, Vec<f64>), InputError> {
        if self.material.levels.layouts.len() == 1 {
            return Ok((planned, after));
        }
        for pass in 0..PASSES {
            let mut pool = planned.clone();
            for (k, own) in pool.iter_mut().enumerate().filter(|(k, _)| !fills_space(*k)) {
                own.points = self.material.pool(own, POOL, self.wanted.seed ^ ((pass * 1000 + k) as u64));
            }
            let (apart, data) = self.apart(&pool, 1.0 / POOL as f64)?;
            // Of each row what it tells about the pairs that are not decided by far.
            // A row that the fit leaves out, such as a saturated one, tells nothing.
            let rows = self.material.measured() + pool.iter().map(|own| own.points.len()).sum::<usize>();
            let mut told = vec![0.0; rows];
            for (apart, before) in apart.iter().zip(before) {
                let share = 1.0 / (apart.square - before).max(1.0);
                for (row, square) in apart.by_row.iter().enumerate() {
                    told[data.order[row]] += share * square;
                }
            }
            let mut trial = planned.clone();
            let mut row = self.material.measured();
            for (k, (own, pool)) in trial.iter_mut().zip(&pool).enumerate() {
                let own_rows = told.get(row..row + pool.points.len()).unwrap_or_default();
                row += pool.points.len();
                if !fills_space(k) {
                    self.material.choose(own, pool, own_rows);
                }
            }
            let found = self.squares(&trial)?;
            if worth(before, &found) <= worth(before, &after) {
                break;
            }
            (planned, after) = (trial, found);
        }
        Ok((planned, after))
    }
}

/// Whether an exposure of a sequence is there to be unlike the others.
fn fills_space(at: usize) -> bool {
    at % SPACE_FILLING == SPACE_FILLING - 1
}

fn pairs(left: &[usize]) -> Vec<[usize; 2]> {
    left.iter().enumerate().flat_map(|(k, &i)| left[k + 1..].iter().map(move |&j| [i, j])).collect()
}

/// What exposures are worth: the part of what decides each pair, and beyond that a little for more.
fn worth(before: &[f64], after: &[f64]) -> f64 {
    let gained = before.iter().zip(after).map(|(before, after)| (after - before).max(0.0));
    gained.map(|gain| (gain / ENOUGH).min(1.0) + 0.01 * (1.0 + gain).ln()).sum()
}

/// What a sequence asks of the people at the bench, in units of a pair that is decided: of plans that tell as much the one
/// with the fewest changes is taken.
fn effort(levels: &Levels, settings: &[Setting]) -> f64 {
    let (mut roll, mut temperature) = (levels.rolls_deg[0], levels.temperatures_c[0]);
    let mut out = 0.0;
    for setting in settings {
        let now = (levels.rolls_deg[setting.levels[4]], levels.temperatures_c[setting.levels[5]]);
        out += if now.0.unwrap_or(0.0) == roll.unwrap_or(0.0) { 0.0 } else { EFFORT_OF_ROLL };
        out += if now.1 == temperature { 0.0 } else { EFFORT_OF_TEMPERATURE };
        out += EFFORT * setting.levels.iter().filter(|level| **level > 0).count() as f64;
        (roll, temperature) = now;
    }
    out
}

/// Changes one exposure's conditions in one thing, makes it anew, or lets two change places.
fn changed(levels: &Levels, settings: &mut [Setting], random: &mut ChaCha8Rng) {
    let at = random.random_range(0..settings.len());
    match random.random_range(0..4) {
        0 => settings[at] = levels.any(random),
        1 => {
            let other = random.random_range(0..settings.len());
            settings.swap(at, other);
        }
        _ => settings[at] = levels.another(&settings[at], random),
    }
}

/// Makes each so-many-th exposure the most unlike those before it, of some that its own seed draws.
fn fill_space(levels: &Levels, settings: &mut [Setting]) {
    for at in (0..settings.len()).filter(|at| fills_space(*at)) {
        let mut random = ChaCha8Rng::seed_from_u64(settings[at].seed);
        let unlike = |setting: &Setting| {
            settings[..at].iter().map(|other| Levels::distance(setting, other)).min().unwrap_or(0)
        };
        let drawn: Vec<Setting> = (0..UNLIKE).map(|_| levels.any(&mut random)).collect();
        // Of equals the first.
        let best = drawn.iter().rev().max_by_key(|setting| unlike(setting)).copied();
        if let Some(best) = best {
            settings[at] = Setting { seed: settings[at].seed, ..best };
        }
    }
}
