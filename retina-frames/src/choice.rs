//! Which form an effect has in the prediction. A first look is by tangents at the state before it; once all parameters are
//! fitted, the forms of every part are weighed anew beside each other, since the pose, and what other parts do, move with
//! them.

use retina_files::InputError;
use retina_formats::FramesEffect;

use crate::FrameSet;
use crate::form::{Form, catalogue};
use crate::model::{Part, State};
use crate::predicted::Predicted;
use crate::solve::{self, Parameter};

/// A form that would have to be what it cannot be counts only where no other does.
const OUTSIDE: f64 = 1e3;
/// Part of the squares of tiles left out by which another form has to be better.
const BETTER: f64 = 1e-3;
/// Forms are changed at most this often beside one set of parts.
const TURNS: usize = 6;

/// States on the way to a prediction: what [`FrameSet::keep`] has kept.
pub struct Kept(Vec<(String, State)>);

/// A state with what its forms are judged by.
struct Judged {
    predicted: Predicted,
    /// Weighted squares of tiles left out.
    left_out: f64,
}

impl FrameSet {
    /// An effect of the catalogue becomes part of the prediction: its best form, with all parameters fitted anew and the
    /// forms of all parts chosen anew.
    ///
    /// # Errors
    /// No such effect, one that is part already, or one that these frames cannot show.
    pub fn add(&mut self, id: &str) -> Result<(), InputError> {
        let refuse = |reason: &str| {
            InputError::new("--effect", format!("these frames cannot show `{id}`")).found(reason)
        };
        if self.state.parts.iter().any(|part| part.id.name() == id) {
            return Err(refuse("the prediction has it already"));
        }
        let all = catalogue(&self.abilities());
        let Some((id, forms)) = all.into_iter().find(|(known, _)| known.name() == id) else {
            return Err(InputError::new("--effect", "is no effect on frames").found(format!("`{id}`")));
        };
        let forms = forms.map_err(|reason| refuse(&reason))?;
        let (form, values) = self.first_look(id, forms).ok_or_else(|| refuse("its columns say nothing"))?;
        let mut state = self.state.clone();
        let values = within(&form, values);
        state.parts.push(Part { id, form, values });
        let parameters = self.parameters(&state);
        let fitted = solve::fit(self.view(), Predicted::of(self.view(), state), &parameters);
        self.state = self.settled(fitted);
        self.history.push((format!("+ {}", id.name()), self.state.clone()));
        Ok(())
    }

    /// Takes the last effect out again.
    pub(crate) fn undo(&mut self) {
        if self.history.len() > 1 {
            self.history.pop();
        }
        if let Some((_, state)) = self.history.last() {
            self.state = state.clone();
        }
    }

    /// What [`FrameSet::restore`] goes back to.
    pub fn keep(&self) -> Kept {
        Kept(self.history.clone())
    }

    /// Goes back to what was kept.
    pub fn restore(&mut self, kept: Kept) {
        self.history = kept.0;
        if let Some((_, state)) = self.history.last() {
            self.state = state.clone();
        }
    }

    /// Takes an effect out of the prediction and of all states on the way to it, each fitted anew.
    pub fn remove(&mut self, id: &str) {
        let without = |state: &State| {
            let parts = state.parts.iter().filter(|part| part.id.name() != id).cloned().collect();
            State { parts, ..state.clone() }
        };
        let label = format!("+ {id}");
        let kept: Vec<(String, State)> =
            self.history.iter().filter(|(own, _)| *own != label).cloned().collect();
        self.history = kept
            .into_iter()
            .map(|(own, state)| {
                if state.parts.iter().all(|part| part.id.name() != id) {
                    return (own, state);
                }
                let state = without(&state);
                let parameters = self.parameters(&state);
                (own, solve::fit(self.view(), Predicted::of(self.view(), state), &parameters).state)
            })
            .collect();
        if let Some((_, state)) = self.history.last() {
            self.state = state.clone();
        }
    }

    /// The part that an effect is.
    pub(crate) fn part(&self, id: &str) -> Option<&Part> {
        self.state.parts.iter().find(|part| part.id.name() == id)
    }

    /// The values that a part's parameter may plausibly have.
    pub(crate) fn plausible(&self, id: &str, parameter: &str) -> Option<[f64; 2]> {
        let change = self.part(id)?.form.change;
        change.names().iter().any(|name| name == parameter).then(|| change.plausible())?
    }

    /// The form whose columns leave least beside the present parameters, with its amplitudes.
    fn first_look(&self, id: FramesEffect, forms: Vec<Form>) -> Option<(Form, Vec<f64>)> {
        let now = Predicted::of(self.view(), self.state.clone());
        let parameters = self.parameters(&self.state);
        let base = now.tangents(self.view(), &parameters);
        let error = now.error(self.view());
        let weight = self.weights(&now, &error, parameters.len());
        let mut best: Option<(f64, Form, Vec<f64>)> = None;
        for form in forms {
            let mut columns = base.clone();
            columns.extend(self.columns(id, &form, &now).into_iter().map(|column| column.values));
            let Some(found) = solve::solved(&columns, &error, &weight, 0.0) else { continue };
            let left = solve::squares_left(&columns, &found, &error, &weight);
            let values = found[base.len()..].to_vec();
            let left = if outside(&form, &values) { OUTSIDE * left } else { left };
            if best.as_ref().is_none_or(|(least, ..)| left < *least) {
                best = Some((left, form, values));
            }
        }
        best.map(|(_, form, values)| (form, values))
    }

