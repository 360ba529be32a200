//! Models that rival each other: which of them the data speak for, and by how much exposures that are planned would tell
//! them apart.
//!
//! The evidence for a form of k parameters on n components with whitened errors e is
//! ln p = -1/2 e^T e - k/2 ln n (G. Schwarz, Annals of Statistics 6, 1978). A model that may have any of V forms, one as
//! likely as another beforehand, has the mean of their p. That favours few parameters. A model with more of them may fit
//! as well, and is not ruled out then: of the odds by the evidence and those by the best form's likelihood alone,
//! exp(-1/2 e^T e), the ones nearer to 1 count.
//!
//! If model i is true with amplitudes a, and model j is fitted to what it predicts, the errors that are left have the
//! squared length T_ij = a^T M a: the non-centrality by which j is refuted (A. C. Atkinson, V. V. Fedorov, Biometrika 62,
//! 1975). The measured rows tell a with an uncertainty C, and the mean of T_ij is a^T M a + tr(C M).

use rayon::prelude::*;
use retina_files::InputError;

use crate::added::{AddedEffect, Adjusted, adjusted, check_effects};
use crate::catalogue::{Variant, later_forms};
use crate::data::Dataset;
use crate::linear::{Basis, dot};
use crate::noise::{Weights, robust_fit};
use crate::own::evaluate;
use crate::scatter::noise;
use crate::score::Frame;

/// A model that may be the true one.
#[derive(Clone)]
pub struct Rival {
    /// What it is called.
    pub name: String,
    /// Its effects, beside the baseline.
    pub effects: Vec<AddedEffect>,
}

/// What the data say of a rival.
#[derive(Debug, Clone, PartialEq)]
pub struct Judgement {
    /// ln of the evidence; only differences mean something.
    pub ln_evidence: f64,
    /// ln of the likelihood of its best form; only differences mean something.
    pub ln_likelihood: f64,
    /// ln of the odds of the likeliest rival against it.
    pub ln_odds_against: f64,
    /// Probability among the rivals, all alike beforehand.
    pub probability: f64,
    /// The exposure whose level is furthest off beside it, as the number of its group, and by how many standard deviations.
    pub worst_level: (usize, f64),
    /// Rms of the errors that it leaves over that of the noise, per component: 1 where all is noise.
    pub error_over_noise: f64,
}

/// Rows that were measured, and after them rows that are planned, of which only the columns count.
#[derive(Clone, Copy)]
pub struct DesignRows<'a> {
    /// All of them.
    pub data: &'a Dataset,
    /// Which ones were measured.
    pub measured: &'a (dyn Fn(usize) -> bool + Sync),
    /// How many rows of the data each measured row stands for.
    pub stands_for: f64,
    /// How many rows each planned row stands for.
    pub planned_for: f64,
}

/// By how much a rival is told from another.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Apart {
    /// Squared length of the whitened errors.
    pub square: f64,
    /// The part of it that each row has.
    pub by_row: Vec<f64>,
}

/// Rivals fitted to data.
pub struct Rivals<'a> {
    rivals: &'a [Rival],
    fitted: Vec<Fitted>,
    judgements: Vec<Judgement>,
    noise: NoiseByLight,
}

/// What a rival's fit chose.
struct Fitted {
    /// Shape parameters that were chosen from lists: effect, value.
    shape: Vec<(usize, f64)>,
    /// Of each effect the parameters of a user's formula; empty for a catalogued one.
    own: Vec<Vec<f64>>,
}

/// Standard deviation of a component against the key that the noise depends on, and the common error of an exposure.
struct NoiseByLight {
    /// Key and standard deviation, in rising order of keys.
    curve: Vec<(f64, f64)>,
    jitter_variance: f64,
    /// Size of a held calibration's own error.
    field_size: f64,
}

/// Points of the noise's curve.
const CURVE: usize = 40;
/// Most forms of a rival's effect that are tried on planned exposures.
const MOST_FORMS: usize = 12;

