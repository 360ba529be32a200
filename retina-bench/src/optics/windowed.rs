//! Where a detector finds a spot: the Gaussian-weighted mean of its light, the weight as wide as the spot asks for.
//!
//! The mean of all light lies aside of a spot's bright core where there is coma, by more than a pixel at the field's edge.
//! So the bench registers the images of points by this place, and not by the mean.

use std::f64::consts::TAU;

use glam::DVec2;
use rayon::prelude::*;
use retina_geometry::cubic_shares;
use retina_optics::facility::{Kernel, PupilSlopes, Wavefront, tangents};
use retina_optics::pupil::gaussian;

/// Variance of a detector's weight in units of the spot's.
const WEIGHT_RATIO: f64 = 2.0;
/// Widths that a detector takes for those of spots, px.
const RANGE_PX: [f64; 2] = [0.5, 7.0];
/// Rays over the pupil.
const RINGS: usize = 7;
const ARMS: usize = 16;
/// Width that a detector finds of Airy's pattern [2 J1(u) / u]^2, in units of u = 2 pi R theta / lambda, by numerical
/// quadrature.
const AIRY: f64 = 1.275;
/// Rounds from the mean of the light and its own width. A detector goes on until nothing moves; where a spot has two cores
/// its answer jumps from one to the other. So few rounds are nearly there, and are smooth over the field: images that are
/// placed by them do not jump.
const ROUNDS: usize = 6;

/// A ray's place (px, from anywhere) and its share of the light.
pub(super) type RayPlace = ([f64; 2], f64);

/// The windowed mean of rays, each spread as a Gaussian of standard deviation `blur_px`, px.
///
/// With rays p_j of shares w_j, a weight of variance v = 2 s^2 about c and b the blur: c is the mean of p_j with the
/// shares w_j exp(-|p_j - c|^2 / (2 (v + b^2))), and s^2 that of the Gaussian whose product with the weight has the
/// moments found (as the detector of `retina-image` has it).
pub(super) fn windowed_mean(rays: &[RayPlace], blur_px: f64) -> [f64; 2] {
    let blur2 = blur_px * blur_px;
    let total: f64 = rays.iter().map(|(_, w)| w).sum();
    let at = [0, 1].map(|k| rays.iter().map(|(p, w)| w * p[k]).sum::<f64>() / total);
    let spread: f64 =
        rays.iter().map(|(p, w)| w * ((p[0] - at[0]).powi(2) + (p[1] - at[1]).powi(2))).sum::<f64>() / total;
    let mut window = Window { at, sigma: (0.5 * spread + blur2).sqrt().clamp(RANGE_PX[0], RANGE_PX[1]) };
    for _ in 0..ROUNDS {
        let wide2 = window.variance() + blur2;
        let mut moments = Moments::default();
        for (place, share) in rays {
            let [x, y] = [place[0] - window.at[0], place[1] - window.at[1]];
            moments.add(share * (-(x * x + y * y) / (2.0 * wide2)).exp(), x, y);
        }
        window.step(&moments, blur2);
    }
    window.at
}

/// Rounds until the windowed mean of an image stands still to 1e-4 px.
const SETTLED: usize = 14;

/// The windowed mean of an image, from its brightest sample, and the width that it finds.
pub(super) fn windowed_in(image: &Kernel) -> Window {
    let side = image.grid.side();
    let brightest = image.values.iter().enumerate().fold(
        (0, 0.0),
        |best: (usize, f32), (i, &v)| {
            if v > best.1 { (i, v) } else { best }
        },
    );
    let offset = |sample: usize| (sample as f64 - (side / 2) as f64) / image.grid.per_px as f64;
    let mut window =
        Window { at: [brightest.0 % side, brightest.0 / side].map(offset), sigma: 2.0 * RANGE_PX[0] };
    for _ in 0..SETTLED {
        window.step(&window.moments(image), 0.0);
    }
    window
}

/// The same by a window for spots of the width `sigma`, px.
pub(super) fn windowed_as(image: &Kernel, start: Window, sigma: f64) -> [f64; 2] {
    let mut window = Window { sigma, ..start };
    for _ in 0..SETTLED {
        window.step(&window.moments(image), 0.0);
        window.sigma = sigma;
    }
    window.at
}

/// A detector's window: its middle, px from the image's, and the width that it takes for the spot's, px.
#[derive(Debug, Clone, Copy)]
pub(super) struct Window {
    pub(super) at: [f64; 2],
    pub(super) sigma: f64,
}

