//! Noise of the centroids: its dependence on brightness, common shifts of exposures, weights and outliers.

use std::ops::Range;

use glam::{DMat2, DVec2};

use super::observations::Observations;
use crate::{NoiseGroups, outwards};

/// Points further off than this many sigmas of one axis are outliers; a two-dimensional normal
/// error is so with exp(-4.5^2 / 2) = 4e-5.
const OUTLIER_SIGMAS: f64 = 4.5;
/// Median of the length of a two-dimensional normal error, in sigmas of one axis: sqrt(2 ln 2).
const MEDIAN_LENGTH: f64 = 1.177_41;
/// Median of a normal error's size, in sigmas.
const MEDIAN_SIZE: f64 = 0.674_49;
/// 1e-6 arcsec, rad: exact data have no noise, and weights must stay finite.
const LEAST_SIGMA: f64 = 5e-12;
/// No spot is so long that it scatters across by less than this part of what it scatters along. In exact data one direction
/// may not scatter at all.
const LEAST_ASPECT: f64 = 0.1;
/// Huber's and Tukey's tuning constants for lengths in the plane: 95 % efficiency at the normal distribution.
const HUBER: f64 = 1.7;
const TUKEY: f64 = 5.1;

/// How residuals become weights.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Robust {
    Huber,
    Tukey,
    /// 1 or 0, so that the covariance is that of weighted least squares.
    Cut,
}

/// Weights of a fit.
#[derive(Debug, Clone)]
pub(crate) struct Weights {
    /// Inverse variance per axis of each point, times its robust weight, rad^-2; 0: outlier.
    pub(crate) inverse_variance: Vec<f64>,
    /// Standard deviation of each centroid towards the field's middle and across, rad: spots are long in one of the two.
    pub(crate) sigma: Vec<DVec2>,
    /// Variance per axis of the common shift of an exposure, rad^2.
    pub(crate) jitter_variance: f64,
    pub(crate) outlier: Vec<bool>,
}

impl Weights {
    /// All alike, nothing known.
    pub(crate) fn equal(count: usize) -> Self {
        Self {
            inverse_variance: vec![1.0; count],
            sigma: vec![DVec2::ONE; count],
            jitter_variance: 0.0,
            outlier: vec![false; count],
        }
    }

    /// From residuals alone: within six typical lengths, or out.
    pub(crate) fn crude(residuals: &[DVec2]) -> Self {
        let mut lengths: Vec<f64> = residuals.iter().map(|r| r.length()).collect();
        let middle = lengths.len() / 2;
        let sigma =
            (*lengths.select_nth_unstable_by(middle, f64::total_cmp).1 / MEDIAN_LENGTH).max(LEAST_SIGMA);
        let outlier: Vec<bool> = residuals.iter().map(|r| r.length() > 6.0 * sigma).collect();
        let inverse_variance =
            outlier.iter().map(|&out| if out { 0.0 } else { 1.0 / (sigma * sigma) }).collect();
        Self {
            inverse_variance,
            sigma: vec![DVec2::splat(sigma); residuals.len()],
            jitter_variance: 0.0,
            outlier,
        }
    }

    /// Factor kappa by which the weighted mean of an exposure's rows is taken off them, so that errors with a common
    /// shift become independent: V^(-1/2) = W^(1/2) (1 - kappa u u^T), u the unit vector of the root weights.
    pub(crate) fn whitening(&self, sum_of_weights: f64) -> f64 {
        1.0 - 1.0 / (1.0 + self.jitter_variance * sum_of_weights).sqrt()
    }

