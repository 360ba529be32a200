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
    }
    for term in &result.terms {
        out.push(format!("{}: depends on {}", term.name, term.covariates.join(", ")));
        out.extend(formula_lines(&term.effect).into_iter().map(|line| format!("    {line}")));
        out.push(format!("  proof on the other half of the groups: {}", proof_text(&term.proof)));
        out.extend(term.words.says.iter().map(|sentence| format!("  {sentence}")));
        if let Some(stronger) = &term.weak_beside {
            out.push(format!(
                "  It is weak beside {stronger}: it may be only what the laws of that formula lack, and its columns are not sure."
            ));
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
        for rival in &term.rivals {
            out.extend(rival_text(rival, unit));
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
    out.push(format!("{} forms were tried", result.tried));
    out.push(String::new());
    out.extend(fit_text(data, &result.fit));
    out.extend(result.notes.iter().map(|note| format!("note: {note}")));
    out
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

fn rival_text(rival: &Rival, unit: &str) -> Vec<String> {
    let at: Vec<String> =
        rival.differs_at.iter().map(|(name, value)| format!("{name} = {}", short(*value))).collect();
    let mut out = vec![format!(
        "  not told apart from a formula of {}: they differ by {} {unit} rms, most at {} ({} {unit})",
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

/// Writes all formulas into a folder: files that `--effect` takes.
///
/// # Errors
/// The folder cannot be made, or a file not be written.
pub fn write_formulas(folder: &Path, result: &Investigation) -> Result<(), InputError> {
    let failed =
        |path: &Path, error: std::io::Error| InputError::new(path, format!("cannot be written: {error}"));
    std::fs::create_dir_all(folder).map_err(|error| failed(folder, error))?;
    for formula in result.formulas() {
        let path = file_of(folder, &formula.name);
        retina_files::write_atomic(&path, formula.effect.as_bytes()).map_err(|error| failed(&path, error))?;
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

/// Where the first formula and its nearest rival differ most.
fn next_json(result: &Investigation) -> Value {
    let rivals = |term: &&Term| !term.rivals.is_empty();
    let Some(term) = result.terms.iter().find(rivals) else { return Value::Null };
    let rival = &term.rivals[0];
    let place: Vec<String> =
        rival.differs_at.iter().map(|(name, value)| format!("{name} = {}", short(*value))).collect();
    json!({
        "action": "measure_at",
        "value": place.join(", "),
        "separates": term.formulas().into_iter().take(2).map(|formula| formula.name).collect::<Vec<_>>(),
        "expected_sigma": rival.differs_by / result.noise.white.hypot(result.noise.group),
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
