//! The card on top of a page: what was found, how sure it is, what to do.

use retina_report::Section;

use super::{rounded, with_sigma};
use crate::added::{AddedEffect, SECOND_ORDERS};
use crate::compare::Comparison;
use crate::data::Dataset;
use crate::diagnose::Diagnosis;
use crate::figure::View;
use crate::fit::Fit;
use crate::headline::{headline, investigate_first};
use crate::output::{rms_name, warnings};
use crate::scatter::Noise;

/// A screen below this p-value is told.
const SEEN: f64 = 0.02;
/// Errors of so many times the noise are more than noise.
const BEYOND_NOISE: f64 = 1.1;
/// Most parameters on a card.
const MOST_PARAMETERS: usize = 6;

type Answers = Vec<(&'static str, String)>;

fn words(id: &str) -> String {
    id.replace('_', " ")
}

fn noise_answer(noise: &Noise, unit: &str) -> String {
    format!("{} {unit} (from {})", rounded(noise.floor()), noise.source.join(", "))
}

/// Coverage of the field and how sure the model's line of sight is; of tables without a field nothing.
fn field_answers(view: &View) -> Answers {
    let Some(figures) = view.field_figures() else { return Vec::new() };
    let [cells, empty] = figures.cells;
    let covered = match empty {
        0 => "points in every part".to_owned(),
        _ => format!("{empty} of {cells} cells have no point: errors there are not measured"),
    };
    let mut out = vec![("Field", covered)];
    let sure = match figures.sigma {
        Some([middle, worst]) => format!(
            "{} arcsec per axis in the middle of the field, {} where it is largest (one sigma, model alone)",
            rounded(middle),
            rounded(worst)
        ),
        None => "not known: the calibration states no covariance, or the points are too few".to_owned(),
    };
    out.push(("How sure", sure));
    out
}

fn warning_answers(data: &Dataset, outliers: usize) -> Answers {
    warnings(data, outliers).into_iter().map(|warning| ("Warning", warning)).collect()
}

/// How far a model is from a table.
pub(super) fn compared(data: &Dataset, result: &Comparison, view: &View) -> Section {
    let unit = data.kind.unit();
    let floor = result.noise.floor();
    let seen: Vec<String> = result
        .dependence
        .iter()
        .filter(|d| d.p_value <= SEEN && d.share >= 5e-4)
        .take(3)
        .map(|d| format!("{} ({:.1} % of the squares)", words(&d.covariates.join(" and ")), 100.0 * d.share))
        .collect();
    let beyond = result.rms > BEYOND_NOISE * floor || !seen.is_empty();
    let heading = format!(
        "Errors of {} {unit} {}; the noise is {}",
        rounded(result.rms),
        rms_name(data),
        rounded(floor)
    );
    let mut answers = warning_answers(data, result.outliers);
    answers.push((
        "Rows",
        format!("{}, {} saturated, {} outliers", result.rows, result.saturated, result.outliers),
    ));
    answers.push(("Noise", noise_answer(&result.noise, unit)));
    let depends =
        if seen.is_empty() { "no column, as far as these data tell".to_owned() } else { seen.join("; ") };
    answers.push(("Depends on", depends));
    answers.extend(field_answers(view));
    let todo = if beyond {
        "find the effect that the model lacks: retina diagnose with the same tables"
    } else {
        "nothing: the model describes these data to their noise"
    };
    answers.push(("What to do", todo.to_owned()));
    Section::new("").card(&heading, &answers)
}

/// What a model lacks.
pub(super) fn diagnosed(data: &Dataset, result: &Diagnosis, view: &View) -> Section {
    let unit = data.kind.unit();
    let mut answers = warning_answers(data, result.outliers);
    answers.push(("Verdict", result.verdict.name().to_owned()));
    answers.extend(investigate_first(result).map(|todo| ("What to do", todo.to_owned())));
    for (own, physical) in result.accepted.iter().zip(&result.physical) {
        let p_value = result.candidates.iter().find(|c| c.effect == *own).map_or(1.0, |c| c.p_value);
        let sure = format!("{}: p = {p_value:.4}", words(own));
        match physical {
            Some(physical) => {
                let quantity = with_sigma(physical.value, physical.sigma);
                let name = words(physical.parameter);
                answers.push(("Found", format!("{sure}, {name} {quantity} {}", physical.unit)));
                answers.push(("What to do", physical.remedy.replace("+-", "\u{b1}")));
            }
            None => answers.push(("Found", sure)),
        }
    }
    if let [first, .., last] = result.steps.as_slice() {
        let (before, after) = (rounded(first.heldout_rms), rounded(last.heldout_rms));
        answers.push(("Error left out", format!("{before} {unit} before, {after} {unit} after")));
    }
    answers.push(("Noise", noise_answer(&result.noise, unit)));
    answers.extend(field_answers(view));
    if let Some(next) = &result.next {
        answers.push(("Measure next", format!("{} ({})", words(next.action), next.value)));
    }
    Section::new("").card(&headline(data, result), &answers)
}

/// What was fitted.
pub(super) fn fitted(data: &Dataset, added: &[AddedEffect], result: &Fit, view: &View) -> Section {
    let unit = data.kind.unit();
    let (first, last) = (result.steps.first(), result.heldout_rms);
    let before = first.map_or(last, |step| step.heldout_rms);
    let names: Vec<String> = added.iter().map(|effect| words(effect.name())).collect();
    let heading = if names.is_empty() {
        format!("The baseline leaves {} {unit} on groups left out", rounded(last))
    } else {
        let change = match (names.len(), last < before) {
            (1, true) => "lowers",
            (1, false) => "does not lower",
            (_, true) => "lower",
            (_, false) => "do not lower",
        };
        let (before, last) = (rounded(before), rounded(last));
        format!(
            "{} {change} the error of groups left out: {before} {unit} before, {last} after",
            names.join(" and ")
        )
    };
    let mut answers = warning_answers(data, result.outliers);
    let own = |name: &str| added.iter().any(|effect| name.starts_with(&format!("{}.", effect.name())));
    for parameter in result
        .parameters
        .iter()
        .filter(|p| own(&p.name) && !p.name.contains(SECOND_ORDERS))
        .take(MOST_PARAMETERS)
    {
        let Some(sigma) = parameter.sigma else { continue };
        answers.push(("Fitted", format!("{} = {}", parameter.name, with_sigma(parameter.value, sigma))));
    }
    answers.push(("Noise", noise_answer(&result.noise, unit)));
    answers.extend(field_answers(view));
    let todo = if last > BEYOND_NOISE * result.noise.floor() {
        "look for what is left beyond the noise: retina diagnose with the same tables and effects"
    } else {
        "nothing: groups left out are described to the noise"
    };
    answers.push(("What to do", todo.to_owned()));
    Section::new("").card(&heading, &answers)
}
