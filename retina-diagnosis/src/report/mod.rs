//! Comparisons, diagnoses and fits as pages: plots first, then figures.

mod shape;
mod signature;

use retina_plot::{Anchor, Axis, Figure, PALETTE, Panel, Style};
use retina_report::{Page, Section};

pub use shape::{Shape, unexplained_shapes};
pub use signature::{effects_page, signature_svg};

use crate::added::AddedEffect;
use crate::compare::Comparison;
use crate::data::Dataset;
use crate::diagnose::Diagnosis;
use crate::figure::figure_svg;
use crate::fit::Fit;
use crate::headline::headline;
use crate::output::{compare_text, diagnose_text, fit_text, implausible_text};
use crate::step::Step;

/// Name of what a step adds, and its error.
fn step_error(step: &Step) -> (String, f64) {
    (step.effects.last().map_or_else(|| "baseline".to_owned(), Clone::clone), step.heldout_rms)
}

fn number(value: f64) -> String {
    format!("{value:.4}")
}

fn with_files(page: Page, data: &Dataset) -> Page {
    let hashes: Vec<(&std::path::Path, String)> = data
        .files
        .iter()
        .map(|path| (path.as_path(), retina_files::hash_file(path).unwrap_or_else(|_| "gone since".into())))
        .collect();
    page.section(Section::new("Tables").files(hashes.iter().map(|(path, hash)| (*path, hash.as_str()))))
}

/// How far the model is from the data.
pub fn compare_page(data: &Dataset, added: &[AddedEffect], result: &Comparison) -> Page {
    let groups: Vec<Vec<String>> = result
        .worst_groups
        .iter()
        .map(|group| vec![group.name.clone(), number(group.rms), group.rows.to_string()])
        .collect();
    let dependence: Vec<Vec<String>> = result
        .dependence
        .iter()
        .map(|d| vec![d.covariates.join(", "), number(d.p_value), format!("{:.2} %", 100.0 * d.share)])
        .collect();
    let page = Page::new("compare", &title("Model and measurements", added))
        .section(Section::new("").figure(
            &figure_svg(data, added),
            "What the model leaves: over the field, and against the columns. Outliers are not drawn.",
        ))
        .section(Section::new("Summary").lines(&compare_text(data, result)))
        .section(Section::new("What the errors depend on").table(&["columns", "p", "share"], &dependence))
        .section(
            Section::new("Worst groups")
                .table(&["group", &format!("rms ({})", data.kind.unit()), "rows"], &groups),
        );
    with_files(page, data)
}

/// What is missing, how the error falls with it, and what is left.
pub fn diagnose_page(data: &Dataset, added: &[AddedEffect], result: &Diagnosis, shapes: &[Shape]) -> Page {
    let steps: Vec<(String, f64)> = result.steps.iter().map(step_error).collect();
    let candidates: Vec<Vec<String>> = result
        .candidates
        .iter()
        .map(|candidate| {
            let parameters: Vec<String> = candidate
                .parameters
                .iter()
                .map(|p| match p.sigma {
                    Some(sigma) => format!("{} = {:.4} +- {:.4}", p.name, p.value, sigma),
                    None => format!("{} = {:.4}", p.name, p.value),
                })
                .collect();
            vec![
                candidate.effect.to_owned(),
                number(candidate.p_value),
                number(candidate.heldout_rms),
                format!("{}{}", parameters.join("; "), implausible_text(&candidate.implausible)),
            ]
        })
        .collect();
    let mut page = Page::new("diagnose", &title(&format!("Diagnosis: {}", result.verdict.name()), added))
        .section(Section::new("").card(&headline(data, result), &answers(data, result)))
        .section(Section::new("The error of groups left out").figure(
            &ladder_svg(&steps, result.noise.floor(), data.kind.unit()),
            "Per component, weighted by the last model's noise, as effects are added. The dashed line is the noise, told apart from the model.",
        ))
        .section(Section::new("Errors before anything is added").figure(&figure_svg(data, added), ""));
    for shape in shapes {
        page = page.section(
            Section::new(&format!("Not explained: {}", shape.covariate))
                .figure(&shape.svg, "Means of the errors that are left, with their standard deviations.")
                .text("To start an effect of one's own from (retina fit --effect FILE):")
                .lines(&shape.formula.lines().collect::<Vec<_>>()),
        );
    }
    let error = format!("left out ({})", data.kind.unit());
    page = page
        .section(Section::new("Candidates").table(&["effect", "p", &error, "parameters"], &candidates))
        .section(Section::new("In full").lines(&diagnose_text(data, result)));
    with_files(page, data)
}

