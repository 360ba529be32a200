//! Results as text and tables.

use std::fmt::Write as _;
use std::path::Path;

use retina_files::{InputError, write_atomic};
use retina_formats::TableKind;

use crate::added::SECOND_ORDERS;
use crate::catalogue::Effect;
use crate::compare::{Comparison, Dependence, PERCENTILES};
use crate::data::Dataset;
use crate::decode::Decoded;
use crate::diagnose::Diagnosis;
use crate::estimate::{Implausible, Parameter};
use crate::fit::Fit;
use crate::headline::{headline, investigate_first};
use crate::scatter::Noise;
use crate::step::Step;
use crate::verdict::too_many_outliers;

/// What has to be said before all else.
pub(crate) fn warnings(data: &Dataset, outliers: usize) -> Vec<String> {
    if !too_many_outliers(data, outliers) {
        return Vec::new();
    }
    let rows = if data.kind == TableKind::Frames { "pixels" } else { "rows" };
    vec![format!(
        "{:.0} % of the {rows} are outliers: the model does not describe them, and all figures are of the others alone; {}",
        100.0 * outliers as f64 / data.len() as f64,
        if data.kind == TableKind::Frames {
            "look at the pose (--baseline physical finds it), and at which image belongs to which frame"
        } else {
            "look at the setup, and at which table belongs to it"
        }
    )]
}

fn warning_lines(data: &Dataset, outliers: usize) -> Vec<String> {
    warnings(data, outliers).into_iter().map(|warning| format!("WARNING: {warning}")).collect()
}

/// What an error is called: of points it has two components.
pub(crate) fn rms_name(data: &Dataset) -> &'static str {
    if data.components() == 2 { "rms per component" } else { "rms" }
}

/// The ladder of held-out errors, and the noise below it.
fn ladder_text(data: &Dataset, steps: &[Step], noise: &Noise, unit: &str) -> Vec<String> {
    let mut out = vec![format!(
        "error of groups left out ({unit} {}), weighted by the last model's noise | unweighted",
        rms_name(data)
    )];
    for step in steps {
        let name = match step.effects.as_slice() {
            [] => "baseline".to_owned(),
            effects => format!("+ {}", effects.join(" + ")),
        };
        out.push(format!(
            "{:10.4} | {:8.4} {unit}  held out, {name}",
            step.heldout_rms, step.heldout_rms_unweighted
        ));
    }
    out.push(format!("{:10.4} |          {unit}  noise: {}", noise.floor(), noise_text(noise, unit)));
    out
}

/// A polynomial as physics, as text.
fn decoded_text(decoded: &Decoded) -> Vec<String> {
    let mut out =
        vec![format!("{} as physics, amplitudes in arcsec at half the camera's width:", decoded.of)];
    for (k, reading) in decoded.readings.iter().enumerate() {
        let parameters: Vec<String> = reading
            .parameters
            .iter()
            .map(|p| {
                let name = p.name.trim_end_matches("_arcsec");
                p.sigma.map_or_else(
                    || format!("{name} {:.3}", p.value),
                    |sigma| format!("{name} {:.3} +- {sigma:.3}", p.value),
                )
            })
            .collect();
        let effects =
            if reading.effects.is_empty() { "nothing".to_owned() } else { reading.effects.join(" + ") };
        out.push(format!("{}{effects}: {}", if k > 0 { "  or " } else { "  " }, parameters.join(", ")));
    }
    out.push(
        "  screen_tilt is as well camera_pointing, decentering as well optical_centre: a roll of the camera tells"
            .to_owned(),
    );
    let expected = decoded
        .remainder_expected_arcsec
        .map_or_else(String::new, |e| format!("; {e:.3} is expected of the polynomial's own uncertainty"));
    out.push(format!("  none of these: {:.3} arcsec rms per axis{expected}", decoded.remainder_rms_arcsec));
    out
}

/// The catalogue as text.
pub fn effects_text(effects: &[&Effect]) -> Vec<String> {
    let mut out = Vec::new();
    for e in effects {
        out.push(format!("{} ({})", e.name(), e.kind().name()));
        out.push(format!("    adds      {}", e.formula()));
        out.push(format!("    size      {}", e.plausible()));
        out.push(format!("    columns   {}", e.covariates().join(", ")));
        out.push(format!("    source    {}", e.source()));
        if e.class.len() > 1 {
            out.push(format!(
                "    alike     {}",
                e.class.iter().filter(|id| **id != e.id).map(|id| id.name()).collect::<Vec<_>>().join(", ")
            ));
        }
        if let Some((action, value)) = e.separated_by() {
            out.push(format!("    separate  {action}: {value}"));
        }
    }
    out
}

/// A parameter that was chosen from a list, to three digits: it has no standard deviation.
fn chosen(parameter: &Parameter) -> String {
    let digits = decimals(0.1 * parameter.value);
    format!("{} {:.digits$}", parameter.name, parameter.value)
}

/// Decimals that show a number to two digits; none of a large one.
pub(crate) fn decimals(value: f64) -> usize {
    let magnitude = value.abs().log10().floor();
    if magnitude.is_finite() { (1.0 - magnitude).clamp(0.0, 12.0) as usize } else { 0 }
}

