//! Which effect is missing: candidates tested, ranked, accepted one by one, until nothing is left to explain.

use std::sync::Arc;

use rayon::prelude::*;
use retina_formats::{EffectId, PointsEffect};

use crate::added::{AddedEffect, settled};
use crate::catalogue::Effect;
use crate::data::Dataset;
use crate::doubts::doubts;
use crate::estimate::{Estimator, Implausible, Parameter, estimate, implausible};
use crate::form_error;
use crate::kept::KeptEffect;
use crate::next::{NextMeasurement, propose};
use crate::noise::Weights;
use crate::physical::{Physical, physical};
use crate::ranking::Ranked;
use crate::retraced::retraced;
use crate::scatter::{Noise, noise};
use crate::score::Frame;
use crate::search::{
    Accepted, FLOOR_NOISE, LEVEL_FIRST, LEVEL_LATER, MOST_ROWS, Prepared, Search, WHOLE_GROUP, prepare,
};
use crate::series::Outlying;
use crate::step::Step;
use crate::sufficient::{note_of_runs, too_little};
use crate::together::Together;
use crate::unexplained::{Unexplained, unexplained};
use crate::verdict::{Findings, Verdict, too_many_outliers};
use crate::wander::correlation;

/// What is asked of a diagnosis.
#[derive(Debug, Clone)]
pub struct DiagnoseOptions {
    /// Sign-flips; the smallest p-value is 1 / (flips + 1).
    pub flips: usize,
    /// Seed of the flips.
    pub seed: u64,
}

impl Default for DiagnoseOptions {
    fn default() -> Self {
        Self { flips: 1999, seed: 1 }
    }
}

/// Most effects that are accepted.
const MOST_ACCEPTED: usize = 4;

/// A correlation of exposures that is less than that of the table by so much is another one.
const LESS_WANDER: f64 = 0.2;

/// Most times that the search is repeated with forms made anew.
const MOST_SEARCHES: usize = 2;

/// An effect that was tried.
#[derive(Debug, Clone)]
pub struct Candidate {
    /// Its id.
    pub effect: &'static str,
    /// p-value, corrected for the number of effects; of the step in which it was decided upon.
    pub p_value: f64,
    /// Held-out error per component with it.
    pub heldout_rms: f64,
    /// Its parameters.
    pub parameters: Vec<Parameter>,
    /// Parameters that are beyond what is plausible by more than two standard deviations, each with its range.
    pub implausible: Vec<Implausible>,
}

/// An effect that could not be tried.
#[derive(Debug, Clone)]
pub struct NotTestable {
    /// Its id.
    pub effect: &'static str,
    /// Why not, with the column that would make it so.
    pub reason: String,
}

/// The diagnosis of a table.
#[derive(Debug, Clone)]
pub struct Diagnosis {
    /// Outliers under the final model.
    pub outliers: usize,
    /// Held-out error of the baseline.
    pub baseline_heldout_rms: f64,
    /// What the measurements scatter by.
    pub noise: Noise,
    /// The outcome.
    pub verdict: Verdict,
    /// Effects accepted, in their order.
    pub accepted: Vec<&'static str>,
    /// For each of them those that these data cannot tell from it.
    pub rivals: Vec<Vec<&'static str>>,
    /// For each of them a column of the table that the catalogue does not know, where it may as well be behind it.
    pub rival_columns: Vec<Option<String>>,
    /// For each of them what it is on the bench, where that can be said.
    pub physical: Vec<Option<Physical>>,
    /// All that could be tried, best first.
    pub candidates: Vec<Candidate>,
    /// Accepted effects with those this data cannot tell from them.
    pub indistinguishable: Vec<&'static str>,
    /// What would tell them apart.
    pub next: Option<NextMeasurement>,
    /// Errors left.
    pub unexplained: Unexplained,
    /// Effects and held-out error, from the baseline on.
    pub steps: Vec<Step>,
    /// Effects that this table cannot show.
    pub not_testable: Vec<NotTestable>,
    /// Formulas of the user's own that joined the model.
    pub kept: Vec<KeptEffect>,
    /// What the user ought to know.
    pub notes: Vec<String>,
}