/// What was found, how sure it is, and what to do.
fn answers(data: &Dataset, result: &Diagnosis) -> Vec<(&'static str, String)> {
    let unit = data.kind.unit();
    let mut out = vec![("Verdict", result.verdict.name().to_owned())];
    for (own, physical) in result.accepted.iter().zip(&result.physical) {
        let p_value = result.candidates.iter().find(|c| c.effect == *own).map_or(1.0, |c| c.p_value);
        let sure = format!("{}: p = {p_value:.4}", own.replace('_', " "));
        match physical {
            Some(physical) => {
                let name = physical.parameter.replace('_', " ");
                let quantity =
                    format!("{name} {:.4} +- {:.4} {}", physical.value, physical.sigma, physical.unit);
                out.push(("Found", format!("{sure}, {quantity}")));
                out.push(("What to do", physical.remedy.clone()));
            }
            None => out.push(("Found", sure)),
        }
    }
    if let [first, .., last] = result.steps.as_slice() {
        let (before, after) = (first.heldout_rms, last.heldout_rms);
        out.push(("Error left out", format!("{before:.4} {unit} before, {after:.4} {unit} after")));
    }
    out.push((
        "Noise",
        format!("{:.4} {unit} (from {})", result.noise.floor(), result.noise.source.join(", ")),
    ));
    if let Some(next) = &result.next {
        out.push(("Measure next", format!("{} ({})", next.action.replace('_', " "), next.value)));
    }
    out
}

/// What was fitted, and what it leaves.
pub fn fit_page(data: &Dataset, added: &[AddedEffect], result: &Fit) -> Page {
    let steps: Vec<(String, f64)> = result.steps.iter().map(step_error).collect();
    let parameters: Vec<Vec<String>> = result
        .parameters
        .iter()
        .map(|p| {
            vec![
                p.name.clone(),
                format!("{:.6}", p.value),
                p.sigma.map_or_else(|| "chosen".into(), |sigma| format!("{sigma:.6}")),
            ]
        })
        .collect();
    let names: Vec<&str> =
        result.parameters.iter().take(result.correlation.len()).map(|p| p.name.as_str()).collect();
    let mut headings = vec![""];
    headings.extend(&names);
    let correlation: Vec<Vec<String>> = result
        .correlation
        .iter()
        .zip(&names)
        .map(|(row, name)| {
            let mut cells = vec![(*name).to_owned()];
            cells.extend(row.iter().map(|value| format!("{value:+.2}")));
            cells
        })
        .collect();
    let page = Page::new("fit", &title("Fit", added))
        .section(Section::new("The error of groups left out").figure(
            &ladder_svg(&steps, result.noise.floor(), data.kind.unit()),
            "Per component, weighted by the last model's noise, as effects are added. The dashed line is the noise, told apart from the model.",
        ))
        .section(Section::new("Before").figure(&figure_svg(data, &[]), "What the baseline alone leaves."))
        .section(Section::new("After").figure(&figure_svg(data, added), "What is left with the effects."))
        .section(Section::new("Parameters").table(&["parameter", "value", "sigma"], &parameters))
        .section(Section::new("Correlation").table(&headings, &correlation))
        .section(Section::new("Summary").lines(&fit_text(data, result)));
    with_files(page, data)
}

fn title(what: &str, added: &[AddedEffect]) -> String {
    match added {
        [] => what.to_owned(),
        _ => format!("{what}, with {}", added.iter().map(AddedEffect::name).collect::<Vec<_>>().join(", ")),
    }
}

/// Held-out error from step to step, and the noise floor.
fn ladder_svg(steps: &[(String, f64)], noise_floor: f64, unit: &str) -> String {
    let highest = steps.iter().map(|step| step.1).fold(noise_floor, f64::max);
    let last = steps.len() as f64 - 1.0;
    let mut panel = Panel::new(
        Axis::linear("effects added").range(-0.3, last.max(1.0) + 0.7),
        Axis::linear(format!("error ({unit})")).range(0.0, 1.15 * highest),
    );
    let points: Vec<[f64; 2]> = steps.iter().enumerate().map(|(i, step)| [i as f64, step.1]).collect();
    panel.line("left out", &points, Style::line(PALETTE[0]));
    panel.dots("", &points, Style::line(PALETTE[0]).width(3.0));
    let floor = [[-0.3, noise_floor], [last.max(1.0) + 0.7, noise_floor]];
    panel.line("noise floor", &floor, Style::line(PALETTE[1]).dashed());
    for (point, (name, _)) in points.iter().zip(steps) {
        panel.text(*point, [6.0, -6.0], name, 10.0, Anchor::Start);
    }
    let mut figure = Figure::new("", 1, 1, [640.0, 320.0]);
    figure.put(0, 0, panel);
    figure.to_svg()
}
