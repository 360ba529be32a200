//! Detection rate against magnitude.

use serde::Serialize;

/// A flash that was there: its magnitude, and whether it was found.
pub type Trial = (f64, bool);

/// Rate in a range of magnitudes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RateBin {
    /// The range.
    pub magnitudes: [f64; 2],
    /// Flashes in it.
    pub flashes: usize,
    /// Found.
    pub found: usize,
    /// Found over flashes.
    pub rate: f64,
    /// Wilson's interval of 95 %.
    pub interval: [f64; 2],
}

/// Rates in bins of `width` magnitudes that hold a flash.
pub fn rate_bins(trials: &[Trial], width: f64) -> Vec<RateBin> {
    let bin = |magnitude: f64| (magnitude / width).floor() as i64;
    let mut numbers: Vec<i64> = trials.iter().map(|(magnitude, _)| bin(*magnitude)).collect();
    numbers.sort_unstable();
    numbers.dedup();
    numbers
        .into_iter()
        .map(|number| {
            let inside = || trials.iter().filter(|(magnitude, _)| bin(*magnitude) == number);
            let (flashes, found) = (inside().count(), inside().filter(|(_, found)| *found).count());
            RateBin {
                magnitudes: [number as f64 * width, (number + 1) as f64 * width],
                flashes,
                found,
                rate: found as f64 / flashes as f64,
                interval: wilson(found, flashes),
            }
        })
        .collect()
}

/// 97.5 % of the normal distribution are below.
const Z: f64 = 1.959_964;

/// The interval of 95 % of a share (Wilson 1927).
pub fn wilson(found: usize, of: usize) -> [f64; 2] {
    let (n, share) = (of as f64, found as f64 / of as f64);
    let centre = share + Z * Z / (2.0 * n);
    let half = Z * (share * (1.0 - share) / n + Z * Z / (4.0 * n * n)).sqrt();
    [-1.0, 1.0].map(|sign| ((centre + sign * half) / (1.0 + Z * Z / n)).clamp(0.0, 1.0))
}

/// A logistic curve through found and missed: rate = 1 / (1 + exp((m - m50) / width)).
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Logistic {
    /// Half of the flashes of this magnitude are found.
    pub magnitude_50: f64,
    /// Its standard deviation; `None` where found and missed do not overlap, and the curve is a step.
    pub sigma_50: Option<f64>,
    /// Magnitudes over which the rate falls from 73 to 50 %.
    pub width: f64,
}

impl Logistic {
    /// The rate at a magnitude.
    pub fn rate(&self, magnitude: f64) -> f64 {
        let at = (magnitude - self.magnitude_50) / self.width.max(1e-9);
        1.0 / (1.0 + at.clamp(-700.0, 700.0).exp())
    }
}

