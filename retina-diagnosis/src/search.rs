//! The search of the diagnosis: effects are accepted one after the other, each by sign-flips of whole groups, and judged
//! beside those accepted before.

use std::collections::VecDeque;

use rayon::prelude::*;
use retina_formats::{EffectId, PowerEffect};

use crate::added::AddedEffect;
use crate::catalogue::{Effect, Variant, effects, of_other_lenses, wide};
use crate::data::Dataset;
use crate::diagnose::NotTestable;
use crate::estimate::is_implausible;
use crate::flips::{Flips, PARAMETRIC, p_values};
use crate::levels;
use crate::noise::{RobustFit, robust_fit, steady_columns};
use crate::other_columns::Follows;
use crate::score::{Frame, HeldOut, Score};
use crate::series::{Outlying, outlying};
use crate::units::VERY_FEW_GROUPS;

/// Level of the first test over all effects, and over all screens: together below 5 %.
pub(crate) const LEVEL_FIRST: [f64; 2] = [0.02, 0.01];
/// Level of later ones.
pub(crate) const LEVEL_LATER: [f64; 2] = [0.01, 0.005];
/// A competitor stays in the set while the best effect adds nothing to it at this level.
const LEVEL_SET: f64 = 0.02;
/// Level below which one may be named in place of a significant one that it clearly beats on groups left out.
const LEVEL_RIVAL: f64 = 0.1;
/// Standard errors of the held-out error by which a form has to be better with its further columns.
pub(crate) const REFINED: f64 = 1.0;
/// Standard errors by which a rival of the same class is worse when it is left out of the set.
const CLEARLY_WORSE: f64 = 2.5;
/// An effect or structure weaker than this, rms over noise, is not reported.
pub(crate) const FLOOR_NOISE: f64 = 0.025;
/// A rival explains what the best effect does if it leaves less than this part of it.
const PART_OF_BEST: f64 = 0.05;
/// Rows that are searched and screened: their columns take about half a gigabyte.
pub(crate) const MOST_ROWS: usize = 50_000;
/// The effect that is a whole group's own, and the level of its test; its forms are in the groups' order.
pub(crate) const WHOLE_GROUP: EffectId = EffectId::Power(PowerEffect::AttenuatorNotChanged);
const LEVEL_GROUP: f64 = 0.005;
/// A label that is wrong is a factor of 2 and more; a tenth of that may be a series' own error.
const FLOOR_GROUP: f64 = 0.1;
/// Standard errors of the held-out error by which an effect has to be better before the groups' levels are asked, and most
/// that are.
const PROMISING: f64 = 1.0;
const MOST_ASKED: usize = 6;
/// More shapes than this are a search.
const SEARCHED: usize = 12;

/// An effect with its forms' columns.
pub(crate) struct Prepared<'a> {
    pub(crate) effect: &'static Effect,
    pub(crate) variants: Vec<Variant<'a>>,
    pub(crate) columns: Vec<Vec<Vec<f64>>>,
}

impl Prepared<'_> {
    /// Leading and further columns of a form.
    pub(crate) fn whole(&self, data: &Dataset, variant: usize) -> Vec<Vec<f64>> {
        let mut out = self.columns[variant].clone();
        out.extend(self.variants[variant].further.iter().map(|term| data.column(term)));
        out
    }

    /// Second orders and other shapes of its own.
    fn wide(&self, data: &Dataset, variant: usize) -> Vec<Vec<f64>> {
        wide(data, self.effect.id, &self.variants[variant].shape)
    }
}

/// An accepted effect.
pub(crate) struct Accepted {
    /// Its number among those that are prepared, and that of its form.
    pub(crate) index: usize,
    pub(crate) variant: usize,
    /// What was taken out with it.
    pub(crate) columns: Vec<Vec<f64>>,
    /// Whether second orders of its own were needed.
    widened: bool,
    /// Another column that may be behind it as well.
    pub(crate) follows: Option<Follows>,
}

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

/// Robust fits that were asked for last: a step's last fit is the next one's first.
struct Fits<'a> {
    data: &'a Dataset,
    kept: VecDeque<(Vec<Vec<f64>>, RobustFit)>,
}

