//! Results as text and JSON.

use std::path::{Path, PathBuf};

use retina_diagnosis::{Dataset, Proof, fit_json, fit_text};
use retina_files::InputError;
use serde_json::{Value, json};

use crate::outcome::{Formula, Investigation, KnownEffect, Rival, Term, WeakEffect};
use crate::words::short;

/// What was found, in a word: `found` or `nothing`.
pub(crate) fn verdict(result: &Investigation) -> &'static str {
    if result.terms.is_empty() { "nothing" } else { "found" }
}

/// What was found, in a sentence.
pub(crate) fn headline(result: &Investigation) -> String {
    let Some(first) = result.terms.first() else {
        return match &result.unproven {
            Some(form) if form.holds_but_is_weak() => format!(
                "A formula of {} holds on data that the search has not seen, but it is too weak to be worth a place in the model: {} of the noise.",
                form.covariates.join(", "),
                short(form.proof.strength)
            ),
            _ => "No formula for what is left holds on data that the search has not seen.".to_owned(),
        };
    };
    let more = match result.terms.len() {
        1 => String::new(),
        count => format!(", and {} more", count - 1),
    };
    format!(
        "A formula of {} holds on data that the search has not seen (p = {}){more}.",
        first.covariates.join(", "),
        short(first.proof.p_value)
    )
}

/// The formula lines of an effect's text.
pub(crate) fn formula_lines(effect: &str) -> Vec<&str> {
    effect
        .lines()
        .filter(|line| ["dx =", "dy =", "value ="].iter().any(|key| line.starts_with(key)))
        .collect()
}

pub(crate) fn proof_text(proof: &Proof) -> String {
    let amplitude = if proof.ratio_sigma.is_finite() {
        format!("amplitude there {} +- {} of the one found", short(proof.ratio), short(proof.ratio_sigma))
    } else {
        "no amplitude: the model has the form already, or one group alone does".to_owned()
    };
    format!("p = {}; {amplitude}; {} of the noise", short(proof.p_value), short(proof.strength))
}

/// For people.
pub fn investigation_text(data: &Dataset, result: &Investigation) -> Vec<String> {
    let unit = data.kind.unit();
    let mut out = vec![headline(result), String::new()];
    if !result.known.is_empty() {
        let beside = if result.terms.is_empty() { "" } else { " beside it" };
        out.push(format!("known effects that were found{beside}: {}", known_text(result)));
        for formula in result.known.iter().filter_map(|known| known.formula.as_ref()) {
            out.push(stood_for(formula));
            out.extend(formula_lines(&formula.effect).into_iter().map(|line| format!("    {line}")));
        }
    }
    if result.terms.is_empty() && result.known.is_empty() {
        out.push(NOTHING.to_owned());
    }
    for term in &result.terms {
        out.push(format!("{}: depends on {}", term.name, term.covariates.join(", ")));
        out.extend(formula_lines(&term.effect).into_iter().map(|line| format!("    {line}")));
        out.push(format!("  proof on the other half of the groups: {}", proof_text(&term.proof)));
        out.extend(term.words.says.iter().map(|sentence| format!("  {sentence}")));
        if let Some(stronger) = &term.weak_beside {
            out.push(format!("  {}", weak_beside_text(stronger)));
        }
        if !term.words.independent_of.is_empty() {
            out.push(format!("  It does not need {}.", term.words.independent_of.join(", ")));
        }
        for (name, share) in &term.alike {
            out.push(format!(
                "  The catalogue's {name} is nearly the same here: it holds {:.1} % of its square.",
                100.0 * share
            ));
        }
        for (k, rival) in term.rivals.iter().enumerate() {
            out.extend(rival_text(&term.rival_name(k), rival, unit));
        }
        for origin in &term.words.origins {
            out.push(format!("  may be: {}", origin.mechanism));
            out.push(format!("      check: {}", origin.check));
            out.push(format!("      shown by: {}", origin.instrument));
        }
    }
    out.extend(result.known_weak.iter().map(weak_text));
    if let Some(unproven) = &result.unproven {
        out.push(format!(
            "looked for {} and {}, the best form of {}: {}",
            if result.terms.is_empty() { "a formula" } else { "one more" },
            if unproven.holds_but_is_weak() { "left out as too weak" } else { "not confirmed" },
            unproven.covariates.join(", "),
            proof_text(&unproven.proof)
        ));
    }
    if let Some(next) = next_measurement(result) {
        out.push(format!(
            "next: measure at {}, where {} differ by {} of the noise",
            next.place,
            next.separates.join(" and "),
            short(next.sigma)
        ));
    }
    out.push(format!("{} forms were tried", result.tried));
    out.push(String::new());
    out.extend(fit_text(data, &result.fit));
    out.extend(result.notes.iter().map(|note| format!("note: {note}")));
    out
}

