//! Which effect is missing: candidates tested, ranked, accepted one by one, until nothing is left to explain.

use rayon::prelude::*;
use retina_formats::{EffectId, PowerEffect};

use crate::added::AddedEffect;
use crate::catalogue::{Effect, Variant, effects};
use crate::data::Dataset;
use crate::estimate::{Implausible, Parameter, estimate, implausible, is_implausible};
use crate::next::{NextMeasurement, propose};
use crate::noise::Weights;
use crate::score::{Flips, Frame, HeldOut, Score, p_values};
use crate::series::{Outlying, outlying};
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

/// Level of the first test over all effects, and over all screens: together below 5 %.
const LEVEL_FIRST: [f64; 2] = [0.02, 0.01];
/// Level of later ones.
const LEVEL_LATER: [f64; 2] = [0.01, 0.005];
/// A competitor stays in the set while the best effect adds nothing to it at this level.
const LEVEL_SET: f64 = 0.02;
/// Standard errors by which groups left out may be worse with an effect: what one group alone shows is told by no other,
/// and counts for one standard error.
const WORSE: f64 = 1.5;
/// Level below which one may be named in place of a significant one that it clearly beats on groups left out.
const LEVEL_RIVAL: f64 = 0.1;
/// Standard errors of the held-out error by which a form has to be better with its further columns.
pub(crate) const REFINED: f64 = 1.0;
/// Standard errors by which a rival of the same class is worse when it is left out of the set.
const CLEARLY_WORSE: f64 = 2.5;
/// An effect or structure weaker than this, rms over noise, is not reported.
const FLOOR_NOISE: f64 = 0.025;
/// Nor is one weaker than this part of what was accepted: forms are leading ones.
const FLOOR_ACCEPTED: f64 = 0.05;
/// Rows that are searched and screened: their columns take about half a gigabyte.
pub(crate) const MOST_ROWS: usize = 50_000;
/// The effect that is a whole group's own, and the level of its test; its forms are in the groups' order.
pub(crate) const WHOLE_GROUP: EffectId = EffectId::Power(PowerEffect::AttenuatorNotChanged);
const LEVEL_GROUP: f64 = 0.005;
/// A label that is wrong is a factor of 2 and more; a tenth of that may be a series' own error.
const FLOOR_GROUP: f64 = 0.1;
/// More shapes than this are a search.
const SEARCHED: usize = 12;
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

/// An effect with its forms' columns.
struct Prepared<'a> {
    effect: &'static Effect,
    variants: Vec<Variant<'a>>,
    columns: Vec<Vec<Vec<f64>>>,
}

impl Prepared<'_> {
    /// Leading and further columns of a form.
    fn whole(&self, data: &Dataset, variant: usize) -> Vec<Vec<f64>> {
        let mut out = self.columns[variant].clone();
        out.extend(self.variants[variant].further.iter().map(|term| data.column(term)));
        out
    }
}