impl NoiseByLight {
    fn of(data: &Dataset, weights: &Weights) -> Self {
        let mut rows: Vec<usize> = (0..data.len()).filter(|&row| !weights.outlier[row]).collect();
        rows.sort_by(|&a, &b| data.noise_key[a].total_cmp(&data.noise_key[b]));
        let size = rows.len().div_ceil(CURVE).max(1);
        let mean =
            |rows: &[usize], of: &[f64]| rows.iter().map(|&row| of[row]).sum::<f64>() / rows.len() as f64;
        let curve = rows
            .chunks(size)
            .map(|chunk| (mean(chunk, &data.noise_key), mean(chunk, &weights.sigma)))
            .collect();
        Self { curve, jitter_variance: weights.jitter_variance, field_size: weights.field_size }
    }

    /// Interpolated; beyond the ends it stays as it is there.
    fn sigma(&self, key: f64) -> f64 {
        let at = self.curve.partition_point(|(own, _)| *own < key);
        match (at.checked_sub(1).map(|below| self.curve[below]), self.curve.get(at)) {
            (Some((low, a)), Some(&(high, b))) if high > low => a + (b - a) * (key - low) / (high - low),
            (Some((_, sigma)), _) | (None, Some(&(_, sigma))) => sigma,
            (None, None) => 1.0,
        }
    }

    /// Weights of rows that count as so many; of those that count as none there is no weight.
    fn weights(&self, data: &Dataset, count: impl Fn(usize) -> f64) -> Weights {
        let sigma: Vec<f64> = data.noise_key.iter().map(|key| self.sigma(*key)).collect();
        Weights {
            weight: sigma.iter().enumerate().map(|(row, sigma)| count(row) / (sigma * sigma)).collect(),
            jitter_variance: self.jitter_variance,
            outlier: (0..data.len()).map(|row| count(row) == 0.0).collect(),
            sigma,
            field_size: self.field_size,
        }
    }
}

impl<'a> Rivals<'a> {
    /// Fits each rival to the data and judges them. All errors are weighed alike: by the noise beside everything that any
    /// of them can explain.
    ///
    /// # Errors
    /// An effect does not fit the data.
    pub fn fit(data: &Dataset, rivals: &'a [Rival]) -> Result<Self, InputError> {
        for rival in rivals {
            check_effects(data, &rival.effects)?;
        }
        // A mount that wanders looks like whatever changes with time.
        let wander = noise(data).map_or(0.0, |noise| noise.wander);
        let data = &Dataset { wander, ..data.clone() };
        let all: Vec<Adjusted> = rivals.par_iter().map(|rival| adjusted(data, &rival.effects)).collect();
        let mut columns: Vec<Vec<f64>> = data.baseline_terms().iter().map(|term| data.column(term)).collect();
        for fit in &all {
            let own = fit.base.iter().zip(&fit.owner).filter(|(_, owner)| owner.is_some());
            columns.extend(own.map(|(column, _)| column.clone()));
            columns.extend(fit.user_values.iter().map(|(_, values)| values.clone()));
        }
        let weights = robust_fit(data, &columns).weights;
        let components = (weights.kept() * data.components()) as f64;
        let mut judgements: Vec<Judgement> = all
            .par_iter()
            .zip(rivals)
            .map(|(fit, rival)| {
                let Evidence { ln_evidence, ln_likelihood, base } =
                    evidence(fit, rival, &weights, components);
                let left = weights.rms(data.components(), &residual(fit, &weights));
                Judgement {
                    ln_evidence,
                    ln_likelihood,
                    ln_odds_against: 0.0,
                    probability: 0.0,
                    worst_level: worst_level(fit, &base, &weights),
                    error_over_noise: left / weights.floor(),
                }
            })
            .collect();
        weigh(&mut judgements);
        let fitted = all.iter().zip(rivals).map(|(fit, rival)| Fitted::of(fit, rival, &weights)).collect();
        let noise = NoiseByLight::of(data, &weights);
        Ok(Self { rivals, fitted, judgements, noise })
    }

    /// What the data say of each.
    pub fn judgements(&self) -> &[Judgement] {
        &self.judgements
    }

