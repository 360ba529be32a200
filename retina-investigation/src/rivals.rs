//! What else the data would have: forms that they do not tell from the chosen one, and shapes that they do not tell apart.

use retina_diagnosis::{Dataset, LeftOut, Remainder};

use crate::columns::{Column, Table};
use crate::form::{Factor, Form};
use crate::outcome::Rival;
use crate::search::{Scored, finite};

/// Standard errors within which formulas are not told apart.
pub(crate) const TOLD_APART: f64 = 2.0;
/// Most formulas beside the first that are named.
const MOST_RIVALS: usize = 4;
/// Formulas with so much more to say are no rivals.
const RIVAL_COMPLEXITY: usize = 2;
/// A formula whose difference from another one is below this share of its rms is the same.
const SAME: f64 = 0.02;

/// A form that was chosen among others on all data.
pub(crate) struct Choice<'a> {
    pub(crate) left: &'a Remainder<'a>,
    pub(crate) scored: &'a [Scored],
    /// Their errors on units left out.
    pub(crate) errors: &'a [LeftOut],
    /// Which of them.
    pub(crate) best: usize,
    pub(crate) columns: &'a [Column],
    pub(crate) whole: &'a Table,
    /// What it adds to each row.
    pub(crate) field: &'a [f64],
}

impl Choice<'_> {
    /// Whether a form is the best one with another delay behind the same column.
    fn only_delayed_otherwise(&self, form: &Form) -> bool {
        let best = &self.scored[self.best].form;
        let alike = |(a, b): (&Factor, &Factor)| {
            let [a_column, b_column] = [a, b].map(|factor| &self.columns[factor.column]);
            let delays = a_column.follows.is_some() && b_column.follows.is_some();
            a.law == b.law && (a.column == b.column || (delays && a_column.source() == b_column.source()))
        };
        form.direction == best.direction
            && form.factors.len() == best.factors.len()
            && form.factors.iter().zip(&best.factors).all(alike)
    }

    /// Time constants of the best form's delay that units left out do not tell from its own, where there are others.
    pub(crate) fn delays_s(&self) -> Option<[f64; 2]> {
        let delay = |form: &Form| {
            form.factors.iter().find_map(|factor| Some(self.columns[factor.column].follows.as_ref()?.1))
        };
        let as_good = |k: &usize| {
            self.only_delayed_otherwise(&self.scored[*k].form)
                && self.errors[*k].beaten_by(&self.errors[self.best]) <= TOLD_APART
        };
        let own = delay(&self.scored[self.best].form)?;
        let all = (0..self.scored.len()).filter(as_good).filter_map(|k| delay(&self.scored[k].form));
        let [low, high] = all.fold([own; 2], |[low, high], delay| [low.min(delay), high.max(delay)]);
        (high > low).then_some([low, high])
    }

    /// Forms that units left out do not tell from the best.
    pub(crate) fn rivals(&self, data: &Dataset, name: &str) -> Vec<Rival> {
        let Self { left, scored, errors, best, columns, whole, field } = *self;
        let n = whole.components;
        let rms = |values: &[f64]| (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt();
        let mut out = Vec::new();
        for (k, rival) in scored.iter().enumerate() {
            let beaten_by = errors[k].beaten_by(&errors[best]);
            let most = scored[best].form.complexity() + RIVAL_COMPLEXITY;
            let more = rival.form.factors.len() > scored[best].form.factors.len();
            let same = k == best || self.only_delayed_otherwise(&rival.form);
            if same || beaten_by > TOLD_APART || more || rival.form.complexity() > most {
                continue;
            }
            let evaluated = finite(rival.form.evaluate(whole, columns));
            let amplitudes: Vec<f64> = left.amplitudes(&evaluated).iter().map(|(value, _)| *value).collect();
            let other = sum(&evaluated, amplitudes.iter().copied());
            // What the baseline takes up is no difference.
            let difference: Vec<f64> = field.iter().zip(&other).map(|(a, b)| a - b).collect();
            let beside = left.beside(&difference);
            let own = left.beside(field);
            if rms(&beside) < SAME * rms(&own) {
                continue;
            }
            let difference = left.without_model(&difference);
            let row = (0..whole.rows)
                .max_by(|&a, &b| {
                    let size =
                        |row: usize| difference[row * n..(row + 1) * n].iter().map(|v| v * v).sum::<f64>();
                    size(a).total_cmp(&size(b))
                })
                .unwrap_or(0);
            let mut names = rival.form.covariates(columns);
            for name in scored[best].form.covariates(columns) {
                if !names.contains(&name) {
                    names.push(name);
                }
            }
            let held = vec![true; rival.form.shapes()];
            out.push(Rival {
                effect: rival.form.effect(columns, data.kind, &format!("{name}_rival"), &amplitudes, &held),
                covariates: rival.form.covariates(columns),
                complexity: rival.form.complexity(),
                heldout_rms: errors[k].rms(),
                difference_rms: rms(&difference),
                differs_by: rms(&difference[row * n..(row + 1) * n]) * (n as f64).sqrt(),
                differs_at: names
                    .into_iter()
                    .filter_map(|name| {
                        let value = data.covariate(&name)?.values[row];
                        Some((name, value))
                    })
                    .collect(),
                beaten_by,
            });
        }
        out.truncate(MOST_RIVALS);
        out
    }
}

/// For each shape parameter whether the data cannot tell it from what else is fitted.
pub(crate) fn inseparable(
    left: &Remainder<'_>,
    form: &Form,
    table: &Table,
    columns: &[Column],
    amplitudes: &[f64],
) -> Vec<bool> {
    let shape = form.shape();
    let of = |shape: &[f64]| {
        sum(&finite(form.with_shape(shape).evaluate(table, columns)), amplitudes.iter().copied())
    };
    let mut beside = finite(form.evaluate(table, columns));
    (0..shape.len())
        .map(|k| {
            let step = 1e-4 * shape[k].abs().max(1e-3);
            let moved = |sign: f64| {
                let mut moved = shape.clone();
                moved[k] += sign * step;
                of(&moved)
            };
            let (above, below) = (moved(1.0), moved(-1.0));
            let slope: Vec<f64> = above.iter().zip(&below).map(|(a, b)| (a - b) / (2.0 * step)).collect();
            let before = left.scores(&[beside.clone()])[0].rank;
            beside.push(slope);
            let separable = left.scores(&[beside.clone()])[0].rank > before;
            if !separable {
                beside.pop();
            }
            !separable
        })
        .collect()
}

/// Columns times amplitudes, added up.
pub(crate) fn sum(columns: &[Vec<f64>], amplitudes: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut out = vec![0.0; columns.first().map_or(0, Vec::len)];
    for (column, amplitude) in columns.iter().zip(amplitudes) {
        out.iter_mut().zip(column).for_each(|(sum, value)| *sum += amplitude * value);
    }
    out
}
