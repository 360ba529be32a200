//! A display that stands far from where it should: its tilt and bow are fitted about the place where it stands.
//!
//! Forms are those of a small change. What a larger one does is not in proportion to it, so it would look like further
//! effects. Once the display's tilt and bow are known, their forms are made anew: what the whole depth does, over the
//! depth, which is right for the amplitudes they were made with, and to second order for those that are fitted then.

use retina_formats::{EffectId, PointsEffect};

use crate::added::{AddedEffect, Adjusted};
use crate::catalogue::depth_mm;
use crate::data::{Dataset, DisplayDepth};
use crate::estimate::{Parameter, estimate};
use crate::noise::robust_fit;

/// Depth within the camera's field from which on it counts, mm: a hundredth to a thirtieth of what it does is not in
/// proportion to it.
const DEEP_MM: f64 = 0.02;

/// The data about the place where effects with these parameters put the display; `None` where it is not deep, or the
/// effects are others.
pub(crate) fn moved<'a>(
    data: &Dataset,
    effects: impl Iterator<Item = (EffectId, &'a [Parameter])>,
) -> Option<Dataset> {
    let rays = data.display?;
    let mut depth = data.display_depth;
    for (effect, parameters) in effects {
        let amplitude = |name: &str| {
            let own = |p: &&Parameter| p.name == name || p.name.ends_with(&format!(".{name}"));
            parameters.iter().find(own).map_or(0.0, |p| p.value)
        };
        let both = || ["a_arcsec", "b_arcsec"].map(amplitude);
        match effect {
            EffectId::Points(PointsEffect::ScreenTilt) => depth.tilt = both(),
            EffectId::Points(PointsEffect::ScreenBow) => depth.bow = both(),
            _ => {}
        }
    }
    let (x, y) = (data.values("x"), data.values("y"));
    let deepest =
        (0..data.len()).map(|row| depth_mm(data, &rays, depth, [x[row], y[row]]).abs()).fold(0.0, f64::max);
    let same = depth == DisplayDepth::default() || depth == data.display_depth;
    (deepest > DEEP_MM && !same).then(|| Dataset { display_depth: depth, ..data.clone() })
}

/// The same by what a first fit of added effects says.
pub(crate) fn moved_by_added(data: &Dataset, added: &[AddedEffect], first: &Adjusted) -> Option<Dataset> {
    let places = |effect: &AddedEffect| {
        matches!(effect.id(), Some(EffectId::Points(PointsEffect::ScreenTilt | PointsEffect::ScreenBow)))
    };
    if data.display.is_none() || !added.iter().any(places) {
        return None;
    }
    let fit = robust_fit(&first.data, &first.base);
    let found = estimate(&first.data, &first.base, &fit.weights).named(0, first.names.clone());
    let own: Vec<(EffectId, Vec<Parameter>)> = added
        .iter()
        .enumerate()
        .filter(|(_, effect)| places(effect))
        .filter_map(|(index, effect)| {
            let parameters = found.iter().zip(&first.owner).filter(|(_, owner)| **owner == Some(index));
            Some((effect.id()?, parameters.map(|(p, _)| p.clone()).collect()))
        })
        .collect();
    moved(data, own.iter().map(|(id, parameters)| (*id, parameters.as_slice())))
}
