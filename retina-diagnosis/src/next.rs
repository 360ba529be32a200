//! What to measure next, so that effects which fit alike are told apart.

use std::sync::{Arc, OnceLock};

use crate::catalogue::Effect;
use crate::data::Dataset;
use crate::linear::dot;
use crate::noise::Weights;
use crate::score::Frame;

/// A proposal.
#[derive(Debug, Clone)]
pub struct NextMeasurement {
    /// What to do.
    pub action: &'static str,
    /// How much of it.
    pub value: &'static str,
    /// Effects that it separates.
    pub separates: Vec<&'static str>,
    /// By how many sigmas the two hardest to tell apart of those would differ, where the design could be computed:
    /// the root of the non-centrality (A. C. Atkinson, V. V. Fedorov, Biometrika 62, 1975, T-optimality).
    pub expected_sigma: Option<f64>,
}

/// The best effect's proposal, with its gain.
pub(crate) fn propose(
    data: &Dataset,
    weights: &Weights,
    best: &'static Effect,
    variant: usize,
    set: &[&'static Effect],
) -> Option<NextMeasurement> {
    let (action, value) =
        best.separated_by().or_else(|| set.iter().find_map(|effect| effect.separated_by()))?;
    let Some(design) = repeated(data, action) else {
        return Some(NextMeasurement {
            action,
            value,
            separates: set.iter().map(|e| e.name()).collect(),
            expected_sigma: None,
        });
    };
    let doubled = Weights {
        weight: weights.weight.repeat(2),
        sigma: weights.sigma.repeat(2),
        jitter_variance: weights.jitter_variance,
        outlier: weights.outlier.repeat(2),
        field_size: weights.field_size,
    };
    let field = expected(data, weights, &design, best, variant)?;
    let base: Vec<Vec<f64>> = design.baseline_terms().iter().map(|term| design.column(term)).collect();
    let mut separates = vec![best.name()];
    let mut least: Option<f64> = None;
    for rival in set.iter().filter(|effect| effect.id != best.id) {
        let Ok(variants) = rival.build(&design) else { continue };
        let mut with = design.clone();
        with.y.clone_from(&field);
        // Its form that comes nearest.
        let left = variants
            .iter()
            .map(|variant| {
                let mut columns = base.clone();
                columns.extend(variant.leading.iter().map(|term| design.column(term)));
                let frame = Frame::weighted(&with, &columns, doubled.clone());
                dot(&frame.error, &frame.error).sqrt()
            })
            .fold(f64::INFINITY, f64::min);
        if left > 1.0 {
            separates.push(rival.name());
            least = Some(least.map_or(left, |l| l.min(left)));
        }
    }
    if separates.len() == 1 {
        // This action tells nothing apart: say what belongs to a rival instead, without a figure.
        let other = set.iter().filter_map(|e| e.separated_by()).find(|(a, _)| *a != action);
        let (action, value) = other.unwrap_or(("magnification", "the other configuration"));
        return Some(NextMeasurement {
            action,
            value,
            separates: set.iter().map(|e| e.name()).collect(),
            expected_sigma: None,
        });
    }
    Some(NextMeasurement { action, value, separates, expected_sigma: least })
}

/// The fitted best effect over the new design.
fn expected(
    data: &Dataset,
    weights: &Weights,
    design: &Dataset,
    best: &'static Effect,
    variant: usize,
) -> Option<Vec<f64>> {
    let forms = best.build(data).ok()?;
    let mut columns: Vec<Vec<f64>> = data.baseline_terms().iter().map(|term| data.column(term)).collect();
    let before = columns.len();
    columns.extend(forms.get(variant)?.leading.iter().map(|term| data.column(term)));
    let values = crate::estimate::estimate(data, &columns, weights).values;
    let there = best.build(design).ok()?;
    let mut out = vec![0.0; design.y.len()];
    for (term, amplitude) in there.get(variant)?.leading.iter().zip(&values[before..]) {
        for (sum, value) in out.iter_mut().zip(design.column(term)) {
            *sum += amplitude * value;
        }
    }
    Some(out)
}

/// The campaign and its repetition under the action; `None` where the table does not say what would change.
fn repeated(data: &Dataset, action: &str) -> Option<Dataset> {
    let mut out = data.clone();
    let rows = data.len();
    out.field = OnceLock::new();
    let again: Vec<usize> = (0..rows).chain(0..rows).collect();
    out.held = data.held.as_ref().map(|held| held.of_rows(&again));
    out.form_error = Arc::new(data.form_error.of_rows(&again));
    out.y.extend_from_slice(&data.y);
    out.order.extend_from_slice(&data.order);
    out.noise_key.extend_from_slice(&data.noise_key);
    out.isotropic_from_error.iter_mut().for_each(|isotropic| isotropic.extend_from_within(..));
    out.channel.extend_from_slice(&data.channel);
    out.frame.extend_from_slice(&data.frame);
    for covariate in &mut out.covariates {
        covariate.values.extend_from_within(..);
    }
    for group in &data.groups {
        let mut again = group.clone();
        again.rows = again.rows.start + rows..again.rows.end + rows;
        out.groups.push(again);
    }
    let mountings = data.roll_rad.len();
    match action {
        "camera_roll" => {
            out.mounting.extend(data.mounting.iter().map(|m| m + mountings));
            out.roll_rad.extend(data.roll_rad.iter().map(|roll| roll + std::f64::consts::FRAC_PI_2));
        }
        "temperature_cycle" => {
            out.mounting.extend_from_slice(&data.mounting);
            let time = data.covariate("time_s")?;
            let (start, end) = time.range();
            let (low, high) = data.covariate("temperature_c")?.range();
            let span = end - start;
            for covariate in &mut out.covariates {
                for row in rows..2 * rows {
                    let t = (time.values[row - rows] - start) / span;
                    if covariate.name == "time_s" {
                        covariate.values[row] += span;
                    } else if covariate.name == "temperature_c" {
                        let turn = (2.0 * std::f64::consts::TAU * t).sin();
                        covariate.values[row] = 0.5 * (low + high) + 0.5 * (high - low) * turn;
                    }
                }
            }
        }
        _ => return None,
    }
    Some(out)
}
