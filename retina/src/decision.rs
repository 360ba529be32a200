//! Deciding between rival models: what the measurements say of them, and the exposures that tell those apart that are
//! left, round after round.

use std::path::PathBuf;

pub use retina_decision::*;
use retina_diagnosis::{DiagnoseOptions, Rival, Rivals, diagnose, headline};
use retina_files::{InputError, write_atomic};
use retina_formats::Measurements;

use crate::workbench::{GivenEffect, Input, Measured, TableMaterial, added_effects};

/// What is asked.
#[derive(Clone)]
pub struct Question {
    /// Rivals, each as effects with `+` between them: ids, or files that end in `.toml`. None: those that a diagnosis
    /// cannot tell apart.
    pub rivals: Vec<String>,
    /// Effects that all rivals have beside their own.
    pub common: Vec<GivenEffect>,
    /// What a plan may change.
    pub freedom: Freedom,
    /// Exposures in a round.
    pub exposures: usize,
    /// Most exposures in all rounds.
    pub budget: usize,
    /// Seed of the search.
    pub seed: u64,
    /// Folder of the rounds.
    pub folder: PathBuf,
}

/// Makes a round's measurements: they are in its folder afterwards.
pub type Take<'a> = &'a dyn Fn(&Round) -> Result<(), InputError>;

/// Judges the rivals by all measurements, and plans the next round. With `take` it makes the measurements too, until one
/// rival is left, the budget is spent, or no exposure tells those apart that are left. What was planned and measured
/// before is read again, so that the same question goes on where it was.
///
/// # Errors
/// Fewer than two rivals, a rival that these measurements cannot show, tables that are not of points, a folder of another
/// question, measurements that do not fit.
pub fn decide(
    input: &Input,
    question: &Question,
    take: Option<Take<'_>>,
    progress: &(dyn Fn(&str, f64) + Sync),
) -> Result<Outcome, InputError> {
    let rounds = Rounds::new(&question.folder)?;
    let first = points(input, &[])?;
    let specified = specified(question, &first)?;
    check_same_question(&rounds, input, &specified)?;
    let mut history = Vec::new();
    let mut seen = 0;
    loop {
        let (tables, waiting) = rounds.measured(&input.setup)?;
        // Probabilities after each round that was measured before.
        for known in seen..tables.len() {
            let material = points(input, &tables[..known])?;
            let rivals = read(&specified, question, &material)?;
            let fitted = Rivals::fit(&material.data, &rivals)?;
            history.push(fitted.judgements().iter().map(|j| j.probability).collect());
        }
        seen = tables.len();
        let material = points(input, &tables)?;
        let rivals = read(&specified, question, &material)?;
        let mut outcome = judged(&rounds, &material, rivals, question, tables.len(), &history)?;
        match (waiting, take) {
            (Some(round), Some(take)) if outcome.decision.left.len() > 1 => {
                measured(take, &round)?;
                continue;
            }
            (Some(round), None) if outcome.decision.left.len() > 1 => outcome.waiting = Some(round.folder),
            _ => plan(&rounds, &material, question, tables.len() + 1, &mut outcome, progress)?,
        }
        record(&rounds, input, &specified, &outcome)?;
        let Some((take, round)) = take.zip(outcome.next.as_ref().map(|_| rounds.round(tables.len() + 1)))
        else {
            return Ok(outcome);
        };
        measured(take, &round)?;
    }
}

fn measured(take: Take<'_>, round: &Round) -> Result<(), InputError> {
    take(round)?;
    if round.points().is_file() || round.images().is_dir() {
        return Ok(());
    }
    Err(InputError::new(&round.folder, "the round was not measured")
        .expected("points.csv, or images/ with images.csv, in the round's folder")
        .help("the command of --take has to write one of them"))
}

/// The measurements with those of the rounds.
fn points(input: &Input, rounds: &[PathBuf]) -> Result<TableMaterial, InputError> {
    let mut input = input.clone();
    let Measured::Files(files) = &mut input.measured else {
        return Err(InputError::new("--data", "is in memory").expected("files of points"));
    };
    files.extend_from_slice(rounds);
    let material = input.table()?;
    match material.tables {
        Measurements::Points(_) => Ok(material),
        _ => Err(InputError::new("--data", "exposures are planned for tables of points alone")
            .found(format!("a table of {}", material.tables.kind().name()))
            .help("`retina diagnose` says what to measure next of other tables")),
    }
}

/// The rivals as text: those that were given, or those that a diagnosis cannot tell apart.
fn specified(question: &Question, material: &TableMaterial) -> Result<Vec<String>, InputError> {
    let rivals = match question.rivals.is_empty() {
        false => question.rivals.clone(),
        true => confounded(question, material)?,
    };
    if let Some(twice) = rivals.iter().enumerate().find(|(k, rival)| rivals[..*k].contains(rival)) {
        return Err(InputError::new("--rival", "is given twice").found(format!("`{}`", twice.1)));
    }
    if rivals.len() < 2 {
        return Err(InputError::new("--rival", "a decision needs at least two rivals")
            .found(rivals.len())
            .help("for example --rival drift --rival thermal_boresight"));
    }
    Ok(rivals)
}