/// Weighted light, and its moments about the window's middle.
#[derive(Default)]
struct Moments {
    light: f64,
    first: [f64; 2],
    /// xx, xy, yy.
    second: [f64; 3],
}

impl Moments {
    fn add(&mut self, light: f64, x: f64, y: f64) {
        self.light += light;
        self.first = [self.first[0] + light * x, self.first[1] + light * y];
        let [xx, xy, yy] = self.second;
        self.second = [xx + light * x * x, xy + light * x * y, yy + light * y * y];
    }
}

impl Window {
    /// Weighted moments of an image.
    fn moments(&self, image: &Kernel) -> Moments {
        let side = image.grid.side();
        let offset = |sample: usize| (sample as f64 - (side / 2) as f64) / image.grid.per_px as f64;
        let [across, down] = self.at.map(|at| -> Vec<(f64, f64)> {
            (0..side)
                .map(|sample| {
                    let x = offset(sample) - at;
                    (x, (-x * x / (2.0 * self.variance())).exp())
                })
                .collect()
        });
        let mut moments = Moments::default();
        for (row, &(y, weight)) in image.values.chunks_exact(side).zip(&down) {
            let mut line = [0.0; 3];
            for (&value, &(x, weight)) in row.iter().zip(&across) {
                let light = weight * f64::from(value);
                line = [line[0] + light, line[1] + light * x, line[2] + light * x * x];
            }
            let [light, x, xx] = line.map(|sum| weight * sum);
            moments.light += light;
            moments.first = [moments.first[0] + x, moments.first[1] + y * light];
            moments.second =
                [moments.second[0] + xx, moments.second[1] + y * x, moments.second[2] + y * y * light];
        }
        moments
    }

    /// Variance of the weight.
    fn variance(&self) -> f64 {
        WEIGHT_RATIO * self.sigma * self.sigma
    }

    /// Moves to where the moments say that the light is, each of whose parts is spread by a Gaussian of variance `blur2`
    /// that the moments do not hold.
    fn step(&mut self, moments: &Moments, blur2: f64) {
        let weight2 = self.variance();
        let wide2 = weight2 + blur2;
        let shrink = weight2 / wide2;
        let own = weight2 * blur2 / wide2;
        let [xx, xy, yy] = moments.second.map(|sum| shrink * shrink * sum / moments.light);
        let (xx, yy) = (xx + own, yy + own);
        let determinant = xx * yy - xy * xy;
        let [a, b, c] =
            [yy / determinant - 1.0 / weight2, -xy / determinant, xx / determinant - 1.0 / weight2];
        let inverse = a * c - b * b;
        // Light that is even over the window has no width in it.
        let next = if a > 0.0 && inverse > 0.0 { inverse.powf(-0.25) } else { 1.5 * self.sigma };
        for (at, sum) in self.at.iter_mut().zip(moments.first) {
            *at += shrink * (1.0 + 1.0 / WEIGHT_RATIO) * sum / moments.light;
        }
        self.sigma = next.clamp(self.sigma / 1.5, 1.5 * self.sigma).clamp(RANGE_PX[0], RANGE_PX[1]);
    }
}

/// How a camera samples spots.
#[derive(Debug, Clone)]
pub(super) struct Sampling {
    /// Focal length, px.
    focal_px: f64,
    /// The rays of a spot: where they pass the pupil, and their shares of the light.
    rays: PupilSlopes,
    weights: Vec<f64>,
}

impl Sampling {
    pub(super) fn new(focal_px: f64) -> Self {
        let pupil = gaussian(RINGS, ARMS, 0.0);
        let rays = PupilSlopes::new(pupil.iter().map(|point| point.at));
        Self { focal_px, rays, weights: pupil.iter().map(|point| point.weight).collect() }
    }

    /// Standard deviation of what spreads a ray, px: the pixel's box, and the diffraction of a clear pupil.
    pub(super) fn blur_px(focal_px: f64, nm: f64, pupil_radius_mm: f64) -> f64 {
        let diffraction = AIRY * nm * 1e-6 / (TAU * pupil_radius_mm) * focal_px;
        diffraction.hypot((1.0f64 / 12.0).sqrt())
    }

    /// Tangents of the windowed mean of a spectral line's light.
    pub(super) fn middle(&self, nm: f64, wavefront: &Wavefront) -> [f64; 2] {
        let rays: Vec<RayPlace> = self
            .rays
            .directions(wavefront)
            .into_iter()
            .zip(&self.weights)
            .map(|(to, weight)| (tangents(to).map(|t| t * self.focal_px), *weight))
            .collect();
        let blur_px = Self::blur_px(self.focal_px, nm, wavefront.pupil_radius_mm);
        windowed_mean(&rays, blur_px).map(|px| px / self.focal_px)
    }
}

