//! Where a detector finds a spot: the Gaussian-weighted mean of its light, the weight as wide as the spot asks for.
//!
//! The mean of all light lies aside of a spot's bright core where there is coma, by more than a pixel at the field's edge.
//! So the bench registers the images of points by this place, and not by the mean.

use std::f64::consts::TAU;

use retina_optics::facility::{SpectralLine, Wavefront, tangents};
use retina_optics::pupil::{PupilPoint, gaussian};

/// Variance of a detector's weight in units of the spot's.
const WEIGHT_RATIO: f64 = 2.0;
/// Widths that a detector takes for those of spots, px.
const RANGE_PX: [f64; 2] = [0.5, 7.0];
/// Rays over the pupil.
const RINGS: usize = 7;
const ARMS: usize = 16;
/// Width that a detector finds of Airy's pattern [2 J1(u) / u]^2, in units of u = 2 pi R theta / lambda: the fixed point of
/// [`windowed_mean`]'s sigma for it, by numerical quadrature.
const AIRY: f64 = 1.275;
/// A step shorter than this ends the iteration, px.
const SETTLED_PX: f64 = 1e-9;
const MOST_ROUNDS: usize = 400;

/// A ray's place (px, from anywhere) and its share of the light.
pub(super) type RayPlace = ([f64; 2], f64);

/// The windowed mean of rays, each spread as a Gaussian of standard deviation `blur_px`: place and the spot's standard
/// deviation, px.
///
/// With rays p_j of shares w_j, a weight of variance v = 2 s^2 about c and b the blur: c is the mean of p_j with the
/// shares w_j exp(-|p_j - c|^2 / (2 (v + b^2))), and s^2 that of the Gaussian whose product with the weight has the
/// moments found (as the detector of `retina-image` has it).
pub(super) fn windowed_mean(rays: &[RayPlace], blur_px: f64) -> ([f64; 2], f64) {
    let blur2 = blur_px * blur_px;
    let total: f64 = rays.iter().map(|(_, w)| w).sum();
    let mut at = [0, 1].map(|k| rays.iter().map(|(p, w)| w * p[k]).sum::<f64>() / total);
    let spread: f64 =
        rays.iter().map(|(p, w)| w * ((p[0] - at[0]).powi(2) + (p[1] - at[1]).powi(2))).sum::<f64>() / total;
    let mut sigma = (0.5 * spread + blur2).sqrt().clamp(RANGE_PX[0], RANGE_PX[1]);
    for _ in 0..MOST_ROUNDS {
        let weight2 = WEIGHT_RATIO * sigma * sigma;
        let wide2 = weight2 + blur2;
        let shrink = weight2 / wide2;
        let (mut light, mut first, mut second) = (0.0, [0.0; 2], [0.0; 3]);
        for (place, share) in rays {
            let [x, y] = [place[0] - at[0], place[1] - at[1]];
            let w = share * (-(x * x + y * y) / (2.0 * wide2)).exp();
            light += w;
            first = [first[0] + w * x, first[1] + w * y];
            second = [second[0] + w * x * x, second[1] + w * x * y, second[2] + w * y * y];
        }
        let own = weight2 * blur2 / wide2;
        let [xx, xy, yy] = second.map(|sum| shrink * shrink * sum / light);
        let (xx, yy) = (xx + own, yy + own);
        let determinant = xx * yy - xy * xy;
        let [a, b, c] =
            [yy / determinant - 1.0 / weight2, -xy / determinant, xx / determinant - 1.0 / weight2];
        let inverse = a * c - b * b;
        // Light that is even over the window has no width in it.
        let next = if a > 0.0 && inverse > 0.0 { inverse.powf(-0.25) } else { 1.5 * sigma };
        let next = next.clamp(sigma / 1.5, 1.5 * sigma).clamp(RANGE_PX[0], RANGE_PX[1]);
        let step = first.map(|sum| shrink * (1.0 + 1.0 / WEIGHT_RATIO) * sum / light);
        at = [at[0] + step[0], at[1] + step[1]];
        let settled = step[0].hypot(step[1]) < SETTLED_PX && (next - sigma).abs() < SETTLED_PX;
        sigma = next;
        if settled {
            break;
        }
    }
    (at, sigma)
}

/// How a camera samples spots.
#[derive(Debug, Clone)]
pub(super) struct Sampling {
    /// Focal length, px.
    focal_px: f64,
    pupil: Vec<PupilPoint>,
}

impl Sampling {
    pub(super) fn new(focal_px: f64) -> Self {
        Self { focal_px, pupil: gaussian(RINGS, ARMS, 0.0) }
    }

    /// Standard deviation of what spreads a ray, px: the pixel's box, and the diffraction of a clear pupil.
    pub(super) fn blur_px(focal_px: f64, nm: f64, pupil_radius_mm: f64) -> f64 {
        let diffraction = AIRY * nm * 1e-6 / (TAU * pupil_radius_mm) * focal_px;
        diffraction.hypot((1.0f64 / 12.0).sqrt())
    }

    /// Tangents of the windowed mean of the light of these spectral lines, each with its wavefront.
    pub(super) fn middle(&self, lines: impl Iterator<Item = (SpectralLine, Wavefront)>) -> [f64; 2] {
        let (mut rays, mut blur, mut shares) = (Vec::new(), 0.0, 0.0);
        for ((nm, share), wavefront) in lines {
            blur += share * Self::blur_px(self.focal_px, nm, wavefront.pupil_radius_mm);
            shares += share;
            rays.extend(self.pupil.iter().map(|point| {
                let at = tangents(wavefront.direction(point.at));
                (at.map(|t| t * self.focal_px), share * point.weight)
            }));
        }
        windowed_mean(&rays, blur / shares).0.map(|px| px / self.focal_px)
    }
}

#[cfg(test)]
mod tests {
    use super::windowed_mean;

    /// One ray is a Gaussian: its place, and its own width.
    #[test]
    fn a_gaussian_is_found_with_its_width() {
        let (at, sigma) = windowed_mean(&[([3.25, -1.5], 0.7)], 0.8);
        assert!((at[0] - 3.25).hypot(at[1] + 1.5) < 1e-12 && (sigma - 0.8).abs() < 1e-8, "{at:?} {sigma}");
    }

    /// A faint wing far off moves the mean of the light, and not what a detector finds; a wing within the window does in
    /// part.
    #[test]
    fn a_wing_counts_as_far_as_the_window_reaches() {
        let wing = |at: f64| windowed_mean(&[([0.0, 0.0], 0.9), ([at, 0.0], 0.1)], 0.8).0[0];
        assert!(wing(12.0).abs() < 1e-3, "{}", wing(12.0));
        assert!(wing(1.0) > 0.05 && wing(1.0) < 0.1, "{}", wing(1.0));
        let two = windowed_mean(&[([-0.3, 0.2], 0.5), ([0.3, 0.2], 0.5)], 0.8).0;
        assert!(two[0].abs() < 1e-9 && (two[1] - 0.2).abs() < 1e-9, "{two:?}");
    }
}
