//! Effects that are part of the model: catalogued ones by id, and the user's own.

use std::path::Path;
use std::sync::Arc;

use retina_files::{InputError, nearest};
use retina_formats::EffectId;

use crate::catalogue::{Effect, effects, wide};
use crate::data::Dataset;
use crate::effect_file::EffectOfFile;
use crate::following::read_column;
use crate::linear::{Basis, dot, solve_positive};
use crate::noise::robust_fit;
use crate::own::{OwnEffect, evaluate, readable_columns};
use crate::ranking::likeliest;
use crate::retraced::retraced_by_added;
use crate::score::{Frame, Score};
use crate::search::{REFINED, WHOLE_GROUP};
use crate::series::outlying;

/// An effect added to the baseline.
#[derive(Clone)]
pub enum AddedEffect {
    /// One of the catalogue.
    Catalogued(&'static Effect),
    /// One's own.
    Own(Arc<dyn OwnEffect>),
}

impl AddedEffect {
    /// From the text of `--effect`: an id, or a file that ends in `.toml`.
    ///
    /// # Errors
    /// No such effect for this table, or the file does not fit.
    pub fn read(text: &str, data: &Dataset) -> Result<Self, InputError> {
        if text.ends_with(".toml") {
            return Ok(Self::Own(Arc::new(EffectOfFile::read(Path::new(text), data)?)));
        }
        let all = effects(Some(data.kind));
        if let Some(effect) = all.iter().find(|effect| effect.name() == text) {
            if data.part(effect.id).is_some() {
                return Ok(Self::Catalogued(effect));
            }
            if let Err(reason) = effect.build(data) {
                return Err(
                    InputError::new("--effect", format!("this table cannot show `{text}`")).found(reason)
                );
            }
            return Ok(Self::Catalogued(effect));
        }
        let ids: Vec<&str> = all.iter().map(|effect| effect.name()).collect();
        let near = nearest(text, ids.iter().copied()).map(|near| format!("did you mean `{near}`? "));
        Err(InputError::new("--effect", format!("is no effect on {}", data.kind.name()))
            .found(format!("`{text}`"))
            .expected("an effect's id, or a file that ends in .toml")
            .help(format!("{}`retina effects` lists them", near.unwrap_or_default())))
    }

    /// From the text of an effect's file; `name` stands for the file in errors.
    ///
    /// # Errors
    /// The text does not fit the table.
    pub fn of_text(name: &str, text: &str, data: &Dataset) -> Result<Self, InputError> {
        Ok(Self::Own(Arc::new(EffectOfFile::parse(Path::new(name), text, data)?)))
    }

    /// Its id, where it is catalogued.
    pub fn id(&self) -> Option<EffectId> {
        match self {
            Self::Catalogued(effect) => Some(effect.id),
            Self::Own(_) => None,
        }
    }

    /// One of one's own.
    ///
    /// # Errors
    /// It reads a column that the data do not have.
    pub fn own(effect: impl OwnEffect + 'static, data: &Dataset) -> Result<Self, InputError> {
        Self::own_shared(Arc::new(effect), data)
    }

    /// As [`Self::own`], one that others hold too.
    ///
    /// # Errors
    /// As [`Self::own`].
    pub fn own_shared(effect: Arc<dyn OwnEffect>, data: &Dataset) -> Result<Self, InputError> {
        for name in effect.columns() {
            if let Err(reason) = read_column(data, name) {
                return Err(InputError::new(effect.source(), "reads a column that the data do not have")
                    .found(format!("`{name}`: {reason}"))
                    .expected(readable_columns(data).join(", ")));
            }
        }
        Ok(Self::Own(effect))
    }

    /// Its id or name.
    pub fn name(&self) -> &str {
        match self {
            Self::Catalogued(effect) => effect.name(),
            Self::Own(effect) => effect.name(),
        }
    }

