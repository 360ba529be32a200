//! Forms made anew about what was found: a display that stands far from where it should, and a strong coma.
//!
//! Forms are those of a small change, or of the nearest one that was traced. What a larger one does is not in proportion
//! to it, so it would look like further effects. Once the display's tilt and bow are known, their forms are made anew: what
//! the whole depth does, over the depth, which is right for the amplitudes they were made with, and to second order for
//! those that are fitted then. With a coma that is known, the lenses are traced anew.

use retina_formats::{EffectId, PointsEffect};
use retina_geometry::ComaForm;

use crate::added::{AddedEffect, Adjusted};
use crate::catalogue::depth_mm;
use crate::data::{Dataset, DisplayDepth};
use crate::estimate::{Parameter, estimate};
use crate::noise::robust_fit;

/// Depth within the camera's field from which on it counts, mm: a hundredth to a thirtieth of what it does is not in
/// proportion to it.
const DEEP_MM: f64 = 0.02;
/// Comas that are traced anew, mm. A weaker one does what the weakest form says. A stronger one smears spots beyond any
/// window.
const TRACED_MM: [f64; 2] = [5e-5, 3e-3];
/// Part of a coma by which it may change without another trace.
const SETTLED: f64 = 0.01;

/// An effect with its parameters.
type Found<'a> = (EffectId, &'a [Parameter]);

/// The data with forms about what these effects say; `None` where the present ones hold.
pub(crate) fn retraced<'a>(data: &Dataset, effects: impl Iterator<Item = Found<'a>>) -> Option<Dataset> {
    let effects: Vec<Found<'_>> = effects.collect();
    let (depth, coma) = (found_depth(data, &effects), found_coma(data, &effects));
    (depth.is_some() || coma.is_some()).then(|| Dataset {
        display_depth: depth.unwrap_or(data.display_depth),
        found_coma: coma.or(data.found_coma),
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

/// The same by what a first fit of added effects says.
pub(crate) fn retraced_by_added(data: &Dataset, added: &[AddedEffect], first: &Adjusted) -> Option<Dataset> {
    use PointsEffect as E;
    let traced = |effect: &AddedEffect| {
        matches!(effect.id(), Some(EffectId::Points(E::ScreenTilt | E::ScreenBow | E::FluxComa)))
    };
    if data.display.is_none() || !added.iter().any(traced) {
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
