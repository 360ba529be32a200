//! `retina investigate` on sets with a hidden formula, and on sets without: asked, one JSON line a finished set, and
//! scored.

use std::collections::{BTreeSet, HashMap, HashSet};
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;
use std::sync::Mutex;
use std::time::Instant;

use rayon::prelude::*;
use retina_diagnosis::Dataset;
use retina_files::InputError;
use retina_formats::TableKind;
use retina_geometry::Setup;
use retina_investigation::{Options, investigate};
use serde::{Deserialize, Serialize};

use crate::algebra::{beside, rms};
use crate::forms::FORMULA;
use crate::generate::{Derived, io, to_bytes};
use crate::lists::{self, Part, finished};
use crate::plan::{Kind, Plan};
use crate::points::baseline_of_table;
use crate::run::{predict, read};
use crate::score::{FINDABLE_SIGMA, Target, field_error, lines, numbers};

/// Largest error of the predicted field, over its rms, of a formula that counts as equivalent.
const EQUIVALENT: f64 = 0.2;
/// How tables of readings begin.
const READINGS: &str = "channel,";
/// Stem of the lists of finished sets.
const LIST: &str = "investigated";

/// What was said of a set.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Investigated {
    set: usize,
    known: Vec<String>,
    /// Columns of the known effects.
    known_columns: Vec<Vec<String>>,
    /// Columns of each formula.
    formulas: Vec<Vec<String>>,
    /// Columns of those that are told to be weak: perhaps what another formula's laws lack.
    weak: Vec<Vec<String>>,
    p: Option<f64>,
    tried: usize,
    seconds: f64,
}

/// Investigates all sets that are not finished, of a part or of all; `progress` is told finished, total and seconds left.
///
/// # Errors
/// A table cannot be read or a result not be written.
pub fn investigate_sets(
    folder: &Path,
    setup: &Path,
    part: Option<Part>,
    progress: impl Fn(usize, usize, f64) + Sync,
) -> Result<(), InputError> {
    let setup = Setup::named(setup, Path::new(""))?;
    let done: HashSet<usize> = finished::<Investigated>(folder, LIST)?.iter().map(|f| f.set).collect();
    let plans: Vec<Plan> = lines(&folder.join("sealed").join("truth.jsonl"))?;
    let own = |set: &usize| Part::has(part, *set);
    let all = plans.iter().map(|p| p.set).filter(own).count();
    let open: Vec<usize> =
        plans.iter().map(|p| p.set).filter(own).filter(|set| !done.contains(set)).collect();
    std::fs::create_dir_all(folder.join("predicted")).map_err(|error| io(folder, &error))?;
    let (file, path) = lists::open::<Investigated>(folder, LIST, part)?;
    let out = Mutex::new((file, 0usize));
    let start = Instant::now();
    open.par_iter().with_max_len(1).try_for_each(|&set| {
        let found = one(folder, &setup, set)?;
        let text = serde_json::to_string(&found).map_err(|error| io(&path, &error))? + "\n";
        let mut out = out.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        out.0.write_all(text.as_bytes()).map_err(|error| io(&path, &error))?;
        out.1 += 1;
        let left = start.elapsed().as_secs_f64() / out.1 as f64 * (open.len() - out.1) as f64;
        progress(all - open.len() + out.1, all, left);
        Ok(())
    })
}

fn one(folder: &Path, setup: &Setup, set: usize) -> Result<Investigated, InputError> {
    let start = Instant::now();
    let own = folder.join("sets").join(format!("{set:05}"));
    let data: Dataset = read(setup, &[own.join("table.csv")])?;
    let found = investigate(&data, &[], &Options::default(), &|_, _| {})?;
    let seconds = start.elapsed().as_secs_f64();
    if !found.known.is_empty() && data.kind == TableKind::Power {
        let path = folder.join("predicted").join(format!("{set:05}.f32"));
        std::fs::write(&path, to_bytes(&found.fit.effect)).map_err(|error| io(&path, &error))?;
    } else if !found.known.is_empty() {
        predict(folder, set, &data, &found.fit)?;
    } else if !found.terms.is_empty() {
        let fresh = read(setup, &[own.join("fresh.csv")])?;
        let predicted = fresh.in_table_order(&found.fit.own_effects_on(&found.model, &fresh));
        let path = folder.join("predicted").join(format!("{set:05}-fresh.f32"));
        std::fs::write(&path, to_bytes(&predicted)).map_err(|error| io(&path, &error))?;
    }
    let columns_of = |weak: bool| -> Vec<Vec<String>> {
        let terms = found.terms.iter().filter(|term| term.weak_beside.is_some() == weak);
        terms.map(|term| term.covariates.clone()).collect()
    };
    Ok(Investigated {
        set,
        known: found.known.iter().map(|known| known.effect.to_owned()).collect(),
        known_columns: found.known.iter().map(|known| known.columns.clone()).collect(),
        formulas: columns_of(false),
        weak: columns_of(true),
        p: found.terms.first().map(|term| term.proof.p_value),
        tried: found.tried,
        seconds,
    })
}