    /// T_ij, in row i and column j, on rows that were measured and rows that are planned: its mean over the amplitudes that
    /// the measured rows allow. An effect that happens to be fitted as nothing may still be there.
    pub fn separations(&self, rows: &DesignRows<'_>) -> Vec<Vec<Apart>> {
        let design = rows.data;
        let of = |planned: f64| {
            let count = |row: usize| if (rows.measured)(row) { rows.stands_for } else { planned };
            self.noise.weights(design, count)
        };
        let (old, all) = (of(0.0), of(rows.planned_for));
        let base: Vec<Vec<f64>> = design.baseline_terms().iter().map(|term| design.column(term)).collect();
        let whitened = |weights: &Weights, column: &[f64]| weights.whitened(design, column);
        let fitted = |weights: &Weights| {
            let mut out = Basis::spanning(&weights.whitened_field(design));
            base.iter().for_each(|column| {
                out.push(whitened(weights, column));
            });
            out
        };
        let (beside, known) = (fitted(&all), fitted(&old));
        let forms: Vec<Vec<Form>> =
            self.rivals.iter().zip(&self.fitted).map(|(rival, fitted)| fitted.forms(rival, design)).collect();
        // What each predicts, beside the baseline.
        let predicted: Vec<Vec<Vec<f64>>> = forms
            .iter()
            .map(|forms| {
                let Some(form) = forms.first() else { return Vec::new() };
                let mut basis = known.clone();
                let told = basis.q.len();
                form.columns.iter().for_each(|column| {
                    basis.push(whitened(&old, column));
                });
                let left: Vec<f64> = design.y.iter().zip(&form.fixed).map(|(y, fixed)| y - fixed).collect();
                let likeliest = basis.coefficients(&whitened(&old, &left)).split_off(base.len());
                let spread = basis.inverse_rows().split_off(base.len());
                let field = |mut field: Vec<f64>, amplitude: &dyn Fn(usize) -> f64| {
                    for (k, column) in form.columns.iter().enumerate() {
                        let amplitude = amplitude(k);
                        field.iter_mut().zip(column).for_each(|(sum, value)| *sum += amplitude * value);
                    }
                    beside.residual(whitened(&all, &field))
                };
                let mut out = vec![field(form.fixed.clone(), &|k| likeliest[k])];
                let directions = told..basis.q.len();
                out.extend(directions.map(|d| field(vec![0.0; design.y.len()], &|k| spread[k][d])));
                out
            })
            .collect();
        (0..forms.len())
            .into_par_iter()
            .map(|i| {
                forms
                    .iter()
                    .enumerate()
                    .map(|(j, forms)| {
                        if i == j {
                            return Apart::default();
                        }
                        forms
                            .iter()
                            .map(|form| {
                                // What the fit of j may change: amplitudes, and the fixed part's own by its slopes.
                                let own = Basis::of(
                                    form.columns.iter().map(|column| beside.residual(whitened(&all, column))),
                                );
                                let fixed = beside.residual(whitened(&all, &form.fixed));
                                let mut apart = Apart::none(design.len());
                                for (k, field) in predicted[i].iter().enumerate() {
                                    let mut left = field.clone();
                                    if k == 0 {
                                        left.iter_mut().zip(&fixed).for_each(|(own, fixed)| *own -= fixed);
                                    }
                                    apart.add(&own.residual(left), design.components());
                                }
                                apart
                            })
                            .min_by(|a, b| a.square.total_cmp(&b.square))
                            .unwrap_or_default()
                    })
                    .collect()
            })
            .collect()
    }
}

impl Apart {
    fn none(rows: usize) -> Self {
        Self { square: 0.0, by_row: vec![0.0; rows] }
    }

    /// Adds the square of whitened errors. Behind those of the rows there may be those of a calibration.
    fn add(&mut self, errors: &[f64], components: usize) {
        self.square += dot(errors, errors);
        for (sum, row) in self.by_row.iter_mut().zip(errors.chunks_exact(components)) {
            *sum += dot(row, row);
        }
    }
}