/// Fits that are kept.
const KEPT_FITS: usize = 2;

impl Fits<'_> {
    fn of(&mut self, columns: &[Vec<f64>]) -> &RobustFit {
        let at = self.kept.iter().position(|(own, _)| own == columns).unwrap_or_else(|| {
            self.kept.truncate(KEPT_FITS - 1);
            self.kept.push_front((columns.to_vec(), robust_fit(self.data, columns)));
            0
        });
        &self.kept[at].1
    }
}

/// What was accepted so far.
pub(crate) struct Search<'a> {
    data: &'a Dataset,
    fits: Fits<'a>,
    prepared: &'a [Prepared<'a>],
    flips: &'a Flips,
    /// Whether something was found before the search.
    later: bool,
    excluded: Vec<bool>,
    /// Columns of the baseline and of the accepted effects.
    pub(crate) base: Vec<Vec<f64>>,
    /// Accepted effects.
    pub(crate) accepted: Vec<Accepted>,
    /// For each of them, those that these data cannot tell from it.
    pub(crate) sets: Vec<Vec<usize>>,
    /// All candidates beside the baseline.
    pub(crate) first_ranking: Option<Vec<Ranked>>,
    /// The effect that is one group's own, with that group.
    pub(crate) group: Option<(usize, Outlying)>,
    /// Effects that are not what happened, since what they explain follows another column.
    pub(crate) put_aside: Vec<(usize, Follows)>,
}

