//! The search of the diagnosis: effects are accepted one after the other, each by sign-flips of whole groups, and judged
//! beside those accepted before.

use std::collections::VecDeque;
use std::sync::Arc;

use rayon::prelude::*;
use retina_formats::{EffectId, PowerEffect};

use crate::added::AddedEffect;
use crate::catalogue::{Effect, Variant, effects, of_other_lenses, wide};
use crate::data::Dataset;
use crate::diagnose::{DiagnoseOptions, NotTestable};
use crate::flips::Flips;
use crate::form_error::{InModel, form_error, part};
use crate::noise::{RobustFit, robust_fit};
use crate::other_columns::Follows;
use crate::ranking::{Ranked, confusable, pick, rank};
use crate::score::Frame;
use crate::series::{Outlying, outlying};

/// Level of the first test over all effects, and over all screens: together below 5 %.
pub(crate) const LEVEL_FIRST: [f64; 2] = [0.02, 0.01];
/// Level of later ones.
pub(crate) const LEVEL_LATER: [f64; 2] = [0.01, 0.005];
/// Standard errors of the held-out error by which a form has to be better with its further columns.
pub(crate) const REFINED: f64 = 1.0;
/// Standard errors by which a rival of the same class is worse when it is left out of the set.
pub(crate) const CLEARLY_WORSE: f64 = 2.5;
/// An effect or structure weaker than this, rms over noise, is not reported.
pub(crate) const FLOOR_NOISE: f64 = 0.025;
/// Rows that are searched and screened: their columns take about half a gigabyte.
pub(crate) const MOST_ROWS: usize = 50_000;
/// The effect that is a whole group's own, and the level of its test; its forms are in the groups' order.
pub(crate) const WHOLE_GROUP: EffectId = EffectId::Power(PowerEffect::AttenuatorNotChanged);
const LEVEL_GROUP: f64 = 0.005;
/// A label that is wrong is a factor of 2 and more; a tenth of that may be a series' own error.
const FLOOR_GROUP: f64 = 0.1;

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
    /// p-value in the step that accepted it.
    pub(crate) p_value: f64,
    /// What was taken out with it.
    pub(crate) columns: Vec<Vec<f64>>,
    /// Whether second orders of its own were needed.
    widened: bool,
    /// Another column that may be behind it as well.
    pub(crate) follows: Option<Follows>,
}

/// Robust fits that were asked for last: a step's last fit is the next one's first.
#[derive(Default)]
struct Fits {
    kept: VecDeque<(Vec<Vec<f64>>, RobustFit)>,
}

/// Fits that are kept.
const KEPT_FITS: usize = 2;

impl Fits {
    fn of(&mut self, data: &Dataset, columns: &[Vec<f64>]) -> &RobustFit {
        let at = self.kept.iter().position(|(own, _)| own == columns).unwrap_or_else(|| {
            self.kept.truncate(KEPT_FITS - 1);
            self.kept.push_front((columns.to_vec(), robust_fit(data, columns)));
            0
        });
        &self.kept[at].1
    }
}

