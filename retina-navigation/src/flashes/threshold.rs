//! How far noise stands out by chance, and the threshold that it exceeds as often as is allowed.

use std::f64::consts::{PI, TAU};

/// Upper tail of the normal distribution.
pub fn normal_tail(x: f64) -> f64 {
    0.5 * libm::erfc(x * std::f64::consts::FRAC_1_SQRT_2)
}

/// What is searched: pixels and their border.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SearchArea {
    /// Pixels.
    pub pixels: usize,
    /// Length of their border, px: of a curve, not of the pixels' steps.
    pub border_px: f64,
}

impl SearchArea {
    /// Of a mask, row by row.
    pub fn of(mask: &[bool], width: usize) -> Self {
        let pixels = mask.iter().filter(|inside| **inside).count();
        let rows = || mask.chunks(width.max(1));
        let across: usize = rows().map(|row| row.windows(2).filter(|pair| pair[0] != pair[1]).count()).sum();
        let down: usize =
            rows().zip(rows().skip(1)).map(|(a, b)| a.iter().zip(b).filter(|(a, b)| a != b).count()).sum();
        // A line at any angle has 4 / pi of its length in steps, in the mean.
        Self { pixels, border_px: 0.25 * PI * (across + down) as f64 }
    }

    /// Maxima above `threshold` standard deviations in so many pixels' sums matched to a spot, of normal noise that is white:
    /// the expected Euler characteristic of what is above it (Adler 1981; Worsley 1995), and no more than pixels above it.
    fn expected_maxima(&self, threshold: f64, spot_sigma_px: f64) -> f64 {
        // Neighbouring sums are alike as exp(-r^2 / 4 s^2), s^2 with a pixel's own variance.
        let curvature = 0.5 / (spot_sigma_px * spot_sigma_px + 1.0 / 12.0);
        let bell = (-0.5 * threshold * threshold).exp();
        let inside = self.pixels as f64 * curvature * threshold * bell / TAU.powf(1.5);
        let border = 0.5 * self.border_px * curvature.sqrt() * bell / TAU;
        let tail = normal_tail(threshold);
        (inside + border + tail).min(self.pixels.max(1) as f64 * tail)
    }

    /// The threshold above which noise has `expected` maxima of sums matched to a spot.
    pub fn matched_threshold_sigma(&self, expected: f64, spot_sigma_px: f64) -> f64 {
        falling(|threshold| self.expected_maxima(threshold, spot_sigma_px) > expected)
    }
}

/// The threshold that the sum of 3 x 3 pixels' normal noise exceeds `expected` times among so many. Detections are fewer:
/// neighbouring sums are alike, and what one pixel makes alone is taken for a hot one. Six tenths are left at 3.7 sigma,
/// more above it.
pub fn threshold_sigma(pixels: usize, expected: f64) -> f64 {
    falling(|threshold| pixels.max(1) as f64 * normal_tail(threshold) > expected)
}

/// From where on there are no longer too many.
fn falling(too_many: impl Fn(f64) -> bool) -> f64 {
    let (mut low, mut high) = (1.0, 40.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if too_many(middle) { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tails_and_thresholds_are_the_tables() {
        // Abramowitz and Stegun, tables 26.1 and 26.2: Q(3), Q(4), Q(5).
        for (x, expected) in [(3.0, 1.349_90e-3), (4.0, 3.167_12e-5), (5.0, 2.866_52e-7)] {
            assert!((normal_tail(x) / expected - 1.0).abs() < 1e-5, "{x}");
        }
        assert!((threshold_sigma(1_000_000, 0.286_652) - 5.0).abs() < 1e-5);
    }

    #[test]
    fn a_disc_has_its_border_and_maxima_are_as_many_as_worsleys_formula_has() {
        let mask: Vec<bool> = (0..256 * 256)
            .map(|k| ((k % 256) as f64 - 128.0).hypot((k / 256) as f64 - 128.0) < 100.0)
            .collect();
        let area = SearchArea::of(&mask, 256);
        assert!((area.border_px / (200.0 * PI) - 1.0).abs() < 0.02, "{}", area.border_px);
        // Worsley et al. (1996), table 2: (4 ln 2) t exp(-t^2 / 2) / (2 pi)^1.5 a resolution element, whose sides are the full
        // width at half maximum of the bell that white noise was smoothed by.
        let s2: f64 = 2.0 * 2.0 + 1.0 / 12.0;
        let element_px2 = 8.0 * 2f64.ln() * s2;
        let wide = SearchArea { pixels: (1000.0 * element_px2) as usize, border_px: 0.0 };
        let expected = 1000.0 * 4.0 * 2f64.ln() * 4.0 * (-8.0f64).exp() / TAU.powf(1.5);
        assert!((wide.expected_maxima(4.0, 2.0) / expected - 1.0).abs() < 1e-3);
    }
}