/// Rivals of the first effect that a diagnosis accepts and cannot tell from others.
fn confounded(question: &Question, material: &TableMaterial) -> Result<Vec<String>, InputError> {
    let common = added_effects(&question.common, &material.data)?;
    let options = DiagnoseOptions { seed: question.seed, ..DiagnoseOptions::default() };
    let found = diagnose(&material.data, &common, &options);
    let of = found.rivals.iter().position(|rivals| !rivals.is_empty()).ok_or_else(|| {
        InputError::new("--rival", "no rivals are given, and a diagnosis finds none that look alike")
            .found(headline(&material.data, &found))
            .help("name at least two: effects' ids, or files of `retina investigate --out`, such as --rival found/found_1.toml --rival found/found_1_rival_1.toml")
    })?;
    let others: Vec<&str> =
        (0..found.accepted.len()).filter(|&k| k != of).map(|k| found.accepted[k]).collect();
    let own = std::iter::once(&found.accepted[of]).chain(&found.rivals[of]);
    Ok(own.map(|id| std::iter::once(id).chain(&others).copied().collect::<Vec<_>>().join("+")).collect())
}

fn read(
    specified: &[String],
    question: &Question,
    material: &TableMaterial,
) -> Result<Vec<Rival>, InputError> {
    let common = added_effects(&question.common, &material.data)?;
    specified
        .iter()
        .map(|text| {
            let own: Vec<GivenEffect> =
                text.split('+').map(|part| GivenEffect::Text(part.trim().to_owned())).collect();
            let mut effects = common.clone();
            for effect in added_effects(&own, &material.data)? {
                if effects.iter().any(|other| other.name() == effect.name()) {
                    return Err(InputError::new("--rival", "has an effect that is in the model already")
                        .found(format!("`{}` in `{text}`", effect.name())));
                }
                effects.push(effect);
            }
            Ok(Rival { name: text.clone(), effects })
        })
        .collect()
}

fn judged(
    rounds: &Rounds,
    material: &TableMaterial,
    rivals: Vec<Rival>,
    question: &Question,
    measured: usize,
    history: &[Vec<f64>],
) -> Result<Outcome, InputError> {
    let decision = Decision::of(&Rivals::fit(&material.data, &rivals)?);
    let mut used = 0;
    for number in 1..=measured {
        let folder = rounds.round(number).folder;
        used +=
            retina_calibration::geometry::MeasurementPlan::read(&folder, &material.setup)?.exposures.len();
    }
    let mut history = history.to_vec();
    history.push(decision.judgements.iter().map(|j| j.probability).collect());
    let beside = decision.decided().map(|best| {
        let options = DiagnoseOptions { seed: question.seed, ..DiagnoseOptions::default() };
        let found = diagnose(&material.data, &rivals[best].effects, &options);
        (found.verdict.name(), headline(&material.data, &found))
    });
    Ok(Outcome {
        rivals,
        decision,
        used,
        budget: question.budget,
        history,
        next: None,
        waiting: None,
        inseparable: false,
        beside,
        notes: material.data.notes.clone(),
    })
}

/// Plans a round, where more than one rival is left and the budget allows.
fn plan(
    rounds: &Rounds,
    material: &TableMaterial,
    question: &Question,
    number: usize,
    outcome: &mut Outcome,
    progress: &(dyn Fn(&str, f64) + Sync),
) -> Result<(), InputError> {
    let exposures = question.exposures.min(outcome.budget.saturating_sub(outcome.used));
    let Measurements::Points(table) = &material.tables else { return Ok(()) };
    if outcome.decision.left.len() < 2 || exposures == 0 {
        return Ok(());
    }
    let fitted = Rivals::fit(&material.data, &outcome.rivals)?;
    let wanted = Wanted {
        table,
        setup: &material.setup,
        rivals: &fitted,
        left: &outcome.decision.left,
        freedom: &question.freedom,
        exposures,
        seed: question.seed.wrapping_add(number as u64),
        choice: Choice::Separating,
    };
    let what = format!("planning round {number}");
    let design = Design::find(&wanted, &|table| material.data_of(table), &|share| progress(&what, share))?;
    if !design.gains() {
        outcome.inseparable = true;
        return Ok(());
    }
    let plan = design.measurement_plan(&material.setup);
    let round = rounds.write(number, &plan, &material.setup, question.seed)?;
    outcome.next = Some((design, round.folder));
    Ok(())
}

/// File that says what was asked and decided.
const RECORD: &str = "decision.json";

fn asked(input: &Input, specified: &[String]) -> serde_json::Value {
    let Measured::Files(files) = &input.measured else { return serde_json::Value::Null };
    serde_json::json!({ "setup": input.setup.name, "data": files, "rivals": specified })
}

/// A folder holds the rounds of one question.
fn check_same_question(rounds: &Rounds, input: &Input, specified: &[String]) -> Result<(), InputError> {
    let path = rounds.folder().join(RECORD);
    let Ok(text) = std::fs::read_to_string(&path) else { return Ok(()) };
    let known: serde_json::Value = serde_json::from_str(&text)
        .map_err(|error| InputError::new(&path, format!("cannot be read: {error}")))?;
    if known["asked"] == asked(input, specified) {
        return Ok(());
    }
    Err(InputError::new(rounds.folder(), "the folder has rounds of another question")
        .found(known["asked"].to_string())
        .expected(asked(input, specified).to_string())
        .help("name another folder with --out"))
}

fn record(rounds: &Rounds, input: &Input, specified: &[String], outcome: &Outcome) -> Result<(), InputError> {
    let path = rounds.folder().join(RECORD);
    let failed = |error: std::io::Error| InputError::new(&path, format!("cannot be written: {error}"));
    std::fs::create_dir_all(rounds.folder()).map_err(failed)?;
    let mut document = decision_json(outcome);
    document["asked"] = asked(input, specified);
    write_atomic(&path, format!("{document:#}\n").as_bytes()).map_err(failed)
}
