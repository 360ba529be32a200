//! A table in two halves that share no error: in one a form is looked for, the other judges it.
//!
//! What is looked for among thousands of forms fits the noise of the data it was found in. On groups that the search has
//! not seen it is one form, whose p-value needs no correction. Two things could still carry noise from one half to the
//! other, and both are taken out of the half that judges. A mount that wanders: the levels of its groups are taken as what the
//! levels of the other half do not predict. A calibration that is held fixed and is a little wrong: its error is the
//! same everywhere, so whatever it could be is fitted freely.

use glam::DVec2;

use crate::added::{AddedEffect, adjusted};
use crate::balance::balanced;
use crate::catalogue::Effect;
use crate::chance::chance;
use crate::data::{Dataset, Flip};
use crate::level::Level;
use crate::linear::{Basis, dot};
use crate::noise::{Weights, robust_fit};
use crate::pixel_noise;
use crate::remainder::{Remainder, forms_of};
use crate::scatter::{Noise, noise};
use crate::score::Frame;
use crate::together::Together;
use crate::units::{Units, in_time};
use crate::wander::possible;

/// Fewest units of a half: their signs flip in 64 ways.
const FEWEST_UNITS: usize = 6;
/// Share of the rows from which on outliers may be what the model lacks.
const MANY_OUTLIERS: f64 = 0.1;

/// Rows of a table with what is fitted to them.
struct Rows {
    /// Rows of the whole table.
    rows: Vec<usize>,
    data: Dataset,
    base: Vec<Vec<f64>>,
}

/// A table, and its two halves.
pub struct Halves {
    whole: Rows,
    search: Rows,
    judge: Rows,
    noise: Noise,
}

/// Rows in which forms are looked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// The half that does not judge.
    Half,
    /// The whole table.
    Whole,
}

/// Why a table cannot be halved.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TooFew {
    /// Exposures, series or nights that there are.
    pub found: usize,
    /// Those that are needed.
    pub needed: usize,
}

/// How a form was judged by data it was not found in.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Proof {
    /// Chance of at least as much agreement where there is nothing: one-sided, by flipping the signs of units, or by
    /// Student's t where few of them carry the form.
    pub p_value: f64,
    /// Amplitude in the judging half over that in the other: 1 for the truth.
    pub ratio: f64,
    /// Standard deviation of that ratio.
    pub ratio_sigma: f64,
    /// Rms of the form beside the model over that of the noise, in the judging half.
    pub strength: f64,
}

impl Halves {
    /// Halves a table whose model has the `added` effects.
    ///
    /// Groups are paired in the order of time; of each pair the halves take the one that keeps their columns balanced.
    /// Where groups are few, runs of their rows are taken instead, and each group's own level is fitted in each half.
    ///
    /// # Errors
    /// There are too few groups.
    pub fn new(data: &Dataset, added: &[AddedEffect]) -> Result<Self, TooFew> {
        let adjusted = adjusted(data, added);
        let (mut data, base) = (adjusted.data, adjusted.base);
        let noise = match data.pixels() {
            Some(pixels) => pixel_noise::noise(pixels.white.as_ref(), &robust_fit(&data, &base)),
            None => noise(&data).ok_or(TooFew { found: 0, needed: 2 * FEWEST_UNITS })?,
        };
        noise.apply(&mut data);
        let units = Units::of(&data);
        if units.count < 2 * FEWEST_UNITS {
            return Err(TooFew { found: units.count, needed: 2 * FEWEST_UNITS });
        }
        let first = balanced(&data, &units);
        let of_half = |half: bool| {
            let mut rows: Vec<usize> = units
                .ranges
                .iter()
                .zip(&units.unit)
                .filter(|(_, unit)| first[**unit] == half)
                .flat_map(|(range, _)| range.clone())
                .collect();
            rows.sort_unstable();
            Rows::of(&data, &base, rows)
        };
        let (search, judge) = (of_half(true), of_half(false));
        let rows = (0..data.len()).collect();
        Ok(Self { whole: Rows { rows, data, base }, search, judge, noise })
    }

