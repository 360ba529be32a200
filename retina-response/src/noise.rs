//! The noise of the readings: stated, or floor and proportional part estimated from the residuals.

use crate::fit::Fit;
use crate::readings::Reading;

/// sigma^2 = floor^2 + (proportional x reading)^2.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Noise {
    /// Standard deviation in the dark, W m^-2.
    pub floor_w_m2: f64,
    /// Standard deviation over the light.
    pub proportional: f64,
}

impl Noise {
    pub(crate) fn sigma(self, light: f64) -> f64 {
        self.floor_w_m2.hypot(self.proportional * light)
    }
}

/// Where the loss of the estimate turns from square to straight, sigmas.
const TURN_SIGMAS: f64 = 2.5;
/// E[psi(z) z] of a normal z for that loss, (2 Phi(c) - 1): with it a normal's own sigma is found.
const CONSISTENCY: f64 = 0.987_58;
/// A reading that the fit follows all but entirely says nothing about noise.
const SMALLEST_KEPT: f64 = 0.05;
/// Values a side of the first grid, over all that a meter may have, and of the second, over what is likely.
const COARSE: usize = 25;
const FINE: usize = 33;
/// Loss above the least from which on a value is not likely: exp(-12).
const UNLIKELY: f64 = 12.0;

/// The noise that the residuals of `fit` leave likely, with the straightened loss above so that outliers count little:
/// the mean of floor^2 and of proportional^2 over their likelihood, both equally likely beforehand at any size. The most
/// likely noise alone may have no proportional part, by chance, where bright readings are few. `sigma` are those of the
/// fit: a residual is raised by its leverage h and counts 1 - h, since what the fit follows says nothing of noise (H. D.
/// Patterson, R. Thompson, Biometrika 58, 1971).
pub(crate) fn estimate(readings: &[Reading], fit: &Fit, sigma: &[f64]) -> Noise {
    let brightest = readings.iter().map(|r| r.irradiance_w_m2.abs()).fold(0.0, f64::max);
    let residuals: Vec<(f64, f64, f64)> = readings
        .iter()
        .zip(sigma)
        .map(|(reading, &sigma)| {
            let light = fit.predicted(reading);
            let kept = (1.0 - fit.leverage(reading, sigma)).max(SMALLEST_KEPT);
            (light, (reading.irradiance_w_m2 - light) / kept.sqrt(), kept)
        })
        .collect();
    let loss = |[floor, proportional]: [f64; 2]| -> f64 {
        let noise = Noise { floor_w_m2: floor.exp(), proportional: proportional.exp() };
        let each = |&(light, residual, kept): &(f64, f64, f64)| {
            let sigma = noise.sigma(light);
            let z = (residual / sigma).abs();
            let rho = if z <= TURN_SIGMAS { 0.5 * z * z } else { TURN_SIGMAS * (z - 0.5 * TURN_SIGMAS) };
            kept * (sigma.ln() + rho / CONSISTENCY)
        };
        // Equally likely at any size: the logarithm's density grows with it.
        residuals.iter().map(each).sum::<f64>() - floor - proportional
    };
    let (floor, proportional) = ((brightest * 1e-5).ln(), (1e-3f64).ln());
    let (wide, narrow) = ((1e4f64).ln(), (1e3f64).ln());
    let whole = [[floor - wide, proportional - narrow], [floor + wide, proportional + narrow]];
    let coarse = on_grid(whole, COARSE, loss);
    let least = coarse.iter().map(|(_, loss)| *loss).fold(f64::INFINITY, f64::min);
    let likely = coarse.iter().filter(|(_, loss)| loss - least < UNLIKELY).map(|(at, _)| *at);
    let step = [0, 1].map(|k| (whole[1][k] - whole[0][k]) / (COARSE - 1) as f64);
    let ends = likely.fold([[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]], |[low, high], at| {
        [[0, 1].map(|k| low[k].min(at[k] - step[k])), [0, 1].map(|k| high[k].max(at[k] + step[k]))]
    });
    let fine = on_grid(ends, FINE, loss);
    let least = fine.iter().map(|(_, loss)| *loss).fold(f64::INFINITY, f64::min);
    let (mut total, mut squares) = (0.0, [0.0; 2]);
    for (at, loss) in &fine {
        let likelihood = (least - loss).exp();
        total += likelihood;
        squares.iter_mut().zip(at).for_each(|(sum, ln)| *sum += likelihood * (2.0 * ln).exp());
    }
    let [floor_w_m2, proportional] = squares.map(|sum| (sum / total).sqrt());
    Noise { floor_w_m2, proportional }
}

/// A function at the places of a grid between two corners.
fn on_grid([low, high]: [[f64; 2]; 2], side: usize, of: impl Fn([f64; 2]) -> f64) -> Vec<([f64; 2], f64)> {
    let along = |k: usize, step: usize| low[k] + (high[k] - low[k]) * step as f64 / (side - 1) as f64;
    (0..side * side)
        .map(|i| {
            let at = [along(0, i / side), along(1, i % side)];
            (at, of(at))
        })
        .collect()
}