/// What is said of values that nothing real has.
pub(crate) fn implausible_text(implausible: &[Implausible]) -> String {
    let each = |i: &Implausible| {
        let [low, high] = i.range;
        match (low.is_finite(), high.is_finite()) {
            (true, true) => format!("{} beyond {low} to {high}", i.name),
            (true, false) => format!("{} below {low}", i.name),
            _ => format!("{} above {high}", i.name),
        }
    };
    match implausible {
        [] => String::new(),
        some => format!("  NOT PLAUSIBLE: {}", some.iter().map(each).collect::<Vec<_>>().join(", ")),
    }
}

/// The noise by its kinds, and where the figures come from.
fn noise_text(noise: &Noise, unit: &str) -> String {
    let mut kinds = vec![format!("{:.4} of each row", noise.white)];
    if noise.group > 0.0 {
        kinds.push(format!("{:.4} common to a group", noise.group));
    }
    if noise.structured > 0.0 {
        kinds.push(format!("beyond it {:.4} {unit} structured and unexplained", noise.structured));
    }
    format!("{} (from {})", kinds.join(", "), noise.source.join(", "))
}

/// Screens that are significant, but for those whose columns are others' and some more, and explain no more than they.
fn worth_telling(screens: &[Dependence]) -> Vec<&Dependence> {
    let significant = |d: &&Dependence| d.p_value <= 0.02 && d.share >= 5e-4;
    let is_idle = |d: &Dependence| {
        screens.iter().filter(significant).any(|other| {
            other.covariates.len() < d.covariates.len()
                && other.covariates.iter().all(|name| d.covariates.contains(name))
                && other.share >= d.share
        })
    };
    screens.iter().filter(significant).filter(|d| !is_idle(d)).collect()
}

/// The comparison as text.
pub fn compare_text(data: &Dataset, result: &Comparison) -> Vec<String> {
    let unit = data.kind.unit();
    let mut out = vec![
        format!("{} rows, {} saturated, {} outliers", result.rows, result.saturated, result.outliers),
        format!(
            "error {:.4} {unit} {}, weighted by the noise that this model leaves; {:.4} unweighted",
            result.rms,
            rms_name(data),
            result.rms_unweighted
        ),
        format!("noise {:.4} {unit}: {}", result.noise.floor(), noise_text(&result.noise, unit)),
    ];
    out.splice(0..0, warning_lines(data, result.outliers));
    let cells: Vec<String> =
        PERCENTILES.iter().zip(result.percentiles).map(|(p, v)| format!("{p} %: {v:.3}")).collect();
    out.push(format!("errors within ({unit}, unweighted, outliers left out)  {}", cells.join("  ")));
    let seen = worth_telling(&result.dependence);
    if seen.is_empty() {
        out.push("no screen finds a column that the errors depend on".to_owned());
    }
    for d in seen.iter().take(8) {
        out.push(format!(
            "depends on {}: {:.1} % of the errors' squares, p = {:.3}",
            d.covariates.join(" and "),
            100.0 * d.share,
            d.p_value
        ));
    }
    if let Some(decoded) = &result.decoded {
        out.extend(decoded_text(decoded));
    }
    for group in &result.worst_groups {
        out.push(format!("worst: {} ({} rows), {:.4} {unit}", group.name, group.rows, group.rms));
    }
    out.extend(result.notes.iter().map(|note| format!("note: {note}")));
    out
}

/// The diagnosis as text.
pub fn diagnose_text(data: &Dataset, result: &Diagnosis) -> Vec<String> {
    let unit = data.kind.unit();
    let mut out = vec![headline(data, result), format!("verdict: {}", result.verdict.name())];
    out.extend(investigate_first(result).map(str::to_owned));
    for (own, physical) in result.accepted.iter().zip(&result.physical) {
        if let Some(p) = physical {
            let digits = decimals(p.sigma);
            let candidate = result.candidates.iter().find(|candidate| candidate.effect == *own);
            out.push(format!(
                "{own}: {} {:.digits$} +- {:.digits$} {}; {}{}",
                p.parameter.replace('_', " "),
                p.value,
                p.sigma,
                p.unit,
                p.remedy,
                candidate.map_or_else(String::new, |candidate| implausible_text(&candidate.implausible))
            ));
        }
    }
    for kept in &result.kept {
        out.push(format!(
            "{}: a formula that was kept, p = {:.4}; {}",
            kept.name,
            kept.p_value,
            kept.file.display()
        ));
    }
    out.splice(0..0, warning_lines(data, result.outliers));
    out.extend(ladder_text(data, &result.steps, &result.noise, unit));
    if let Some(next) = &result.next {
        let gain =
            next.expected_sigma.map_or_else(String::new, |s| format!(", would differ by {s:.1} sigma"));
        let separates = match next.separates.as_slice() {
            [] => String::new(),
            effects => format!(", separates {}", effects.join(", ")),
        };
        out.push(format!("measure next: {} ({}){separates}{gain}", next.action, next.value));
    }
    out.push("effect                  p        held out   parameters".to_owned());
    for c in &result.candidates {
        let parameters: Vec<String> = c
            .parameters
            .iter()
            .map(|p| match p.sigma {
                Some(sigma) => {
                    let digits = decimals(sigma);
                    format!("{} {:.digits$} +- {:.digits$}", p.name, p.value, sigma)
                }
                None => chosen(p),
            })
            .collect();
        out.push(format!(
            "{:22} {:7.4} {:10.4}   {}{}",
            c.effect,
            c.p_value,
            c.heldout_rms,
            parameters.join(", "),
            implausible_text(&c.implausible)
        ));
    }
    for not in &result.not_testable {
        out.push(format!("{:22} not testable: {}", not.effect, not.reason));
    }
    out.extend(result.notes.iter().map(|note| format!("note: {note}")));
    out
}

