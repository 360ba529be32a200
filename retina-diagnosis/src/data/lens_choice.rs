//! Whether another lens model leaves less of the points than the chosen one does.

use rayon::prelude::*;
use retina_geometry::{LensModel, Pinhole};

use super::lens::{self, Shown};

/// Points that are looked at, and fewest of a mounting.
const MOST_POINTS: usize = 2000;
const FEWEST_OF_MOUNTING: usize = 40;
/// Fewer points tell no model from another.
const FEWEST_POINTS: usize = 100;
/// A model is told where it leaves less than this share of what the chosen one leaves.
const BETTER: f64 = 0.8;
/// Of models that leave nearly the same the simplest is told.
const ALIKE: f64 = 1.05;

/// What to try instead of the chosen model; `None` where no other is clearly better.
pub(super) fn better(chosen: LensModel, camera: &Pinhole, points: &[Shown]) -> Option<String> {
    if points.len() < FEWEST_POINTS {
        return None;
    }
    let looked_at = lens::evenly(points, MOST_POINTS, FEWEST_OF_MOUNTING);
    let left_px: Vec<Option<f64>> = LensModel::ALL
        .par_iter()
        .map(|model| {
            let fitted = lens::fitted(*model, camera, &looked_at).ok()?;
            lens::errors(&fitted, &looked_at).map(|errors| lens::sigma_px(&errors))
        })
        .collect();
    let of =
        |model: LensModel| LensModel::ALL.iter().position(|own| *own == model).and_then(|at| left_px[at]);
    let own = of(chosen)?;
    let least = left_px.iter().flatten().copied().fold(own, f64::min);
    // They stand with the fewest coefficients first.
    let best = LensModel::ALL.into_iter().find(|model| of(*model).is_some_and(|px| px <= ALIKE * least))?;
    let left = of(best)?;
    (left < BETTER * own).then(|| {
        format!(
            "the lens model `{best}` leaves {left:.3} px of the points where `{chosen}` leaves {own:.3} px: try --baseline {best}. What is named beside the wrong model may be only what this lens lacks",
            best = best.name(),
            chosen = chosen.name()
        )
    })
}
