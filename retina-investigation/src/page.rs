//! The result as a page.

use retina_diagnosis::{AddedEffect, Dataset, fit_page_under, followed_svg};
use retina_report::{Page, Section};

use crate::outcome::{Investigation, Term};
use crate::output::{
    NOTHING, formula_lines, headline, investigation_text, known_text, next_measurement, proof_text,
    stood_for, weak_beside_text, weak_text,
};
use crate::words::short;

/// A page that opens offline: each formula in words and drawn on the data, then the fit.
pub fn investigation_page(data: &Dataset, result: &Investigation) -> Page {
    let model = result.model.as_slice();
    let known = model.len() - result.terms.len();
    let title = match result.terms.is_empty() {
        true => "Investigation: no formula".to_owned(),
        false => format!("Investigation: a formula of {}", result.terms[0].covariates.join(", ")),
    };
    let mut page = fit_page_under(data, model, &result.fit, &title, Some(card(data, result)))
        .section(Section::new("The investigation in full").lines(&investigation_text(data, result)));
    // Sections come after the card in the order of the text.
    for (number, term) in result.terms.iter().enumerate().rev() {
        page = page.after_card(term_section(data, &model[..known + number], term));
    }
    let mut told = vec![format!("{} forms were tried.", result.tried)];
    for formula in result.known.iter().filter_map(|known| known.formula.as_ref()) {
        told.push(format!("{} {}", stood_for(formula), formula_lines(&formula.effect).join("; ")));
    }
    if !result.known.is_empty() {
        told.push(format!("Known effects that belong to the model: {}.", known_text(result)));
    }
    told.extend(result.known_weak.iter().map(weak_text));
    if let Some(unproven) = &result.unproven {
        told.push(format!(
            "Looked for and {}, the best form of {}: {}.",
            if unproven.holds_but_is_weak() { "left out as too weak" } else { "not confirmed" },
            unproven.covariates.join(", "),
            proof_text(&unproven.proof)
        ));
    }
    page.after_card(Section::new("How it was looked for").list(&told))
}

/// What was found, how sure it is, what to do.
fn card(data: &Dataset, result: &Investigation) -> Section {
    let unit = data.kind.unit();
    let mut answers: Vec<(&str, String)> = Vec::new();
    for term in &result.terms {
        let weak = if term.weak_beside.is_some() { ", weak" } else { "" };
        answers.push((
            "Found",
            format!("{}: of {}{weak}, {} {unit} rms", term.name, term.covariates.join(", "), short(term.rms)),
        ));
        answers.push(("How sure", format!("on the other half of the groups {}", proof_text(&term.proof))));
        if !term.rivals.is_empty() {
            let names: Vec<String> = (0..term.rivals.len()).map(|k| term.rival_name(k)).collect();
            answers.push(("Not told apart from", names.join(", ")));
        }
    }
    if !result.known.is_empty() {
        answers.push(("Known effects", known_text(result)));
    }
    if let [first, .., last] = result.fit.steps.as_slice() {
        let (before, after) = (short(first.heldout_rms), short(last.heldout_rms));
        answers.push(("Error left out", format!("{before} {unit} before, {after} {unit} after")));
    }
    answers.push(("Noise", format!("{} {unit}", short(result.noise.floor()))));
    answers.extend(todo(result).map(|todo| ("What to do", todo)));
    Section::new("").card(&headline(result), &answers)
}

fn todo(result: &Investigation) -> Option<String> {
    if let Some(next) = next_measurement(result) {
        return Some(format!(
            "measure at {}, where {} differ by {} of the noise; retina decide designs such exposures",
            next.place,
            next.separates.join(" and "),
            short(next.sigma)
        ));
    }
    match result.terms.first() {
        Some(term) => term.words.origins.first().map(|origin| origin.check.clone()),
        None => result.known.is_empty().then(|| NOTHING.to_owned()),
    }
}

fn term_section(data: &Dataset, before: &[AddedEffect], term: &Term) -> Section {
    let over =
        std::iter::once(None).chain(term.reads.iter().map(|name| Some((name.as_str(), &term.along[..]))));
    let figures: Vec<String> =
        over.filter_map(|over| followed_svg(data, before, &term.field, over)).collect();
    let mut says = term.words.says.clone();
    if !term.words.independent_of.is_empty() {
        says.push(format!("It does not need {}.", term.words.independent_of.join(", ")));
    }
    if let Some(stronger) = &term.weak_beside {
        says.push(weak_beside_text(stronger));
    }
    says.push(format!("On the other half of the groups: {}.", proof_text(&term.proof)));
    let mut section = Section::new(&format!("{} depends on {}", term.name, term.covariates.join(", ")))
        .lines(&formula_lines(&term.effect))
        .list(&says)
        .figures(
            &figures,
            "Means of the errors along the formula's vectors, with their standard deviations, and the formula: over its size, and over what it is a function of. What the rest of the model can be is taken out of both.",
        );
    let origins: Vec<Vec<String>> = term
        .words
        .origins
        .iter()
        .map(|origin| vec![origin.mechanism.clone(), origin.check.clone(), origin.instrument.clone()])
        .collect();
    if !origins.is_empty() {
        section = section.table(&["It may be", "How to check", "What would show it"], &origins);
    }
    let rivals: Vec<Vec<String>> = term
        .rivals
        .iter()
        .enumerate()
        .map(|(k, rival)| {
            let at = rival.differs_at.iter().map(|(name, value)| format!("{name} = {}", short(*value)));
            vec![
                term.rival_name(k),
                formula_lines(&rival.effect).join("; "),
                format!("{} {}", short(rival.difference_rms), data.kind.unit()),
                at.collect::<Vec<_>>().join(", "),
                format!("{} {}", short(rival.differs_by), data.kind.unit()),
            ]
        })
        .collect();
    if !rivals.is_empty() {
        section = section.table(
            &["Name", "These data cannot tell it from", "Difference, rms", "Largest at", "There"],
            &rivals,
        );
    }
    section
        .text("As a user's effect (retina fit --effect FILE):")
        .lines(&term.effect.lines().collect::<Vec<_>>())
}
