//! How many exposures it takes to decide between two effects that a campaign cannot tell apart: exposures that are
//! designed for it, exposures drawn at random from the same conditions, and more of the same as before.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use rayon::prelude::*;
use retina_decision::{Choice, Decision, Design, Factor, Freedom, Wanted};
use retina_diagnosis::{AddedEffect, Baseline, Dataset, Rival, Rivals, Source};
use retina_files::InputError;
use retina_formats::{Measurements, PointsTable};
use retina_geometry::Setup;
use serde::{Deserialize, Serialize};

use crate::generate::io;
use crate::plan::CLASSES;
use crate::points::{Campaign, Chamber, Hidden, Shot, nature};

/// Exposures of a round, and most of them.
const ROUND: usize = 1;
const MOST: usize = 24;
/// Points of an exposure.
const POINTS: usize = 12;
/// Sizes of the hidden effect, of the noise.
const STRENGTHS: [f64; 2] = [0.5, 1.0];
/// Conditions that no campaign changes by itself.
const ORDINARY: [Factor; 5] =
    [Factor::Channel, Factor::Exposure, Factor::Roll, Factor::Temperature, Factor::Wait];

/// One case: who is hidden, who might be taken for it, and what it took.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Case {
    hidden: String,
    rival: String,
    strength: f64,
    seed: u64,
    designed: Taken,
    random: Taken,
    same: Taken,
}

#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct Taken {
    /// Exposures beside the campaign.
    exposures: usize,
    /// Whether the hidden one was left; `None`: not decided.
    right: Option<bool>,
}

impl Taken {
    /// Exposures, of a case that was not decided the most.
    fn cost(&self) -> usize {
        if self.right.is_some() { self.exposures } else { MOST }
    }
}

/// Decides all pairs of the classes, each with each of the two hidden, `sets` times; returns the table of results.
///
/// # Errors
/// A table cannot be written or read.
pub fn decide_pairs(
    folder: &Path,
    setup: &Path,
    sets: usize,
    seed: u64,
    progress: impl Fn(usize, usize, f64) + Sync,
) -> Result<String, InputError> {
    let setup = Setup::named(setup, Path::new(""))?;
    let mut open = Vec::new();
    for class in CLASSES {
        for hidden in class {
            for rival in class.iter().filter(|rival| *rival != hidden) {
                for strength in STRENGTHS {
                    open.extend((0..sets).map(|set| (*hidden, *rival, strength, seed + set as u64)));
                }
            }
        }
    }
    std::fs::create_dir_all(folder).map_err(|error| io(folder, &error))?;
    let (start, done) = (Instant::now(), AtomicUsize::new(0));
    let cases: Vec<Option<Case>> = open
        .par_iter()
        .with_max_len(1)
        .enumerate()
        .map(|(number, &(hidden, rival, strength, seed))| {
            let own = folder.join(format!("{number:04}"));
            let case = one(&own, &setup, hidden, rival, strength, seed)?;
            let done = done.fetch_add(1, Ordering::Relaxed) + 1;
            let left = start.elapsed().as_secs_f64() / done as f64 * (open.len() - done) as f64;
            progress(done, open.len(), left);
            Ok(case)
        })
        .collect::<Result<_, InputError>>()?;
    let cases: Vec<Case> = cases.into_iter().flatten().collect();
    let path = folder.join("decided.jsonl");
    let lines: Result<Vec<String>, _> = cases.iter().map(serde_json::to_string).collect();
    let text = lines.map_err(|error| io(&path, &error))?.join("\n");
    std::fs::write(&path, text + "\n").map_err(|error| io(&path, &error))?;
    Ok(table(&cases))
}

