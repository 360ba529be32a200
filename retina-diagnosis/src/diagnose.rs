//! Which effect is missing: candidates tested, ranked, accepted one by one, until nothing is left to explain.

use crate::added::AddedEffect;
use crate::catalogue::Effect;
use crate::data::Dataset;
use crate::estimate::{Implausible, Parameter, estimate, implausible};
use crate::next::{NextMeasurement, propose};
use crate::noise::Weights;
use crate::score::{Flips, Frame};
use crate::search::{LEVEL_FIRST, LEVEL_LATER, MOST_ROWS, Prepared, Ranked, Search, prepare};
use crate::series::Outlying;
use crate::step::Step;
use crate::unexplained::{Unexplained, unexplained};
use crate::verdict::{Verdict, too_many_outliers};

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
    /// What no model can undercut.
    pub noise_floor: f64,
    /// The outcome.
    pub verdict: Verdict,
    /// Effects accepted, in their order.
    pub accepted: Vec<&'static str>,
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
    /// What the user ought to know.
    pub notes: Vec<String>,
}

/// Diagnoses a table; `added` effects belong to the model already.
pub fn diagnose(data: &Dataset, added: &[AddedEffect], options: &DiagnoseOptions) -> Diagnosis {
    search(data, added, options, MOST_ACCEPTED, None)
}

/// Looks for one effect alone, for models that are made anew with each effect. `before` is the strength of those found
/// so far, rms over noise.
pub fn diagnose_step(
    data: &Dataset,
    added: &[AddedEffect],
    options: &DiagnoseOptions,
    before: Option<f64>,
) -> Diagnosis {
    search(data, added, options, 1, before)
}

/// Runs the search, judges what is left, and puts the answer together.
fn search(
    data: &Dataset,
    added: &[AddedEffect],
    options: &DiagnoseOptions,
    most: usize,
    before: Option<f64>,
) -> Diagnosis {
    let thinned = data.thinned(MOST_ROWS);
    let data = thinned.as_ref().unwrap_or(data);
    let mut notes = data.notes.clone();
    let (prepared, not_testable) = prepare(data, added);
    let adjusted = crate::added::adjusted(data, added);
    let data = &adjusted.data;
    let flips = Flips::draw(data, options.flips, options.seed);
    notes.extend(few_groups(data));
    let baseline: Vec<Vec<f64>> = adjusted.base.clone();
    let mut found = Search::new(data, &prepared, &flips, baseline.clone(), before);
    notes.extend(found.whole_group());
    while found.accepted.len() < most && found.step() {}

    let fit = crate::noise::robust_fit(data, &found.base);
    let noise_floor = crate::neighbours::floor(data, &fit).unwrap_or_else(|| fit.weights.floor());
    let frame = Frame::weighted(data, &found.base, fit.weights);
    let levels = [found.level(LEVEL_FIRST[1], LEVEL_LATER[1]), LEVEL_LATER[1]];
    let unexplained = unexplained(data, found.base.clone(), levels, found.floor(), &flips);
    let outliers = frame.weights.outlier.iter().filter(|out| **out).count();
    let verdict = Verdict::of(
        !unexplained.covariates.is_empty(),
        found.accepted.is_empty(),
        found.sets.iter().any(|set| set.len() > 1),
        too_many_outliers(data, outliers),
    );
    notes.extend(crate::noise::lost_groups(data, &frame.weights));
    let steps = ladder(data, &baseline, &prepared, &found.accepted, &frame.weights);
    let next = found.sets.iter().zip(&found.accepted).find(|(set, _)| set.len() > 1).and_then(
        |(set, &(index, variant))| {
            let members: Vec<&'static Effect> = set.iter().map(|&i| prepared[i].effect).collect();
            propose(data, &frame.weights, prepared[index].effect, variant, &members)
        },
    );
    let ranking = found.first_ranking.take().unwrap_or_default();
    let mut candidates = candidates(data, &baseline, &prepared, ranking, &frame.weights, &found.accepted);
    if let Some((index, outlying)) = &found.group {
        let candidate = group_candidate(prepared[*index].effect.name(), outlying, steps[0].heldout_rms);
        let first = found.accepted.first().is_some_and(|a| a.0 == *index);
        candidates.insert(if first { 0 } else { candidates.len() }, candidate);
    }
    let mut indistinguishable: Vec<&'static str> = Vec::new();
    for &i in found.sets.iter().flatten() {
        if !indistinguishable.contains(&prepared[i].effect.name()) {
            indistinguishable.push(prepared[i].effect.name());
        }
    }
    Diagnosis {
        outliers,
        baseline_heldout_rms: steps[0].heldout_rms,
        noise_floor,
        verdict,
        accepted: found.accepted.iter().map(|&(i, _)| prepared[i].effect.name()).collect(),
        candidates,
        indistinguishable,
        next,
        unexplained,
        steps,
        not_testable,
        notes,
    }
}

/// Says that few groups allow no small p-value.
fn few_groups(data: &Dataset) -> Option<String> {
    let groups = data.groups.len();
    (groups < 8).then(|| {
        let ways = 1u64 << groups.saturating_sub(1);
        format!(
            "{groups} groups can be flipped in {ways} ways: no p-value below {:.3} is possible; measure more {}",
            1.0 / ways as f64,
            if data.components() == 2 { "exposures" } else { "series" }
        )
    })
}

/// The candidate that is one group's own level.
fn group_candidate(effect: &'static str, outlying: &Outlying, heldout_rms: f64) -> Candidate {
    let offset = Parameter { name: "factor_less_1".to_owned(), value: outlying.offset, sigma: None };
    let number = Parameter { name: "series_number".to_owned(), value: outlying.group as f64, sigma: None };
    Candidate {
        effect,
        p_value: outlying.p_value,
        heldout_rms,
        parameters: vec![offset, number],
        implausible: Vec::new(),
    }
}

/// Held-out error from the baseline on, all under the final weights.
fn ladder(
    data: &Dataset,
    baseline: &[Vec<f64>],
    prepared: &[Prepared<'_>],
    accepted: &[(usize, usize)],
    weights: &Weights,
) -> Vec<Step> {
    let mut base = baseline.to_vec();
    let mut names: Vec<String> = Vec::new();
    let held_out = |base: &[Vec<f64>]| Frame::weighted(data, base, weights.clone()).held_out(&[]);
    let mut out = vec![Step::new(Vec::new(), &held_out(&base))];
    for &(index, variant) in accepted {
        let mut leading = base.clone();
        leading.extend(prepared[index].columns[variant].iter().cloned());
        base.extend(prepared[index].whole(data, variant));
        names.push(prepared[index].effect.name().to_owned());
        let (leading, whole) = (held_out(&leading), held_out(&base));
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
    accepted: &[(usize, usize)],
) -> Vec<Candidate> {
    let mut out: Vec<Candidate> = ranking
        .into_iter()
        .map(|ranked| {
            let form = &prepared[ranked.index];
            let mut columns = baseline.to_vec();
            columns.extend(form.columns[ranked.variant].iter().cloned());
            let leading = &form.variants[ranked.variant].leading;
            let names = leading.iter().map(|term| term.name.clone()).collect();
            let mut parameters = estimate(data, &columns, weights).named(baseline.len(), names);
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
                p_value: ranked.p_value,
                heldout_rms: ranked.held_out.rms,
                parameters,
                implausible,
            }
        })
        .collect();
    // What was accepted first leads the list, also where it is a hair behind one that was no better in the end.
    if let Some(&(index, _)) = accepted.first() {
        out.sort_by_key(|candidate| candidate.effect != prepared[index].effect.name());
    }
    out
}
