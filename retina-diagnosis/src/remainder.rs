//! What a model leaves on some rows, and how forms do beside it.

use rayon::prelude::*;

use crate::catalogue::{Effect, Variant, effects};
use crate::data::{Dataset, Term};
use crate::levels_left::FormScore;
use crate::linear::{dot, least_squares};
use crate::score::Frame;

/// What a model leaves on some rows: forms are scored beside it.
pub struct Remainder<'a> {
    pub(crate) frame: Frame<'a>,
    pub(crate) base: &'a [Vec<f64>],
}

/// Squares of the errors of units when they are left out.
#[derive(Clone)]
pub struct LeftOut(crate::score::HeldOut);

impl LeftOut {
    /// Sum over the units.
    pub fn total(&self) -> f64 {
        self.0.total()
    }

    /// Weighted rms per component.
    pub fn rms(&self) -> f64 {
        self.0.rms
    }

    /// By how many standard errors the other is better, unit by unit; negative where it is worse.
    pub fn beaten_by(&self, other: &Self) -> f64 {
        self.0.beaten_by(&other.0)
    }
}

impl<'a> Remainder<'a> {
    /// The rows it is of.
    pub fn data(&self) -> &'a Dataset {
        self.frame.data
    }

    /// Scores of forms, each some columns over all components of the rows.
    pub fn scores(&self, forms: &[Vec<Vec<f64>>]) -> Vec<FormScore> {
        self.frame.form_scores(forms)
    }

    /// Amplitudes of columns beside the model, with standard deviations; infinite where they depend on each other.
    pub fn amplitudes(&self, columns: &[Vec<f64>]) -> Vec<(f64, f64)> {
        self.frame.amplitudes(columns)
    }

    /// Errors of units left out, of the model with further columns.
    pub fn left_out(&self, columns: &[Vec<f64>]) -> LeftOut {
        LeftOut(self.frame.held_out(columns))
    }

    /// A field over the rows without what the model's columns can make of it, by plain least squares.
    pub fn without_model(&self, field: &[f64]) -> Vec<f64> {
        let (coefficients, _) = least_squares(self.base, field);
        let mut out = field.to_vec();
        for (column, c) in self.base.iter().zip(coefficients) {
            out.iter_mut().zip(column).for_each(|(value, column)| *value -= c * column);
        }
        out
    }

    /// What the model leaves of a column, whitened.
    pub fn beside(&self, column: &[f64]) -> Vec<f64> {
        self.frame.residual(column)
    }

    /// Catalogued effects that come nearest to a field over the rows: the share of its square, beside the model, that the
    /// nearest form of each has in common with it. Most alike first.
    pub fn alike(&self, field: &[f64]) -> Vec<(&'static str, f64)> {
        let data = self.frame.data;
        let own = self.frame.residual(field);
        let square = dot(&own, &own).max(f64::MIN_POSITIVE);
        let mut out: Vec<(&'static str, f64)> = effects(Some(data.kind))
            .par_iter()
            .filter_map(|effect| {
                let share = |columns: &Vec<Vec<f64>>| -> f64 {
                    self.frame.directions(columns).iter().map(|q| dot(q, &own).powi(2)).sum::<f64>() / square
                };
                let shares = forms_of(effect, data)?.iter().map(share).fold(0.0, f64::max);
                Some((effect.name(), shares.min(1.0)))
            })
            .collect();
        out.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(b.0)));
        out
    }

    /// A catalogued effect in its form that has the most merit, with second orders or without: its score, and errors of units
    /// left out. `None` where the rows cannot show it.
    pub fn known(&self, effect: &Effect) -> Option<(FormScore, LeftOut)> {
        let data = self.frame.data;
        let mut forms = forms_of(effect, data)?;
        let columns = |terms: &[Term<'_>]| terms.iter().map(|term| data.column(term)).collect();
        forms.extend(effect.build(data).ok()?.iter().map(|variant| columns(&variant.leading)));
        let mut scores = self.scores(&forms);
        let best = (0..forms.len()).max_by(|&a, &b| scores[a].merit().total_cmp(&scores[b].merit()))?;
        Some((scores.swap_remove(best), self.left_out(&forms[best])))
    }

    /// Number of components that count.
    pub fn components(&self) -> f64 {
        self.frame.components()
    }
}

/// Columns of an effect's forms, second orders with them; `None` where the rows cannot show it.
pub(crate) fn forms_of(effect: &Effect, data: &Dataset) -> Option<Vec<Vec<Vec<f64>>>> {
    let columns = |variant: &Variant<'_>| {
        variant.leading.iter().chain(&variant.further).map(|term| data.column(term)).collect()
    };
    Some(effect.build(data).ok()?.iter().map(columns).collect())
}