/// `None` where the campaign decides by itself, or cannot show the rival.
fn one(
    folder: &Path,
    setup: &Setup,
    hidden: &str,
    rival: &str,
    strength: f64,
    seed: u64,
) -> Result<Option<Case>, InputError> {
    std::fs::create_dir_all(folder).map_err(|error| io(folder, &error))?;
    let campaign = Campaign {
        rows: 1200,
        exposures: 30,
        jitter: 0.3,
        outliers: 0.02,
        colours: crate::forms::needs_colours(hidden),
        // Time and temperature go together in it.
        chamber: Chamber::WarmUp,
        roll_deg: 0.0,
        seed,
        wander: 0.0,
    };
    let effects = [Hidden { id: hidden.to_owned(), strength }];
    let natures = [nature(seed, 0)];
    let made = campaign.make(&effects, &natures, None);
    let base = folder.join("campaign.csv");
    std::fs::write(&base, &made.text).map_err(|error| io(&base, &error))?;
    let taken = |name: &str, choice: Choice, held: &[Factor]| -> Result<Option<Taken>, InputError> {
        let freedom = Freedom { held: held.to_vec(), points: Some(POINTS), ..Freedom::default() };
        let mut tables = vec![base.clone()];
        loop {
            let exposures = ROUND * (tables.len() - 1);
            let measured = Measurements::read(&tables)?;
            let data = data(setup, &measured)?;
            let Ok(rivals) = [hidden, rival]
                .iter()
                .map(|id| {
                    let effects = vec![AddedEffect::read(id, &data)?];
                    Ok(Rival { name: (*id).to_owned(), effects })
                })
                .collect::<Result<Vec<Rival>, InputError>>()
            else {
                return Ok(None);
            };
            let fitted = Rivals::fit(&data, &rivals)?;
            let decision = Decision::of(&fitted);
            if let Some(best) = decision.decided() {
                return Ok((exposures > 0).then_some(Taken { exposures, right: Some(best == 0) }));
            }
            if decision.left.len() == 1 || exposures >= MOST {
                return Ok(Some(Taken { exposures, right: None }));
            }
            let Measurements::Points(table) = &measured else { return Ok(None) };
            let wanted = Wanted {
                table,
                setup,
                rivals: &fitted,
                left: &decision.left,
                freedom: &freedom,
                exposures: ROUND,
                seed: seed + exposures as u64,
                choice,
            };
            let make = |table: PointsTable| data_of(setup, table);
            let design = Design::find(&wanted, &make, &|_| {})?;
            // No exposure that may be made tells these two apart.
            if choice == Choice::Separating && !design.gains() {
                return Ok(Some(Taken { exposures, right: None }));
            }
            let text = campaign.follow(
                &shots(&design),
                &effects,
                &natures,
                &made.amplitudes,
                seed ^ (0x5eed_0000 + exposures as u64),
            );
            tables.push(written(folder, name, tables.len(), &text)?);
        }
    };
    let Some(designed) = taken("designed", Choice::Separating, &[])? else { return Ok(None) };
    let Some(random) = taken("random", Choice::Random, &[])? else { return Ok(None) };
    let Some(same) = taken("same", Choice::Random, &ORDINARY)? else { return Ok(None) };
    let (hidden, rival) = (hidden.to_owned(), rival.to_owned());
    Ok(Some(Case { hidden, rival, strength, seed, designed, random, same }))
}

fn written(folder: &Path, name: &str, round: usize, text: &str) -> Result<PathBuf, InputError> {
    let path = folder.join(format!("{name}_{round:02}.csv"));
    std::fs::write(&path, text).map_err(|error| io(&path, &error))?;
    Ok(path)
}

fn data(setup: &Setup, tables: &Measurements) -> Result<Dataset, InputError> {
    let baseline = Baseline::Physical;
    Dataset::new(&Source { tables, setup, calibration: None, response: None, baseline })
}

fn data_of(setup: &Setup, table: PointsTable) -> Result<Dataset, InputError> {
    data(setup, &Measurements::Points(table))
}

fn shots(design: &Design) -> Vec<Shot> {
    design
        .planned
        .iter()
        .map(|planned| Shot {
            time_s: planned.exposure.time_s.unwrap_or(0.0),
            temperature_c: planned.exposure.temperature_c.unwrap_or(20.0),
            roll_deg: planned.exposure.camera_roll_deg.unwrap_or(0.0),
            mounting: planned.exposure.mounting.unwrap_or(0.0) as usize,
            channel: planned.channel as usize,
            points: planned.points.iter().map(|p| (p.screen_px(), f64::from(p.digital_count))).collect(),
        })
        .collect()
}

/// Results by class: exposures that were taken until one was left or the most were reached, of cases that any of the three
/// decided.
fn table(cases: &[Case]) -> String {
    let mut out = String::from(
        "| class | cases | decided by none | exposures: designed | random | the same | designed over random | not decided: designed | random | the same | wrong |\n|---|---|---|---|---|---|---|---|---|---|---|\n",
    );
    let arms = |case: &Case| [case.designed, case.random, case.same];
    let mut line = |name: &str, own: &[&Case]| {
        let open: Vec<&&Case> =
            own.iter().filter(|case| arms(case).iter().any(|taken| taken.right.is_some())).collect();
        let sum = |arm: usize| open.iter().map(|case| arms(case)[arm].cost()).sum::<usize>();
        let undecided = |arm: usize| open.iter().filter(|case| arms(case)[arm].right.is_none()).count();
        let wrong: usize =
            (0..3).map(|arm| own.iter().filter(|case| arms(case)[arm].right == Some(false)).count()).sum();
        let _ = writeln!(
            out,
            "| {name} | {} | {} | {} | {} | {} | {:.2} | {} | {} | {} | {wrong} |",
            own.len(),
            own.len() - open.len(),
            sum(0),
            sum(1),
            sum(2),
            sum(0) as f64 / sum(1).max(1) as f64,
            undecided(0),
            undecided(1),
            undecided(2),
        );
    };
    for class in CLASSES {
        let own: Vec<&Case> = cases.iter().filter(|case| class.contains(&case.hidden.as_str())).collect();
        line(&class.join(", "), &own);
    }
    for strength in STRENGTHS {
        let own: Vec<&Case> = cases.iter().filter(|case| case.strength == strength).collect();
        line(&format!("strength {strength}"), &own);
    }
    line("all", &cases.iter().collect::<Vec<_>>());
    out
}
