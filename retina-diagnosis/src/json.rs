//! Results as JSON.

use serde_json::{Map, Value, json};

use crate::catalogue::Effect;
use crate::compare::{Comparison, PERCENTILES};
use crate::data::{Dataset, Measure};
use crate::diagnose::Diagnosis;
use crate::estimate::Parameter;
use crate::fit::Fit;
use crate::headline::headline;
use crate::output::warnings;
use crate::physical::Physical;
use crate::scatter::Noise;
use crate::step::Step;

fn parameters_json(parameters: &[Parameter]) -> Value {
    let entries: Map<String, Value> =
        parameters.iter().map(|p| (p.name.clone(), json!({ "value": p.value, "sigma": p.sigma }))).collect();
    Value::Object(entries)
}

fn steps_json(steps: &[Step]) -> Value {
    let step = |s: &Step| json!({ "effects": s.effects, "heldout_rms": s.heldout_rms, "heldout_rms_unweighted": s.heldout_rms_unweighted });
    steps.iter().map(step).collect()
}

/// A range; an end that is open is null.
fn range_json(range: [f64; 2]) -> Value {
    range.iter().map(|end| if end.is_finite() { json!(end) } else { Value::Null }).collect()
}

fn accepted_at(result: &Diagnosis, effect: &str) -> Option<usize> {
    result.accepted.iter().position(|own| *own == effect)
}

fn physical_json(physical: &Physical) -> Value {
    json!({
        "called": physical.called,
        "parameter": physical.parameter,
        "value": physical.value,
        "unit": physical.unit,
        "sigma": physical.sigma,
        "remedy": physical.remedy,
    })
}

fn noise_json(noise: &Noise) -> Value {
    json!({ "white": noise.white, "group": noise.group, "structured": noise.structured, "source": noise.source })
}

/// Where the bodies of images are seen; nothing of other tables.
fn placement_json(data: &Dataset) -> Value {
    let measure = |m: &Measure| json!({ "value": m.value, "sigma": m.sigma });
    let placements = data.pixels().map_or(&[][..], |pixels| &pixels.placements);
    placements
        .iter()
        .map(|p| {
            json!({
                "image": p.image,
                "predicted_px": p.predicted_px,
                "seen_x_px": measure(&p.seen_px[0]),
                "seen_y_px": measure(&p.seen_px[1]),
                "roll_rad": measure(&p.roll_rad),
                "scale_relative": measure(&p.scale),
            })
        })
        .collect()
}

/// The same object with the placements, where there are any.
fn with_placement(mut out: Value, data: &Dataset) -> Value {
    let placement = placement_json(data);
    if placement.as_array().is_some_and(|all| !all.is_empty()) {
        out["placement"] = placement;
    }
    out
}

/// `compare --json`, schema `retina.compare/1`.
pub fn compare_json(data: &Dataset, result: &Comparison) -> Value {
    let percentiles: Map<String, Value> =
        PERCENTILES.iter().zip(result.percentiles).map(|(p, v)| (p.to_string(), json!(v))).collect();
    let mut out = json!({
        "schema": "retina.compare/1",
        "table": data.kind.name(),
        "rows": result.rows,
        "saturated": result.saturated,
        "outliers": result.outliers,
        "rms": result.rms,
        "rms_unweighted": result.rms_unweighted,
        "noise_floor": result.noise.floor(),
        "noise": noise_json(&result.noise),
        "jitter": result.jitter,
        "unit": data.kind.unit(),
        "percentiles": percentiles,
        "worst_groups": result.worst_groups.iter().map(|g| json!({ "group": g.name, "rms": g.rms, "rows": g.rows })).collect::<Vec<_>>(),
        "dependence": result.dependence.iter().map(|d| json!({ "covariates": d.covariates, "p_value": d.p_value, "share": d.share })).collect::<Vec<_>>(),
        "warnings": warnings(data, result.outliers),
        "notes": result.notes,
    });
    if let Some(fraction) = result.fraction_within_10_arcsec {
        out["fraction_within_10_arcsec"] = json!(fraction);
    }
    if let Some(decoded) = &result.decoded {
        out["decoded"] = json!({
            "of": decoded.of,
            "readings": decoded.readings.iter().map(|r| json!({ "effects": r.effects, "parameters": parameters_json(&r.parameters) })).collect::<Vec<_>>(),
            "remainder_rms_arcsec": decoded.remainder_rms_arcsec,
            "remainder_expected_arcsec": decoded.remainder_expected_arcsec,
        });
    }
    with_placement(out, data)
}

