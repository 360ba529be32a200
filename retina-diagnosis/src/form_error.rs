//! How far the form of a strong effect may be off, because lenses as built are not exactly those of the setup.
//!
//! An effect's form is traced through the setup's prescription. Radii, indices, gaps, tilts and decentres are off by their
//! tolerances, and the form with them: by a small part of the effect that is smooth over the field and largest at its
//! edge. Beside a strong effect this is more than the noise, and would look like further effects. So it is a random field
//! beside the model, as the error of the calibration is, once a diagnosis has found the effect. A fit of effects that are
//! given takes their forms as they are.
//!
//! Sizes and shape are those of eight facilities drawn within the tolerances of `validation/as_built.py` from two
//! designs: displacements by each effect, less those of the nominal design times the scale that fits best. By restricted
//! likelihood a field r^2 P_i(x) P_j(y) is better than one without r^2 for a tilt, both bows and a pointing, which were
//! tried both ways. Each degree is smaller than the one before by 0.84 to 1.0 (0.65 of a radial term).

use std::ops::Range;

use glam::DVec2;
use retina_formats::{EffectId, PointsEffect};

use crate::data::Dataset;
use crate::estimate::estimate;
use crate::field::{Held, half_widths, products};
use crate::linear::{Basis, dot};
use crate::noise::Weights;
use crate::search::FLOOR_NOISE;
use crate::series::median;

/// By how much a form is off, as parts of the effect.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Part {
    /// Rms of the smooth field: 0.07 to 0.11 were found for the display's or the camera's place, and for what the lenses
    /// bend themselves 0.26 to 0.30 (coma), 0.31 (the optical centre), 0.37 (a radial term).
    smooth: f64,
    /// Standard deviation of each mode by which the form is larger here and smaller there. The first mode is its scale. The
    /// eight facilities' scales were off by 0.006 to 0.016 rms (places), 0.01 to 0.04 (lenses) and 0.04 to 0.08 (coma).
    gain: f64,
    /// Degree of these modes.
    gain_degree: u32,
}

const BY_PLACE: Part = Part { smooth: 0.1, gain: 0.02, gain_degree: 0 };
const BY_LENSES: Part = Part { smooth: 0.3, gain: 0.04, gain_degree: 0 };
/// Where bright cores turn round in the field is another place in other lenses: no smooth field follows that.
const BY_COMA: Part = Part { smooth: 0.3, gain: 0.1, gain_degree: 2 };
/// The degree of the last modes before r^2.
const DEGREE: u32 = 6;
/// Each degree's modes are smaller than those before by this factor.
const DECAY: f64 = 0.9;

/// An effect that the model has, and its place among the model's columns.
pub(crate) struct InModel {
    pub(crate) effect: EffectId,
    /// Whether its form does not depend on the light.
    pub(crate) steady: bool,
    /// Its leading columns.
    pub(crate) columns: Range<usize>,
}

/// By how much the form of an effect is off; `None` of one that is not made by the lenses, or that depends on the light.
pub(crate) fn part(effect: EffectId, steady: bool) -> Option<Part> {
    use PointsEffect as E;
    let EffectId::Points(effect) = effect else { return None };
    match effect {
        E::ScreenTilt | E::ScreenBow | E::CameraPointing => Some(BY_PLACE),
        E::RadialHigherOrder | E::Decentering | E::ThinPrism | E::OpticalCentre => Some(BY_LENSES),
        E::FluxComa | E::FluxShift => steady.then_some(BY_COMA),
        _ => None,
    }
}

/// What the forms of the model's effects may be off by.
#[derive(Debug, Clone, Default)]
pub(crate) struct FormError {
    /// Rms over the rows, per component.
    pub(crate) arcsec: f64,
    /// Independent, each of unit variance.
    pub(crate) columns: Vec<Vec<f64>>,
}

impl FormError {
    /// On some of the rows.
    pub(crate) fn of_rows(&self, rows: &[usize]) -> Self {
        let of =
            |column: &Vec<f64>| rows.iter().flat_map(|row| [column[2 * row], column[2 * row + 1]]).collect();
        Self { arcsec: self.arcsec, columns: self.columns.iter().map(of).collect() }
    }
}

/// What the forms of the model's effects may be off by beside its first `baseline` columns; `None` where that is less than
/// can be seen, and where no calibration is held fixed: the baseline follows what is smooth then.
pub(crate) fn form_error(
    data: &Dataset,
    model: &[Vec<f64>],
    baseline: usize,
    effects: &[InModel],
    weights: &Weights,
) -> Option<FormError> {
    let off: Vec<(Part, &InModel)> =
        effects.iter().filter_map(|own| Some((part(own.effect, own.steady)?, own))).collect();
    let Some(Held::Geometry(held)) = &data.held else { return None };
    if off.is_empty() {
        return None;
    }
    let found = estimate(data, model, weights);
    let basis = Basis::of(model[..baseline].iter().cloned());
    let (mut columns, mut square) = (Vec::new(), 0.0);
    for (part, own) in &off {
        let mut displacement = vec![0.0; data.y.len()];
        for at in own.columns.clone() {
            displacement.iter_mut().zip(&model[at]).for_each(|(sum, value)| *sum += found.values[at] * value);
        }
        let beside = basis.residual(displacement.clone());
        square += part.smooth.powi(2) * dot(&beside, &beside) / beside.len() as f64;
        columns.extend(modulated(&held.sight, &displacement, *part));
    }
    let arcsec = square.sqrt();
    columns.extend(modes(&held.sight, arcsec));
    (arcsec > FLOOR_NOISE * median(&weights.sigma)).then_some(FormError { arcsec, columns })
}

/// The form itself, larger here and smaller there. Products come along both axes in turn: one of each pair is the scalar.
fn modulated(sight: &[DVec2], displacement: &[f64], part: Part) -> Vec<Vec<f64>> {
    products(sight, half_widths(sight), 0, part.gain_degree, |_| part.gain)
        .into_iter()
        .step_by(2)
        .map(|mode| {
            mode.chunks_exact(2)
                .zip(displacement.chunks_exact(2))
                .flat_map(|(by, d)| [by[0] * d[0], by[0] * d[1]])
                .collect()
        })
        .collect()
}

/// What a diagnosis says of it.
pub(crate) fn note(data: &Dataset) -> Option<String> {
    (data.form_error.arcsec > 0.0).then(|| {
        format!(
            "the forms of effects are those of the setup's lenses; lenses as they were built, within ordinary tolerances, give others by about {:.2} arcsec rms, smooth over the field. What is left is judged beside that",
            data.form_error.arcsec
        )
    })
}

/// Independent columns, each of unit variance, of a form that is off by `rms_arcsec` at lines of sight `sight` (tangents).
fn modes(sight: &[DVec2], rms_arcsec: f64) -> Vec<Vec<f64>> {
    let r4 = sight.iter().map(|r| r.length_squared().powi(2)).sum::<f64>() / sight.len() as f64;
    let r2: Vec<f64> = sight.iter().map(|r| r.length_squared() / r4.sqrt()).collect();
    let sizes = |degree: u32| DECAY.powi(degree as i32);
    let variance: f64 = (0..=DEGREE).map(|d| f64::from(d + 1) * sizes(d).powi(2)).sum();
    let unit = rms_arcsec / variance.sqrt();
    products(sight, half_widths(sight), 0, DEGREE, |degree| unit * sizes(degree))
        .into_iter()
        .map(|mut column| {
            column.chunks_exact_mut(2).zip(&r2).for_each(|(d, r2)| d.iter_mut().for_each(|v| *v *= r2));
            column
        })
        .collect()
}
