//! Forms made anew about what was found: a display that stands far from where it should, a strong coma, and another
//! exponent of the display.
//!
//! Forms are those of a small change, or of the nearest one that was traced. What a larger one does is not in proportion
//! to it, so it would look like further effects. Once the display's tilt and bow are known, their forms are made anew: what
//! the whole depth does, over the depth, which is right for the amplitudes they were made with, and to second order for
//! those that are fitted then. With a coma that is known, the lenses are traced anew. The display's exponent is one of a
//! power, and its form about the exponent that was found is the power itself.

use retina_formats::{EffectId, PointsEffect, PowerEffect};
use retina_geometry::ComaForm;

use crate::added::{AddedEffect, Adjusted};
use crate::catalogue::depth_mm;
use crate::data::{Dataset, DisplayDepth, FoundGamma};
use crate::estimate::{Parameter, estimate};
use crate::noise::robust_fit;
use crate::series::median;

/// Depth within the camera's field from which on it counts, mm: a hundredth to a thirtieth of what it does is not in
/// proportion to it.
const DEEP_MM: f64 = 0.02;
/// Comas that are traced anew, mm. A weaker one does what the weakest form says. A stronger one smears spots beyond any
/// window.
const TRACED_MM: [f64; 2] = [5e-5, 3e-3];
/// Part of a coma by which it may change without another trace.
const SETTLED: f64 = 0.01;
/// Exponents below this do what their logarithm says. One that changes by less than a part of itself is known.
const BENT: f64 = 0.005;
const SETTLED_EXPONENT: f64 = 1e-3;

/// An effect with its parameters.
type Found<'a> = (EffectId, &'a [Parameter]);

/// The data with forms about what these effects say; `None` where the present ones hold.
pub(crate) fn retraced<'a>(data: &Dataset, effects: impl Iterator<Item = Found<'a>>) -> Option<Dataset> {
    let effects: Vec<Found<'_>> = effects.collect();
    let (depth, coma) = (found_depth(data, &effects), found_coma(data, &effects));
    let gamma = found_gamma(data, &effects);
    (depth.is_some() || coma.is_some() || gamma.is_some()).then(|| Dataset {
        display_depth: depth.unwrap_or(data.display_depth),
        found_coma: coma.or(data.found_coma),
        found_gamma: gamma.or(data.found_gamma),
        ..data.clone()
    })
}

fn value(parameters: &[Parameter], name: &str) -> Option<f64> {
    let own = |p: &&Parameter| p.name == name || p.name.ends_with(&format!(".{name}"));
    parameters.iter().find(own).map(|p| p.value)
}

/// Where the effects put the display, if it is deep there and its place was not known yet.
fn found_depth(data: &Dataset, effects: &[Found<'_>]) -> Option<DisplayDepth> {
    if data.display_depth != DisplayDepth::default() {
        return None;
    }
    let rays = data.display?;
    let mut depth = DisplayDepth::default();
    for (effect, parameters) in effects {
        let both = || ["a_arcsec", "b_arcsec"].map(|name| value(parameters, name).unwrap_or(0.0));
        match effect {
            EffectId::Points(PointsEffect::ScreenTilt) => depth.tilt = both(),
            EffectId::Points(PointsEffect::ScreenBow) => depth.bow = both(),
            _ => {}
        }
    }
    let (x, y) = (data.values("x"), data.values("y"));
    let deepest =
        (0..data.len()).map(|row| depth_mm(data, &rays, depth, [x[row], y[row]]).abs()).fold(0.0, f64::max);
    (deepest > DEEP_MM).then_some(depth)
}

/// The form of the coma that is among the effects, if it is another one than before.
fn found_coma(data: &Dataset, effects: &[Found<'_>]) -> Option<ComaForm> {
    let tracer = data.tracer.as_ref()?;
    let of_coma = |(effect, _): &&Found<'_>| matches!(effect, EffectId::Points(PointsEffect::FluxComa));
    let (_, parameters) = effects.iter().find(of_coma)?;
    let coma_mm = 1e-3 * value(parameters, "coma_um")?;
    let settled = data.found_coma.is_some_and(|known| (coma_mm / known.coma_mm - 1.0).abs() < SETTLED);
    let [least, most] = TRACED_MM;
    (!settled && (least..=most).contains(&coma_mm.abs())).then(|| tracer.coma_form(coma_mm)).flatten()
}

/// The display's exponent, less the setup's, if it is another one than before.
fn found_gamma(data: &Dataset, effects: &[Found<'_>]) -> Option<FoundGamma> {
    let of_gamma = |(effect, _): &&Found<'_>| matches!(effect, EffectId::Power(PowerEffect::Gamma));
    let (_, parameters) = effects.iter().find(of_gamma)?;
    let exponent = value(parameters, "exponent")?;
    let settled =
        data.found_gamma.is_some_and(|known| (exponent / known.exponent - 1.0).abs() < SETTLED_EXPONENT);
    if settled || exponent.abs() < BENT {
        return None;
    }
    // The gain by the brightest half of the readings, where the exponent counts least.
    let (level, lit) = (data.values("level"), data.values("lit"));
    let middle =
        median(&level.iter().zip(lit).filter(|(_, lit)| **lit > 0.0).map(|(l, _)| *l).collect::<Vec<_>>());
    let bright = (0..data.len()).filter(|&i| lit[i] > 0.0 && level[i] >= middle);
    let gains: Vec<f64> =
        bright.map(|i| (1.0 + data.y[i * data.components()]) / level[i].powf(exponent)).collect();
    let gain = median(&gains);
    (gain > 0.0).then_some(FoundGamma { exponent, gain })
}

/// The same by what a first fit of added effects says.
pub(crate) fn retraced_by_added(data: &Dataset, added: &[AddedEffect], first: &Adjusted) -> Option<Dataset> {
    use PointsEffect as E;
    let traced = |effect: &AddedEffect| match effect.id() {
        Some(EffectId::Points(E::ScreenTilt | E::ScreenBow | E::FluxComa)) => data.display.is_some(),
        Some(EffectId::Power(PowerEffect::Gamma)) => true,
        _ => false,
    };
    if !added.iter().any(traced) {
        return None;
    }
    let fit = robust_fit(&first.data, &first.base);
    let found = estimate(&first.data, &first.base, &fit.weights).named(0, first.names.clone());
    let own: Vec<(EffectId, Vec<Parameter>)> = added
        .iter()
        .enumerate()
        .filter(|(_, effect)| traced(effect))
        .filter_map(|(index, effect)| {
            let parameters = found.iter().zip(&first.owner).filter(|(_, owner)| **owner == Some(index));
            Some((effect.id()?, parameters.map(|(p, _)| p.clone()).collect()))
        })
        .collect();
    retraced(data, own.iter().map(|(id, parameters)| (*id, parameters.as_slice())))
}