/// Places along x and y of the display at which [`Offsets`] are computed: cubics between them are within 0.003 px rms of a
/// table four times as dense. (A polynomial over the whole display rings where a spot has two cores.)
const PLACES: [usize; 2] = [33, 23];

/// How far a detector finds spots from the mean of their light, px: a table over the display, joined by cubics (Catmull
/// and Rom's).
pub(super) struct Offsets {
    half_screen_mm: [f64; 2],
    values: Vec<DVec2>,
}

impl Offsets {
    /// `of` a place of the display, mm.
    pub(super) fn new(half_screen_mm: [f64; 2], of: impl Fn([f64; 2]) -> DVec2 + Sync) -> Self {
        let at = |i: usize| {
            let place = [i % PLACES[0], i / PLACES[0]];
            [0, 1].map(|k| half_screen_mm[k] * (2.0 * place[k] as f64 / (PLACES[k] - 1) as f64 - 1.0))
        };
        let values = (0..PLACES[0] * PLACES[1]).into_par_iter().map(|i| of(at(i))).collect();
        Self { half_screen_mm, values }
    }

    /// At a place of the display, mm.
    pub(super) fn at(&self, at_mm: [f64; 2]) -> DVec2 {
        let [x, y] = [0, 1].map(|k| {
            let last = PLACES[k] - 1;
            let at = (at_mm[k] / self.half_screen_mm[k] + 1.0) / 2.0 * last as f64;
            let cell = (at.max(0.0) as usize).min(last - 1);
            (cell, cubic_shares(at - cell as f64), last)
        });
        let mut sum = DVec2::ZERO;
        for (j, wy) in y.1.into_iter().enumerate() {
            for (i, wx) in x.1.into_iter().enumerate() {
                sum += wx * wy * self.beyond([x.0 + i, y.0 + j].map(|k| k as isize - 1));
            }
        }
        sum
    }

    /// A value of the table; straight on beyond its edge.
    fn beyond(&self, place: [isize; 2]) -> DVec2 {
        let [i, j] = [0, 1].map(|k| place[k].clamp(0, PLACES[k] as isize - 1));
        let value = |i: isize, j: isize| self.values[j as usize * PLACES[0] + i as usize];
        let (di, dj) = (place[0] - i, place[1] - j);
        let edge = value(i, j);
        edge + (edge - value(i - di, j)) + (edge - value(i, j - dj))
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use super::{Offsets, windowed_mean};

    /// One ray is a Gaussian: its place.
    #[test]
    fn a_gaussian_is_found() {
        let at = windowed_mean(&[([3.25, -1.5], 0.7)], 0.8);
        assert!((at[0] - 3.25).hypot(at[1] + 1.5) < 1e-12, "{at:?}");
    }

    /// A faint wing far off moves the mean of the light, and not what a detector finds; a wing within the window does in
    /// part.
    #[test]
    fn a_wing_counts_as_far_as_the_window_reaches() {
        let wing = |at: f64| windowed_mean(&[([0.0, 0.0], 0.9), ([at, 0.0], 0.1)], 0.8)[0];
        assert!(wing(12.0).abs() < 1e-3, "{}", wing(12.0));
        assert!(wing(1.0) > 0.05 && wing(1.0) < 0.1, "{}", wing(1.0));
        let two = windowed_mean(&[([-0.3, 0.2], 0.5), ([0.3, 0.2], 0.5)], 0.8);
        assert!(two[0].abs() < 1e-9 && (two[1] - 0.2).abs() < 1e-9, "{two:?}");
    }

    /// A parabola is joined exactly, a smooth function to the fourth order, up to the edge of the display.
    #[test]
    fn offsets_between_their_places() {
        let of =
            |[x, y]: [f64; 2]| DVec2::new(1.0 + 0.2 * x - 0.1 * x * y, (0.4 * x).sin() * (0.3 * y).cos());
        let offsets = Offsets::new([9.0, 6.0], of);
        for at in [[0.0, 0.0], [3.3, -2.1], [-8.2, 5.1], [9.0, 6.0], [-9.0, -6.0]] {
            let (found, wanted) = (offsets.at(at), of(at));
            assert!((found.x - wanted.x).abs() < 1e-12, "{at:?}: {found}, {wanted}");
            assert!((found.y - wanted.y).abs() < 1e-3, "{at:?}: {found}, {wanted}");
        }
    }
}
