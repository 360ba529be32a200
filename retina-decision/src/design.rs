//! The search for the exposures that tell rivals apart.

use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use retina_calibration::geometry::MeasurementPlan;
use retina_diagnosis::{Dataset, Rivals};
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
}

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
/// Random conditions among which the most unlike are taken.
const UNLIKE: usize = 16;
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
        let squares = |settings: &[Setting]| -> Result<Vec<f64>, InputError> {
            let data = make(material.table(&material.planned(settings)))?;
            let measured = material.measured();
            let all =
                wanted.rivals.separations(&data, &|row| data.order[row] < measured, material.stands_for);
            Ok(pairs.iter().map(|&[i, j]| all[i][j].min(all[j][i])).collect())
        };
        let before = squares(&[])?;
        let any = |random: &mut ChaCha8Rng| -> Vec<Setting> {
            (0..wanted.exposures).map(|_| material.levels.any(random)).collect()
        };
        if wanted.choice == Choice::Random {
            let settings = any(&mut random);
            return Ok(Self::of(&material, &settings, &pairs, &before, &squares(&settings)?, 1));
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
                    Ok((worth(&before, &after), settings, after))
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
        Ok(Self::of(&material, settings, &pairs, &before, after, tried))
    }

    fn of(
        material: &Material<'_>,
        settings: &[Setting],
        pairs: &[[usize; 2]],
        before: &[f64],
        after: &[f64],
        tried: usize,
    ) -> Self {
        let separation = |((pair, before), after): ((&[usize; 2], &f64), &f64)| Separation {
            pair: *pair,
            before: before.sqrt(),
            after: after.sqrt(),
        };
        Self {
            planned: material.planned(settings),
            separations: pairs.iter().zip(before).zip(after).map(separation).collect(),
            tried,
        }
    }

    /// As screens and exposures.
    pub fn measurement_plan(&self, setup: &Setup) -> MeasurementPlan {
        measurement_plan(&self.planned, setup)
    }
}

fn pairs(left: &[usize]) -> Vec<[usize; 2]> {
    left.iter().enumerate().flat_map(|(k, &i)| left[k + 1..].iter().map(move |&j| [i, j])).collect()
}

/// What exposures are worth: the part of what decides each pair, and beyond that a little for more.
fn worth(before: &[f64], after: &[f64]) -> f64 {
    let gained = before.iter().zip(after).map(|(before, after)| (after - before).max(0.0));
    gained.map(|gain| (gain / ENOUGH).min(1.0) + 0.01 * (1.0 + gain).ln()).sum()
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
    for at in (SPACE_FILLING - 1..settings.len()).step_by(SPACE_FILLING) {
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