/// Standard deviations below which an accepted effect's own amplitude may be none.
const CLEAR_SIGMAS: f64 = 2.0;

/// Diagnoses a table; `added` effects belong to the model already.
pub fn diagnose(data: &Dataset, added: &[AddedEffect], options: &DiagnoseOptions) -> Diagnosis {
    let wanted = Wanted { most: MOST_ACCEPTED, later: false, wander: None };
    let (mut found, mut accounts) = search(data, added, options, &wanted);
    // What an effect does from exposure to exposure looks like a mount that wanders until it is known.
    let wander = accounts.wander.filter(|wander| found.noise.wander - wander >= LESS_WANDER);
    let wanted = Wanted { wander, ..wanted };
    if let Some(wander) = wander {
        (found, accounts) = search(data, added, options, &wanted);
        found.notes.push(format!(
            "beside what was found exposures follow each other with a correlation of {wander:.2}, not of {:.2}: the tests take the former",
            found.noise.wander
        ));
    }
    let mut about: Option<Dataset> = None;
    for _ in 0..MOST_SEARCHES {
        let effects = accounts.effects.iter().map(|(effect, own)| (*effect, own.as_slice()));
        let Some(mut next) = retraced(about.as_ref().unwrap_or(data), effects) else { break };
        if next.found_coma.is_some() || next.found_gamma.is_some() {
            // Ids of the catalogue: each of them reads.
            let accepted = found.accepted.iter().filter_map(|id| AddedEffect::read(id, data).ok());
            let model: Vec<AddedEffect> = added.iter().cloned().chain(accepted).collect();
            next = settled(&next, &model).0.unwrap_or(next);
        }
        (found, accounts) = search(&next, added, options, &wanted);
        about = Some(next);
    }
    found
}

/// Looks for one effect alone, for models that are made anew with each effect. `later`: others were found before.
pub fn diagnose_step(
    data: &Dataset,
    added: &[AddedEffect],
    options: &DiagnoseOptions,
    later: bool,
) -> Diagnosis {
    search(data, added, options, &Wanted { most: 1, later, wander: None }).0
}

/// How a search is made.
struct Wanted {
    /// Most effects that are accepted.
    most: usize,
    /// Others were found before.
    later: bool,
    /// Correlation of groups that follow each other, where it is known better than from the table by itself.
    wander: Option<f64>,
}

/// Accepted effects with their parameters.
type Effects = Vec<(EffectId, Vec<Parameter>)>;

/// What a search leaves to those that follow.
struct Accounts {
    effects: Effects,
    /// Correlation of groups that follow each other beside the accepted effects; `None` where the table has none, or nothing
    /// was accepted.
    wander: Option<f64>,
}

