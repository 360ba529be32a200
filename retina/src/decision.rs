//! Deciding between rival models: what the measurements say of them, and the exposures that tell those apart that are
//! left, round after round.

mod record;

use std::path::PathBuf;

pub use retina_decision::*;
use retina_diagnosis::{AddedEffect, DiagnoseOptions, Diagnosis, Rival, Rivals, diagnose, headline};
use retina_files::InputError;
use retina_formats::Measurements;

use crate::workbench::{GivenEffect, Input, Measured, TableMaterial, added_effects};
use record::{Asked, write_record};

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

/// Most effects that a diagnosis adds to all rivals.
const MOST_JOINED: usize = 4;

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
    let asked = Asked::of(input, question, &specified)?;
    asked.check(rounds.folder())?;
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
        if outcome.verdict() == "none_needed" {
            let found = diagnosed(&material, question, &outcome.common);
            outcome.beside = Some((found.verdict.name(), headline(&material.data, &found)));
        }
        write_record(rounds.folder(), &asked, &outcome)?;
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

/// An effect was given as a rival.
fn of_rival(mut error: InputError) -> InputError {
    if error.file.as_os_str() == "--effect" {
        error.file = "--rival".into();
    }
    error
}

fn read(
    specified: &[String],
    question: &Question,
    material: &TableMaterial,
) -> Result<Vec<Rival>, InputError> {
    let common = added_effects(&question.common, &material.data)?;
    let rivals: Vec<Rival> = specified
        .iter()
        .map(|text| {
            let own: Vec<GivenEffect> =
                text.split('+').map(|part| GivenEffect::Text(part.trim().to_owned())).collect();
            let mut effects = common.clone();
            for effect in added_effects(&own, &material.data).map_err(of_rival)? {
                if effects.iter().any(|other| other.name() == effect.name()) {
                    return Err(InputError::new("--rival", "has an effect that is in the model already")
                        .found(format!("`{}` in `{text}`", effect.name())));
                }
                effects.push(effect);
            }
            Ok(Rival { name: text.clone(), effects })
        })
        .collect::<Result<_, InputError>>()?;
    let names = |rival: &Rival| {
        let mut names: Vec<String> = rival.effects.iter().map(|effect| effect.name().to_owned()).collect();
        names.sort();
        names
    };
    for (k, own) in rivals.iter().enumerate() {
        if let Some(other) = rivals[..k].iter().find(|other| names(other) == names(own)) {
            return Err(InputError::new("--rival", "two rivals are the same model")
                .found(format!("`{}` and `{}`", other.name, own.name)));
        }
    }
    Ok(rivals)
}

fn diagnosed(material: &TableMaterial, question: &Question, beside: &[AddedEffect]) -> Diagnosis {
    let options = DiagnoseOptions { seed: question.seed, ..DiagnoseOptions::default() };
    diagnose(&material.data, beside, &options)
}

/// Judges the rivals. What a diagnosis names beside the only one that is left may be what ruled the others out: all rivals
/// get it, and are judged again.
fn judged(
    rounds: &Rounds,
    material: &TableMaterial,
    mut rivals: Vec<Rival>,
    question: &Question,
    measured: usize,
    history: &[Vec<f64>],
) -> Result<Outcome, InputError> {
    let mut common = added_effects(&question.common, &material.data)?;
    let mut notes = material.data.notes.clone();
    let (mut decision, mut beside);
    loop {
        decision = Decision::of(&Rivals::fit(&material.data, &rivals)?);
        beside = None;
        let Some(best) = decision.decided() else { break };
        let found = diagnosed(material, question, &rivals[best].effects);
        beside = Some((found.verdict.name(), headline(&material.data, &found)));
        let has = |effects: &[AddedEffect], id: &str| effects.iter().any(|effect| effect.name() == id);
        let further: Vec<&str> = found.accepted.iter().copied().filter(|id| !has(&common, id)).collect();
        if further.is_empty() || common.len() >= question.common.len() + MOST_JOINED {
            break;
        }
        for id in further {
            let effect = AddedEffect::read(id, &material.data)?;
            for rival in rivals.iter_mut().filter(|rival| !has(&rival.effects, id)) {
                rival.effects.push(effect.clone());
            }
            common.push(effect);
            notes.push(format!(
                "a diagnosis beside {} names {id}: all rivals have it here, and were judged again",
                rivals[best].name
            ));
        }
    }
    let none = Rival { name: "none of them".to_owned(), effects: common.clone() };
    let needed = !Decision::of(&Rivals::fit(&material.data, &[rivals[decision.best].clone(), none])?)
        .left
        .contains(&1);
    let mut used = 0;
    for number in 1..=measured {
        let round = rounds.round(number);
        let plan = retina_calibration::geometry::MeasurementPlan::read(&round.folder, &material.setup)?;
        used += plan.exposures.len();
        if let Measurements::Points(table) = &material.tables {
            notes.extend(round.deviations(&plan, table)?);
        }
    }
    let mut history = history.to_vec();
    history.push(decision.judgements.iter().map(|j| j.probability).collect());
    Ok(Outcome {
        exposures: exposure_names(material),
        rivals,
        common,
        decision,
        needed,
        used,
        budget: question.budget,
        history,
        next: None,
        waiting: None,
        inseparable: false,
        beside,
        notes,
    })
}

/// Names of the data's exposures: with their file where there are several, since each round has a 000.png.
fn exposure_names(material: &TableMaterial) -> Vec<String> {
    let groups = material.data.groups.iter();
    let Measurements::Points(table) = &material.tables else {
        return groups.map(|group| group.name.clone()).collect();
    };
    groups
        .map(|group| {
            let row = table.rows.get(material.data.order[group.rows.start]);
            let file = row.and_then(|row| table.files.get(row.file)).filter(|_| table.files.len() > 1);
            file.map_or_else(|| group.name.clone(), |file| format!("{}: {}", file.path.display(), group.name))
        })
        .collect()
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
