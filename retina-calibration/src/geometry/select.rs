//! The form of D^-1 by exposures left out, with a one-standard-error rule.

use glam::DVec2;
use rand::SeedableRng as _;
use rand::seq::SliceRandom as _;
use rayon::prelude::*;

use super::fit::{Gram, grams, predict};
use super::form::{Domain, ModelForm};
use super::noise::Weights;
use super::observations::Observations;

/// Groups that are left out in turn.
const FOLDS: usize = 10;
/// Fewest points a coefficient.
const POINTS_PER_COLUMN: usize = 6;

/// One form on the ladder.
#[derive(Debug, Clone, PartialEq)]
pub struct Rung {
    /// The form.
    pub form: ModelForm,
    /// Weighted error per axis of left-out exposures, with their own common shift accounted for, arcsec.
    pub heldout_rms_arcsec: f64,
    /// How much worse than the best rung, in standard errors of the difference over the folds; 0 for the best.
    pub behind_best: f64,
}

/// Parts the exposures at random into groups to be left out together.
pub(crate) fn folds(exposures: usize) -> Vec<Vec<usize>> {
    let mut order: Vec<usize> = (0..exposures).collect();
    order.shuffle(&mut rand_chacha::ChaCha8Rng::seed_from_u64(0));
    let count = FOLDS.min(exposures).max(1);
    (0..count)
        .map(|fold| {
            let mut group: Vec<usize> = order.iter().skip(fold).step_by(count).copied().collect();
            group.sort_unstable();
            group
        })
        .collect()
}

/// Highest degree of D^-1 that is tried: D, its inverse, needs more to undo it.
pub(crate) const HIGHEST_DEGREE: u32 = 9;
/// Intervals between the rings' knots, where there are rings: with 12 and with 24 the bench's lenses leave the same.
pub(crate) const RINGS: u32 = 16;
/// Rings add to at least this degree.
const LEAST_RINGED_DEGREE: u32 = 3;

/// A form of this degree follows the points well enough to tell outliers and the distortion's centre.
const FOLLOWING_DEGREE: u32 = 5;
/// The degree of a lens's leading distortion. Without it the mapping of a facility is off by tens of arcseconds.
pub(crate) const CUBIC: u32 = 3;

/// Points that a plain form of a degree needs.
pub(crate) fn points_needed(degree: u32) -> usize {
    ModelForm::plain(degree).len() * POINTS_PER_COLUMN
}

/// Whether there are enough points for a form.
pub(crate) fn bears(observations: &Observations, form: &ModelForm) -> bool {
    form.len() * POINTS_PER_COLUMN <= observations.len()
}

/// The widest form without rings: the highest degree that the points bear by itself, and what their levels bear of the
/// irradiance. Not every combination of the two is borne.
pub(crate) fn widest(observations: &Observations, plain: bool) -> ModelForm {
    let mut levels: Vec<f64> = observations.l.clone();
    levels.sort_by(f64::total_cmp);
    // Two levels closer than a quarter of a magnitude are one.
    levels.dedup_by(|b, a| (*b - *a).abs() < 0.1);
    let power = if plain { 0 } else { (levels.len() as u32).saturating_sub(1).min(3) };
    let borne = |degree: &u32| bears(observations, &ModelForm::plain(*degree));
    let degree = (1..=HIGHEST_DEGREE).rev().find(borne).unwrap_or(1);
    ModelForm { degree, irradiance_degree: degree.min(3), irradiance_power: power, rings: 0 }
}

/// A form that follows these points well enough to tell outliers: as wide as they bear, with the lens's cubic first, then
/// a shift with the irradiance.
pub(crate) fn following(observations: &Observations, widest: ModelForm) -> ModelForm {
    let degree = widest.degree.min(FOLLOWING_DEGREE);
    let within = ModelForm {
        degree,
        irradiance_degree: widest.irradiance_degree.min(degree),
        irradiance_power: widest.irradiance_power.min(2),
        rings: 0,
    };
    forms_within(within)
        .into_iter()
        .filter(|form| bears(observations, form))
        .max_by_key(|form| (form.degree.min(CUBIC), form.irradiance_power.min(1), form.len()))
        .unwrap_or(ModelForm::plain(1))
}

