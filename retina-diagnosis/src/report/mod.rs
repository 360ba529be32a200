//! Comparisons, diagnoses and fits as pages: plots first, then figures.

mod card;
mod shape;
mod signature;

use retina_formats::TableKind;
use retina_plot::{Anchor, Axis, PALETTE, Panel, Style};
use retina_report::{Page, Section};

pub use shape::{Shape, followed_svg, unexplained_shapes};
pub use signature::{effects_page, signature_svgs};

use crate::added::AddedEffect;
use crate::compare::Comparison;
use crate::data::Dataset;
use crate::diagnose::Diagnosis;
use crate::figure::{View, svgs};
use crate::fit::Fit;
use crate::output::{compare_text, decimals, diagnose_text, fit_text, implausible_text};
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
    let view = View::of(data, added);
    let page = Page::new("compare", &title("Model and measurements", added))
        .section(card::compared(data, result, &view))
        .section(field_section("Over the field", &view, view.field_panels()))
        .section(columns_section("Against the columns", &view))
        .section(Section::new("What the errors depend on").table(&["columns", "p", "share"], &dependence))
        .section(
            Section::new("Worst groups")
                .table(&["group", &format!("rms ({})", data.kind.unit()), "rows"], &groups),
        )
        .section(Section::new("In full").lines(&compare_text(data, result)));
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
                    Some(sigma) => format!("{} = {}", p.name, with_sigma(p.value, sigma)),
                    None => format!("{} = {}", p.name, rounded(p.value)),
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
    let before = View::of(data, added);
    let after = explained(data, added, result);
    let mut page = Page::new("diagnose", &title(&format!("Diagnosis: {}", result.verdict.name()), added))
        .section(card::diagnosed(data, result, after.as_ref().unwrap_or(&before)))
        .section(Section::new("Errors before and after").figures(
            &before_and_after(data, &steps, result.noise.floor(), &before, after.as_ref()),
            ladder_caption(data),
        ))
        .section(field_section("Over the field, before anything is added", &before, {
            let mut panels = before.signed_over_field();
            panels.extend(before.coverage());
            panels.extend(before.uncertainty().filter(|_| after.is_none()));
            panels
        }))
        .section(columns_section("Against the columns, before anything is added", &before));
    if let Some(after) = &after {
        page = page
            .section(field_section("Over the field, with what was found", after, {
                after.signed_over_field().into_iter().chain(after.uncertainty()).collect()
            }))
            .section(columns_section("Against the columns, with what was found", after));
    }
    if !shapes.is_empty() {
        let svgs: Vec<&str> = shapes.iter().map(|shape| shape.svg.as_str()).collect();
        let mut section = Section::new("Not explained")
            .figures(&svgs, "Means of the errors that are left, with their standard deviations.")
            .text("To start an effect of one's own from (retina fit --effect FILE):");
        for shape in shapes {
            section = section.lines(&shape.formula.lines().collect::<Vec<_>>());
        }
        page = page.section(section);
    }
    let error = format!("left out ({})", data.kind.unit());
    page = page
        .section(Section::new("Candidates").table(&["effect", "p", &error, "parameters"], &candidates))
        .section(Section::new("In full").lines(&diagnose_text(data, result)));
    with_files(page, data)
}

/// What was fitted, and what it leaves.
pub fn fit_page(data: &Dataset, added: &[AddedEffect], result: &Fit) -> Page {
    fit_page_under(data, added, result, &title("Fit", added), None)
}

/// The same under a title, and a card, of one's own.
pub fn fit_page_under(
    data: &Dataset,
    added: &[AddedEffect],
    result: &Fit,
    title: &str,
    card: Option<Section>,
) -> Page {
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
    let (before, after) = (View::of(data, &[]), View::of(data, added));
    let page = Page::new("fit", title)
        .section(card.unwrap_or_else(|| card::fitted(data, added, result, &after)))
        .section(Section::new("Errors before and after").figures(
            &before_and_after(data, &steps, result.noise.floor(), &before, Some(&after)),
            ladder_caption(data),
        ))
        .section(field_section("Over the field, with the effects", &after, {
            let maps = [after.coverage(), after.uncertainty()].into_iter().flatten();
            after.signed_over_field().into_iter().chain(maps).collect()
        }))
        .section(columns_section("Against the columns, with the effects", &after))
        .section(columns_section("Against the columns, the baseline alone", &before))
        .section(Section::new("Parameters").table(&["parameter", "value", "sigma"], &parameters))
        .section(Section::new("Correlation").table(&headings, &correlation))
        .section(Section::new("In full").lines(&fit_text(data, result)));
    with_files(page, data)
}

fn title(what: &str, added: &[AddedEffect]) -> String {
    match added {
        [] => what.to_owned(),
        _ => format!("{what}, with {}", added.iter().map(AddedEffect::name).collect::<Vec<_>>().join(", ")),
    }
}

/// The model with the effects that were accepted. None where there are none, and none of frames: those effects are part
/// of the prediction already.
fn explained(data: &Dataset, added: &[AddedEffect], result: &Diagnosis) -> Option<View> {
    if result.accepted.is_empty() || data.kind == TableKind::Frames {
        return None;
    }
    let mut all = added.to_vec();
    for id in &result.accepted {
        all.push(AddedEffect::read(id, data).ok()?);
    }
    Some(View::of(data, &all))
}

