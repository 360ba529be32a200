//! Writes the sets, and apart from them their truth.

use std::path::Path;

use rayon::prelude::*;
use retina_files::{InputError, write_atomic};
use serde::{Deserialize, Serialize};

use crate::forms::FORMULA;
use crate::plan::{Kind, Plan, formula_plan, formula_power_plan, plan};
use crate::points::{Campaign, Chamber, nature};
use crate::power_formulas::{Behind, PowerFormula, table};
use crate::readings::{self, NOISE};

/// What the scorer needs beside the plan.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(crate) struct Derived {
    pub(crate) set: usize,
    pub(crate) r_squared: Vec<f64>,
    pub(crate) oracle_sigma: Vec<f64>,
}

/// Follow-up campaigns by the action that they carry out.
pub(crate) const FOLLOW_UPS: [&str; 2] = ["camera_roll", "temperature_cycle"];

pub(crate) fn io(path: &Path, error: &dyn std::fmt::Display) -> InputError {
    InputError::new(path, format!("cannot be written: {error}"))
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), InputError> {
    write_atomic(path, bytes).map_err(|error| io(path, &error))
}

/// Single-precision numbers, little-endian.
pub(crate) fn to_bytes(values: &[f64]) -> Vec<u8> {
    values.iter().flat_map(|v| (*v as f32).to_le_bytes()).collect()
}

/// The truth of all sets as text: the plans alone, which no rounding of a processor can change.
fn truth(plans: &[Plan]) -> Result<String, InputError> {
    let mut out = String::new();
    for plan in plans {
        let line =
            serde_json::to_string(plan).map_err(|error| InputError::new("truth", error.to_string()))?;
        out.push_str(&line);
        out.push('\n');
    }
    Ok(out)
}

/// Writes `DIR/sets/NNNNN/*.csv` and `DIR/sealed/`, of one kind where that is given; returns the hash of the truth.
///
/// # Errors
/// A file cannot be written.
pub fn generate(folder: &Path, seed: u64, sets: usize, kind: Option<&str>) -> Result<String, InputError> {
    let sealed = folder.join("sealed");
    std::fs::create_dir_all(&sealed).map_err(|error| io(&sealed, &error))?;
    let of = match kind {
        Some("formula") => formula_plan,
        Some("formula-power") => formula_power_plan,
        _ => plan,
    };
    let plans: Vec<Plan> = (0..sets)
        .map(|set| of(seed, set))
        .filter(|plan| kind.is_none_or(|kind| kind == plan.kind.name()))
        .collect();
    let truth = truth(&plans)?;
    let derived: Vec<Derived> = plans.par_iter().map(|plan| one(folder, plan)).collect::<Result<_, _>>()?;
    let mut lines = String::new();
    for line in &derived {
        lines.push_str(
            &serde_json::to_string(line).map_err(|error| InputError::new("derived", error.to_string()))?,
        );
        lines.push('\n');
    }
    write(&sealed.join("derived.jsonl"), lines.as_bytes())?;
    write(&sealed.join("truth.jsonl"), truth.as_bytes())?;
    Ok(blake3::hash(truth.as_bytes()).to_string())
}

/// A table of readings with a formula or without, and of a formula another day without noise.
fn power_formula(folder: &Path, own: &Path, plan: &Plan) -> Result<Derived, InputError> {
    let (seed, scatter) = (plan.campaign.seed, plan.campaign.jitter * NOISE);
    let constants = nature(seed, 0);
    let formula = PowerFormula::of(constants.seed);
    let hidden = plan.hidden.first();
    let of = |amplitude: Option<f64>| match hidden {
        Some(hidden) if hidden.id == FORMULA => Behind::Formula(&formula, hidden.strength, amplitude),
        Some(hidden) => Behind::Known(&hidden.id, &constants, hidden.strength),
        None => Behind::Nothing,
    };
    let (text, field, amplitude) = table(&of(None), seed, scatter, 1.0);
    write(&own.join("table.csv"), text.as_bytes())?;
    let sealed = folder.join("sealed");
    if hidden.is_some() {
        write(&sealed.join(format!("{:05}.f32", plan.set)), &to_bytes(&field))?;
    }
    let (text, field, _) = table(&of(Some(amplitude)), seed.wrapping_add(1), 0.0, 0.0);
    write(&own.join("fresh.csv"), text.as_bytes())?;
    write(&sealed.join(format!("{:05}-fresh.f32", plan.set)), &to_bytes(&field))?;
    let whole = field.iter().map(|v| v * v).sum::<f64>().sqrt() / NOISE;
    Ok(Derived { set: plan.set, r_squared: Vec::new(), oracle_sigma: vec![whole] })
}

fn one(folder: &Path, plan: &Plan) -> Result<Derived, InputError> {
    let own = folder.join("sets").join(format!("{:05}", plan.set));
    std::fs::create_dir_all(&own).map_err(|error| io(&own, &error))?;
    let seed = plan.campaign.seed;
    let natures: Vec<_> = (0..plan.hidden.len()).map(|k| nature(seed, k as u64)).collect();
    let (id, strength) =
        plan.hidden.first().map_or((None, 0.0), |hidden| (Some(hidden.id.as_str()), hidden.strength));
    match plan.kind {
        Kind::Power => {
            let text = readings::power(id, strength, &nature(seed, 0), seed);
            write(&own.join("table.csv"), text.as_bytes())?;
            return Ok(Derived { set: plan.set, ..Derived::default() });
        }
        Kind::Phase => {
            let text = readings::phase(id, strength, &nature(seed, 0), seed);
            write(&own.join("table.csv"), text.as_bytes())?;
            return Ok(Derived { set: plan.set, ..Derived::default() });
        }
        Kind::FormulaPower => return power_formula(folder, &own, plan),
        _ => {}
    }
    let made = plan.campaign.make(&plan.hidden, &natures, None);
    write(&own.join("table.csv"), made.text.as_bytes())?;
    if !plan.hidden.is_empty() {
        let sum: Vec<f64> =
            (0..made.fields[0].len()).map(|at| made.fields.iter().map(|f| f[at]).sum()).collect();
        let path = folder.join("sealed").join(format!("{:05}.f32", plan.set));
        write(&path, &to_bytes(&sum))?;
    }
    if plan.kind == Kind::Formula {
        // The same facility on another day: exposures that nobody has seen, without noise.
        let fresh = Campaign { seed: seed.wrapping_add(1), jitter: 0.0, outliers: 0.0, ..plan.campaign };
        let amplitudes = (!made.amplitudes.is_empty()).then_some(made.amplitudes.as_slice());
        let fresh = fresh.make(&plan.hidden, &natures, amplitudes);
        write(&own.join("fresh.csv"), fresh.text.as_bytes())?;
        if let Some(field) = fresh.fields.first() {
            write(&folder.join("sealed").join(format!("{:05}-fresh.f32", plan.set)), &to_bytes(field))?;
        }
    }
    if plan.kind == Kind::Confounded {
        for (k, action) in FOLLOW_UPS.into_iter().enumerate() {
            // The same facility on another day.
            let mut again = Campaign { seed: seed.wrapping_add(1 + k as u64), ..plan.campaign };
            match action {
                "camera_roll" => again.roll_deg = 90.0,
                _ => again.chamber = Chamber::Cycles,
            }
            let follow = again.make(&plan.hidden, &natures, Some(&made.amplitudes));
            write(&own.join(format!("{action}.csv")), follow.text.as_bytes())?;
        }
    }
    Ok(Derived { set: plan.set, r_squared: made.r_squared, oracle_sigma: made.oracle_sigma })
}