fn listed(formulas: &[Vec<String>]) -> String {
    formulas.iter().map(|columns| columns.join(", ")).collect::<Vec<_>>().join("; ")
}

/// Columns with x and y as one place.
fn columns<'a>(names: impl Iterator<Item = &'a str>) -> BTreeSet<String> {
    names
        .flat_map(|name| match name {
            "x" | "y" | "r" => vec!["place"],
            "F" => vec!["log10_irradiance"],
            "level" => vec!["digital_count"],
            // The light of a square is that of its count times its area.
            "ln_irradiance" | "per_irradiance" => vec!["digital_count", "square_px"],
            name => vec![name],
        })
        .map(str::to_owned)
        .collect()
}

/// The same, on the table's own rows where known effects are in the model: only formulas are evaluated elsewhere.
fn error_of(folder: &Path, said: &Investigated) -> Option<f64> {
    if said.known.is_empty() {
        return fresh_error(folder, said.set);
    }
    let table = folder.join("sets").join(format!("{:05}", said.set)).join("table.csv");
    if !std::fs::read_to_string(table).ok()?.starts_with(READINGS) {
        return field_error(folder, said.set);
    }
    let predicted = numbers(&folder.join("predicted").join(format!("{:05}.f32", said.set)))?;
    let truth = numbers(&folder.join("sealed").join(format!("{:05}.f32", said.set)))?;
    Some(relative_error(&truth, &predicted))
}

/// Predicted minus true relative readings beside one gain, over the true ones' rms.
fn relative_error(truth: &[f64], predicted: &[f64]) -> f64 {
    let (gain, ones) = (vec![vec![1.0; truth.len()]], vec![1.0; truth.len()]);
    let difference: Vec<f64> = predicted.iter().zip(truth).map(|(p, t)| p - t).collect();
    rms(&beside(&gain, &difference, &ones)) / rms(&beside(&gain, truth, &ones))
}

/// Predicted minus true field on fresh exposures beside the baseline, over the true one's rms.
fn fresh_error(folder: &Path, set: usize) -> Option<f64> {
    let truth = numbers(&folder.join("sealed").join(format!("{set:05}-fresh.f32")))?;
    let predicted = numbers(&folder.join("predicted").join(format!("{set:05}-fresh.f32")))
        .unwrap_or_else(|| vec![0.0; truth.len()]);
    let table =
        std::fs::read_to_string(folder.join("sets").join(format!("{set:05}")).join("fresh.csv")).ok()?;
    if table.starts_with(READINGS) {
        return Some(relative_error(&truth, &predicted));
    }
    let (base, _) = baseline_of_table(&table);
    let ones = vec![1.0; truth.len()];
    let difference: Vec<f64> = predicted.iter().zip(&truth).map(|(p, t)| p - t).collect();
    Some(rms(&beside(&base, &difference, &ones)) / rms(&beside(&base, &truth, &ones)))
}