struct Ranked {
    index: usize,
    variant: usize,
    p_value: f64,
    strength: f64,
    held_out: HeldOut,
    refined: bool,
    /// Columns of the form, and one more where it was searched for among many.
    columns: usize,
    /// An amplitude is beyond what is plausible.
    implausible: bool,
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
    if data.groups.len() < 8 {
        notes.push(format!(
            "{} groups can be flipped in {} ways: no p-value below {:.3} is possible; measure more {}",
            data.groups.len(),
            1u64 << data.groups.len().saturating_sub(1),
            1.0 / f64::from(1u32 << data.groups.len().saturating_sub(1)),
            if data.components() == 2 { "exposures" } else { "series" }
        ));
    }
    let baseline: Vec<Vec<f64>> = adjusted.base.clone();
    let mut base = baseline.clone();
    let mut accepted: Vec<(usize, usize)> = Vec::new();
    let mut sets: Vec<Vec<usize>> = Vec::new();
    let mut excluded = vec![false; prepared.len()];
    let mut strength = before.unwrap_or(0.0);
    let mut first_ranking: Option<Vec<Ranked>> = None;
    let group = whole_group(data, &base, &prepared);
    if let Some((index, found)) = group {
        excluded[index] = true;
        if found.p_value <= LEVEL_GROUP && found.offset.abs() >= FLOOR_GROUP {
            notes.push(format!(
                "series `{}` is off by a factor of {:.3} (Grubbs' test of the series' levels); nothing tells its factor while it is left out, so that held-out errors do not fall",
                data.groups[found.group].name,
                1.0 + found.offset
            ));
            base.extend(prepared[index].whole(data, found.group));
            accepted.push((index, found.group));
            sets.push(vec![index]);
        }
    }
    while accepted.len() < most {
        let level = if accepted.is_empty() && before.is_none() { LEVEL_FIRST[0] } else { LEVEL_LATER[0] };
        let floor = FLOOR_NOISE.max(FLOOR_ACCEPTED * strength);
        let frame = Frame::fitted(data, &base);
        let ranking = rank(&frame, &prepared, &excluded, &flips);
        // An unexplained effect that groups have in common is taken for jitter at first, and looks weak beside it.
        let best = pick(&ranking, level, 0.0, &frame.held_out(&[]));
        let Some(best) = best else {
            first_ranking.get_or_insert(ranking);
            break;
        };
        // Noise and jitter once more, without what the best effect explains.
        let mut with_best = base.clone();
        with_best.extend(prepared[best.index].whole(data, best.variant));
        let weights = Frame::fitted(data, &with_best).weights;
        let frame = Frame::weighted(data, &base, weights);
        let ranking = rank(&frame, &prepared, &excluded, &flips);
        let Some(best) = pick(&ranking, level, floor, &frame.held_out(&[])) else {
            first_ranking.get_or_insert(ranking);
            break;
        };
        let (index, variant) = (best.index, best.variant);
        let set = confusable(&frame, &prepared, &ranking, best, level, &flips);
        strength = f64::hypot(strength, best.strength);
        base.extend(prepared[index].whole(data, variant));
        accepted.push((index, variant));
        excluded[index] = true;
        for &member in &set {
            excluded[member] = true;
        }
        sets.push(set);
        first_ranking.get_or_insert(ranking);
    }

    let fit = crate::noise::robust_fit(data, &base);
    let noise_floor = crate::neighbours::floor(data, &fit).unwrap_or_else(|| fit.weights.floor());
    let frame = Frame::weighted(data, &base, fit.weights);
    let level = if accepted.is_empty() && before.is_none() { LEVEL_FIRST[1] } else { LEVEL_LATER[1] };
    let unexplained = unexplained(
        data,
        base.clone(),
        [level, LEVEL_LATER[1]],
        FLOOR_NOISE.max(FLOOR_ACCEPTED * strength),
        &flips,
    );
    let outliers = frame.weights.outlier.iter().filter(|out| **out).count();
    let several = sets.iter().any(|set| set.len() > 1);
    let verdict = Verdict::of(
        !unexplained.covariates.is_empty(),
        accepted.is_empty(),
        several,
        too_many_outliers(data, outliers),
    );
    notes.extend(crate::noise::lost_groups(data, &frame.weights));
    let steps = ladder(data, &baseline, &prepared, &accepted, &frame.weights);
    let next =
        sets.iter().zip(&accepted).find(|(set, _)| set.len() > 1).and_then(|(set, &(index, variant))| {
            let members: Vec<&'static Effect> = set.iter().map(|&i| prepared[i].effect).collect();
            propose(data, &frame.weights, prepared[index].effect, variant, &members)
        });
    let mut candidates =
        candidates(data, &baseline, &prepared, first_ranking.unwrap_or_default(), &frame.weights, &accepted);
    if let Some((index, found)) = group {
        let offset = Parameter { name: "factor_less_1".to_owned(), value: found.offset, sigma: None };
        let number = Parameter { name: "series_number".to_owned(), value: found.group as f64, sigma: None };
        let candidate = Candidate {
            effect: prepared[index].effect.name(),
            p_value: found.p_value,
            heldout_rms: steps[0].heldout_rms,
            parameters: vec![offset, number],
            implausible: Vec::new(),
        };
        let first = accepted.first().is_some_and(|a| a.0 == index);
        candidates.insert(if first { 0 } else { candidates.len() }, candidate);
    }
    let mut indistinguishable: Vec<&'static str> = Vec::new();
    for &i in sets.iter().flatten() {
        if !indistinguishable.contains(&prepared[i].effect.name()) {
            indistinguishable.push(prepared[i].effect.name());
        }
    }
    Diagnosis {
        outliers,
        baseline_heldout_rms: steps[0].heldout_rms,
        noise_floor,
        verdict,
        accepted: accepted.iter().map(|&(i, _)| prepared[i].effect.name()).collect(),
        candidates,
        indistinguishable,
        next,
        unexplained,
        steps,
        not_testable,
        notes,
    }
}