/// Runs the search, judges what is left, and puts the answer together.
fn search(
    data: &Dataset,
    added: &[AddedEffect],
    options: &DiagnoseOptions,
    wanted: &Wanted,
) -> (Diagnosis, Accounts) {
    let thinned = data.thinned(MOST_ROWS);
    let (scatter, (prepared, not_testable)) =
        rayon::join(|| noise(data), || prepare(thinned.as_ref().unwrap_or(data), added));
    let data = thinned.as_ref().unwrap_or(data);
    let mut notes = data.notes.clone();
    let mut adjusted = crate::added::adjusted(data, added);
    if let Some(noise) = &scatter {
        noise.apply(&mut adjusted.data);
    }
    adjusted.data.wander = wanted.wander.unwrap_or(adjusted.data.wander);
    let given = Arc::new(adjusted.data);
    notes.extend(note_of_runs(&given));
    let baseline = adjusted.base;
    let mut found = Search::new(Arc::clone(&given), &prepared, options, baseline.clone(), wanted.later);
    notes.extend(found.whole_group());
    while found.accepted.len() < wanted.most && found.step() {}

    let (fit, steps) = loop {
        let fit = found.fit();
        let steps = ladder(&found, &baseline, &prepared, &fit.weights);
        let Some(idle) = idle(&steps) else { break (fit, steps) };
        let name = prepared[found.accepted[idle].index].effect.name();
        notes.push(format!(
            "{name} was found and taken out again: beside the others it does not lower the error of what is left out ({:.4} before, {:.4} with it)",
            steps[idle].heldout_rms,
            steps[idle + 1].heldout_rms
        ));
        found.take_out(idle);
    };
    let data = Arc::clone(&found.data);
    let data: &Dataset = &data;
    let noise = Noise::beside(scatter, data, &fit);
    let frame = Frame::with_outliers_cut(data, &found.base, &fit);
    let levels = [found.level(LEVEL_FIRST[1], LEVEL_LATER[1]), LEVEL_LATER[1]];
    let mut unexplained = unexplained(&frame, levels, FLOOR_NOISE, &found.flips);
    let together = Together::of(data, &fit.residual, &fit.weights);
    if let Some(together) = together {
        notes.push(together.note());
        for name in ["x", "y"] {
            if !unexplained.covariates.iter().any(|known| known == name) {
                unexplained.covariates.push(name.to_owned());
            }
        }
    }
    // What another column describes better is there all the same, whether or not a screen sees it.
    let aside = found.put_aside.iter().filter(|_| found.accepted.is_empty());
    for (_, follows) in aside {
        if !unexplained.covariates.contains(&follows.column) {
            unexplained.covariates.push(follows.column.clone());
        }
    }
    let outliers = fit.weights.outlier.iter().filter(|out| **out).count();
    let insufficient = too_little(data, &noise, &fit.weights);
    let verdict = Verdict::of(Findings {
        structure: !unexplained.covariates.is_empty(),
        nothing: found.accepted.is_empty(),
        several: found.sets.iter().any(|set| set.len() > 1)
            || found.accepted.iter().any(|own| own.follows.is_some()),
        outliers: too_many_outliers(data, outliers),
        too_little: insufficient.is_some(),
    });
    notes.extend(crate::noise::lost_groups(data, &fit.weights));
    notes.extend(doubts(data, &noise, &fit.weights));
    let name = |index: usize| prepared[index].effect.name();
    notes.extend(found.put_aside.iter().map(|(index, follows)| follows.in_place_of(name(*index))));
    let beside = |own: &Accepted| Some(own.follows.as_ref()?.as_well_as(name(own.index)));
    notes.extend(found.accepted.iter().filter_map(beside));
    notes.extend(unexplained.weak.as_ref().map(|weak| {
        let within = weak.width_px.map_or_else(String::new, |px| format!(" within {px:.0} {}", data.px_name()));
        format!(
            "neighbours in {}{within} share {:.2} of the noise: a fixed pattern that is real, and too weak to count",
            weak.covariates.join(", "),
            weak.strength
        )
    }));
    let mut next =
        found.sets.iter().zip(&found.accepted).find(|(set, _)| set.len() > 1).and_then(|(set, own)| {
            let members: Vec<&'static Effect> = set.iter().map(|&i| prepared[i].effect).collect();
            propose(data, &fit.weights, prepared[own.index].effect, own.variant, &members)
        });
    if verdict == Verdict::Undecided
        && let Some((why, instead)) = insufficient
    {
        notes.insert(0, format!("undecided: {why}"));
        next = Some(instead);
    }
    let ranking = found.first_ranking.take().unwrap_or_default();
    let mut candidates = candidates(&given, &baseline, &prepared, ranking, &fit.weights, &found.accepted);
    if let Some((index, outlying)) = &found.group {
        let candidate = group_candidate(prepared[*index].effect.name(), outlying, steps[0].heldout_rms);
        let first = found.accepted.first().is_some_and(|a| a.index == *index);
        candidates.insert(if first { 0 } else { candidates.len() }, candidate);
    }
    let mut indistinguishable: Vec<&'static str> = Vec::new();
    for &i in found.sets.iter().flatten() {
        if !indistinguishable.contains(&prepared[i].effect.name()) {
            indistinguishable.push(prepared[i].effect.name());
        }
    }
    let wander = (data.wander > 0.0 && !found.accepted.is_empty())
        .then(|| correlation(data, &fit.residual, &fit.weights));
    let (effects, physical) = quantities(data, &baseline, &prepared, &found.accepted, &fit.weights);
    notes.extend(found.accepted.iter().zip(&physical).filter_map(|(own, physical)| {
        let physical = physical.as_ref().filter(|p| p.value.abs() < CLEAR_SIGMAS * p.sigma)?;
        Some(format!(
            "{}: what is there is not its plain form, whose amplitude is {:.1} standard deviations beside the others: take its figures with care",
            prepared[own.index].effect.name(),
            physical.value.abs() / physical.sigma
        ))
    }));
    notes.extend(form_error::note(data));
    notes.extend(by_default_lenses(data, found.accepted.iter().map(|own| prepared[own.index].effect)));
    let rivals = |(set, own): (&Vec<usize>, &Accepted)| {
        set.iter().filter(|i| **i != own.index).map(|&i| prepared[i].effect.name()).collect()
    };
    let diagnosis = Diagnosis {
        outliers,
        baseline_heldout_rms: steps[0].heldout_rms,
        noise,
        verdict,
        accepted: found.accepted.iter().map(|own| prepared[own.index].effect.name()).collect(),
        rivals: found.sets.iter().zip(&found.accepted).map(rivals).collect(),
        rival_columns: found.accepted.iter().map(|own| Some(own.follows.as_ref()?.column.clone())).collect(),
        physical,
        candidates,
        indistinguishable,
        next,
        unexplained,
        steps,
        not_testable,
        kept: Vec::new(),
        notes,
    };
    (diagnosis, Accounts { effects, wander })
}

