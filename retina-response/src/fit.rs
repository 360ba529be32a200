//! Least squares of one channel's readings: N^2 (1 - c (N / N_max)^2) I(B) + zero, with I(B) = lit(B) + dark. The factor
//! with c is the optics' relative illumination, which falls as the square of the field angle to first order, averaged
//! over the square; N_max is the largest square. Without it a facility's cos^4 law becomes an error of gamma and zero.

use crate::linear::Normal;
use crate::readings::Reading;
use crate::spline::Basis;

/// Readings farther than this from the fit, in sigmas, take no part: 1 of 150 000 by chance.
pub(crate) const OUTLIER_SIGMAS: f64 = 4.5;
/// Where Huber's loss turns from square to straight, sigmas.
const HUBER_SIGMAS: f64 = 2.0;

/// Which of the three constants are fitted; the others are 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Constants {
    /// Light of a pixel of the square at count 0.
    pub(crate) dark: bool,
    /// Reading of the meter where no square is lit.
    pub(crate) zero: bool,
    /// Loss of light across the largest square.
    pub(crate) fall_off: bool,
}

impl Constants {
    fn count(self) -> usize {
        usize::from(self.dark) + usize::from(self.zero) + usize::from(self.fall_off)
    }
}

/// A fit, in the readings' unit.
#[derive(Debug, Clone)]
pub(crate) struct Fit {
    pub(crate) basis: Basis,
    /// Coefficients of the basis: ln of the lit part.
    pub(crate) shape: Vec<f64>,
    /// Light of a pixel at count 0.
    pub(crate) dark: f64,
    /// The meter's zero.
    pub(crate) zero: f64,
    /// Part of its light that the largest square loses to the fall-off.
    pub(crate) fall_off: f64,
    /// Side of the largest square.
    pub(crate) largest_px: f64,
    /// Of shape, dark, zero, fall-off (those that were fitted, in this order).
    pub(crate) covariance: Vec<Vec<f64>>,
    pub(crate) constants: Constants,
    /// Which readings took part.
    pub(crate) used: Vec<bool>,
}

impl Fit {
    /// I(B), a pixel's irradiance.
    pub(crate) fn pixel(&self, count: usize) -> f64 {
        self.basis.lit(&self.shape, count) + self.dark
    }

    /// What the meter should say.
    pub(crate) fn predicted(&self, reading: &Reading) -> f64 {
        if reading.is_lit() { self.area(reading) * self.pixel(reading.count) + self.zero } else { self.zero }
    }

    /// Pixels in the middle of the field that give as much light as the reading's square, as its series reads it.
    pub(crate) fn area(&self, reading: &Reading) -> f64 {
        reading.gain * reading.pixels() * (1.0 - self.fall_off * self.relative_square(reading))
    }

    fn relative_square(&self, reading: &Reading) -> f64 {
        (reading.square_px / self.largest_px).powi(2)
    }

    /// The derivatives of I(B) by the fitted unknowns.
    fn pixel_row(&self, count: usize) -> Vec<f64> {
        let lit = self.basis.lit(&self.shape, count);
        let mut row: Vec<f64> = self.basis.row(count).iter().map(|b| lit * b).collect();
        row.extend(self.constants.dark.then_some(1.0));
        row.extend(self.constants.zero.then_some(0.0));
        row.extend(self.constants.fall_off.then_some(0.0));
        row
    }

    /// The standard deviation of I(B).
    pub(crate) fn pixel_sigma(&self, count: usize) -> f64 {
        quadratic(&self.covariance, &self.pixel_row(count)).sqrt()
    }

    /// Position of dark and zero among the unknowns.
    pub(crate) fn dark_index(&self) -> Option<usize> {
        self.constants.dark.then_some(self.shape.len())
    }

    /// Position of zero among the unknowns.
    pub(crate) fn zero_index(&self) -> Option<usize> {
        self.constants.zero.then(|| self.shape.len() + usize::from(self.constants.dark))
    }

    /// Position of the fall-off among the unknowns.
    pub(crate) fn fall_off_index(&self) -> Option<usize> {
        let before = usize::from(self.constants.dark) + usize::from(self.constants.zero);
        self.constants.fall_off.then(|| self.shape.len() + before)
    }

