//! The result as a page.

use retina_diagnosis::{AddedEffect, Dataset, fit_page, followed_svg};
use retina_report::{Page, Section};

use crate::outcome::{Investigation, Term};
use crate::output::{formula_lines, headline, investigation_text, known_text, proof_text, weak_text};
use crate::words::short;

/// A page that opens offline: each formula in words and drawn on the data, then the fit.
pub fn investigation_page(data: &Dataset, result: &Investigation) -> Page {
    let model = result.model.as_slice();
    let known = model.len() - result.terms.len();
    let mut page = fit_page(data, model, &result.fit)
        .section(Section::new("The investigation in full").lines(&investigation_text(data, result)));
    // Sections come after the card in the order of the text.
    for (number, term) in result.terms.iter().enumerate().rev() {
        page = page.after_card(term_section(data, &model[..known + number], term));
    }
    let mut told = vec![format!("{} forms were tried.", result.tried)];
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
    page.after_card(Section::new(&headline(result)).list(&told))
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
        says.push(format!("It is weak beside {stronger}: it may be only what that lacks."));
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
        .map(|rival| {
            let at = rival.differs_at.iter().map(|(name, value)| format!("{name} = {}", short(*value)));
            vec![
                formula_lines(&rival.effect).join("; "),
                format!("{} {}", short(rival.difference_rms), data.kind.unit()),
                at.collect::<Vec<_>>().join(", "),
            ]
        })
        .collect();
    if !rivals.is_empty() {
        section =
            section.table(&["These data cannot tell it from", "Difference, rms", "Largest at"], &rivals);
    }
    section
        .text("As a user's effect (retina fit --effect FILE):")
        .lines(&term.effect.lines().collect::<Vec<_>>())
}
