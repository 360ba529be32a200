//! Effects estimated together with the baseline.

use std::path::Path;

use rayon::prelude::*;
use retina_files::InputError;

use crate::added::{AddedEffect, Adjusted, SECOND_ORDERS, adjusted};
use crate::data::{Dataset, Flip};
use crate::estimate::{Parameter, estimate};
use crate::linear::dot;
use crate::noise::robust_fit;
use crate::own::evaluate;
use crate::scatter::{Noise, noise};
use crate::score::Frame;
use crate::step::Step;
use crate::sufficient::note_of_runs;
use crate::uncertainty::correlation_of;
use crate::units::flip_of;

/// Effects and baseline fitted to a table.
pub struct Fit {
    /// Parameters in the order of `correlation`; those that were chosen from lists after them.
    pub parameters: Vec<Parameter>,
    /// Correlation of the fitted parameters, row by row.
    pub correlation: Vec<Vec<f64>>,
    /// Weighted rms per component, without outliers.
    pub rms: f64,
    /// The same without weights.
    pub rms_unweighted: f64,
    /// The weighted one of groups left out.
    pub heldout_rms: f64,
    /// What the measurements scatter by.
    pub noise: Noise,
    /// Effects and held-out error, from the baseline on.
    pub steps: Vec<Step>,
    /// Number of outliers.
    pub outliers: usize,
    /// What the user ought to know.
    pub notes: Vec<String>,
    /// What the effects add to each row, components side by side, in the data's unit.
    pub effect: Vec<f64>,
    /// Errors left in each row, components side by side, in the data's unit.
    pub residual: Vec<f64>,
    /// Whether a row is an outlier.
    pub outlier: Vec<bool>,
}

impl Fit {
    /// Rms of what the effects add, per component in the table's unit.
    pub fn effect_rms(&self) -> f64 {
        (dot(&self.effect, &self.effect) / self.effect.len().max(1) as f64).sqrt()
    }

    /// Refuses to write row by row what was fitted to a part of the rows.
    pub(crate) fn check_covers(&self, path: &Path, data: &Dataset) -> Result<(), InputError> {
        if !data.in_part && self.outlier.len() == data.len() {
            return Ok(());
        }
        Err(InputError::new(path, "the table is too long to be written row by row")
            .found(format!("{} rows, of which {} were fitted", data.table_rows, self.outlier.len()))
            .help("part the table into campaigns"))
    }
}

/// Correlations above this are told to the user.
const HIGH_CORRELATION: f64 = 0.95;

/// Fits.
///
/// # Errors
/// A user's formula is not finite, or its parameters cannot be told apart.
pub fn fit(data: &Dataset, added: &[AddedEffect]) -> Result<Fit, InputError> {
    let whole = data;
    let fitted_part = data.fitted_part();
    let data = fitted_part.as_ref().unwrap_or(data);
    crate::added::check_effects(data, added)?;
    let Adjusted { data: mut shifted, base, names, owner, shape, start, user_values } = adjusted(data, added);
    let scatter = noise(whole);
    if let Some(noise) = &scatter {
        noise.weigh(&mut shifted);
    }
    let robust = robust_fit(&shifted, &base);
    let noise = Noise::beside(scatter, &shifted, &robust);
    let estimate = estimate(&shifted, &base, &robust.weights);
    let n = names.len();
    let (sigma, correlation) = correlation_of(&estimate.covariance);
    if let Some(i) = (0..n).find(|&i| owner[i].is_some() && sigma[i] == 0.0) {
        return Err(InputError::new(
            "--effect",
            "the effects cannot be told apart, or not from the baseline",
        )
        .found(format!("`{}` does what the others do", names[i]))
        .help("leave one of them out: `retina effects ID` names those that look alike"));
    }
    let mut notes = data.notes.clone();
    for i in 0..n {
        for j in 0..i {
            // Second orders are printed together, and share what they are by construction.
            let own = [i, j].iter().any(|&k| names[k].contains(SECOND_ORDERS));
            if owner[i].is_some() && !own && correlation[i][j].abs() > HIGH_CORRELATION {
                notes.push(format!(
                    "{} and {} are correlated by {:.3}",
                    names[i], names[j], correlation[i][j]
                ));
            }
        }
    }
    let mut parameters = estimate.named(0, names);
    for (parameter, start) in parameters.iter_mut().zip(&start) {
        parameter.value += start;
    }
    parameters.extend(shape.into_iter().map(|(_, name, value)| Parameter { name, value, sigma: None }));

    let mut effect = vec![0.0; data.y.len()];
    let mut residual = shifted.y.clone();
    for (k, column) in base.iter().enumerate() {
        let c = estimate.values[k];
        for at in 0..column.len() {
            residual[at] -= c * column[at];
            if owner[k].is_some() {
                effect[at] += c * column[at];
            }
        }
    }
    for (_, values) in &user_values {
        effect.iter_mut().zip(values).for_each(|(sum, v)| *sum += v);
    }

    // Of few exposures rows are left out, as in a diagnosis: of one, nothing else can be.
    let flip = flip_of(data, &noise);
    if flip == Flip::Rows {
        let in_runs = Dataset { flip, ..data.clone() };
        notes.extend(note_of_runs(&in_runs));
    }
    let step = |count: usize| {
        let within = |index: Option<usize>| index.is_none_or(|index| index < count);
        let columns: Vec<Vec<f64>> =
            base.iter().zip(&owner).filter(|(_, o)| within(**o)).map(|(c, _)| c.clone()).collect();
        let mut so_far = Dataset { flip, ..data.clone() };
        for (index, values) in &user_values {
            if *index < count {
                so_far.y.iter_mut().zip(values).for_each(|(y, v)| *y -= v);
            }
        }
        let frame = Frame::weighted(&so_far, &columns, robust.weights.clone());
        let names = added[..count].iter().map(|effect| effect.name().to_owned()).collect();
        Step::new(names, &frame.held_out(&[]))
    };
    let steps: Vec<Step> = (0..=added.len()).into_par_iter().map(step).collect();
    Ok(Fit {
        parameters,
        correlation,
        rms: robust.weights.rms(data.components(), &residual),
        rms_unweighted: robust.weights.rms_unweighted(data.components(), &residual),
        heldout_rms: steps[added.len()].heldout_rms,
        noise,
        steps,
        outliers: robust.weights.outlier.iter().filter(|out| **out).count(),
        notes,
        effect,
        residual,
        outlier: robust.weights.outlier,
    })
}

impl Fit {
    /// What the users' effects of the fit's `model` add to the rows of other data, all components, in the table's unit.
    pub fn own_effects_on(&self, model: &[AddedEffect], data: &Dataset) -> Vec<f64> {
        let mut out = vec![0.0; data.y.len()];
        for effect in model {
            let AddedEffect::Own(user) = effect else { continue };
            let value = |name: &str| {
                let name = format!("{}.{name}", user.name());
                self.parameters.iter().find(|p| p.name == name).map_or(0.0, |p| p.value)
            };
            let parameters: Vec<f64> = user.parameters().iter().map(|p| value(&p.name)).collect();
            let (values, _) = evaluate(user.as_ref(), data, &parameters);
            out.iter_mut().zip(&values).for_each(|(sum, v)| *sum += v);
        }
        out
    }
}