impl<'a> Search<'a> {
    pub(crate) fn new(
        data: &'a Dataset,
        prepared: &'a [Prepared<'a>],
        flips: &'a Flips,
        base: Vec<Vec<f64>>,
        later: bool,
    ) -> Self {
        Self {
            data,
            fits: Fits { data, kept: VecDeque::new() },
            prepared,
            flips,
            later,
            excluded: vec![false; prepared.len()],
            base,
            accepted: Vec::new(),
            sets: Vec::new(),
            first_ranking: None,
            group: None,
            put_aside: Vec::new(),
        }
    }

    /// Robust fit of what was accepted.
    pub(crate) fn fit(&mut self) -> RobustFit {
        self.fits.of(&self.base).clone()
    }

    fn frame(&mut self) -> Frame<'a> {
        let weights = self.fits.of(&self.base).weights.clone();
        Frame::weighted(self.data, &self.base, weights)
    }

    /// The level of the first effect, or of later ones.
    pub(crate) fn level(&self, first: f64, later: f64) -> f64 {
        if self.accepted.is_empty() && !self.later { first } else { later }
    }

    fn accept(&mut self, index: usize, variant: usize, set: Vec<usize>, follows: Option<Follows>) {
        let columns = self.prepared[index].whole(self.data, variant);
        self.base.extend(columns.iter().cloned());
        self.accepted.push(Accepted { index, variant, columns, widened: false, follows });
        self.excluded[index] = true;
        for &member in &set {
            self.excluded[member] = true;
        }
        self.sets.push(set);
    }

    /// Takes an accepted effect out of the model; it is not looked for again.
    pub(crate) fn take_out(&mut self, place: usize, baseline: &[Vec<f64>]) {
        self.accepted.remove(place);
        self.sets.remove(place);
        self.base = baseline.to_vec();
        for accepted in &self.accepted {
            self.base.extend(accepted.columns.iter().cloned());
        }
    }

    /// Takes out with accepted effects what they are beyond their leading forms, where that lowers the error of what is
    /// left out: what is left of a strong effect is its own, before it is another.
    fn widen(&mut self) {
        for k in 0..self.accepted.len() {
            if self.accepted[k].widened {
                continue;
            }
            let (index, variant) = (self.accepted[k].index, self.accepted[k].variant);
            let prepared = &self.prepared[index];
            // The setup's lenses come first: what is beyond them has to show clearly.
            let others = of_other_lenses(self.data, prepared.effect.id, &prepared.columns[variant]);
            for (own, by) in [(prepared.wide(self.data, variant), REFINED), (others, CLEARLY_WORSE)] {
                if own.is_empty() {
                    continue;
                }
                let frame = self.frame();
                if frame.held_out(&[]).beaten_by(&frame.held_out(&own)) <= by {
                    continue;
                }
                self.base.extend(own.iter().cloned());
                self.accepted[k].columns.extend(own);
                self.accepted[k].widened = true;
            }
        }
    }

    /// Tests whether one group is off as a whole, and says so.
    pub(crate) fn whole_group(&mut self) -> Option<String> {
        let (index, found) = whole_group(self.data, &self.base, self.prepared)?;
        self.excluded[index] = true;
        let (group, offset, p_value) = (found.group, found.offset, found.p_value);
        self.group = Some((index, found));
        if p_value > LEVEL_GROUP || offset.abs() < FLOOR_GROUP {
            return None;
        }
        self.accept(index, group, vec![index], None);
        Some(format!(
            "series `{}` is off by a factor of {:.3} (Grubbs' test of the series' levels). No other series knows that factor: the errors are told on rows left out, not on whole series",
            self.data.groups[group].name,
            1.0 + offset
        ))
    }

    /// Accepts the best effect that is left; false where none is significant. Effects whose place another column takes are
    /// put aside on the way.
    pub(crate) fn step(&mut self) -> bool {
        loop {
            match self.try_best() {
                Tried::Accepted => return true,
                Tried::PutAside => {}
                Tried::Nothing => return false,
            }
        }
    }

    fn try_best(&mut self) -> Tried {
        let level = self.level(LEVEL_FIRST[0], LEVEL_LATER[0]);
        let (data, prepared) = (self.data, self.prepared);
        let frame = Frame::with_outliers_cut(data, &self.base, self.fits.of(&self.base));
        let ranking = rank(&frame, &self.base, prepared, &self.excluded, self.flips);
        // An unexplained effect that groups have in common is taken for jitter at first, and looks weak beside it.
        let Some(best) = pick(&ranking, level, 0.0, &frame.held_out(&[])) else {
            self.first_ranking.get_or_insert(ranking);
            return Tried::Nothing;
        };
        // Noise and jitter once more, without what the best effect explains.
        let mut with_best = self.base.clone();
        with_best.extend(prepared[best.index].whole(data, best.variant));
        let weights = self.fits.of(&with_best).weights.clone();
        let frame = Frame::weighted(data, &self.base, weights);
        let ranking = rank(&frame, &self.base, prepared, &self.excluded, self.flips);
        let Some(best) = pick(&ranking, level, FLOOR_NOISE, &frame.held_out(&[])) else {
            self.first_ranking.get_or_insert(ranking);
            return Tried::Nothing;
        };
        let (index, variant) = (best.index, best.variant);
        let follows =
            Follows::find(&frame, prepared[index].effect, &prepared[index].columns[variant], &best.held_out);
        let follows = match follows {
            Some(follows) if follows.clearly() => {
                self.first_ranking.get_or_insert(ranking);
                self.excluded[index] = true;
                self.put_aside.push((index, follows));
                return Tried::PutAside;
            }
            other => other,
        };
        let set = confusable(&frame, &self.base, prepared, &ranking, best, level, self.flips);
        self.first_ranking.get_or_insert(ranking);
        self.accept(index, variant, set, follows);
        self.widen();
        Tried::Accepted
    }
}

/// What became of the best effect.
enum Tried {
    Accepted,
    /// What it explains follows another column.
    PutAside,
    /// None is significant.
    Nothing,
}

/// Effects of the table with their columns, and those it cannot show.
pub(crate) fn prepare<'a>(data: &'a Dataset, added: &[AddedEffect]) -> (Vec<Prepared<'a>>, Vec<NotTestable>) {
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
    Some((index, outlying(data, &robust_fit(data, base))?))
}

/// All candidates with p-values and held-out errors, best first.
fn rank(
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
fn pick<'r>(ranking: &'r [Ranked], level: f64, floor: f64, before: &HeldOut) -> Option<&'r Ranked> {
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
fn confusable(
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
