//! Which candidate is best, and which ones these data cannot tell from it.

use rayon::prelude::*;

use crate::catalogue::Variant;
use crate::estimate::is_implausible;
use crate::flips::{Flips, PARAMETRIC, p_values};
use crate::levels;
use crate::noise::steady_columns;
use crate::score::{Frame, HeldOut, Score};
use crate::search::{CLEARLY_WORSE, LEVEL_LATER, Prepared, REFINED};
use crate::units::VERY_FEW_GROUPS;

/// A competitor stays in the set while the best effect adds nothing to it at this level.
const LEVEL_SET: f64 = 0.02;
/// Level below which one may be named in place of a significant one that it clearly beats on groups left out.
const LEVEL_RIVAL: f64 = 0.1;
/// A rival explains what the best effect does if it leaves less than this part of it.
const PART_OF_BEST: f64 = 0.05;
/// Standard errors of the held-out error by which an effect has to be better before the groups' levels are asked, and most
/// that are.
const PROMISING: f64 = 1.0;
const MOST_ASKED: usize = 6;
/// More shapes than this are a search.
const SEARCHED: usize = 12;

/// A candidate beside a base.
pub(crate) struct Ranked {
    pub(crate) index: usize,
    pub(crate) variant: usize,
    pub(crate) p_value: f64,
    pub(crate) strength: f64,
    pub(crate) held_out: HeldOut,
    pub(crate) refined: bool,
    /// Columns of the form, and one more where it was searched for among many.
    pub(crate) columns: usize,
    /// An amplitude is beyond what is plausible.
    pub(crate) implausible: bool,
}