/// What to do where nothing was found.
pub(crate) const NOTHING: &str =
    "Known effects are the diagnosis's to find: ask `retina diagnose` about the same table.";

pub(crate) fn weak_beside_text(stronger: &str) -> String {
    format!(
        "It is weak beside {stronger}: it may be only what the laws of that lack, and its columns are not sure."
    )
}

/// A formula that a known effect is in the model for.
pub(crate) fn stood_for(formula: &Formula) -> String {
    format!(
        "{} was found as a formula of {}, which is nearly the same here:",
        formula.known.unwrap_or_default(),
        formula.columns.join(", ")
    )
}

/// Known effects with the columns that they depend on here.
pub(crate) fn known_text(result: &Investigation) -> String {
    let text = |known: &KnownEffect| match known.columns.is_empty() {
        true => known.effect.to_owned(),
        false => format!("{} ({})", known.effect, known.columns.join(", ")),
    };
    result.known.iter().map(text).collect::<Vec<_>>().join(", ")
}

pub(crate) fn weak_text(weak: &WeakEffect) -> String {
    format!(
        "{} holds on the other half, too ({} of the noise). It is weak beside {} and may be only what the laws of that formula lack: it is not in the model.",
        weak.effect,
        short(weak.strength),
        weak.beside
    )
}

fn rival_text(name: &str, rival: &Rival, unit: &str) -> Vec<String> {
    let at: Vec<String> =
        rival.differs_at.iter().map(|(name, value)| format!("{name} = {}", short(*value))).collect();
    let mut out = vec![format!(
        "  not told apart from {name}, a formula of {}: they differ by {} {unit} rms, most at {} ({} {unit})",
        rival.covariates.join(", "),
        short(rival.difference_rms),
        at.join(", "),
        short(rival.differs_by)
    )];
    out.extend(formula_lines(&rival.effect).into_iter().map(|line| format!("      {line}")));
    out
}

fn proof_json(proof: &Proof) -> Value {
    json!({
        "p_value": proof.p_value,
        "ratio": proof.ratio,
        "ratio_sigma": if proof.ratio_sigma.is_finite() { json!(proof.ratio_sigma) } else { Value::Null },
        "strength": proof.strength,
    })
}

fn term_json(term: &Term) -> Value {
    json!({
        "name": term.name,
        "weak_beside": term.weak_beside,
        "effect_toml": term.effect,
        "covariates": term.covariates,
        "proof": proof_json(&term.proof),
        "rms": term.rms,
        "rivals": term.rivals.iter().map(|rival| json!({
            "effect_toml": rival.effect,
            "covariates": rival.covariates,
            "difference_rms": rival.difference_rms,
            "differs_by": rival.differs_by,
            "differs_at": rival.differs_at.iter().cloned().collect::<std::collections::BTreeMap<String, f64>>(),
            "beaten_by": rival.beaten_by,
        })).collect::<Vec<_>>(),
        "alike": term.alike.iter().map(|(effect, share)| json!({ "effect": effect, "share": share })).collect::<Vec<_>>(),
        "says": term.words.says,
        "independent_of": term.words.independent_of,
        "origins": term.words.origins.iter().map(|origin| json!({
            "mechanism": origin.mechanism,
            "check": origin.check,
            "instrument": origin.instrument,
        })).collect::<Vec<_>>(),
    })
}

/// The file of an effect in the folder of [`write_formulas`].
fn file_of(folder: &Path, name: &str) -> PathBuf {
    folder.join(format!("{name}.toml"))
}