    /// Correlation of two unknowns.
    pub(crate) fn correlation(&self, i: usize, j: usize) -> f64 {
        self.covariance[i][j] / (self.covariance[i][i] * self.covariance[j][j]).sqrt()
    }

    fn moved(&self, step: &[f64]) -> Self {
        let mut moved = self.clone();
        for (value, by) in moved.shape.iter_mut().zip(step) {
            *value += by;
        }
        if let Some(i) = self.dark_index() {
            moved.dark += step[i];
        }
        if let Some(i) = self.zero_index() {
            moved.zero += step[i];
        }
        if let Some(i) = self.fall_off_index() {
            moved.fall_off += step[i];
        }
        moved
    }

    /// Sum of Huber's loss (`robust`) or half the squares over the readings that take part.
    fn cost(&self, readings: &[Reading], sigma: &[f64], robust: bool) -> f64 {
        let each = |i: usize| {
            let r = (readings[i].irradiance_w_m2 - self.predicted(&readings[i])) / sigma[i];
            if robust { huber(r) } else { 0.5 * r * r }
        };
        (0..readings.len()).filter(|&i| self.used[i]).map(each).sum()
    }

    /// Levenberg-Marquardt from here; iteratively reweighted where `robust`. `None` where the readings do
    /// not tell the unknowns apart.
    fn improve(mut self, readings: &[Reading], sigma: &[f64], robust: bool) -> Option<Self> {
        let mut cost = self.cost(readings, sigma, robust);
        let mut damping = 1e-6;
        for _ in 0..200 {
            let normal = self.normal(readings, sigma, robust);
            let solution = normal.solve(damping)?;
            let moved = self.moved(&solution.x);
            let new = moved.cost(readings, sigma, robust);
            if new.is_finite() && new <= cost {
                let done = cost - new <= 1e-12 * cost;
                (self, cost) = (moved, new);
                damping = (damping * 0.2).max(1e-15);
                if done {
                    break;
                }
            } else {
                damping *= 10.0;
                if damping > 1e6 {
                    break;
                }
            }
        }
        self.covariance = self.normal(readings, sigma, false).solve(0.0)?.covariance;
        Some(self)
    }

    /// The derivatives of a reading by the fitted unknowns, in sigmas.
    fn row(&self, reading: &Reading, sigma: f64) -> Vec<f64> {
        let area = self.area(reading);
        let mut row = self.pixel_row(reading.count);
        row.iter_mut().for_each(|value| *value *= area / sigma);
        if let Some(zero) = self.zero_index() {
            row[zero] = 1.0 / sigma;
        }
        if let Some(fall_off) = self.fall_off_index() {
            let lost = reading.gain * reading.pixels() * self.relative_square(reading);
            row[fall_off] = -lost * self.pixel(reading.count) / sigma;
        }
        row
    }

    /// How much of a reading's own noise the fit follows, 0 to 1: its residual is smaller by the root of
    /// 1 less that.
    pub(crate) fn leverage(&self, reading: &Reading, sigma: f64) -> f64 {
        quadratic(&self.covariance, &self.row(reading, sigma)).min(1.0)
    }

    fn normal(&self, readings: &[Reading], sigma: &[f64], robust: bool) -> Normal {
        let unknowns = self.shape.len() + self.constants.count();
        let mut normal = Normal::new(unknowns);
        for (i, reading) in readings.iter().enumerate().filter(|(i, _)| self.used[*i]) {
            let row = self.row(reading, sigma[i]);
            let right = (reading.irradiance_w_m2 - self.predicted(reading)) / sigma[i];
            let weight = if robust { (HUBER_SIGMAS / right.abs()).min(1.0) } else { 1.0 };
            normal.add(&row, right, weight);
        }
        normal
    }