    /// The columns it depends on.
    pub(crate) fn columns(&self) -> Vec<&str> {
        match self {
            Self::Catalogued(effect) => effect.covariates().to_vec(),
            Self::Own(effect) => effect.columns(),
        }
    }
}

fn finite(values: &[f64], slopes: &[Vec<f64>]) -> bool {
    values.iter().chain(slopes.iter().flatten()).all(|v| v.is_finite())
}

/// Data and base columns with the added effects in.
pub(crate) struct Adjusted {
    /// y without the non-linear part of the users' effects at their fitted parameters.
    pub(crate) data: Dataset,
    /// Baseline, then the added effects' columns.
    pub(crate) base: Vec<Vec<f64>>,
    /// Names of the columns.
    pub(crate) names: Vec<String>,
    /// Which effect (index into the added ones) a column belongs to; `None`: the baseline.
    pub(crate) owner: Vec<Option<usize>>,
    /// Shape parameters chosen from lists: effect, name, value.
    pub(crate) shape: Vec<(usize, String, f64)>,
    /// For each column the value its coefficient is counted from: of users' effects and of parts of a prediction.
    pub(crate) start: Vec<f64>,
    /// Fixed part of these effects, per effect.
    pub(crate) user_values: Vec<(usize, Vec<f64>)>,
}

/// Refuses users' effects that cannot be fitted to these data.
///
/// # Errors
/// A formula or a derivative is not finite at the start values, or a parameter cannot be told from what else is fitted.
pub fn check_effects(data: &Dataset, added: &[AddedEffect]) -> Result<(), InputError> {
    for effect in added {
        let AddedEffect::Own(user) = effect else { continue };
        let start: Vec<f64> = user.parameters().iter().map(|p| p.start).collect();
        let (values, slopes) = evaluate(user.as_ref(), data, &start);
        if !finite(&values, &slopes) {
            let at = values.iter().position(|v| !v.is_finite());
            return Err(InputError::new(user.source(), format!("effect `{}` is not finite at its start values", user.name()))
                .found(at.map_or_else(
                    || "a derivative that is not finite".to_owned(),
                    |at| format!("row {} of the data", data.order[at / data.components()] + 1),
                ))
                .help("keep divisions by 0, logarithms and powers of 0 out of the formula, or choose other start values"));
        }
        let mut adjusted = adjusted(data, &[]);
        let before = adjusted.base.len();
        adjusted.base.extend(slopes);
        let frame = Frame::fitted(data, &adjusted.base[..before]);
        for (k, parameter) in user.parameters().iter().enumerate() {
            if adjusted.base[before + k].iter().all(|slope| *slope == 0.0) {
                return Err(InputError::new(
                    user.source(),
                    format!("nothing changes with parameter `{}` near its start value", parameter.name),
                )
                .at(format!("key `parameters.{}`", parameter.name))
                .help(
                    "step() has no slope: write its place as a number, or tanh((t - t0) / w) with a width",
                ));
            }
            let mut others: Vec<Vec<f64>> = adjusted.base.clone();
            let own = others.remove(before + k);
            let beside = Frame::weighted(data, &others, frame.weights.clone());
            if beside.score(&[own]).rank() == 0 {
                return Err(InputError::new(
                    user.source(),
                    format!(
                        "parameter `{}` cannot be told from the others or from the baseline",
                        parameter.name
                    ),
                )
                .at(format!("key `parameters.{}`", parameter.name))
                .help("a column that is constant here, or a form that the baseline has already"));
            }
        }
    }
    Ok(())
}

/// Names of the coefficients of an effect's second orders, after its own name and before their number.
pub(crate) const SECOND_ORDERS: &str = ".own_";

/// Levenberg-Marquardt's turns.
const TURNS: usize = 60;

/// Most times that forms are made anew.
const MOST_TRACES: usize = 6;

/// Fits the users' parameters and lays out all columns; those of a display that stands aside, and of a strong coma, about
/// what was found.
pub(crate) fn adjusted(data: &Dataset, added: &[AddedEffect]) -> Adjusted {
    settled(data, added).1
}

/// The same, with the data whose forms are made about it; `None` where these are the given ones.
pub(crate) fn settled(data: &Dataset, added: &[AddedEffect]) -> (Option<Dataset>, Adjusted) {
    let mut about: Option<Dataset> = None;
    let mut adjusted = laid_out(data, added);
    for _ in 0..MOST_TRACES {
        let Some(next) = retraced_by_added(about.as_ref().unwrap_or(data), added, &adjusted) else { break };
        adjusted = laid_out(&next, added);
        about = Some(next);
    }
    (about, adjusted)
}

fn laid_out(data: &Dataset, added: &[AddedEffect]) -> Adjusted {
    let mut base: Vec<Vec<f64>> = Vec::new();
    let (mut names, mut owner) = (Vec::new(), Vec::new());
    for term in data.baseline_terms() {
        base.push(data.column(&term));
        names.push(term.name);
        owner.push(None);
    }
    let mut start = data.baseline_values();
    let mut shape = Vec::new();
    let mut out = data.clone();
    let mut user_values = Vec::new();
    for (index, part) in added.iter().enumerate().filter_map(|(i, e)| Some((i, data.part(e.id()?)?))) {
        for (column, value) in &part.tangents {
            base.push(column.values.clone());
            names.push(format!("{}.{}", part.id.name(), column.name));
            owner.push(Some(index));
            start.push(*value);
        }
        out.y.iter_mut().zip(&part.adds).for_each(|(y, value)| *y -= value);
        shape.extend(part.shape.iter().map(|(n, v)| (index, format!("{}.{n}", part.id.name()), *v)));
        user_values.push((index, part.adds.clone()));
    }
    for (index, effect) in added.iter().enumerate() {
        let AddedEffect::Catalogued(effect) = effect else { continue };
        let Ok(variants) = effect.build(data) else { continue };
        let frame = Frame::fitted(&out, &base);
        let columns: Vec<Vec<Vec<f64>>> =
            variants.iter().map(|v| v.leading.iter().map(|t| data.column(t)).collect()).collect();
        let scores: Vec<f64> = frame.scores(&columns).iter().map(Score::deviate).collect();
        // Robust weights throw a series out whose level is wrong, and with it the form that would explain it.
        let off = if effect.id == WHOLE_GROUP {
            outlying(data, &robust_fit(data, &base)).map(|off| off.group)
        } else {
            None
        };
        let likeliest = || likeliest(&frame, &variants, &columns, &scores).map(|(best, _)| best);
        let Some(best) = off.or_else(likeliest) else { continue };
        let further: Vec<Vec<f64>> = variants[best].further.iter().map(|t| data.column(t)).collect();
        let mut whole = columns[best].clone();
        whole.extend(further.iter().cloned());
        let refined = frame.held_out(&columns[best]).beaten_by(&frame.held_out(&whole)) > REFINED;
        let taken = if refined { &whole } else { &columns[best] };
        let own = second_orders(&frame, &base, taken, wide(data, effect.id, &variants[best].shape));
        let mut put = |term: &str, column: Vec<f64>| {
            base.push(column);
            names.push(format!("{}.{term}", effect.name()));
            owner.push(Some(index));
            start.push(0.0);
        };
        for (term, column) in variants[best].leading.iter().zip(&columns[best]) {
            put(&term.name, column.clone());
        }
        if refined {
            let mut beside = frame.with(&columns[best]);
            for (term, column) in variants[best].further.iter().zip(further) {
                // One that the others make up already has no coefficient of its own.
                if beside.score(std::slice::from_ref(&column)).rank() > 0 {
                    beside = beside.with(std::slice::from_ref(&column));
                    put(term.name.as_str(), column);
                }
            }
        }
        for (k, column) in own.into_iter().enumerate() {
            put(&format!("{}{}", &SECOND_ORDERS[1..], k + 1), column);
        }
        shape.extend(variants[best].shape.iter().map(|(n, v)| (index, format!("{}.{n}", effect.name()), *v)));
    }
    let users: Vec<(usize, &dyn OwnEffect)> = added
        .iter()
        .enumerate()
        .filter_map(|(i, e)| if let AddedEffect::Own(user) = e { Some((i, user.as_ref())) } else { None })
        .collect();
    let found = levenberg_marquardt(&out, &base, &users);
    let mut at = 0;
    for (index, user) in &users {
        let here = &found[at..at + user.parameters().len()];
        let (values, slopes) = evaluate(*user, data, here);
        for (y, value) in out.y.iter_mut().zip(&values) {
            *y -= value;
        }
        for (parameter, slope) in user.parameters().iter().zip(slopes) {
            base.push(slope);
            names.push(format!("{}.{}", user.name(), parameter.name));
            owner.push(Some(*index));
        }
        start.extend(here);
        user_values.push((*index, values));
        at += user.parameters().len();
    }
    Adjusted { data: out, base, names, owner, shape, start, user_values }
}

/// What an effect is beyond the columns `taken` of it, where that lowers the error of what is left out: orthogonal to
/// these and to the base, so that their amplitudes keep their meaning and their values.
fn second_orders(
    frame: &Frame<'_>,
    base: &[Vec<f64>],
    taken: &[Vec<f64>],
    own: Vec<Vec<f64>>,
) -> Vec<Vec<f64>> {
    let both: Vec<Vec<f64>> = taken.iter().chain(&own).cloned().collect();
    if own.is_empty() || frame.held_out(taken).beaten_by(&frame.held_out(&both)) <= REFINED {
        return Vec::new();
    }
    let data = frame.data;
    let whitened = |column: &[f64]| frame.weights.whitened(data, column);
    let known: Vec<&Vec<f64>> = base.iter().chain(taken).collect();
    let along = Basis::of(known.iter().map(|column| whitened(column)));
    let mut beside = frame.with(taken);
    let mut out = Vec::new();
    for mut column in own {
        // Columns that those before them make up already have no coefficient of their own.
        if beside.score(std::slice::from_ref(&column)).rank() == 0 {
            continue;
        }
        beside = beside.with(std::slice::from_ref(&column));
        for (known, share) in known.iter().zip(along.coefficients(&whitened(&column))) {
            column.iter_mut().zip(*known).for_each(|(value, k)| *value -= share * k);
        }
        out.push(column);
    }
    out
}

/// Users' parameters by D. Marquardt's method (SIAM Journal 11, 1963), all linear columns solved for at every turn.
fn levenberg_marquardt(data: &Dataset, base: &[Vec<f64>], users: &[(usize, &dyn OwnEffect)]) -> Vec<f64> {
    let mut theta: Vec<f64> =
        users.iter().flat_map(|(_, user)| user.parameters().iter().map(|p| p.start)).collect();
    if theta.is_empty() {
        return theta;
    }
    let model = |theta: &[f64]| {
        let (mut values, mut slopes) = (vec![0.0; data.y.len()], Vec::new());
        let mut at = 0;
        for (_, user) in users {
            let (v, s) = evaluate(*user, data, &theta[at..at + user.parameters().len()]);
            values.iter_mut().zip(&v).for_each(|(sum, v)| *sum += v);
            slopes.extend(s);
            at += user.parameters().len();
        }
        (values, slopes)
    };
    // Weights from the model linearised at its start, which leaves little of the effect among the errors.
    let (values, slopes) = model(&theta);
    let mut shifted = data.clone();
    shifted.y.iter_mut().zip(&values).for_each(|(y, v)| *y -= v);
    let mut columns = base.to_vec();
    columns.extend(slopes);
    let weights = robust_fit(&shifted, &columns).weights;
    let frame = Frame::weighted(data, base, weights);
    let projected = |column: Vec<f64>| frame.residual(&column);
    let error_of = |values: Vec<f64>| -> Vec<f64> {
        projected(values).iter().zip(&frame.error).map(|(v, e)| e - v).collect()
    };
    let mut damping = 1e-3;
    let (values, mut slopes) = model(&theta);
    let mut error = error_of(values);
    let mut cost = dot(&error, &error);
    for _ in 0..TURNS {
        let jacobian: Vec<Vec<f64>> = slopes.iter().map(|s| projected(s.clone())).collect();
        let n = theta.len();
        let mut normal: Vec<f64> = (0..n * n).map(|at| dot(&jacobian[at / n], &jacobian[at % n])).collect();
        for i in 0..n {
            normal[i * n + i] *= 1.0 + damping;
        }
        let right: Vec<f64> = jacobian.iter().map(|j| dot(j, &error)).collect();
        let Some(step) = solve_positive(&normal, &right) else { break };
        let trial: Vec<f64> = theta.iter().zip(&step).map(|(t, s)| t + s).collect();
        let (values, next) = model(&trial);
        let next_error = error_of(values);
        let next_cost = dot(&next_error, &next_error);
        if next_cost.is_finite() && next_cost <= cost {
            let done = cost - next_cost <= 1e-12 * cost;
            (theta, slopes, error, cost) = (trial, next, next_error, next_cost);
            damping = (damping * 0.2).max(1e-12);
            if done {
                break;
            }
        } else {
            damping *= 10.0;
            if damping > 1e12 {
                break;
            }
        }
    }
    theta
}