/// Writes all formulas into a folder: files that `--effect` takes. Formulas of an earlier run that this one does not have
/// stay there, since somebody may have changed them; a note of the result names them.
///
/// # Errors
/// The folder cannot be made, or a file not be written.
pub fn write_formulas(folder: &Path, result: &mut Investigation) -> Result<(), InputError> {
    let failed =
        |path: &Path, error: std::io::Error| InputError::new(path, format!("cannot be written: {error}"));
    std::fs::create_dir_all(folder).map_err(|error| failed(folder, error))?;
    for formula in result.formulas() {
        let path = file_of(folder, &formula.name);
        retina_files::write_atomic(&path, formula.effect.as_bytes()).map_err(|error| failed(&path, error))?;
    }
    let own: Vec<PathBuf> = result.formulas().iter().map(|formula| file_of(folder, &formula.name)).collect();
    let entries = std::fs::read_dir(folder).map_err(|error| failed(folder, error))?;
    let mut older: Vec<String> = entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.extension().is_some_and(|extension| extension == "toml") && !own.contains(path))
        .filter_map(|path| Some(path.file_name()?.to_str()?.to_owned()))
        .filter(|name| name.starts_with("found_") || name.starts_with("formula_of_"))
        .collect();
    if !older.is_empty() {
        older.sort_unstable();
        result.notes.push(format!(
            "{} has formulas of an earlier run, which are not of this one: {}",
            folder.display(),
            older.join(", ")
        ));
    }
    Ok(())
}

fn formula_json(formula: &Formula, folder: Option<&Path>) -> Value {
    let mut out = json!({
        "name": formula.name,
        "file": folder.map(|folder| file_of(folder, &formula.name).display().to_string()),
        "columns": formula.columns,
        "complexity": formula.complexity,
        "heldout_rms": formula.heldout_rms,
        "known": formula.known,
    });
    for line in formula_lines(&formula.effect) {
        if let Some((key, text)) = line.split_once(" = ") {
            out[key] = text.trim_matches('"').into();
        }
    }
    out
}

/// A measurement that separates two formulas.
pub(crate) struct Next {
    /// Columns and their values.
    pub(crate) place: String,
    /// Names of the formulas.
    pub(crate) separates: Vec<String>,
    /// Their difference there, in the noise of a row.
    pub(crate) sigma: f64,
}

/// Where the first formula that has a rival and its nearest one differ most.
pub(crate) fn next_measurement(result: &Investigation) -> Option<Next> {
    let term = result.terms.iter().find(|term| !term.rivals.is_empty())?;
    let rival = &term.rivals[0];
    let place: Vec<String> =
        rival.differs_at.iter().map(|(name, value)| format!("{name} = {}", short(*value))).collect();
    Some(Next {
        place: place.join(", "),
        separates: term.formulas().into_iter().take(2).map(|formula| formula.name).collect(),
        sigma: rival.differs_by / result.noise.white.hypot(result.noise.group),
    })
}

fn next_json(result: &Investigation) -> Value {
    next_measurement(result).map_or(Value::Null, |next| {
        json!({
            "action": "measure_at",
            "value": next.place,
            "separates": next.separates,
            "expected_sigma": next.sigma,
        })
    })
}

/// `investigate --json`, schema `retina.investigation/1`. `folder` is that of [`write_formulas`].
pub fn investigation_json(data: &Dataset, result: &Investigation, folder: Option<&Path>) -> Value {
    let fitted = fit_json(data, &result.fit);
    let proof = result.terms.first().map(|term| &term.proof);
    let proof = proof.or(result.unproven.as_ref().map(|unproven| &unproven.proof));
    let formulas: Vec<Value> =
        result.formulas().iter().map(|formula| formula_json(formula, folder)).collect();
    let known: Vec<&str> = result.known.iter().map(|known| known.effect).collect();
    json!({
        "schema": "retina.investigation/1",
        "table": data.kind.name(),
        "unit": data.kind.unit(),
        "verdict": verdict(result),
        "headline": headline(result),
        "found": !result.terms.is_empty(),
        "p_value": proof.map(|proof| proof.p_value),
        "formulas": formulas,
        "next_measurement": next_json(result),
        "known": known,
        "known_weak": result.known_weak.iter().map(|weak| json!({
            "effect": weak.effect,
            "strength": weak.strength,
            "beside": weak.beside,
        })).collect::<Vec<_>>(),
        "terms": result.terms.iter().map(term_json).collect::<Vec<_>>(),
        "unproven": result.unproven.as_ref().map(|unproven| json!({
            "effect_toml": unproven.effect,
            "covariates": unproven.covariates,
            "proof": proof_json(&unproven.proof),
        })),
        "tried": result.tried,
        "rows": fitted["rows"],
        "outliers": fitted["outliers"],
        "fit": fitted,
        "notes": result.notes,
    })
}