/// The fit as text.
pub fn fit_text(data: &Dataset, result: &Fit) -> Vec<String> {
    let unit = data.kind.unit();
    let mut out = warning_lines(data, result.outliers);
    out.extend(ladder_text(data, &result.steps, &result.noise, unit));
    out.push(format!(
        "{:10.4} | {:8.4} {unit}  in the fit, {} outliers left out",
        result.rms, result.rms_unweighted, result.outliers
    ));
    let seconds = |name: &str| name.contains(SECOND_ORDERS);
    for p in result.parameters.iter().filter(|p| !seconds(&p.name)) {
        out.push(match p.sigma {
            Some(sigma) => format!("{:40} {:14.6} +- {:.6}", p.name, p.value, sigma),
            None => format!("{:40} {:14.6} (chosen)", p.name, p.value),
        });
    }
    let count = result.parameters.iter().filter(|p| seconds(&p.name)).count();
    if count > 0 {
        out.push(format!(
            "and {count} second orders of these effects, with the JSON (NAME{SECOND_ORDERS}1, ...)"
        ));
    }
    out.extend(result.notes.iter().map(|note| format!("note: {note}")));
    out
}

/// Writes [`predictions_text`].
///
/// # Errors
/// The file cannot be written.
pub fn write_predictions(path: &Path, data: &Dataset, fit: &Fit) -> Result<(), InputError> {
    let text = predictions_text(path, data, fit)?;
    write_atomic(path, text.as_bytes())
        .map_err(|error| InputError::new(path, format!("cannot be written: {error}")))
}

/// `fit --predictions`, a table: a row for each row of the files, in their order; saturated rows were not fitted and
/// have empty cells and count as outliers. `path` names it in errors.
///
/// # Errors
/// The fit is not of all the rows.
pub fn predictions_text(path: &Path, data: &Dataset, fit: &Fit) -> Result<String, InputError> {
    fit.check_covers(path, data)?;
    let n = data.components();
    let mut text = String::from(if data.kind == TableKind::Points {
        "baseline_x_px,baseline_y_px,effect_x_px,effect_y_px,residual_x_px,residual_y_px,outlier\n"
    } else if data.kind == TableKind::Frames {
        "image,camera_x_px,camera_y_px,baseline,effect,residual,outlier\n"
    } else {
        "baseline,effect,residual,outlier\n"
    });
    for row in data.rows_of_lines() {
        let Some(row) = row else {
            text.push_str(&",".repeat(3 * n));
            text.push_str("1\n");
            continue;
        };
        let frame = &data.frame[row];
        let in_table = |values: &[f64]| -> Vec<f64> {
            (0..n).map(|i| (0..n).map(|j| frame.to_table[i][j] * values[row * n + j]).sum()).collect()
        };
        let (effect, residual) = (in_table(&fit.effect), in_table(&fit.residual));
        let baseline: Vec<f64> = (0..n).map(|i| frame.measured[i] - effect[i] - residual[i]).collect();
        if let Some(place) = data.pixels().map(|pixels| pixels.place[row]) {
            let _ = write!(text, "{},{},{},", place[0] + 1.0, place[1], place[2]);
        }
        for value in baseline.iter().chain(&effect).chain(&residual) {
            let _ = write!(text, "{value:.9e},");
        }
        let _ = writeln!(text, "{}", u8::from(fit.outlier[row]));
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_that_add_nothing_are_left_out() {
        let screen = |columns: &str, p_value, share| Dependence {
            covariates: columns.split(' ').map(str::to_owned).collect(),
            p_value,
            share,
        };
        let screens = [
            screen("exposure_s x y", 0.001, 0.782),
            screen("x y", 0.001, 0.790),
            screen("time_s x y", 0.001, 0.85),
            screen("x", 0.5, 0.8),
        ];
        let told: Vec<String> = worth_telling(&screens).iter().map(|d| d.covariates.join(" ")).collect();
        assert_eq!(told, ["x y", "time_s x y"]);
    }

    #[test]
    fn what_was_chosen_from_a_list_is_shown_with_its_value() {
        for (value, expected) in
            [(87.0, "tau_s 87.0"), (0.5, "tau_s 0.500"), (690.0, "tau_s 690"), (0.0, "tau_s 0")]
        {
            let parameter = Parameter { name: "tau_s".into(), value, sigma: None };
            assert_eq!(chosen(&parameter), expected);
        }
    }
}