    /// The same halves in each other's place: the one that judged is searched.
    pub fn exchanged(self) -> Self {
        Self { whole: self.whole, search: self.judge, judge: self.search, noise: self.noise }
    }

    /// The noise of the table.
    pub fn noise(&self) -> &Noise {
        &self.noise
    }

    /// Rows of a part, without what the added effects are beyond their columns.
    pub fn data(&self, part: Part) -> &Dataset {
        &self.rows(part).data
    }

    /// Rows of the whole table that are in the half that does not judge, in their order.
    pub fn searched_rows(&self) -> &[usize] {
        &self.search.rows
    }

    fn rows(&self, part: Part) -> &Rows {
        match part {
            Part::Half => &self.search,
            Part::Whole => &self.whole,
        }
    }

    /// What the model leaves in a part, weighed as if these columns belonged to it.
    pub fn left(&self, part: Part, with: &[Vec<f64>]) -> Remainder<'_> {
        self.rows(part).remainder(with)
    }

    /// The same, but what the model lacks may be strong: outliers that lie together and point the same way count. Where the
    /// others are many, all rows weigh the same, and the largest errors are cut.
    pub fn left_unrejected(&self, part: Part, with: &[Vec<f64>]) -> Remainder<'_> {
        let Rows { data, base, .. } = self.rows(part);
        let columns: Vec<Vec<f64>> = base.iter().chain(with).cloned().collect();
        let mut fit = robust_fit(data, &columns);
        if let Some(together) = Together::of(data, &fit.residual, &fit.weights) {
            fit.weights.count_again(together.rows);
        }
        let outliers = fit.weights.outlier.iter().filter(|out| **out).count();
        let frame = if outliers as f64 > MANY_OUTLIERS * data.len() as f64 {
            let (weights, y) = fit.cut_alike(data, 1.0 - 0.5 * MANY_OUTLIERS);
            Frame::of_values(data, base, weights, &y)
        } else {
            Frame::weighted(data, base, fit.weights)
        };
        Remainder { frame, base }
    }

    /// Judges a form: `predicted` is what the other half says it adds to each row of the table, in the table's unit;
    /// `columns` are those it was fitted with, for the weights.
    ///
    /// The proof has to hold with the correlation of groups that was told, and with the largest that is hardly less likely
    /// than the likeliest: the larger p-value counts. With too small a correlation a form that follows the wandering in one
    /// half agrees with the other. With too large a one the other half's errors, which the form was fitted to, come in with
    /// the opposite sign.
    pub fn prove(&self, predicted: &[f64], columns: &[Vec<f64>], seed: u64) -> Proof {
        let weights = [&self.search, &self.judge].map(|half| half.weights(&half.cut(columns)));
        let told = self.whole.data.wander;
        let proof = self.prove_under(&weights, told, predicted, seed);
        let possible = self.possible_wander(columns);
        if possible <= told {
            return proof;
        }
        let under = self.prove_under(&weights, possible, predicted, seed);
        Proof { p_value: proof.p_value.max(under.p_value), ..proof }
    }

    /// The proof under a correlation of groups that follow each other.
    fn prove_under(&self, weights: &[Weights; 2], rho: f64, predicted: &[f64], seed: u64) -> Proof {
        let whiten = |column: &[f64]| self.conditioned(weights, rho, column);
        let mut basis = Basis::default();
        if let Some(field) = self.whole.data.field() {
            for (column, _) in field.columns(1.0) {
                basis.push(whiten(column));
            }
        }
        for column in &self.whole.base {
            basis.push(whiten(column));
        }
        for column in self.levels_of_groups() {
            basis.push(whiten(&column));
        }
        let beside = |column: &[f64]| basis.residual(basis.residual(whiten(column)));
        let (form, error) = (beside(predicted), beside(&self.whole.data.y));
        let square = dot(&form, &form);
        let before = whiten(predicted);
        // A form that the model has already, or that is all one unit's.
        if square <= 1e-8 * dot(&before, &before) || square <= 0.0 {
            return Proof { p_value: 1.0, ratio: 0.0, ratio_sigma: f64::INFINITY, strength: 0.0 };
        }
        let n = self.whole.data.components();
        let units = Units::of(&self.judge.data);
        let (mut shares, mut squares) = (vec![0.0; units.count], vec![0.0; units.count]);
        for (range, &unit) in units.ranges.iter().zip(&units.unit) {
            let span = range.start * n..range.end * n;
            shares[unit] += dot(&form[span.clone()], &error[span.clone()]);
            squares[unit] += dot(&form[span.clone()], &form[span]);
        }
        let found: f64 = shares.iter().sum();
        let scatter = shares.iter().map(|share| (share - found / units.count as f64).powi(2)).sum::<f64>();
        let kept = (weights[1].kept() * n) as f64;
        Proof {
            p_value: chance(&shares, &squares, seed),
            ratio: found / square,
            ratio_sigma: scatter.sqrt() / square,
            strength: (square / kept).sqrt(),
        }
    }

    /// Judges a catalogued effect: fitted in the half that searches, in its form that fits best there. `None` where the table
    /// cannot show it.
    pub fn prove_known(&self, effect: &Effect, seed: u64) -> Option<Proof> {
        let left = self.left(Part::Half, &[]);
        let (_, columns) = forms_of(effect, &self.whole.data)?
            .into_iter()
            .map(|columns| (left.scores(&[self.search.cut(&columns)])[0].statistic, columns))
            .max_by(|a, b| a.0.total_cmp(&b.0))?;
        Some(self.prove_columns(&columns, seed))
    }

    /// Judges columns over all rows: their amplitudes are fitted in the half that searches.
    pub fn prove_columns(&self, columns: &[Vec<f64>], seed: u64) -> Proof {
        let amplitudes = self.left(Part::Half, &[]).amplitudes(&self.search.cut(columns));
        let mut predicted = vec![0.0; self.whole.data.y.len()];
        for (column, (amplitude, _)) in columns.iter().zip(amplitudes) {
            predicted.iter_mut().zip(column).for_each(|(sum, value)| *sum += amplitude * value);
        }
        self.prove(&predicted, columns, seed)
    }

    /// Each group's level in each component, where halves are runs of rows of the same groups: what the two share.
    fn levels_of_groups(&self) -> Vec<Vec<f64>> {
        let data = &self.whole.data;
        if data.flip != Flip::Rows {
            return Vec::new();
        }
        group_levels(data)
    }

    /// The largest correlation of groups that follow each other that is hardly less likely than the likeliest, beside a form
    /// of these columns.
    fn possible_wander(&self, columns: &[Vec<f64>]) -> f64 {
        let Rows { data, base, .. } = &self.whole;
        if !data.jitters {
            return 0.0;
        }
        let all: Vec<Vec<f64>> = base.iter().chain(columns).cloned().collect();
        let fit = robust_fit(data, &all);
        possible(data, &fit.residual, &fit.weights)
    }

    /// A column over all rows as the judging half sees it: whitened, and without what the other half's levels predict where
    /// groups follow each other. An autoregression of first order of correlation rho is known beside its nearest known
    /// neighbours, d before and e after, by (1, rho^(d + e); rho^(d + e), 1)^-1 (rho^d, rho^e).
    fn conditioned(&self, weights: &[Weights; 2], rho: f64, column: &[f64]) -> Vec<f64> {
        let halves = [&self.search, &self.judge];
        let mut white = [0, 1].map(|k| {
            let mut cut = halves[k].cut_one(column);
            weights[k].whiten_rows_of(&halves[k].data, &mut cut);
            cut
        });
        if rho == 0.0 {
            return std::mem::take(&mut white[1]);
        }
        // For each group in the order of time: which half, and its number there.
        let mut place = vec![(0, 0); self.whole.data.groups.len()];
        for (k, half) in halves.iter().enumerate() {
            let mut at = 0;
            for (g, group) in self.whole.data.groups.iter().enumerate() {
                if half.data.groups.get(at).is_some_and(|own| own.name == group.name) {
                    place[g] = (k, at);
                    at += 1;
                }
            }
        }
        let order: Vec<(usize, usize)> = in_time(&self.whole.data).into_iter().map(|g| place[g]).collect();
        let own = |&(k, g): &(usize, usize)| {
            let data: &Dataset = &halves[k].data;
            let level = weights[k].level(data, data.groups[g].rows.clone());
            let found = level.of(data, &weights[k], &white[k]);
            (level, found)
        };
        let levels: Vec<(Level, DVec2)> = order.iter().map(own).collect();
        let counts: Vec<bool> = levels.iter().map(|(level, _)| level.counts()).collect();
        let mut changes = Vec::new();
        for (t, &(k, _)) in order.iter().enumerate() {
            if k == 0 || !counts[t] {
                continue;
            }
            // Known are the other half, and of this one what lies before.
            let before = (0..t).rev().find(|&s| counts[s]);
            let after = (t + 1..order.len()).find(|&s| counts[s] && order[s].0 == 0);
            let near = |s: Option<usize>| s.map_or(0.0, |s| rho.powi(s.abs_diff(t) as i32));
            let (b, a) = (near(before), near(after));
            let both = b * a;
            let share = 1.0 - both * both;
            let (of_before, of_after) = ((b - both * a) / share, (a - both * b) / share);
            let root = (1.0 - of_before * b - of_after * a).sqrt();
            let at = |s: Option<usize>| s.map_or(DVec2::ZERO, |s| levels[s].1);
            let own = (levels[t].1 - of_before * at(before) - of_after * at(after)) / root;
            changes.push((t, own - levels[t].1));
        }
        for (t, change) in changes {
            levels[t].0.add(&self.judge.data, &weights[1], &mut white[1], change);
        }
        std::mem::take(&mut white[1])
    }
}

