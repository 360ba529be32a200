//! Noise that changes over the field by more than is stated, and is larger along one direction.
//!
//! What a table states of a centroid, or what its light says, holds for spots that are round. Spots that are long, towards
//! the field's middle or across, scatter by more in that direction; forms along it would then seem surer than they are,
//! and forms across less sure. Neighbours tell the noise apart from any model: structure that is wider than their distance
//! is not in their differences.

use glam::{DMat2, DVec2};
use retina_calibration::outwards;

use crate::data::Dataset;
use crate::linear::dot;
use crate::noise::Weights;

/// Pairs of neighbours in a ring, and fewest rings.
const PAIRS: usize = 100;
const FEWEST_RINGS: usize = 4;
/// Squares of a ring's differences beyond so many of their mean count as that.
const MOST: f64 = 9.0;

/// By what the noise exceeds what is stated, over the distance from the field's middle.
#[derive(Debug, Clone)]
pub(crate) struct Edge {
    /// Distance, and the factors' logarithms towards the middle and across; rising.
    rings: Vec<(f64, DVec2)>,
    /// d ln(noise) / d(key) of the rows' own keys.
    slope: f64,
}

fn place(data: &Dataset, row: usize) -> DVec2 {
    DVec2::new(data.values("x")[row], data.values("y")[row])
}

impl Edge {
    /// From pairs of rows that are next to each other in the field, with their differences in sigmas that the weights
    /// expect. `None` where there are too few.
    pub(crate) fn of(
        data: &Dataset,
        weights: &Weights,
        pairs: &[(usize, usize)],
        differences: &[DVec2],
    ) -> Option<Self> {
        let ring_of = |(&(i, j), difference): (&(usize, usize), &DVec2)| {
            let at = 0.5 * (place(data, i) + place(data, j));
            let along = outwards(at).transpose() * *difference;
            (at.length(), along * along)
        };
        let mut order: Vec<(f64, DVec2)> = pairs.iter().zip(differences).map(ring_of).collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        let count = order.len() / PAIRS;
        if count < FEWEST_RINGS {
            return None;
        }
        let mean = |part: &[(f64, DVec2)]| {
            let plain = part.iter().map(|p| p.1).sum::<DVec2>() / part.len() as f64;
            part.iter().map(|p| p.1.min(MOST * plain)).sum::<DVec2>() / part.len() as f64
        };
        let all = 0.5 * mean(&order).element_sum();
        let rings: Vec<(f64, DVec2)> = (0..count)
            .map(|k| {
                let part = &order[k * order.len() / count..(k + 1) * order.len() / count];
                let at = part.iter().map(|p| p.0).sum::<f64>() / part.len() as f64;
                (at, 0.5 * (mean(part) / all).map(f64::ln))
            })
            .collect();
        if rings.iter().any(|(_, factors)| !factors.is_finite()) {
            return None;
        }
        Some(Self { rings, slope: slope(&data.noise_key, weights) })
    }

    /// Tells a table: by which keys its rows are weighed, and what makes each row's error isotropic.
    pub(crate) fn tell(&self, data: &mut Dataset) {
        let of_row = |row: usize| {
            let at = place(data, row);
            let factors = self.at(at.length()).map(f64::exp);
            // Of the same mean square as before.
            let mean = (0.5 * factors.length_squared()).sqrt();
            let turn = outwards(at);
            let isotropic = turn * DMat2::from_diagonal(mean / factors) * turn.transpose();
            (self.slope * data.noise_key[row] + mean.ln(), isotropic)
        };
        let (keys, isotropic): (Vec<f64>, Vec<DMat2>) = (0..data.len()).map(of_row).unzip();
        data.noise_key = keys;
        data.isotropic_from_error = Some(isotropic);
    }

    /// Straight between the rings, level beyond them.
    fn at(&self, r: f64) -> DVec2 {
        let next = self.rings.partition_point(|ring| ring.0 < r);
        match (next.checked_sub(1).map(|below| self.rings[below]), self.rings.get(next)) {
            (Some((low, a)), Some(&(high, b))) if high > low => a + (b - a) * ((r - low) / (high - low)),
            (Some((_, a)), _) | (None, Some(&(_, a))) => a,
            (None, None) => DVec2::ZERO,
        }
    }
}

/// Of the logarithm of the rows' noise over their keys, by least squares; 0 where the keys are the same.
fn slope(key: &[f64], weights: &Weights) -> f64 {
    let mean = key.iter().sum::<f64>() / key.len() as f64;
    let beside: Vec<f64> = key.iter().map(|k| k - mean).collect();
    let logs: Vec<f64> = weights.sigma.iter().map(|sigma| sigma.ln()).collect();
    let square = dot(&beside, &beside);
    if square > 0.0 { dot(&beside, &logs) / square } else { 0.0 }
}