/// All candidates with p-values and held-out errors, best first.
pub(crate) fn rank(
    frame: &Frame<'_>,
    base: &[Vec<f64>],
    prepared: &[Prepared<'_>],
    excluded: &[bool],
    flips: &Flips,
) -> Vec<Ranked> {
    let open: Vec<usize> = (0..prepared.len()).filter(|&i| !excluded[i]).collect();
    let forms: Vec<&Vec<Vec<f64>>> = open.iter().flat_map(|&i| &prepared[i].columns).collect();
    let mut all = frame.scores(&forms).into_iter();
    let scores: Vec<Vec<Score>> =
        open.iter().map(|&i| all.by_ref().take(prepared[i].columns.len()).collect()).collect();
    let borrowed: Vec<Vec<&Score>> = scores.iter().map(|variants| variants.iter().collect()).collect();
    let p = p_values(&borrowed, flips);
    frame.make_folds();
    let mut out: Vec<Ranked> = open
        .par_iter()
        .zip(&scores)
        .zip(&p)
        .filter_map(|((&index, scores), &p_value)| {
            let forms = &prepared[index].variants;
            let deviates: Vec<f64> = scores.iter().map(Score::deviate).collect();
            let (variant, implausible) = likeliest(frame, forms, &prepared[index].columns, &deviates)?;
            let (form, score) = (&forms[variant], &scores[variant]);
            let leading = frame.held_out(&prepared[index].columns[variant]);
            let mut better = false;
            let mut held_out = leading;
            // Further columns mend a form. Where its own amplitude cannot be, they would stand in for it.
            if !form.further.is_empty() && !implausible {
                let refined = frame.held_out(&prepared[index].whole(frame.data, variant));
                better = held_out.beaten_by(&refined) > REFINED;
                if better {
                    held_out = refined;
                }
            }
            let strength = score.strength(frame.components());
            let columns = form.leading.len()
                + if better { form.further.len() } else { 0 }
                + usize::from(prepared[index].variants.len() > SEARCHED);
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
    if levels::few_groups(frame.data) {
        ask_levels(frame, base, prepared, &mut out, forms.len());
    }
    out
}

/// p-values by the groups' levels, of the few effects that promise most on what is left out. Where flips do not tell an
/// effect they may; where flips may take a wandering of few groups for an effect of whole groups, they have to agree.
fn ask_levels(
    frame: &Frame<'_>,
    base: &[Vec<f64>],
    prepared: &[Prepared<'_>],
    ranking: &mut [Ranked],
    forms: usize,
) {
    let before = frame.held_out(&[]);
    // Of some dozen groups nobody knows how closely they follow each other.
    let unsure = frame.data.groups.len() <= VERY_FEW_GROUPS || frame.data.wander > 0.0;
    let promising = ranking.iter_mut().filter(|r| before.beaten_by(&r.held_out) > PROMISING).take(MOST_ASKED);
    promising.par_bridge().for_each(|r| {
        let columns = &prepared[r.index].columns[r.variant];
        let doubted = unsure && columns.len() == steady_columns(frame.data, columns);
        if r.p_value <= LEVEL_LATER[0] && !doubted {
            return;
        }
        let own = forms as f64 * levels::p_value(frame.data, base, columns);
        r.p_value = r.p_value.min(PARAMETRIC * own);
        if doubted {
            r.p_value = r.p_value.max(own.min(1.0));
        }
    });
}

/// The one that is worth its name, with the fewest columns of those whose held-out error is within a standard error of
/// the least (L. Breiman et al., Classification and Regression Trees, 1984, sec. 3.4.3). One that does not lower
/// the held-out error below `before` is none. That there is something is for the significant ones to say; which one it is may
/// be one whose p-value few groups keep large, if it is clearly better on groups left out. One whose amplitude cannot be
/// comes after all of equal merit.
pub(crate) fn pick<'r>(
    ranking: &'r [Ranked],
    level: f64,
    floor: f64,
    before: &HeldOut,
) -> Option<&'r Ranked> {
    let better = |r: &&Ranked| r.strength >= floor && before.beaten_by(&r.held_out) > 0.0;
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

/// The likeliest of an effect's forms whose amplitude can be, else of all, and whether it is such a one.
pub(crate) fn likeliest(
    frame: &Frame<'_>,
    forms: &[Variant<'_>],
    columns: &[Vec<Vec<f64>>],
    deviates: &[f64],
) -> Option<(usize, bool)> {
    let mut order: Vec<usize> = (0..forms.len()).collect();
    order.sort_by(|&a, &b| deviates[b].total_cmp(&deviates[a]));
    let found = order.iter().copied().find(|&k| !beyond(frame, &forms[k], &columns[k]));
    Some((found.or_else(|| order.first().copied())?, found.is_none()))
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
pub(crate) fn confusable(
    frame: &Frame<'_>,
    base: &[Vec<f64>],
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
    // What nothing real has is no rival of what something has.
    let real = |r: &Ranked| best.implausible || !r.implausible;
    let rivals: Vec<&Ranked> = ranking
        .iter()
        .filter(|r| r.index != best.index && r.p_value <= level && !searched(r) && real(r))
        .collect();
    let kept: Vec<bool> = rivals
        .par_iter()
        .map(|rival| {
            let (own, other) = (
                &prepared[best.index].columns[best.variant],
                prepared[rival.index].whole(frame.data, rival.variant),
            );
            let beside = frame.with(&other);
            let score = beside.score(own);
            let by_levels = || {
                let base: Vec<Vec<f64>> = base.iter().chain(&other).cloned().collect();
                PARAMETRIC * levels::p_value(frame.data, &base, own)
            };
            // Of what one ordinary campaign cannot separate it has to be clearly worse.
            let class = prepared[best.index].effect.class.contains(&prepared[rival.index].effect.id);
            (class && rival.held_out.beaten_by(&best.held_out) <= CLEARLY_WORSE)
                || score.rank() == 0
                || score.strength(beside.components()) < PART_OF_BEST * best.strength
                || (p_values(&[vec![&score]], flips)[0] > LEVEL_SET
                    && !(levels::few_groups(frame.data) && by_levels() <= LEVEL_SET))
        })
        .collect();
    out.extend(rivals.iter().zip(&kept).filter(|(_, kept)| **kept).map(|(rival, _)| rival.index));
    out
}