    /// Chooses the forms of all parts by the error of tiles left out, each beside the others as they are, until none
    /// changes.
    pub(crate) fn settled(&self, start: Predicted) -> State {
        let all = catalogue(&self.abilities());
        let others: Vec<(usize, Vec<Form>)> = (0..start.state.parts.len())
            .filter_map(|k| {
                let (_, forms) = all.iter().find(|(id, _)| *id == start.state.parts[k].id)?;
                // Forms that differ in where they are looked for first alone are one.
                let mut distinct: Vec<Form> = Vec::new();
                for form in forms.as_ref().ok()? {
                    if !distinct.iter().any(|known| known.change == form.change) {
                        distinct.push(form.clone());
                    }
                }
                (distinct.len() > 1).then_some((k, distinct))
            })
            .collect();
        if others.is_empty() {
            return start.state;
        }
        let error = start.error(self.view());
        let weight = self.weights(&start, &error, self.parameters(&start.state).len());
        let mut now = self.judged(start, &weight);
        for _ in 0..TURNS {
            let Some(trial) = self.likeliest(&now.predicted, &others, &weight) else { break };
            let parameters = self.parameters(&trial.state);
            let then = self.judged(solve::fit(self.view(), trial, &parameters), &weight);
            if then.left_out > (1.0 - BETTER) * now.left_out {
                break;
            }
            now = then;
        }
        now.predicted.state
    }

    /// The state with one form changed that promises most by a step along the tangents; `None` where none promises
    /// anything.
    fn likeliest(&self, now: &Predicted, others: &[(usize, Vec<Form>)], weight: &[f64]) -> Option<Predicted> {
        let (view, state) = (self.view(), &now.state);
        let parameters = self.parameters(state);
        let tangents = now.tangents(view, &parameters);
        let mut best: Option<(f64, State)> = None;
        let mut consider = |left_out: f64, state: State| {
            if best.as_ref().is_none_or(|(least, _)| left_out < *least) {
                best = Some((left_out, state));
            }
        };
        let (_, present) = solve::held_out(&self.rows, &tangents, &now.error(view), weight)?;
        for (k, forms) in others {
            for form in forms.iter().filter(|form| form.change != state.parts[*k].form.change) {
                let mut trial = state.clone();
                trial.parts[*k].form = form.clone();
                if form.change.names().len() != state.parts[*k].values.len() {
                    continue;
                }
                let there = now.beside(view, trial);
                let mut columns = tangents.clone();
                for (column, parameter) in columns.iter_mut().zip(&parameters) {
                    if matches!(parameter, Parameter::Part(part, _) if part == k) {
                        *column = there.tangent(view, *parameter);
                    }
                }
                let found = solve::held_out(&self.rows, &columns, &there.error(view), weight);
                let Some((step, left_out)) = found else { continue };
                let mut trial = there.state;
                let mut values = trial.parts[*k].values.clone();
                for (parameter, by) in parameters.iter().zip(&step) {
                    if let Parameter::Part(part, i) = parameter
                        && part == k
                    {
                        values[*i] += by;
                    }
                }
                let left_out = if outside(form, &values) { OUTSIDE * left_out } else { left_out };
                trial.parts[*k].values = within(form, values);
                if left_out < (1.0 - BETTER) * present {
                    consider(left_out, trial);
                }
            }
        }
        best.map(|(_, state)| now.beside(view, state))
    }

    fn judged(&self, predicted: Predicted, weight: &[f64]) -> Judged {
        let tangents = predicted.tangents(self.view(), &self.parameters(&predicted.state));
        let left_out = solve::held_out(&self.rows, &tangents, &predicted.error(self.view()), weight);
        Judged { predicted, left_out: left_out.map_or(f64::INFINITY, |(_, left_out)| left_out) }
    }

    pub(crate) fn weights(&self, predicted: &Predicted, error: &[f64], fitted: usize) -> Vec<f64> {
        let key = self.rows.noise_key(&self.sights, predicted);
        solve::weights(&self.rows, &key, error, fitted)
    }
}

fn outside(form: &Form, values: &[f64]) -> bool {
    let [low, high] = form.change.range();
    values.iter().any(|value| !(low..=high).contains(value))
}

/// Values that the form may have to begin with.
fn within(form: &Form, mut values: Vec<f64>) -> Vec<f64> {
    let [low, high] = form.change.range();
    for value in &mut values {
        *value = value.clamp(low, high);
        // A variance of 0 has no way back by its tangent.
        if low == 0.0 && *value < 0.1 * form.probe {
            *value = 0.1 * form.probe;
        }
    }
    values
}