/// Odds and probabilities from evidence and likelihood.
fn weigh(judgements: &mut [Judgement]) {
    let best = judgements.iter().max_by(|a, b| a.ln_evidence.total_cmp(&b.ln_evidence)).cloned();
    let Some(best) = best else { return };
    for own in judgements.iter_mut() {
        let by_evidence = best.ln_evidence - own.ln_evidence;
        own.ln_odds_against = by_evidence.min(best.ln_likelihood - own.ln_likelihood).max(0.0);
    }
    let sum: f64 = judgements.iter().map(|own| (-own.ln_odds_against).exp()).sum();
    for own in judgements {
        own.probability = (-own.ln_odds_against).exp() / sum;
    }
}

/// The group whose mean error is furthest off beside these columns.
fn worst_level(fit: &Adjusted, base: &[Vec<f64>], weights: &Weights) -> (usize, f64) {
    let frame = Frame::weighted(&fit.data, base, weights.clone());
    let mut worst = (0, 0.0);
    for (number, group) in fit.data.groups.iter().enumerate() {
        let level = weights.level(&fit.data, group.rows.clone()).of(&fit.data, weights, &frame.error);
        let sigmas = level.abs().max_element();
        if sigmas > worst.1 {
            worst = (number, sigmas);
        }
    }
    worst
}

/// What a rival leaves of the data, in their unit.
fn residual(fit: &Adjusted, weights: &Weights) -> Vec<f64> {
    let values = crate::estimate::estimate(&fit.data, &fit.base, weights).values;
    let mut out = fit.data.y.clone();
    for (column, value) in fit.base.iter().zip(values) {
        out.iter_mut().zip(column).for_each(|(left, c)| *left -= value * c);
    }
    out
}

/// One form of a rival on some rows: what does not depend on amplitudes, and columns that do.
struct Form {
    fixed: Vec<f64>,
    columns: Vec<Vec<f64>>,
}

impl Fitted {
    fn of(fit: &Adjusted, rival: &Rival, weights: &Weights) -> Self {
        let estimate = crate::estimate::estimate(&fit.data, &fit.base, weights);
        let own = (0..rival.effects.len())
            .map(|index| match &rival.effects[index] {
                AddedEffect::Catalogued(_) => Vec::new(),
                AddedEffect::Own(_) => (0..fit.base.len())
                    .filter(|&k| fit.owner[k] == Some(index))
                    .map(|k| fit.start[k] + estimate.values[k])
                    .collect(),
            })
            .collect();
        Self { shape: fit.shape.iter().map(|(effect, _, value)| (*effect, *value)).collect(), own }
    }

    /// The form that the fit chose; then all that a fit to further data may choose.
    fn forms(&self, rival: &Rival, design: &Dataset) -> Vec<Form> {
        let mut chosen = Form { fixed: vec![0.0; design.y.len()], columns: Vec::new() };
        let mut free = Vec::new();
        let mut others: Vec<Vec<Vec<f64>>> = Vec::new();
        for (index, effect) in rival.effects.iter().enumerate() {
            match effect {
                AddedEffect::Own(user) => {
                    let (values, slopes) = evaluate(user.as_ref(), design, &self.own[index]);
                    chosen.fixed.iter_mut().zip(&values).for_each(|(sum, value)| *sum += value);
                    free.extend(slopes.iter().cloned());
                    chosen.columns.extend(slopes);
                }
                AddedEffect::Catalogued(known) => {
                    let variants = known.build(design).unwrap_or_default();
                    let shape: Vec<f64> =
                        self.shape.iter().filter(|(own, _)| *own == index).map(|(_, value)| *value).collect();
                    let nearest = nearest(&variants, &shape);
                    let Some(own) = variants.get(nearest) else { continue };
                    chosen.columns.extend(leading(own, design));
                    free.extend(whole(own, design));
                    let stride = variants.len().div_ceil(MOST_FORMS).max(1);
                    let further = variants.iter().enumerate().filter(|(k, _)| *k != nearest).step_by(stride);
                    others.extend(further.map(|(_, variant)| whole(variant, design)));
                    others.extend(later_forms(design, known.id));
                }
            }
        }
        // Of models with several effects only the chosen form counts: their other forms are too many.
        let alone = rival.effects.len() == 1;
        let others = others.into_iter().filter(|_| alone);
        let fixed = chosen.fixed.clone();
        let form = |columns| Form { fixed: fixed.clone(), columns };
        let further: Vec<Form> = std::iter::once(free).chain(others).map(form).collect();
        std::iter::once(chosen).chain(further).collect()
    }
}