/// Every form within the widest, without and with rings, judged by the folds; the rungs in order of their coefficients, and
/// the chosen one: the smallest that is not worse than the best by more than one standard error.
pub(crate) fn ladder(
    observations: &Observations,
    groups: &[Vec<usize>],
    widest: ModelForm,
    domain: &Domain,
    weights: &Weights,
) -> Option<(Vec<Rung>, ModelForm)> {
    // Against an affine fit the squares are small, and lose no digits in the differences below.
    let affine = domain.basis(ModelForm::plain(1));
    let first = grams(observations, groups, &affine, &observations.undistorted, weights);
    let line = Gram::sum(first.iter())?.solve(&affine, &[0, 1, 2])?;
    let fitted = predict(observations, &affine, &line);
    let target: Vec<DVec2> = observations.undistorted.iter().zip(&fitted).map(|(u, f)| *u - *f).collect();
    let rings = if domain.rings.is_some() { RINGS } else { 0 };
    let basis = domain.basis(ModelForm { rings, ..widest });
    let columns_of = |form: ModelForm| -> Vec<usize> {
        let own = form.terms();
        let shared = own.iter().filter_map(|term| basis.terms.iter().position(|other| other == term));
        let ringed = if form.rings > 0 { basis.terms.len()..basis.len() } else { 0..0 };
        shared.chain(ringed).collect()
    };
    let folds = grams(observations, groups, &basis, &target, weights);
    let total = Gram::sum(folds.iter())?;
    let training: Vec<Gram> =
        folds.iter().map(|fold| if folds.len() > 1 { total.without(fold) } else { fold.clone() }).collect();
    let judge = |form: ModelForm| {
        let columns = columns_of(form);
        let squares: Option<Vec<f64>> = folds
            .iter()
            .zip(&training)
            .map(|(fold, training)| Some(fold.squares(&columns, &training.solve(&basis, &columns)?)))
            .collect();
        Some((form, squares?))
    };
    let plain: Vec<ModelForm> =
        forms_within(widest).into_iter().filter(|form| bears(observations, form)).collect();
    let ringed = plain.iter().filter(|form| rings > 0 && form.degree >= LEAST_RINGED_DEGREE);
    let ringed = ringed.map(|form| ModelForm { rings, ..*form }).filter(|form| bears(observations, form));
    let forms: Vec<ModelForm> = plain.iter().copied().chain(ringed).collect();
    let mut judged: Vec<(ModelForm, Vec<f64>)> = forms.into_par_iter().filter_map(judge).collect();
    judged.sort_by_key(|(form, _)| (form.len(), form.rings, form.irradiance_power, form.irradiance_degree));
    let weight: f64 = folds.iter().map(|fold| fold.weight).sum();
    let sum = |squares: &Vec<f64>| squares.iter().sum::<f64>();
    let best = judged.iter().min_by(|a, b| sum(&a.1).total_cmp(&sum(&b.1)))?.1.clone();
    let rungs: Vec<Rung> = judged
        .iter()
        .map(|(form, squares)| {
            let count = squares.len() as f64;
            let mean = (sum(squares) - sum(&best)) / count;
            let variance: f64 = squares.iter().zip(&best).map(|(s, b)| (s - b - mean).powi(2)).sum::<f64>()
                / (count - 1.0).max(1.0);
            let behind = if mean > 0.0 { mean / (variance / count).sqrt().max(1e-300) } else { 0.0 };
            let heldout_rms_arcsec = (sum(squares) / (2.0 * weight)).sqrt().to_degrees() * 3600.0;
            Rung { form: *form, heldout_rms_arcsec, behind_best: behind }
        })
        .collect();
    let chosen = rungs.iter().find(|rung| rung.behind_best <= 1.0)?.form;
    Some((rungs, chosen))
}

fn forms_within(widest: ModelForm) -> Vec<ModelForm> {
    let mut out = Vec::new();
    for degree in 1..=widest.degree {
        out.push(ModelForm::plain(degree));
        for irradiance_power in 1..=widest.irradiance_power {
            for irradiance_degree in 0..=widest.irradiance_degree.min(degree) {
                out.push(ModelForm { degree, irradiance_degree, irradiance_power, rings: 0 });
            }
        }
    }
    out
}
