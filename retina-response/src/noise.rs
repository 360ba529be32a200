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
/// Grid steps a side, and how often the grid is narrowed about its best cell.
const GRID: usize = 9;
const NARROWINGS: usize = 7;

/// Noise by the scale that makes the residuals of `fit` most likely, with the straightened loss above so
/// that outliers count little. `sigma` are those of the fit: each residual is raised by its leverage.
pub(crate) fn estimate(readings: &[Reading], fit: &Fit, sigma: &[f64]) -> Noise {
    let brightest = readings.iter().map(|r| r.irradiance_w_m2.abs()).fold(0.0, f64::max);
    let pairs: Vec<(f64, f64)> = readings
        .iter()
        .zip(sigma)
        .map(|(reading, &sigma)| {
            let light = fit.predicted(reading);
            let kept = (1.0 - fit.leverage(reading, sigma)).max(SMALLEST_KEPT);
            (light, (reading.irradiance_w_m2 - light) / kept.sqrt())
        })
        .collect();
    let loss = |floor: f64, proportional: f64| -> f64 {
        let noise = Noise { floor_w_m2: floor, proportional };
        let each = |&(light, residual): &(f64, f64)| {
            let sigma = noise.sigma(light);
            let z = (residual / sigma).abs();
            let rho = if z <= TURN_SIGMAS { 0.5 * z * z } else { TURN_SIGMAS * (z - 0.5 * TURN_SIGMAS) };
            sigma.ln() + rho / CONSISTENCY
        };
        pairs.iter().map(each).sum()
    };
    let mut centre = [(brightest * 1e-5).ln(), (1e-3f64).ln()];
    let mut half = [(1e4f64).ln(), (1e3f64).ln()];
    for _ in 0..NARROWINGS {
        let mut best = (f64::INFINITY, centre);
        for i in 0..GRID * GRID {
            let along =
                |k: usize, step: usize| centre[k] + half[k] * (2.0 * step as f64 / (GRID - 1) as f64 - 1.0);
            let at = [along(0, i / GRID), along(1, i % GRID)];
            let value = loss(at[0].exp(), at[1].exp());
            if value < best.0 {
                best = (value, at);
            }
        }
        centre = best.1;
        half = half.map(|h| h * 0.35);
    }
    // Each of the two figures rests on about half of the residuals: what is divided by them is Student's t of
    // so many degrees of freedom, whose standard deviation this is.
    let freedom = (0.5 * (readings.len() as f64 - fit.covariance.len() as f64)).max(3.0);
    let student = (freedom / (freedom - 2.0)).sqrt();
    Noise { floor_w_m2: centre[0].exp() * student, proportional: centre[1].exp() * student }
}