/// What stands beneath the ladder, and the arrows of tables that have a field.
fn ladder_caption(data: &Dataset) -> &'static str {
    match data.kind {
        TableKind::Points => {
            "Errors of groups left out: per component, weighted by the last model's noise, as effects are added. The dashed line is the noise, told apart from the model. Arrows are mean errors of cells, all on the key's scale."
        }
        _ => {
            "Errors of groups left out: weighted by the last model's noise, as effects are added. The dashed line is the noise, told apart from the model."
        }
    }
}

/// The ladder of held-out errors, and for points the errors over the field on one scale.
fn before_and_after(
    data: &Dataset,
    steps: &[(String, f64)],
    noise_floor: f64,
    before: &View,
    after: Option<&View>,
) -> Vec<String> {
    let mut panels = vec![ladder(steps, noise_floor, data.kind.unit())];
    let reference = before.arrow_reference();
    panels.extend(before.arrows_over_field("mean errors of cells, before", reference));
    panels.extend(after.and_then(|after| after.arrows_over_field("mean errors of cells, after", reference)));
    svgs(&panels)
}

/// Panels over the field, with what they show; of tables without a field nothing.
fn field_section(heading: &str, view: &View, panels: Vec<Panel>) -> Section {
    if panels.is_empty() {
        return Section::new("");
    }
    let elsewhere = view.uncertain_elsewhere();
    let left_out = if elsewhere > 0.01 {
        format!(
            " {:.0} % of the uncertainty's square changes with other columns than the place; the map holds the rest.",
            100.0 * elsewhere
        )
    } else {
        String::new()
    };
    Section::new(heading).figures(
        &svgs(&panels),
        &format!(
            "x and y are the displayed line of sight, 1 at half the camera's width. Orange is an error towards larger x or y, purple towards smaller, white none. Hatched cells have no point. The uncertainty is that of the model's line of sight from the covariance of all that was fitted, shift and scale included, and of a calibration that is held; it does not hold the noise of a single point. Where there is no point it is continued.{left_out}"
        ),
    )
}

fn columns_section(heading: &str, view: &View) -> Section {
    Section::new(heading).figures(
        &svgs(&view.over_columns()),
        "Faint dots are rows, strong ones means of bins with one standard deviation: that of the rows' noise and of what a group shares. Outliers are left out, and the largest hundredth of the errors lies beyond the range.",
    )
}

/// Held-out error from step to step, and the noise floor.
fn ladder(steps: &[(String, f64)], noise_floor: f64, unit: &str) -> Panel {
    /// Half the height of a bar.
    const HALF: f64 = 0.32;
    let highest = steps.iter().map(|step| step.1).fold(noise_floor, f64::max);
    let names = steps
        .iter()
        .enumerate()
        .map(|(k, (name, _))| if k == 0 { name.clone() } else { format!("+ {name}") });
    let mut panel = Panel::new(
        Axis::linear(format!("error of groups left out ({unit})")).range(0.0, 1.22 * highest),
        Axis::named(names.collect()).reversed(),
    )
    .title("what each effect takes off");
    for (k, (_, error)) in steps.iter().enumerate() {
        let (low, high) = (k as f64 - HALF, k as f64 + HALF);
        let bar = [[0.0, low], [*error, low], [*error, high], [0.0, high]];
        panel.polygon(&bar, Style::line(PALETTE[0]).width(0.0).filled(0.75));
        panel.text([*error, k as f64], [5.0, 4.0], rounded(*error), 10.0, Anchor::Start);
    }
    let floor = [[noise_floor, -0.5], [noise_floor, steps.len() as f64 - 0.5]];
    panel.line("noise", &floor, Style::line(PALETTE[1]).dashed());
    panel
}

/// A value and its standard deviation, with the digits that the latter leaves; far from 1 with a power of ten.
fn with_sigma(value: f64, sigma: f64) -> String {
    let exponent = value.abs().max(sigma).log10().floor();
    if exponent.is_finite() && !(-4.0..6.0).contains(&exponent) {
        let factor = 10f64.powf(exponent);
        let digits = decimals(sigma / factor);
        return format!("({:.digits$} \u{b1} {:.digits$})e{exponent}", value / factor, sigma / factor);
    }
    let digits = decimals(sigma);
    format!("{value:.digits$} \u{b1} {sigma:.digits$}")
}

/// Three digits.
fn rounded(value: f64) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    let decimals = (2.0 - value.abs().log10().floor()).clamp(0.0, 12.0) as usize;
    format!("{value:.decimals$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_have_the_digits_that_their_sigma_leaves() {
        assert_eq!(with_sigma(63.6832, 0.5064), "63.68 \u{b1} 0.51");
        assert_eq!(with_sigma(-385.2, 25.1), "-385 \u{b1} 25");
        assert_eq!(with_sigma(1.473e-7, 1.9e-9), "(1.473 \u{b1} 0.019)e-7");
        assert_eq!(rounded(0.004_131), "0.00413");
        assert_eq!(rounded(4.196), "4.20");
        assert_eq!(rounded(0.0), "0");
    }
}
