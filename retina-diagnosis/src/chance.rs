//! How likely units that share no error agree with a form by chance, where that form was found elsewhere.
//!
//! Each unit u has a share <form, error> of the agreement and a square |form|^2.

use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use crate::series::two_sided;

/// Draws of the signs.
const FLIPS: usize = 9999;
/// A form that fewer units carry is judged by Student's t: the signs of six units cannot reach 1 %.
const FEW_CARRY: f64 = 8.0;

/// Chance of at least as much agreement where there is nothing, one-sided. How many units carry the form is the square of
/// the sum of their squares over the sum of the squares' squares: it does not depend on the errors.
pub(crate) fn chance(shares: &[f64], squares: &[f64], seed: u64) -> f64 {
    let whole: f64 = squares.iter().sum();
    let carry = whole * whole / squares.iter().map(|s| s * s).sum::<f64>();
    if carry < FEW_CARRY { by_student(shares, squares) } else { by_flips(shares, seed) }
}

/// The share of flipped signs whose sum is at least as large. The model has taken a mean out of the units' errors, so they are
/// smaller than those that are flipped would be by (1 - 1 / units)^(1/2).
fn by_flips(shares: &[f64], seed: u64) -> f64 {
    let taken_out = (1.0 - 1.0 / shares.len().max(2) as f64).sqrt();
    let found: f64 = taken_out * shares.iter().sum::<f64>();
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let reached = (0..FLIPS)
        .filter(|_| {
            let drawn: f64 =
                shares.iter().map(|share| if random.random::<bool>() { *share } else { -share }).sum();
            drawn >= found - 1e-9 * found.abs()
        })
        .count();
    (1 + reached) as f64 / (1 + FLIPS) as f64
}

/// Student's t of the amplitude. Each unit measures it by <form, error> / |form|, which is normal about amplitude times
/// |form| with one variance for all units. That variance comes from what the amplitude leaves.
fn by_student(shares: &[f64], squares: &[f64]) -> f64 {
    let whole: f64 = squares.iter().sum();
    let amplitude = shares.iter().sum::<f64>() / whole;
    // A unit that the form hardly touches measures nothing.
    let measuring: Vec<(f64, f64)> =
        shares.iter().zip(squares).filter(|(_, s)| **s > 1e-9 * whole).map(|(e, s)| (*e, *s)).collect();
    let free = measuring.len().saturating_sub(1);
    if amplitude <= 0.0 || free == 0 {
        return 1.0;
    }
    let left: f64 = measuring.iter().map(|(e, s)| (e - amplitude * s).powi(2) / s).sum();
    let sigma = (left / free as f64 / whole).sqrt();
    0.5 * two_sided(amplitude / sigma.max(f64::MIN_POSITIVE), free)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of equal units it is the test of a mean (numbers by numerical integration of Student's density). Of unequal ones,
    /// two of which carry the form, it says what signs cannot.
    #[test]
    fn student_says_more_than_signs_of_few_units() {
        let values = [1.1, 0.4, -0.3, 0.8, 1.5, 0.2];
        let p = by_student(&values, &[1.0; 6]);
        assert!((p / 0.033_766 - 1.0).abs() < 5e-3, "{p}");
        let (form, error) = ([2.0, 0.5, 0.5, 1.0, 0.2, 3.0], [1.5, 0.2, -0.4, 1.2, 0.5, 2.0]);
        let shares: Vec<f64> = form.iter().zip(error).map(|(f, e)| f * e).collect();
        let squares = form.map(|f: f64| f * f);
        let p = chance(&shares, &squares, 1);
        assert!((p / 0.000_904 - 1.0).abs() < 2e-2, "{p}");
        assert!(by_flips(&shares, 1) > 0.02);
        assert_eq!(by_student(&shares.iter().map(|s| -s).collect::<Vec<_>>(), &squares), 1.0);
    }

    /// Twelve units that carry a form alike: their signs decide, and one in 4096 flips reaches as much.
    #[test]
    fn many_units_are_judged_by_their_signs() {
        let p = chance(&[1.0; 12], &[1.0; 12], 1);
        assert!((1e-4..1e-3).contains(&p), "{p}");
    }
}