/// The form whose shape parameters are nearest.
fn nearest(variants: &[Variant<'_>], shape: &[f64]) -> usize {
    let far = |variant: &Variant<'_>| -> f64 {
        let size = |a: f64, b: f64| (a - b).abs() / (a.abs() + b.abs()).max(1e-300);
        variant.shape.iter().zip(shape).map(|((_, own), wanted)| size(*own, *wanted)).sum()
    };
    (0..variants.len()).min_by(|&a, &b| far(&variants[a]).total_cmp(&far(&variants[b]))).unwrap_or(0)
}

/// How well a rival describes the data.
struct Evidence {
    /// ln of the mean evidence of its forms.
    ln_evidence: f64,
    /// ln of the likelihood of its best form.
    ln_likelihood: f64,
    /// All columns of that form.
    base: Vec<Vec<f64>>,
}

/// Judges a rival by all of its forms. Of a model of several effects one at a time has other forms than those that the fit
/// chose.
fn evidence(fit: &Adjusted, rival: &Rival, weights: &Weights, components: f64) -> Evidence {
    let owned = fit.owner.iter().flatten().count();
    let columns = |index: usize, own: bool| -> Vec<Vec<f64>> {
        let all = fit.base.iter().zip(&fit.owner);
        all.filter(|(_, owner)| (**owner == Some(index)) == own).map(|(column, _)| column.clone()).collect()
    };
    let mut evidences: Vec<f64> = Vec::new();
    let mut best = (f64::NEG_INFINITY, fit.base.clone());
    for (index, effect) in rival.effects.iter().enumerate() {
        let chosen = columns(index, true);
        let further = owned - chosen.len();
        let mut forms = vec![chosen];
        if let AddedEffect::Catalogued(known) = effect {
            for variant in known.build(&fit.data).unwrap_or_default() {
                if !variant.further.is_empty() {
                    forms.push(whole(&variant, &fit.data));
                }
                forms.push(leading(&variant, &fit.data));
            }
            forms.extend(later_forms(&fit.data, known.id));
        }
        let others = columns(index, false);
        let frame = Frame::weighted(&fit.data, &others, weights.clone());
        let square = dot(&frame.error, &frame.error);
        for (score, form) in frame.scores(&forms).iter().zip(&forms) {
            let ln_likelihood = -0.5 * (square - score.statistic);
            evidences.push(ln_likelihood - 0.5 * (further + score.rank()) as f64 * components.ln());
            if ln_likelihood > best.0 {
                best = (ln_likelihood, others.iter().chain(form).cloned().collect());
            }
        }
    }
    if evidences.is_empty() {
        // The baseline alone.
        let frame = Frame::weighted(&fit.data, &fit.base, weights.clone());
        best.0 = -0.5 * dot(&frame.error, &frame.error);
        evidences.push(best.0);
    }
    let most = evidences.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let sum: f64 = evidences.iter().map(|ln| (ln - most).exp()).sum();
    Evidence { ln_evidence: most + (sum / evidences.len() as f64).ln(), ln_likelihood: best.0, base: best.1 }
}

/// Columns of a form's leading terms.
fn leading(variant: &Variant<'_>, data: &Dataset) -> Vec<Vec<f64>> {
    variant.leading.iter().map(|term| data.column(term)).collect()
}

/// Columns of all that a form may have.
fn whole(variant: &Variant<'_>, data: &Dataset) -> Vec<Vec<f64>> {
    variant.leading.iter().chain(&variant.further).map(|term| data.column(term)).collect()
}
