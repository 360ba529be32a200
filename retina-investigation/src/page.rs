//! The result as a page.

use retina_diagnosis::{AddedEffect, Dataset, fit_page, followed_svg};
use retina_report::{Page, Section};

use crate::outcome::{Investigation, Term};
use crate::output::{headline, investigation_text};

/// A page that opens offline: each formula drawn on the data, then the fit.
pub fn investigation_page(data: &Dataset, result: &Investigation) -> Page {
    let model = result.model.as_slice();
    let known = model.len() - result.terms.len();
    let mut page = fit_page(data, model, &result.fit);
    // Sections come after the card in the order of the text.
    for (number, term) in result.terms.iter().enumerate().rev() {
        page = page.after_card(term_section(data, &model[..known + number], term));
    }
    page.after_card(Section::new(&headline(result)).lines(&investigation_text(data, result)))
}

fn term_section(data: &Dataset, before: &[AddedEffect], term: &Term) -> Section {
    let over = std::iter::once(None).chain(term.covariates.iter().map(|name| Some(name.as_str())));
    let figures: Vec<String> =
        over.filter_map(|column| followed_svg(data, before, &term.field, column)).collect();
    Section::new(&format!("Formula {} on the data", term.name))
        .figures(
            &figures,
            "Means of the errors along the formula's vectors, with their standard deviations, and the formula. What the rest of the model can be is taken out of both.",
        )
        .text("As a user's effect (retina fit --effect FILE):")
        .lines(&term.effect.lines().collect::<Vec<_>>())
}