/// Fits the curve by maximum likelihood (Newton's method); `None` where all were found or all missed.
pub fn fit_logistic(trials: &[Trial]) -> Option<Logistic> {
    let faintest = trials.iter().filter(|t| t.1).map(|t| t.0).reduce(f64::max)?;
    let brightest_missed = trials.iter().filter(|t| !t.1).map(|t| t.0).reduce(f64::min)?;
    if faintest <= brightest_missed {
        let magnitude_50 = 0.5 * (faintest + brightest_missed);
        return Some(Logistic { magnitude_50, sigma_50: None, width: 0.0 });
    }
    // Log-odds a - b (m - centre); the start is a curve through the overlap's middle.
    let centre = 0.5 * (faintest + brightest_missed);
    let (mut a, mut b) = (0.0, 4.0 / (faintest - brightest_missed).max(0.1));
    let mut information = [[1.0, 0.0], [0.0, 1.0]];
    let likelihood = |a: f64, b: f64| -> f64 {
        let term = |(magnitude, found): &Trial| {
            let odds = a - b * (magnitude - centre);
            let odds = if *found { odds } else { -odds };
            // ln(1 / (1 + e^-x)) without overflow.
            -((-odds.abs()).exp().ln_1p() + (-odds).max(0.0))
        };
        trials.iter().map(term).sum()
    };
    for _ in 0..200 {
        let (mut gradient, mut hessian) = ([0.0; 2], [0.0; 3]);
        for (magnitude, found) in trials {
            let x = magnitude - centre;
            let rate = 1.0 / (1.0 + (b * x - a).clamp(-700.0, 700.0).exp());
            let off = f64::from(u8::from(*found)) - rate;
            gradient = [gradient[0] + off, gradient[1] - off * x];
            let weight = rate * (1.0 - rate);
            hessian = [hessian[0] + weight, hessian[1] - weight * x, hessian[2] + weight * x * x];
        }
        let determinant = hessian[0] * hessian[2] - hessian[1] * hessian[1];
        if determinant.is_nan() || determinant <= 0.0 {
            return None;
        }
        information = [
            [hessian[2] / determinant, -hessian[1] / determinant],
            [-hessian[1] / determinant, hessian[0] / determinant],
        ];
        let step = information.map(|row| row[0] * gradient[0] + row[1] * gradient[1]);
        // The likelihood is concave: a step that is too long is halved.
        let mut share = 1.0;
        while share > 1e-6 && likelihood(a + share * step[0], b + share * step[1]) < likelihood(a, b) {
            share *= 0.5;
        }
        (a, b) = (a + share * step[0], b + share * step[1]);
        if step[0].hypot(step[1]) < 1e-10 {
            break;
        }
    }
    // A rate that grows towards faint flashes is no detector's.
    if b.is_nan() || b <= 0.0 {
        return None;
    }
    let to = [1.0 / b, -a / (b * b)];
    let variance = to[0] * (information[0][0] * to[0] + information[0][1] * to[1])
        + to[1] * (information[1][0] * to[0] + information[1][1] * to[1]);
    Some(Logistic { magnitude_50: centre + a / b, sigma_50: Some(variance.max(0.0).sqrt()), width: 1.0 / b })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wilsons_intervals_are_the_published_ones() {
        // Newcombe (1998), table I, method 3: 81 of 263: 0.2553 to 0.3662; 0 of 20: 0 to 0.1611; 1 of 29: 0.0061 to 0.1718.
        for (found, of, expected) in
            [(81, 263, [0.2553, 0.3662]), (0, 20, [0.0, 0.1611]), (1, 29, [0.0061, 0.1718])]
        {
            let interval = wilson(found, of);
            assert!((0..2).all(|k| (interval[k] - expected[k]).abs() < 6e-5), "{interval:?}");
        }
    }

    #[test]
    fn the_curve_that_was_drawn_from_is_found_within_its_sigma() {
        let truth = Logistic { magnitude_50: 8.3, sigma_50: None, width: 0.2 };
        let mut state = 7u64;
        let mut uniform = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        let trials: Vec<Trial> = (0..2000)
            .map(|_| {
                let magnitude = 6.0 + 4.0 * uniform();
                (magnitude, uniform() < truth.rate(magnitude))
            })
            .collect();
        let fit = fit_logistic(&trials).unwrap();
        let sigma = fit.sigma_50.unwrap();
        // Fisher information of evenly spread magnitudes: n / 4 mag times the width a flash: 0.02.
        assert!((sigma / 0.02 - 1.0).abs() < 0.3, "{sigma}");
        assert!((fit.magnitude_50 - 8.3).abs() < 3.0 * sigma && (fit.width - 0.2).abs() < 0.05, "{fit:?}");
        assert_eq!(fit_logistic(&[(5.0, true), (6.0, true)]), None);
        let step = fit_logistic(&[(5.0, true), (6.0, false)]).unwrap();
        assert_eq!((step.magnitude_50, step.sigma_50), (5.5, None));
    }
}
