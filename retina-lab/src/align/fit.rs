//! The screws' positions from the spots of a round.
//!
//! The model is linear about a guess: spots = model(guess) + J (state - guess). Beside the screws stands what lenses as
//! built change: a scale along each axis, distortion of third and fifth order, the size of the spots, and the curvature of
//! the field.

use faer::linalg::solvers::Solve as _;
use faer::{Mat, Side};
use glam::DVec2;

use super::{Estimate, FITTED};
use crate::spots::Spot;
use crate::{Screw, Turns};

/// What the lenses as built change: scales, distortion (2), factor and summand of the spots' variance, curvature.
const LENSES: usize = 7;
const UNKNOWN: usize = FITTED.len() + LENSES;
/// What is known of them beforehand: scales to 1 %, distortion (of tangents) to 0.1 and 3, the spots' size to 5 % and
/// 0.1 px^2, the curvature of the field, as focus, to 0.001 mm / mm^2.
const KNOWN: [f64; LENSES] = [0.01, 0.01, 0.1, 3.0, 0.05, 0.1, 1e-3];
/// What hands and rulers reach: the tilts and shifts of a bench that stands, deg or mm, in the order of [`FITTED`]. Of
/// positions that the spots cannot tell apart the smallest is taken.
/// The relay's lenses are built in, within the tolerances of mounts.
const BY_HAND: [f64; FITTED.len()] =
    [0.5, 0.5, 0.3, 0.3, 0.5, BUILT_MM, BUILT_MM, BUILT_DEG, BUILT_DEG, 0.5, 0.5, 5.0];
const BUILT_MM: f64 = 0.05;
const BUILT_DEG: f64 = 0.05;
/// The model's own error: of a centroid, px, and of a variance, of itself and px^2.
const PLACE_SIGMA_PX: f64 = 0.03;
const VARIANCE_SIGMA: (f64, f64) = (0.05, 0.03);

/// Derivatives by the screws that are fitted: of the place, px, and of the variance, px^2.
pub(super) type Slopes = [(DVec2, f64); FITTED.len()];

/// A spot as measured and as the model has it, and its derivatives by the screws.
pub(super) struct Pair {
    /// Measured.
    pub(super) seen: Spot,
    /// Of the model at the guess.
    pub(super) model: Spot,
    /// By the screws that are fitted.
    pub(super) slopes: Slopes,
    /// From the image's centre, tangents of the field.
    pub(super) field: DVec2,
    /// Focal length, px.
    pub(super) focal_px: f64,
    /// From the screen's centre, mm.
    pub(super) screen_mm: DVec2,
}

/// What the spots of a round say.
pub(super) struct Fit {
    /// The screws' positions beside the design.
    pub(super) screws: Vec<(Screw, Estimate)>,
    /// RMS of the centroids about the model, px an axis.
    pub(super) rms_px: f64,
}

impl Pair {
    /// Rows of the equations: derivatives, residual and standard deviation.
    fn rows(&self) -> [([f64; UNKNOWN], f64, f64); 3] {
        let residual = self.seen.at_px - self.model.at_px;
        let variance = self.seen.variance_px2 - self.model.variance_px2;
        let mut rows = [[0.0; UNKNOWN]; 3];
        for (k, (place, width)) in self.slopes.iter().enumerate() {
            rows[0][k] = place.x;
            rows[1][k] = place.y;
            rows[2][k] = *width;
        }
        let (at, r2) = (self.field * self.focal_px, self.field.length_squared());
        let first = FITTED.len();
        rows[0][first] = at.x;
        rows[1][first + 1] = at.y;
        for (k, factor) in [r2, r2 * r2].into_iter().enumerate() {
            rows[0][first + 2 + k] = at.x * factor;
            rows[1][first + 2 + k] = at.y * factor;
        }
        let by_focus = FITTED.iter().position(|(screw, _)| *screw == Screw::ScreenFocus);
        rows[2][first + 4] = self.model.variance_px2;
        rows[2][first + 5] = 1.0;
        rows[2][first + 6] = by_focus.map_or(0.0, |k| self.slopes[k].1) * self.screen_mm.length_squared();
        let width_sigma = (VARIANCE_SIGMA.0 * self.seen.variance_px2).hypot(VARIANCE_SIGMA.1);
        [
            (rows[0], residual.x, PLACE_SIGMA_PX),
            (rows[1], residual.y, PLACE_SIGMA_PX),
            (rows[2], variance, width_sigma),
        ]
    }
}

/// Huber's weight of a residual in standard deviations.
fn weight(residual: f64) -> f64 {
    (3.0 / residual.abs()).min(1.0)
}

/// The screws' positions; the model is linear about `guess`. `None` where the spots do not determine them.
pub(super) fn fit(pairs: &[Pair], guess: &Turns) -> Option<Fit> {
    let rows: Vec<_> = pairs.iter().flat_map(Pair::rows).collect();
    let mut step = [0.0; UNKNOWN];
    let mut found = None;
    // Weights follow from what the last step leaves.
    for pass in 0..5 {
        let mut normal = Mat::<f64>::zeros(UNKNOWN, UNKNOWN);
        let mut right = Mat::<f64>::zeros(UNKNOWN, 1);
        let (mut chi2, mut squares_px2) = (0.0, 0.0);
        for (k, (slopes, residual, sigma)) in rows.iter().enumerate() {
            let model: f64 = slopes.iter().zip(&step).map(|(slope, step)| slope * step).sum();
            let left = (residual - model) / sigma;
            let weight = if pass == 0 { 1.0 } else { weight(left) };
            chi2 += weight * left * left;
            if k % 3 < 2 {
                squares_px2 += weight * (left * sigma).powi(2);
            }
            for i in 0..UNKNOWN {
                right[(i, 0)] += weight * slopes[i] * residual / (sigma * sigma);
                for j in 0..UNKNOWN {
                    normal[(i, j)] += weight * slopes[i] * slopes[j] / (sigma * sigma);
                }
            }
        }
        for (k, sigma) in KNOWN.into_iter().enumerate() {
            normal[(FITTED.len() + k, FITTED.len() + k)] += sigma.powi(-2);
        }
        for (k, ((screw, _), sigma)) in FITTED.iter().zip(BY_HAND).enumerate() {
            normal[(k, k)] += sigma.powi(-2);
            right[(k, 0)] -= guess.get(*screw) / (sigma * sigma);
        }
        let factor = normal.llt(Side::Lower).ok()?;
        let solution = factor.solve(&right);
        let covariance = factor.solve(&Mat::<f64>::identity(UNKNOWN, UNKNOWN));
        step = std::array::from_fn(|k| solution[(k, 0)]);
        // Where the spots differ from the model by more than its error, so does what is found.
        let scale = (chi2 / rows.len().saturating_sub(UNKNOWN).max(1) as f64).sqrt().max(1.0);
        let screws = FITTED.iter().enumerate().map(|(k, (screw, _))| {
            (
                *screw,
                Estimate { value: guess.get(*screw) + step[k], sigma: scale * covariance[(k, k)].sqrt() },
            )
        });
        let rms_px = (squares_px2 / (2 * pairs.len()) as f64).sqrt();
        found = Some(Fit { screws: screws.collect(), rms_px });
    }
    found
}
