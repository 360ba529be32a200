//! Noise that grows towards the field's edge more than is stated.
//!
//! What a table states of a centroid, or what its light says, holds for spots that are round. Long spots at the edge of a
//! field scatter by more, and forms that grow outwards would then seem surer than they are. Neighbours tell it apart from
//! any model: structure that is wider than their distance is not in their differences.

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
    /// Distance, and the factor's logarithm; rising.
    rings: Vec<(f64, f64)>,
    /// d ln(noise) / d(key) of the rows' own keys.
    slope: f64,
}

impl Edge {
    /// From pairs of rows that are next to each other in the field, with the squares of their differences over those that
    /// the weights expect. `None` where there are too few.
    pub(crate) fn of(
        data: &Dataset,
        weights: &Weights,
        pairs: &[(usize, usize)],
        squares: &[f64],
    ) -> Option<Self> {
        let (x, y) = (data.values("x"), data.values("y"));
        let r = |row: usize| x[row].hypot(y[row]);
        let mut order: Vec<(f64, f64)> =
            pairs.iter().zip(squares).map(|(&(i, j), square)| (0.5 * (r(i) + r(j)), *square)).collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        let count = order.len() / PAIRS;
        if count < FEWEST_RINGS {
            return None;
        }
        let mean = |part: &[(f64, f64)]| {
            let plain = part.iter().map(|p| p.1).sum::<f64>() / part.len() as f64;
            part.iter().map(|p| p.1.min(MOST * plain)).sum::<f64>() / part.len() as f64
        };
        let all = mean(&order);
        let rings: Vec<(f64, f64)> = (0..count)
            .map(|k| {
                let part = &order[k * order.len() / count..(k + 1) * order.len() / count];
                let at = part.iter().map(|p| p.0).sum::<f64>() / part.len() as f64;
                (at, 0.5 * (mean(part) / all).ln())
            })
            .collect();
        if rings.iter().any(|(_, factor)| !factor.is_finite()) {
            return None;
        }
        Some(Self { rings, slope: slope(&data.noise_key, weights) })
    }

    /// The logarithm of each row's noise, up to a constant: keys for weights.
    pub(crate) fn keys(&self, data: &Dataset) -> Vec<f64> {
        let (x, y) = (data.values("x"), data.values("y"));
        (0..data.len()).map(|row| self.slope * data.noise_key[row] + self.at(x[row].hypot(y[row]))).collect()
    }

    /// Straight between the rings, level beyond them.
    fn at(&self, r: f64) -> f64 {
        let next = self.rings.partition_point(|ring| ring.0 < r);
        match (next.checked_sub(1).map(|below| self.rings[below]), self.rings.get(next)) {
            (Some((low, a)), Some(&(high, b))) if high > low => a + (b - a) * (r - low) / (high - low),
            (Some((_, a)), _) | (None, Some(&(_, a))) => a,
            (None, None) => 0.0,
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
