//! Effects found one by one; the prediction is made anew with each, so that what two do together is in it.

use retina_diagnosis::{
    AddedEffect, Candidate, Dataset, DiagnoseOptions, Diagnosis, Findings, Parameter, Step, Verdict,
    diagnose_step, fit, implausible, too_many_outliers,
};
use retina_files::InputError;

use crate::FrameSet;
use crate::physical::physical;

/// Most effects that are accepted.
const MOST_ACCEPTED: usize = 7;
/// Part of the error of tiles left out by which an effect has to lower it.
const LEAST_GAIN: f64 = 0.002;

/// Standard deviations within which all parameters of an effect lie that others have made needless.
const IDLE_SIGMAS: f64 = 3.0;

/// The first accepted effect but the last whose parameters are all nothing.
fn idle(accepted: &[&'static str], parameters: &[Parameter]) -> Option<usize> {
    let earlier = accepted.len().saturating_sub(1);
    accepted[..earlier].iter().position(|id| {
        let own = format!("{id}.");
        let mut free = parameters.iter().filter(|p| p.name.starts_with(&own) && p.sigma.is_some()).peekable();
        free.peek().is_some()
            && free.all(|p| p.sigma.is_some_and(|sigma| p.value.abs() < IDLE_SIGMAS * sigma))
    })
}

fn ladder_end(ladder: &[Step]) -> f64 {
    ladder.last().map_or(f64::INFINITY, |step| step.heldout_rms)
}

/// Diagnoses frames: `effects` (ids and files) belong to the model already. The set keeps what was accepted; the data
/// are the pixels under it.
///
/// # Errors
/// An effect that these frames cannot show, a file that does not fit.
pub fn diagnose_frames(
    set: &mut FrameSet,
    effects: &[String],
    options: &DiagnoseOptions,
) -> Result<(Dataset, Vec<AddedEffect>, Diagnosis), InputError> {
    let (mut data, mut added) = set.with_effects(effects)?;
    let given = added.len();
    let mut found = diagnose_step(&data, &added, options, false);
    let mut out = Diagnosis {
        accepted: Vec::new(),
        rivals: Vec::new(),
        rival_columns: Vec::new(),
        indistinguishable: Vec::new(),
        next: None,
        ..found.clone()
    };
    // What happened on the way; the rest is told of the last model.
    let mut events: Vec<String> = Vec::new();
    let mut decided: Vec<Candidate> = Vec::new();
    let mut several = false;
    let mut ladder: Vec<Step> = Vec::new();
    let mut fitted_parameters: Vec<Parameter> = Vec::new();
    while let (Some(&id), true) = (found.accepted.first(), out.accepted.len() < MOST_ACCEPTED) {
        set.add(id)?;
        let next = set.dataset(true)?;
        let mut with = added.clone();
        with.push(AddedEffect::read(id, &next)?);
        let (steps, parameters) = match fit(&next, &with) {
            Ok(fitted) => (fitted.steps, fitted.parameters),
            Err(refused) => {
                events.push(format!("{id} is significant and cannot be fitted beside the others: {refused}"));
                set.undo();
                break;
            }
        };
        let [before, after] = [2, 1].map(|back| steps[steps.len() - back].heldout_rms);
        if after > (1.0 - LEAST_GAIN) * before {
            events.push(format!(
                "{id} is significant and was taken out again: with it the error of tiles left out is {after:.4} instead of {before:.4}"
            ));
            set.undo();
            break;
        }
        (data, added, ladder, fitted_parameters) = (next, with, steps, parameters);
        out.accepted.push(id);
        several |= found.indistinguishable.len() > 1;
        out.rivals.append(&mut found.rivals);
        out.rival_columns.append(&mut found.rival_columns);
        out.physical.push(None);
        for rival in &found.indistinguishable {
            if !out.indistinguishable.contains(rival) {
                out.indistinguishable.push(rival);
            }
        }
        if found.next.is_some() && out.next.is_none() {
            out.next = found.next.clone();
        }
        decided.extend(found.candidates.iter().find(|candidate| candidate.effect == id).cloned());
        while let Some(idle) = idle(&out.accepted, &fitted_parameters) {
            let (kept, name) = (set.keep(), out.accepted[idle]);
            set.remove(name);
            let next = set.dataset(true)?;
            let mut without = added.clone();
            without.remove(given + idle);
            let trial = fit(&next, &without).ok();
            let Some(trial) = trial.filter(|t| t.heldout_rms < (1.0 + LEAST_GAIN) * ladder_end(&ladder))
            else {
                set.restore(kept);
                break;
            };
            events.push(format!(
                "{name} was found and taken out again: beside the others the error of tiles left out is {:.4} without it, {:.4} with it",
                trial.heldout_rms,
                ladder_end(&ladder)
            ));
            (data, added, ladder, fitted_parameters) = (next, without, trial.steps, trial.parameters);
            out.accepted.remove(idle);
            out.rivals.remove(idle);
            out.rival_columns.remove(idle);
            out.physical.remove(idle);
            out.indistinguishable.retain(|own| *own != name);
            decided.retain(|candidate| candidate.effect != name);
        }
        found = diagnose_step(&data, &added, options, true);
    }
    // What was accepted has the values of the last model, and the error of its step of the ladder.
    for (k, candidate) in decided.iter_mut().enumerate() {
        let own = format!("{}.", candidate.effect);
        let of = |p: &Parameter| {
            let name = p.name.strip_prefix(&own)?.to_owned();
            Some(Parameter { name, ..p.clone() })
        };
        candidate.parameters = fitted_parameters.iter().filter_map(of).collect();
        let range = |p: &Parameter| set.plausible(candidate.effect, &p.name);
        candidate.implausible = implausible(candidate.parameters.iter().map(|p| (p, range(p))));
        candidate.heldout_rms = ladder[given + k + 1].heldout_rms;
        // What cannot be is no quantity of anything.
        out.physical[k] = set
            .part(candidate.effect)
            .filter(|_| candidate.implausible.is_empty())
            .and_then(|part| physical(part, &candidate.parameters));
    }
    let later = found.candidates.into_iter().filter(|c| !out.accepted.contains(&c.effect));
    out.candidates = decided.into_iter().chain(later).collect();
    out.outliers = found.outliers;
    out.notes = found.notes.into_iter().chain(events).collect();
    out.noise = found.noise;
    out.unexplained = found.unexplained;
    out.not_testable = found.not_testable;
    // Structure that is left after a refusal is structure all the same.
    let structure = !out.unexplained.covariates.is_empty();
    out.verdict = Verdict::of(Findings {
        structure,
        nothing: out.accepted.is_empty(),
        several,
        outliers: too_many_outliers(&data, out.outliers),
        too_little: false,
    });
    if !ladder.is_empty() {
        let accepted: Vec<String> = out.accepted.iter().map(|id| (*id).to_owned()).collect();
        let own = |(k, step): (usize, Step)| Step { effects: accepted[..k].to_vec(), ..step };
        out.steps = ladder.into_iter().skip(given).enumerate().map(own).collect();
        out.baseline_heldout_rms = out.steps[0].heldout_rms;
    } else if let Some(first) = out.steps.first().cloned() {
        out.steps = vec![first];
    }
    Ok((data, added, out))
}