/// Says so where an accepted effect was told from its like by lenses that the setup does not name.
fn by_default_lenses(data: &Dataset, mut accepted: impl Iterator<Item = &'static Effect>) -> Option<String> {
    use PointsEffect as E;
    let traced = [
        E::ScreenTilt,
        E::ScreenBow,
        E::CameraPointing,
        E::OpticalCentre,
        E::Decentering,
        E::ThinPrism,
        E::FluxComa,
        E::FluxShift,
    ];
    let of = accepted.find(|effect| traced.iter().any(|id| effect.id == EffectId::Points(*id)))?;
    data.default_lenses.then(|| {
        format!(
            "the setup names no lenses (optics.system): {} was told from a tilt of the display and other effects of the lenses by the default doublets. With other lenses it may be one of those: name yours, or measure again with the camera rolled by 90 deg",
            of.name()
        )
    })
}

/// The last accepted effect whose step does not lower the error of what is left out.
fn idle(steps: &[Step]) -> Option<usize> {
    (1..steps.len()).rev().find(|&k| steps[k].heldout_rms >= steps[k - 1].heldout_rms).map(|k| k - 1)
}

/// The candidate that is one group's own level.
fn group_candidate(effect: &'static str, outlying: &Outlying, heldout_rms: f64) -> Candidate {
    let offset = Parameter { name: "factor_less_1".to_owned(), value: outlying.offset, sigma: None };
    let number = Parameter { name: "series_index".to_owned(), value: outlying.group as f64, sigma: None };
    Candidate {
        effect,
        p_value: outlying.p_value,
        heldout_rms,
        parameters: vec![offset, number],
        implausible: Vec::new(),
    }
}