/// Opens the truth: how often the columns were right, a formula was equivalent, and something was found that is not
/// there.
///
/// # Errors
/// Truth or results cannot be read.
pub fn score_investigated(folder: &Path) -> Result<(Vec<Target>, String), InputError> {
    let plans: Vec<Plan> = lines(&folder.join("sealed").join("truth.jsonl"))?;
    let derived: Vec<Derived> = lines(&folder.join("sealed").join("derived.jsonl"))?;
    let said: Vec<Investigated> = finished(folder, LIST)?;
    let derived: HashMap<usize, Derived> = derived.into_iter().map(|d| (d.set, d)).collect();
    let said: HashMap<usize, Investigated> = said.into_iter().map(|s| (s.set, s)).collect();
    let mut right = HashMap::<String, [usize; 4]>::new();
    let mut listing = String::from(
        "| set | strength | truth | known | formulas | weak | error on fresh exposures |\n|---|---|---|---|---|---|---|\n",
    );
    let mut nulls: HashMap<&str, [usize; 2]> = HashMap::new();
    for plan in &plans {
        let Some(said) = said.get(&plan.set) else { continue };
        let hidden = plan.hidden.first();
        let Some(formula) = hidden.filter(|hidden| hidden.id == FORMULA) else {
            let kind = match hidden {
                Some(_) => "a known effect",
                None if plan.campaign.wander > 0.0 => "a mount that wanders",
                None if plan.kind == Kind::FormulaPower && plan.campaign.jitter > 1.0 => {
                    "a meter that repeats badly"
                }
                None => "nothing",
            };
            let count = nulls.entry(kind).or_default();
            count[0] += 1;
            count[1] += usize::from(!said.formulas.is_empty() || !said.known.is_empty() && hidden.is_none());
            continue;
        };
        let findable =
            derived.get(&plan.set).is_some_and(|d| d.oracle_sigma.iter().all(|z| *z >= FINDABLE_SIGMA));
        let truth = columns(plan.covariates.iter().map(String::as_str));
        let found = columns(said.formulas.iter().chain(&said.known_columns).flatten().map(String::as_str));
        let error = error_of(folder, said);
        let count = right.entry(format!("{}", formula.strength)).or_default();
        count[0] += 1;
        count[1] += usize::from(findable);
        count[2] += usize::from(found == truth);
        count[3] += usize::from(error.is_some_and(|e| e <= EQUIVALENT));
        let _ = writeln!(
            listing,
            "| {} | {} | {} | {} | {} | {} | {} |",
            plan.set,
            formula.strength,
            plan.covariates.join(", "),
            said.known.join(", "),
            listed(&said.formulas),
            listed(&said.weak),
            error.map_or_else(String::new, |e| format!("{e:.2}"))
        );
    }
    let mut seconds: Vec<f64> = said.values().map(|s| s.seconds).collect();
    seconds.sort_by(f64::total_cmp);
    let sum = |at: usize| -> usize {
        right.iter().filter(|(s, _)| s.parse::<f64>().is_ok_and(|s| s >= 1.0)).map(|(_, c)| c[at]).sum()
    };
    let false_finds = nulls.values().fold([0, 0], |sum, [of, count]| [sum[0] + of, sum[1] + count]);
    let target = |name: &str, count, of, wanted| Target { name: name.to_owned(), count, of, wanted };
    let targets = vec![
        target("right columns from strength 1", sum(2), sum(0), (0.95, true)),
        target("equivalent formula from strength 1", sum(3), sum(0), (0.80, true)),
        target("found where there is no formula", false_finds[1], false_finds[0], (0.03, false)),
    ];
    let mut text = String::from("| target | count | share | upper 95 % | wanted |\n|---|---|---|---|---|\n");
    for target in &targets {
        let wanted = if target.wanted.1 { "at least" } else { "at most" };
        let _ = writeln!(
            text,
            "| {} | {} of {} | {:.1} % | {:.1} % | {wanted} {} % |",
            target.name,
            target.count,
            target.of,
            100.0 * target.share(),
            100.0 * target.upper(),
            100.0 * target.wanted.0
        );
    }
    text.push_str("\n| strength | sets | findable | right columns | equivalent |\n|---|---|---|---|---|\n");
    let mut strengths: Vec<_> = right.iter().collect();
    strengths.sort_by(|a, b| a.0.parse::<f64>().unwrap_or(0.0).total_cmp(&b.0.parse().unwrap_or(0.0)));
    for (strength, [of, findable, columns, equal]) in strengths {
        let _ = writeln!(text, "| {strength} | {of} | {findable} | {columns} | {equal} |");
    }
    text.push_str("\n| without a formula | sets | something found that is not there |\n|---|---|---|\n");
    let mut kinds: Vec<_> = nulls.into_iter().collect();
    kinds.sort_unstable();
    for (kind, [of, count]) in kinds {
        let _ = writeln!(text, "| {kind} | {of} | {count} |");
    }
    let middle = seconds.get(seconds.len() / 2).copied().unwrap_or(f64::NAN);
    let longest = seconds.last().copied().unwrap_or(f64::NAN);
    let _ = writeln!(text, "\nSeconds a set, several at a time: median {middle:.1}, longest {longest:.1}.\n");
    Ok((targets, text + &listing))
}