/// `diagnose --json`, schema `retina.diagnosis/1`.
pub fn diagnose_json(data: &Dataset, result: &Diagnosis) -> Value {
    let out = json!({
        "schema": "retina.diagnosis/1",
        "table": data.kind.name(),
        "rows": data.table_rows,
        "outliers": result.outliers,
        "baseline": {
            "heldout_rms": result.baseline_heldout_rms,
            "heldout_rms_unweighted": result.steps.first().map(|step| step.heldout_rms_unweighted),
            "unit": data.kind.unit(),
            "noise_floor": result.noise.floor(),
        },
        "headline": headline(data, result),
        "verdict": result.verdict.name(),
        "noise": noise_json(&result.noise),
        "accepted": result.accepted,
        "rivals": result.accepted.iter().zip(&result.rivals).map(|(own, rivals)| ((*own).to_owned(), json!(rivals))).collect::<Map<String, Value>>(),
        "rival_columns": result.accepted.iter().zip(&result.rival_columns).filter_map(|(own, column)| Some(((*own).to_owned(), json!(column.as_ref()?)))).collect::<Map<String, Value>>(),
        "physical": result.accepted.iter().zip(&result.physical).filter_map(|(own, physical)| Some(((*own).to_owned(), physical_json(physical.as_ref()?)))).collect::<Map<String, Value>>(),
        "candidates": result.candidates.iter().map(|c| json!({
            "effect": c.effect,
            "p_value": c.p_value,
            "heldout_rms": c.heldout_rms,
            "parameters": parameters_json(&c.parameters),
            "rivals": accepted_at(result, c.effect).map(|at| &result.rivals[at]),
            "physical": accepted_at(result, c.effect).and_then(|at| result.physical.get(at)?.as_ref()).map(physical_json),
            "implausible": c.implausible.iter().map(|i| json!({ "parameter": i.name, "plausible": range_json(i.range) })).collect::<Vec<_>>(),
        })).collect::<Vec<_>>(),
        "kept": result.kept.iter().map(|kept| json!({ "name": kept.name, "file": kept.file, "p_value": kept.p_value })).collect::<Vec<_>>(),
        "indistinguishable": result.indistinguishable,
        "next_measurement": result.next.as_ref().map(|next| json!({
            "action": next.action,
            "value": next.value,
            "separates": next.separates,
            "expected_sigma": next.expected_sigma,
        })),
        "unexplained": {
            "p_value": result.unexplained.p_value,
            "covariates": result.unexplained.covariates,
            "width_px": result.unexplained.width_px,
            "would_have_been_seen": result.unexplained.visible.iter().filter(|v| v[1].is_finite()).map(|v| json!({ "wavelength_px": v[0], "amplitude": v[1], "power": 0.95 })).collect::<Vec<_>>(),
        },
        "steps": steps_json(&result.steps),
        "not_testable": result.not_testable.iter().map(|n| json!({ "effect": n.effect, "reason": n.reason })).collect::<Vec<_>>(),
        "warnings": warnings(data, result.outliers),
        "notes": result.notes,
    });
    with_placement(out, data)
}

/// `fit --json`, schema `retina.fit/1`.
pub fn fit_json(data: &Dataset, result: &Fit) -> Value {
    let fitted: Vec<&str> =
        result.parameters[..result.correlation.len()].iter().map(|p| p.name.as_str()).collect();
    let out = json!({
        "schema": "retina.fit/1",
        "table": data.kind.name(),
        "unit": data.kind.unit(),
        "rows": data.table_rows,
        "outliers": result.outliers,
        "parameters": parameters_json(&result.parameters),
        "correlation": { "parameters": fitted, "matrix": result.correlation },
        "rms": result.rms,
        "rms_unweighted": result.rms_unweighted,
        "heldout_rms": result.heldout_rms,
        "noise": noise_json(&result.noise),
        "noise_floor": result.noise.floor(),
        "steps": steps_json(&result.steps),
        "warnings": warnings(data, result.outliers),
        "notes": result.notes,
    });
    with_placement(out, data)
}

/// `effects --json`, schema `retina.effects/1`.
pub fn effects_json(effects: &[&Effect]) -> Value {
    let list: Vec<Value> = effects
        .iter()
        .map(|e| {
            json!({
                "effect": e.name(),
                "table": e.kind().name(),
                "formula": e.formula(),
                "source": e.source(),
                "covariates": e.covariates(),
                "plausible": e.plausible(),
                "class": e.class.iter().map(|id| id.name()).collect::<Vec<_>>(),
                "separated_by": e.separated_by().map(|(action, value)| json!({ "action": action, "value": value })),
            })
        })
        .collect();
    json!({ "schema": "retina.effects/1", "effects": list })
}