/// What was accepted so far.
pub(crate) struct Search<'a> {
    /// The data; beside accepted effects of the lenses their forms may be off.
    pub(crate) data: Arc<Dataset>,
    /// The same while nothing was accepted.
    given: Arc<Dataset>,
    /// Number of its columns in `base`.
    baseline: usize,
    fits: Fits,
    prepared: &'a [Prepared<'a>],
    /// Draws of the null beside the present data.
    pub(crate) flips: Arc<Flips>,
    drawn: DiagnoseOptions,
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
        data: Arc<Dataset>,
        prepared: &'a [Prepared<'a>],
        options: &DiagnoseOptions,
        base: Vec<Vec<f64>>,
        later: bool,
    ) -> Self {
        Self {
            baseline: base.len(),
            fits: Fits::default(),
            prepared,
            flips: Arc::new(Flips::draw(&data, options.flips, options.seed)),
            given: Arc::clone(&data),
            data,
            drawn: options.clone(),
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
        self.fits.of(&self.data, &self.base).clone()
    }

    /// The level of the first effect, or of later ones.
    pub(crate) fn level(&self, first: f64, later: f64) -> f64 {
        if self.accepted.is_empty() && !self.later { first } else { later }
    }

    fn accept(
        &mut self,
        index: usize,
        variant: usize,
        p_value: f64,
        set: Vec<usize>,
        follows: Option<Follows>,
    ) {
        let columns = self.prepared[index].whole(&self.data, variant);
        self.base.extend(columns.iter().cloned());
        self.accepted.push(Accepted { index, variant, p_value, columns, widened: false, follows });
        self.excluded[index] = true;
        for &member in &set {
            self.excluded[member] = true;
        }
        self.sets.push(set);
        self.let_forms_be_off();
    }

    /// From here on the forms of the accepted effects may be off by what lenses as built make of them.
    fn let_forms_be_off(&mut self) {
        let weights = self.fits.of(&self.data, &self.base).weights.clone();
        let mut model = self.base[..self.baseline].to_vec();
        let mut effects = Vec::new();
        for own in &self.accepted {
            let prepared = &self.prepared[own.index];
            let from = model.len();
            model.extend(prepared.columns[own.variant].iter().cloned());
            let steady = prepared.variants[own.variant].is_steady();
            effects.push(InModel { effect: prepared.effect.id, steady, columns: from..model.len() });
        }
        let off = form_error(&self.given, &model, self.baseline, &effects, &weights);
        if off.is_some() || !Arc::ptr_eq(&self.data, &self.given) {
            self.data =
                off.map_or_else(|| Arc::clone(&self.given), |off| Arc::new(self.given.with_form_error(off)));
            self.fits = Fits::default();
            self.flips = Arc::new(Flips::draw(&self.data, self.drawn.flips, self.drawn.seed));
        }
    }

    /// The data as the first so many accepted effects find them.
    pub(crate) fn data_beside(&self, count: usize) -> &Dataset {
        let of_lenses = |own: &Accepted| {
            let prepared = &self.prepared[own.index];
            part(prepared.effect.id, prepared.variants[own.variant].is_steady()).is_some()
        };
        if self.accepted[..count].iter().any(of_lenses) { &self.data } else { &self.given }
    }

    /// Takes an accepted effect out of the model; it is not looked for again.
    pub(crate) fn take_out(&mut self, place: usize) {
        self.accepted.remove(place);
        self.sets.remove(place);
        self.base.truncate(self.baseline);
        for accepted in &self.accepted {
            self.base.extend(accepted.columns.iter().cloned());
        }
        self.let_forms_be_off();
    }

    /// Takes out with accepted effects what they are beyond their leading forms, where that lowers the error of what is
    /// left out: what is left of a strong effect is its own, before it is another.
    fn widen(&mut self) {
        let data = Arc::clone(&self.data);
        for k in 0..self.accepted.len() {
            if self.accepted[k].widened {
                continue;
            }
            let (index, variant) = (self.accepted[k].index, self.accepted[k].variant);
            let prepared = &self.prepared[index];
            // The setup's lenses come first: what is beyond them has to show clearly.
            let others = of_other_lenses(&data, prepared.effect.id, &prepared.columns[variant]);
            for (own, by) in [(prepared.wide(&data, variant), REFINED), (others, CLEARLY_WORSE)] {
                if own.is_empty() {
                    continue;
                }
                let weights = self.fits.of(&data, &self.base).weights.clone();
                let frame = Frame::weighted(&data, &self.base, weights);
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
        let (index, found) = whole_group(&self.data, &self.base, self.prepared)?;
        self.excluded[index] = true;
        let (group, offset, p_value) = (found.group, found.offset, found.p_value);
        self.group = Some((index, found));
        if p_value > LEVEL_GROUP || offset.abs() < FLOOR_GROUP {
            return None;
        }
        self.accept(index, group, p_value, vec![index], None);
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
        let (data, flips) = (Arc::clone(&self.data), Arc::clone(&self.flips));
        let (data, flips, prepared) = (&*data, &*flips, self.prepared);
        let frame = Frame::with_outliers_cut(data, &self.base, self.fits.of(&self.data, &self.base));
        let ranking = rank(&frame, &self.base, prepared, &self.excluded, flips);
        // An unexplained effect that groups have in common is taken for jitter at first, and looks weak beside it.
        let Some(best) = pick(&ranking, level, 0.0, &frame.held_out(&[])) else {
            self.first_ranking.get_or_insert(ranking);
            return Tried::Nothing;
        };
        // Noise and jitter once more, without what the best effect explains.
        let mut with_best = self.base.clone();
        with_best.extend(prepared[best.index].whole(data, best.variant));
        let weights = self.fits.of(&self.data, &with_best).weights.clone();
        let frame = Frame::weighted(data, &self.base, weights);
        let ranking = rank(&frame, &self.base, prepared, &self.excluded, flips);
        let Some(best) = pick(&ranking, level, FLOOR_NOISE, &frame.held_out(&[])) else {
            self.first_ranking.get_or_insert(ranking);
            return Tried::Nothing;
        };
        let (index, variant, p_value) = (best.index, best.variant, best.p_value);
        let follows =
            Follows::find(&frame, prepared[index].effect, &prepared[index].columns, variant, &best.held_out);
        let follows = match follows {
            Some(follows) if follows.clearly() => {
                self.first_ranking.get_or_insert(ranking);
                self.excluded[index] = true;
                self.put_aside.push((index, follows));
                return Tried::PutAside;
            }
            other => other,
        };
        let set = confusable(&frame, &self.base, prepared, &ranking, best, level, flips);
        self.first_ranking.get_or_insert(ranking);
        self.accept(index, variant, p_value, set, follows);
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
