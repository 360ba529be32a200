//! Formulas that a user keeps from earlier tables: tried where no effect of the catalogue explains what is left.

use std::path::{Path, PathBuf};

use retina_files::InputError;

use crate::added::AddedEffect;
use crate::data::Dataset;
use crate::diagnose::{DiagnoseOptions, Diagnosis, diagnose};
use crate::own::evaluate;
use crate::parts::Halves;
use crate::verdict::Verdict;

/// A kept formula that holds in a table.
#[derive(Debug, Clone, PartialEq)]
pub struct KeptEffect {
    /// Its name.
    pub name: String,
    /// Its file.
    pub file: PathBuf,
    /// Chance of at least as much agreement in the half that did not fit it, corrected for the number of formulas.
    pub p_value: f64,
}

/// A kept formula: its file, and what it says.
pub type KeptFormula = (PathBuf, AddedEffect);

/// Level at which a kept formula is taken.
const LEVEL: f64 = 0.01;
/// Relative fall of the held-out error for which a kept formula takes the place of known effects.
const LEAST_GAIN: f64 = 0.02;
/// Most kept formulas that join a model.
const MOST: usize = 4;

/// The formulas of a folder that can be read for these data: each file that ends in `.toml`, in the order of their names.
/// Those of other tables, and those that read columns which are not there, are left out, with a note for each.
///
/// # Errors
/// The folder cannot be read, or holds no formula.
pub fn kept_effects(folder: &Path, data: &Dataset) -> Result<(Vec<KeptFormula>, Vec<String>), InputError> {
    let entries = std::fs::read_dir(folder).map_err(|error| {
        InputError::new("--catalogue", format!("the folder cannot be read: {error}"))
            .found(folder.display().to_string())
            .help("`retina investigate --out DIR` writes formulas into one")
    })?;
    let mut files: Vec<PathBuf> = entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.extension().is_some_and(|extension| extension == "toml"))
        .collect();
    files.sort();
    if files.is_empty() {
        return Err(InputError::new("--catalogue", "the folder holds no formulas")
            .found(folder.display().to_string())
            .expected("files that end in .toml, as `retina investigate --out DIR` writes them"));
    }
    let (mut out, mut notes) = (Vec::new(), Vec::new());
    for file in files {
        let effect = AddedEffect::read(&file.display().to_string(), data);
        match effect.and_then(|effect| {
            crate::added::check_effects(data, std::slice::from_ref(&effect))?;
            Ok(effect)
        }) {
            Ok(effect) => out.push((file, effect)),
            Err(error) => notes.push(format!("{} was not tried: {error}", file.display())),
        }
    }
    Ok((out, notes))
}

/// Diagnoses a table. Where known effects name all, the best kept formula is tried in their place. Where it ends in `unknown`,
/// kept formulas are tried beside the accepted effects: each is fitted to
/// half of the groups, and the other half judges it. Those that hold join the model, and the diagnosis is made anew.
/// Returns the model with them.
pub fn diagnose_with_kept(
    data: &Dataset,
    added: &[AddedEffect],
    kept: &[KeptFormula],
    options: &DiagnoseOptions,
) -> (Diagnosis, Vec<AddedEffect>) {
    let mut model = added.to_vec();
    let mut taken: Vec<KeptEffect> = Vec::new();
    let mut found = diagnose(data, &model, options);
    while found.verdict == Verdict::Unknown && taken.len() < MOST {
        let Some((k, p_value)) = best(data, &model, &found.accepted, kept, &taken, options) else { break };
        let (file, effect) = &kept[k];
        taken.push(KeptEffect { name: effect.name().to_owned(), file: file.clone(), p_value });
        model.push(effect.clone());
        found = diagnose(data, &model, options);
    }
    if found.verdict == Verdict::Named && taken.is_empty() {
        // Effects of the catalogue may imitate a formula that is kept. Of the two models the one counts that predicts
        // exposures better which it has not seen.
        if let Some((k, p_value)) = best(data, &model, &[], kept, &taken, options) {
            let (file, effect) = &kept[k];
            let mut with = model.clone();
            with.push(effect.clone());
            let other = diagnose(data, &with, options);
            if held_out(&other) < (1.0 - LEAST_GAIN) * held_out(&found) {
                taken.push(KeptEffect { name: effect.name().to_owned(), file: file.clone(), p_value });
                (model, found) = (with, other);
            }
        }
    }
    if found.verdict == Verdict::Adequate && !taken.is_empty() {
        found.verdict = Verdict::Named;
    }
    if taken.len() < kept.len() {
        found.notes.push(match found.verdict {
            Verdict::Unknown => format!("{} kept formulas do not hold in this table", kept.len() - taken.len()),
            _ => format!(
                "{} kept formulas are not in the model: it predicts unseen groups as well without them. `retina fit --effect \
                 FILE` fits one all the same",
                kept.len() - taken.len()
            ),
        });
    }
    found.kept = taken;
    (found, model)
}

/// The held-out error of what was found. Without weights: those of two models differ.
fn held_out(found: &Diagnosis) -> f64 {
    found.steps.last().map_or(f64::INFINITY, |step| step.heldout_rms_unweighted)
}

/// The kept formula that holds best beside what was found, with its p-value.
fn best(
    data: &Dataset,
    model: &[AddedEffect],
    accepted: &[&'static str],
    kept: &[KeptFormula],
    taken: &[KeptEffect],
    options: &DiagnoseOptions,
) -> Option<(usize, f64)> {
    let mut beside = model.to_vec();
    beside.extend(accepted.iter().filter_map(|id| AddedEffect::read(id, data).ok()));
    let halves = Halves::new(data, &beside).ok()?;
    let named = |effect: &AddedEffect| model.iter().any(|other| other.name() == effect.name());
    let open: Vec<usize> = (0..kept.len())
        .filter(|&k| !named(&kept[k].1) && !taken.iter().any(|taken| taken.file == kept[k].0))
        .collect();
    open.iter()
        .filter_map(|&k| {
            let AddedEffect::Own(user) = &kept[k].1 else { return None };
            let start: Vec<f64> = user.parameters().iter().map(|parameter| parameter.start).collect();
            let (_, slopes) = evaluate(user.as_ref(), data, &start);
            let proof = halves.prove_columns(&slopes, options.seed);
            Some((k, (proof.p_value * open.len() as f64).min(1.0)))
        })
        .filter(|(_, p_value)| *p_value <= LEVEL)
        .min_by(|a, b| a.1.total_cmp(&b.1))
}