/// What each accepted effect is on the bench: its leading amplitudes beside the others'.
fn quantities(
    data: &Dataset,
    baseline: &[Vec<f64>],
    prepared: &[Prepared<'_>],
    accepted: &[Accepted],
    weights: &Weights,
) -> (Effects, Vec<Option<Physical>>) {
    let mut columns = baseline.to_vec();
    for own in accepted {
        columns.extend(prepared[own.index].columns[own.variant].iter().cloned());
    }
    let found = estimate(data, &columns, weights);
    let k1 =
        data.baseline_terms().iter().position(|term| term.name == "k1_arcsec").map(|at| found.values[at]);
    let mut at = baseline.len();
    accepted
        .iter()
        .map(|own| {
            let form = &prepared[own.index].variants[own.variant];
            let mut parameters = found.named(at, form.leading.iter().map(|term| term.name.clone()).collect());
            at += form.leading.len();
            for (name, value) in &form.shape {
                parameters.push(Parameter { name: (*name).to_owned(), value: *value, sigma: None });
            }
            let id = prepared[own.index].effect.id;
            let physical = physical(data, id, &parameters, k1);
            ((id, parameters), physical)
        })
        .unzip()
}

/// Held-out error from the baseline on, all under the final weights.
fn ladder(
    found: &Search<'_>,
    baseline: &[Vec<f64>],
    prepared: &[Prepared<'_>],
    weights: &Weights,
) -> Vec<Step> {
    let accepted = &found.accepted;
    let mut base = baseline.to_vec();
    let mut names: Vec<String> = Vec::new();
    // A factor of one series is known to that series alone: rows are left out there, not series.
    let own = accepted.iter().any(|own| prepared[own.index].effect.id == WHOLE_GROUP);
    let held_out = |base: &[Vec<f64>], count: usize| {
        let frame = Frame::weighted(found.data_beside(count), base, weights.clone());
        if own { frame.leaving_out_rows().held_out(&[]) } else { frame.held_out(&[]) }
    };
    let mut out = vec![Step::new(Vec::new(), &held_out(&base, 0))];
    for (before, own) in accepted.iter().enumerate() {
        let mut leading = base.clone();
        leading.extend(prepared[own.index].columns[own.variant].iter().cloned());
        base.extend(own.columns.iter().cloned());
        names.push(prepared[own.index].effect.name().to_owned());
        let (leading, whole) = (held_out(&leading, before + 1), held_out(&base, before + 1));
        out.push(Step::new(names.clone(), if leading.rms < whole.rms { &leading } else { &whole }));
    }
    out
}

fn candidates(
    data: &Dataset,
    baseline: &[Vec<f64>],
    prepared: &[Prepared<'_>],
    ranking: Vec<Ranked>,
    weights: &Weights,
    accepted: &[Accepted],
) -> Vec<Candidate> {
    let beside = Estimator::new(data, baseline, weights);
    let mut out: Vec<Candidate> = ranking
        .into_par_iter()
        .map(|ranked| {
            let form = &prepared[ranked.index];
            let own = accepted.iter().find(|own| own.index == ranked.index);
            let leading = &form.variants[ranked.variant].leading;
            let names = leading.iter().map(|term| term.name.clone()).collect();
            let mut parameters = beside.with(&form.columns[ranked.variant]).named(baseline.len(), names);
            let ranges = leading.iter().map(|term| term.plausible);
            let implausible = implausible(parameters.iter().zip(ranges));
            for (name, value) in &form.variants[ranked.variant].shape {
                parameters.push(Parameter { name: (*name).to_owned(), value: *value, sigma: None });
            }
            if ranked.refined {
                parameters.push(Parameter { name: "shape_refined".to_owned(), value: 1.0, sigma: None });
            }
            Candidate {
                effect: form.effect.name(),
                p_value: own.map_or(ranked.p_value, |own| own.p_value),
                heldout_rms: ranked.held_out.rms,
                parameters,
                implausible,
            }
        })
        .collect();
    // What was accepted first leads the list, also where it is a hair behind one that was no better in the end.
    if let Some(first) = accepted.first() {
        out.sort_by_key(|candidate| candidate.effect != prepared[first.index].effect.name());
    }
    out
}