/// Effects of the table with their columns, and those it cannot show.
fn prepare<'a>(data: &'a Dataset, added: &[AddedEffect]) -> (Vec<Prepared<'a>>, Vec<NotTestable>) {
    let (mut prepared, mut not) = (Vec::new(), Vec::new());
    for effect in effects(Some(data.kind)) {
        if added.iter().any(|a| matches!(a, AddedEffect::Catalogued(e) if e.id == effect.id)) {
            continue;
        }
        match effect.build(data) {
            Ok(variants) => {
                let columns: Vec<Vec<Vec<f64>>> = variants
                    .par_iter()
                    .map(|variant| variant.leading.iter().map(|term| data.column(term)).collect())
                    .collect();
                prepared.push(Prepared { effect, variants, columns });
            }
            Err(reason) => not.push(NotTestable { effect: effect.name(), reason }),
        }
    }
    (prepared, not)
}

/// The effect whose forms are one group each, with the group whose level is most off.
fn whole_group(data: &Dataset, base: &[Vec<f64>], prepared: &[Prepared<'_>]) -> Option<(usize, Outlying)> {
    let index = prepared.iter().position(|p| p.effect.id == WHOLE_GROUP)?;
    let error = crate::noise::robust_fit(data, base).residual;
    Some((index, outlying(data, &error)?))
}

/// All candidates with p-values and held-out errors, best first.
fn rank(frame: &Frame<'_>, prepared: &[Prepared<'_>], excluded: &[bool], flips: &Flips) -> Vec<Ranked> {
    let open: Vec<usize> = (0..prepared.len()).filter(|&i| !excluded[i]).collect();
    let forms: Vec<&Vec<Vec<f64>>> = open.iter().flat_map(|&i| &prepared[i].columns).collect();
    let mut all = frame.scores(&forms).into_iter();
    let scores: Vec<Vec<Score>> =
        open.iter().map(|&i| all.by_ref().take(prepared[i].columns.len()).collect()).collect();
    let borrowed: Vec<Vec<&Score>> = scores.iter().map(|variants| variants.iter().collect()).collect();
    let p = p_values(&borrowed, flips);
    let mut out: Vec<Ranked> = open
        .par_iter()
        .zip(&scores)
        .zip(&p)
        .filter_map(|((&index, scores), &p_value)| {
            let (variant, score) =
                scores.iter().enumerate().max_by(|a, b| a.1.deviate().total_cmp(&b.1.deviate()))?;
            let leading = frame.held_out(&prepared[index].columns[variant]);
            let mut better = false;
            let mut held_out = leading;
            if !prepared[index].variants[variant].further.is_empty() {
                let refined = frame.held_out(&prepared[index].whole(frame.data, variant));
                better = held_out.beaten_by(&refined) > REFINED;
                if better {
                    held_out = refined;
                }
            }
            let strength = score.strength(frame.components());
            let form = &prepared[index].variants[variant];
            let columns = form.leading.len()
                + if better { form.further.len() } else { 0 }
                + usize::from(prepared[index].variants.len() > SEARCHED);
            let implausible = beyond(frame, form, &prepared[index].columns[variant]);
            Some(Ranked {
                index,
                variant,
                p_value,
                strength,
                held_out,
                refined: better,
                columns,
                implausible,
            })
        })
        .collect();
    out.sort_by(|a, b| a.held_out.total().total_cmp(&b.held_out.total()));
    out
}