    /// New weights from residuals (rad) of a fit with `columns` coefficients per axis, of which
    /// `steady` are functions of the irradiance alone.
    pub(crate) fn update(
        &mut self,
        observations: &Observations,
        residuals: &[DVec2],
        columns: usize,
        steady: usize,
        robust: Robust,
    ) {
        let shifts = self.estimate_shifts(observations, residuals, steady);
        let own = observations
            .exposures
            .iter()
            .zip(&shifts)
            .flat_map(|((_, range), shift)| range.clone().map(move |i| (i, residuals[i] - *shift)));
        let error: Vec<DVec2> =
            own.map(|(i, error)| outwards(observations.sight[i]).transpose() * error).collect();
        let distance: Vec<f64> = observations.sight.iter().map(|sight| sight.length()).collect();
        let groups = NoiseGroups {
            rows: 100,
            fitted: (columns + shifts.len()) as f64,
            median_of_normal: MEDIAN_SIZE,
            least: LEAST_SIGMA,
        };
        let along = |axis: fn(&DVec2) -> f64| {
            let size: Vec<f64> = error.iter().map(|error| axis(error).abs()).collect();
            groups.sigmas_in_field(&observations.noise_key, &distance, &size, &self.outlier)
        };
        let (radial, tangential) = (along(|e| e.x), along(|e| e.y));
        let both = radial.into_iter().zip(tangential).map(DVec2::from);
        self.sigma = both.map(|sigma| sigma.max(DVec2::splat(LEAST_ASPECT * sigma.max_element()))).collect();
        for (i, error) in error.iter().enumerate() {
            let t = (*error / self.sigma[i]).length();
            self.outlier[i] = t > OUTLIER_SIGMAS;
            let factor = match robust {
                Robust::Huber => (HUBER / t).min(1.0),
                Robust::Tukey => (1.0 - (t / TUKEY).powi(2)).max(0.0).powi(2),
                Robust::Cut => f64::from(u8::from(!self.outlier[i])),
            };
            self.inverse_variance[i] = factor / self.variance(i);
        }
    }

    /// Sum over both axes of a V^-1 b, where the points of an exposure share a shift.
    pub(crate) fn product(&self, observations: &Observations, a: &[DVec2], b: &[DVec2]) -> f64 {
        let of_exposure = |(_, range): &(usize, Range<usize>)| {
            let (mut sum, mut product, mut of_a, mut of_b) = (0.0, 0.0, DVec2::ZERO, DVec2::ZERO);
            for i in range.clone() {
                let weight = self.inverse_variance[i];
                sum += weight;
                product += weight * a[i].dot(b[i]);
                of_a += weight * a[i];
                of_b += weight * b[i];
            }
            let variance = self.jitter_variance;
            product - variance / (1.0 + variance * sum) * of_a.dot(of_b)
        };
        observations.exposures.iter().map(of_exposure).sum()
    }

    /// The common shift of an exposure's points, shrunk by what their noise leaves uncertain.
    fn shift_of(&self, residuals: &[DVec2], points: Range<usize>) -> DVec2 {
        let sum: f64 = self.inverse_variance[points.clone()].iter().sum();
        let mean: DVec2 = points.map(|i| residuals[i] * self.inverse_variance[i]).sum();
        mean * (self.jitter_variance / (1.0 + self.jitter_variance * sum))
    }

    /// Of a point, the mean of its axes, rad^2.
    pub(crate) fn variance(&self, point: usize) -> f64 {
        0.5 * self.sigma[point].length_squared()
    }

    /// Covariance of a point's error, x and y, rad^2.
    pub(crate) fn covariance(&self, observations: &Observations, point: usize) -> DMat2 {
        let turn = outwards(observations.sight[point]);
        let sigma = self.sigma[point];
        turn * DMat2::from_diagonal(sigma * sigma) * turn.transpose()
    }

    /// Moment estimate of the shifts' variance (R. DerSimonian and N. Laird, Controlled Clinical Trials 7, 1986, eq. 8),
    /// and each exposure's shift, shrunk by what its points' noise leaves uncertain.
    fn estimate_shifts(
        &mut self,
        observations: &Observations,
        residuals: &[DVec2],
        steady: usize,
    ) -> Vec<DVec2> {
        let means: Vec<(f64, DVec2)> = observations
            .exposures
            .iter()
            .map(|(_, range)| {
                let weights = &self.inverse_variance[range.clone()];
                let sum: f64 = weights.iter().sum();
                let mean: DVec2 = residuals[range.clone()].iter().zip(weights).map(|(r, w)| *r * *w).sum();
                (sum, if sum > 0.0 { mean / sum } else { DVec2::ZERO })
            })
            .collect();
        let free = means.len() as f64 - 1.0 - steady as f64;
        let total: f64 = means.iter().map(|(sum, _)| sum).sum();
        let squares: f64 = means.iter().map(|(sum, _)| sum * sum).sum();
        let known = self.sigma.iter().any(|&sigma| sigma != DVec2::ONE);
        let spread: f64 = means.iter().map(|(sum, mean)| sum * mean.length_squared() / 2.0).sum();
        let scale = total - squares / total;
        self.jitter_variance =
            if known && free >= 1.0 && scale > 0.0 { ((spread - free) / scale).max(0.0) } else { 0.0 };
        observations.exposures.iter().map(|(_, range)| self.shift_of(residuals, range.clone())).collect()
    }
}