/// A column for each group and component that is 1 there.
fn group_levels(data: &Dataset) -> Vec<Vec<f64>> {
    let n = data.components();
    let mut out = Vec::new();
    for group in &data.groups {
        for axis in 0..n {
            let mut column = vec![0.0; data.y.len()];
            group.rows.clone().for_each(|row| column[row * n + axis] = 1.0);
            out.push(column);
        }
    }
    out
}

impl Rows {
    fn of(data: &Dataset, base: &[Vec<f64>], rows: Vec<usize>) -> Self {
        let mut own = data.of_rows(&rows);
        if data.wander > 0.0 {
            // Every second group: the correlation of neighbours is that of groups two apart.
            own.wander = data.wander * data.wander;
        }
        let mut out = Self { rows, data: own, base: Vec::new() };
        out.base = out.cut(base);
        if data.flip == Flip::Rows {
            out.base.extend(group_levels(&out.data));
        }
        out
    }

    fn cut_one(&self, column: &[f64]) -> Vec<f64> {
        let n = self.data.components();
        self.rows.iter().flat_map(|&row| column[row * n..(row + 1) * n].iter().copied()).collect()
    }

    fn cut(&self, columns: &[Vec<f64>]) -> Vec<Vec<f64>> {
        columns.iter().map(|column| self.cut_one(column)).collect()
    }

    fn weights(&self, with: &[Vec<f64>]) -> Weights {
        let columns: Vec<Vec<f64>> = self.base.iter().chain(with).cloned().collect();
        robust_fit(&self.data, &columns).weights
    }

    fn remainder(&self, with: &[Vec<f64>]) -> Remainder<'_> {
        let frame = Frame::weighted(&self.data, &self.base, self.weights(with));
        Remainder { frame, base: &self.base }
    }
}