/// The one that is worth its name, with the fewest columns of those whose held-out error is within a standard error of
/// the least (L. Breiman et al., Classification and Regression Trees, 1984, sec. 3.4.3). One that makes the held-out
/// error clearly larger than `before` is none. That there is something is for the significant ones to say; which one it is may
/// be one whose p-value few groups keep large, if it is clearly better on groups left out. One whose amplitude cannot be
/// comes after all of equal merit.
fn pick<'r>(ranking: &'r [Ranked], level: f64, floor: f64, before: &HeldOut) -> Option<&'r Ranked> {
    let better = |r: &&Ranked| r.strength >= floor && r.held_out.beaten_by(before) <= WORSE;
    let significant = || ranking.iter().filter(|r| r.p_value <= level).filter(better);
    let least = significant().next()?;
    let rival = ranking.iter().filter(|r| r.p_value <= LEVEL_RIVAL && !r.implausible).find(better);
    if let Some(rival) = rival
        && least.held_out.beaten_by(&rival.held_out) > CLEARLY_WORSE
    {
        return Some(rival);
    }
    significant()
        .filter(|r| r.held_out.beaten_by(&least.held_out) <= 1.0)
        .min_by_key(|r| (r.implausible, r.columns))
}

/// Whether a form would need an amplitude beyond what is plausible.
fn beyond(frame: &Frame<'_>, form: &Variant<'_>, columns: &[Vec<f64>]) -> bool {
    if form.leading.iter().all(|term| term.plausible.is_none()) {
        return false;
    }
    let parameters = frame.amplitudes(columns);
    form.leading.iter().zip(parameters).any(|(term, (value, sigma))| {
        term.plausible.is_some_and(|range| is_implausible(value, Some(sigma), range))
    })
}

/// Candidates beside which the best effect adds nothing: their forms are taken whole, so that a leading form's own
/// mismatch does not count against them.
fn confusable(
    frame: &Frame<'_>,
    prepared: &[Prepared<'_>],
    ranking: &[Ranked],
    best: &Ranked,
    level: f64,
    flips: &Flips,
) -> Vec<usize> {
    let mut out = vec![best.index];
    // A form searched over many shapes can be as near to a simple one as its shapes are dense: it has to do better.
    let searched = |r: &Ranked| {
        prepared[r.index].variants.len() > SEARCHED && r.held_out.total() >= best.held_out.total()
    };
    let rivals: Vec<&Ranked> =
        ranking.iter().filter(|r| r.index != best.index && r.p_value <= level && !searched(r)).collect();
    let kept: Vec<bool> = rivals
        .par_iter()
        .map(|rival| {
            let beside = frame.with(&prepared[rival.index].whole(frame.data, rival.variant));
            let score = beside.score(&prepared[best.index].columns[best.variant]);
            // Of what one ordinary campaign cannot separate it has to be clearly worse.
            let class = prepared[best.index].effect.class.contains(&prepared[rival.index].effect.id);
            (class && rival.held_out.beaten_by(&best.held_out) <= CLEARLY_WORSE)
                || score.rank() == 0
                || score.strength(beside.components()) < FLOOR_ACCEPTED * best.strength
                || p_values(&[vec![&score]], flips)[0] > LEVEL_SET
        })
        .collect();
    out.extend(rivals.iter().zip(&kept).filter(|(_, kept)| **kept).map(|(rival, _)| rival.index));
    out
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