    /// From a start: robustly first, then by least squares without the readings that are too far away.
    pub(crate) fn refine(self, readings: &[Reading], sigma: &[f64]) -> Option<Self> {
        let mut fit = Self { used: vec![true; readings.len()], ..self }.improve(readings, sigma, true)?;
        for _ in 0..10 {
            let far = |i: usize| (readings[i].irradiance_w_m2 - fit.predicted(&readings[i])).abs() / sigma[i];
            let used: Vec<bool> = (0..readings.len()).map(|i| far(i) <= OUTLIER_SIGMAS).collect();
            let settled = used == fit.used;
            fit = Self { used, ..fit }.improve(readings, sigma, false)?;
            if settled {
                break;
            }
        }
        Some(fit)
    }

    /// Other constants, the same shape.
    pub(crate) fn with_constants(mut self, constants: Constants) -> Self {
        self.dark = if constants.dark { self.dark } else { 0.0 };
        self.zero = if constants.zero { self.zero } else { 0.0 };
        self.fall_off = if constants.fall_off { self.fall_off } else { 0.0 };
        self.constants = constants;
        self
    }

    /// The same curve on another basis, as the start of its fit: the shape is fitted to ln of the lit part
    /// at `counts`.
    pub(crate) fn on_basis(&self, basis: Basis, counts: &[usize]) -> Option<Self> {
        let mut normal = Normal::new(basis.len());
        for &count in counts {
            normal.add(basis.row(count), self.basis.lit(&self.shape, count).ln(), 1.0);
        }
        Some(Self { shape: normal.solve(0.0)?.x, basis, ..self.clone() })
    }
}

/// Where the power law's fit starts: gamma on a grid, no fall-off, the three other unknowns by robust linear least
/// squares for each. `None` where no gamma gives light.
pub(crate) fn power_law_start(readings: &[Reading], sigma: &[f64], constants: Constants) -> Option<Fit> {
    let mut best: Option<(f64, Fit)> = None;
    for step in 0..=60 {
        let gamma = 0.4 + 0.08 * f64::from(step);
        let unknowns = 1 + usize::from(constants.dark) + usize::from(constants.zero);
        let mut x = vec![0.0; unknowns];
        for round in 0..8 {
            let mut normal = Normal::new(unknowns);
            for (reading, sigma) in readings.iter().zip(sigma) {
                let pixels = reading.gain * reading.pixels();
                let mut row = vec![pixels * (reading.count as f64 / 255.0).powf(gamma) / sigma];
                row.extend(constants.dark.then_some(pixels / sigma));
                row.extend(constants.zero.then_some(1.0 / sigma));
                let right = reading.irradiance_w_m2 / sigma;
                let residual: f64 = right - row.iter().zip(&x).map(|(a, b)| a * b).sum::<f64>();
                let weight = if round == 0 { 1.0 } else { (HUBER_SIGMAS / residual.abs()).min(1.0) };
                normal.add(&row, right, weight);
            }
            x = normal.solve(0.0)?.x;
        }
        if x[0] <= 0.0 {
            continue;
        }
        let fit = Fit {
            basis: Basis::power_law(),
            shape: vec![x[0].ln(), gamma],
            dark: if constants.dark { x[1] } else { 0.0 },
            zero: if constants.zero { x[unknowns - 1] } else { 0.0 },
            fall_off: 0.0,
            largest_px: readings.iter().map(|reading| reading.square_px).fold(f64::MIN_POSITIVE, f64::max),
            covariance: Vec::new(),
            constants,
            used: vec![true; readings.len()],
        };
        let cost = fit.cost(readings, sigma, true);
        if best.as_ref().is_none_or(|(least, _)| cost < *least) {
            best = Some((cost, fit));
        }
    }
    best.map(|(_, fit)| fit)
}

/// Huber's loss of a residual in sigmas.
pub(crate) fn huber(r: f64) -> f64 {
    if r.abs() <= HUBER_SIGMAS { 0.5 * r * r } else { HUBER_SIGMAS * (r.abs() - 0.5 * HUBER_SIGMAS) }
}

/// row^T C row.
pub(crate) fn quadratic(covariance: &[Vec<f64>], row: &[f64]) -> f64 {
    let product = |line: &Vec<f64>| line.iter().zip(row).map(|(a, b)| a * b).sum::<f64>();
    covariance.iter().zip(row).map(|(line, a)| a * product(line)).sum::<f64>().max(0.0)
}
