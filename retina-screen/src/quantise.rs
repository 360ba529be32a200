//! From wanted irradiance to digital counts over a whole image.

use retina_radiometry::ScreenResponse;

/// How irradiance between two counts is rounded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Quantisation {
    /// Each pixel takes the nearest count.
    Nearest,
    /// What a pixel's rounding leaves goes to its neighbours still to come, within the lit area: sums
    /// over a few pixels, and with them flux and limb, keep what single pixels lose.
    #[default]
    Diffused,
}

impl Quantisation {
    /// The name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Nearest => "nearest",
            Self::Diffused => "diffused",
        }
    }
}

/// The nearest count of each pixel.
pub(crate) fn nearest(response: &ScreenResponse, wanted_w_m2_nm: &[f32]) -> Vec<u8> {
    wanted_w_m2_nm.iter().map(|&wanted| response.nearest_count(wanted)).collect()
}

/// Error diffusion in irradiance with the weights of Floyd and Steinberg (1976): 7, 3, 5, 1
/// sixteenths to the next pixel and to the three below, rows taken to and fro. Dark pixels take
/// none, and the lit ones among the four share all of it; where all are dark it stays with none.
/// A pixel beyond the largest count passes nothing on: it is saturated, not rounded.
pub(crate) fn diffused(response: &ScreenResponse, wanted_w_m2_nm: &[f32], width: usize) -> Vec<u8> {
    let mut counts = vec![0; wanted_w_m2_nm.len()];
    let brightest = response.brightest_w_m2_nm() as f32;
    let levels: Vec<f32> = (0..=255u8).map(|b| response.irradiance_w_m2_nm([b; 3]) as f32).collect();
    // Errors for this row and the next, with a dark pixel on either side.
    let (mut here, mut below) = (vec![0f32; width + 2], vec![0f32; width + 2]);
    let rows = wanted_w_m2_nm.len() / width.max(1);
    for row in 0..rows {
        let line = &wanted_w_m2_nm[row * width..(row + 1) * width];
        let next = if row + 1 < rows { &wanted_w_m2_nm[(row + 1) * width..(row + 2) * width] } else { &[] };
        let lit = |line: &[f32], column: usize| column < line.len() && line[column] > 0.0;
        below.fill(0.0);
        let forward = row % 2 == 0;
        for step in 0..width {
            let column = if forward { step } else { width - 1 - step };
            let wanted = line[column];
            if wanted <= 0.0 {
                continue;
            }
            let asked = wanted + here[column + 1];
            let count = response.nearest_count(asked);
            counts[row * width + column] = count;
            if asked > brightest {
                continue;
            }
            let left = asked - levels[usize::from(count)];
            // Ahead and behind along this row; wrapping below 0 gives a column that is not lit.
            let (ahead, behind) = if forward {
                (column + 1, column.wrapping_sub(1))
            } else {
                (column.wrapping_sub(1), column + 1)
            };
            let to_ahead = if lit(line, ahead) { 7.0 } else { 0.0 };
            let to_below = [(behind, 3.0), (column, 5.0), (ahead, 1.0)];
            let shares = to_below.map(|(k, weight)| if lit(next, k) { weight } else { 0.0 });
            let total = to_ahead + shares.iter().sum::<f32>();
            if total == 0.0 {
                continue;
            }
            if to_ahead > 0.0 {
                here[ahead + 1] += left * to_ahead / total;
            }
            for ((k, _), share) in to_below.into_iter().zip(shares) {
                if share > 0.0 {
                    below[k + 1] += left * share / total;
                }
            }
        }
        std::mem::swap(&mut here, &mut below);
    }
    counts
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A disc of a level that lies between two counts, on dark ground, 64 pixels wide.
    fn disc(level: f32) -> Vec<f32> {
        (0..64 * 64)
            .map(|i| {
                let (x, y) = ((i % 64) as f32 - 31.5, (i / 64) as f32 - 31.5);
                if x.hypot(y) < 25.0 { level } else { 0.0 }
            })
            .collect()
    }

    fn flux(response: &ScreenResponse, counts: &[u8]) -> f64 {
        counts.iter().map(|&b| response.irradiance_w_m2_nm([b; 3])).sum()
    }

    #[test]
    fn diffusion_keeps_the_flux_that_rounding_loses() {
        let response = ScreenResponse::power_law(2.2, -1.44);
        let steps = [20u8, 21].map(|b| response.irradiance_w_m2_nm([b; 3]));
        let wanted = disc((steps[0] + 0.3 * (steps[1] - steps[0])) as f32);
        let true_flux: f64 = wanted.iter().map(|&w| f64::from(w)).sum();
        // Rounding down loses 0.3 of a step of 2.2 / 20.
        let rounded = flux(&response, &nearest(&response, &wanted)) / true_flux - 1.0;
        assert!((rounded + 0.3 * 0.113 / 1.034).abs() < 2e-3, "{rounded}");
        let kept = flux(&response, &diffused(&response, &wanted, 64)) / true_flux - 1.0;
        assert!(kept.abs() < 3e-4, "{kept}");
    }

    #[test]
    fn dark_pixels_stay_dark_and_exact_levels_stay_exact() {
        let response = ScreenResponse::power_law(2.2, -1.44);
        let wanted = disc(response.irradiance_w_m2_nm([77; 3]) as f32);
        let counts = diffused(&response, &wanted, 64);
        for (count, wanted) in counts.iter().zip(&wanted) {
            assert_eq!(*count, if *wanted > 0.0 { 77 } else { 0 });
        }
        let bright = disc(1.0);
        assert_eq!(diffused(&response, &bright, 64), nearest(&response, &bright));
        assert!(diffused(&response, &[], 64).is_empty());
    }
}
