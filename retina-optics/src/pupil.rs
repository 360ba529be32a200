//! Points and weights on the pupil.

use std::f64::consts::{PI, TAU};

/// A pupil point (unit disc) and its share of the pupil's area; the weights of a set sum to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PupilPoint {
    /// x and y on the unit disc.
    pub at: [f64; 2],
    /// Share of the area.
    pub weight: f64,
}

/// Gauss-Legendre nodes and weights on [0, 1], by Newton's method on the Legendre polynomial.
pub fn gauss_legendre(count: usize) -> Vec<(f64, f64)> {
    let n = count as f64;
    (0..count)
        .map(|i| {
            let mut x = (PI * (i as f64 + 0.75) / (n + 0.5)).cos();
            let mut slope = 1.0;
            for _ in 0..100 {
                let (mut p, mut q) = (1.0, 0.0);
                for k in 0..count {
                    let k = k as f64;
                    (p, q) = (((2.0 * k + 1.0) * x * p - k * q) / (k + 1.0), p);
                }
                slope = n * (x * p - q) / (x * x - 1.0);
                let step = p / slope;
                x -= step;
                if step.abs() < 1e-15 {
                    break;
                }
            }
            ((1.0 - x) / 2.0, 1.0 / ((1.0 - x * x) * slope * slope))
        })
        .collect()
}

/// Gaussian quadrature over a disc or ring (G. W. Forbes, "Optical system assessment for design:
/// numerical ray tracing in the Gaussian pupil", J. Opt. Soc. Am. A 5, 1943 (1988)): `rings`
/// Gauss-Legendre radii in r^2, `arms` equal angles. `obscuration` is the inner radius, 0 to below 1.
/// Exact for polynomials up to degree 4 rings - 2 in r and angular frequencies below `arms`.
pub fn gaussian(rings: usize, arms: usize, obscuration: f64) -> Vec<PupilPoint> {
    let inner2 = obscuration * obscuration;
    let mut points = Vec::with_capacity(rings * arms);
    for (u, weight) in gauss_legendre(rings) {
        let r = (inner2 + (1.0 - inner2) * u).sqrt();
        for arm in 0..arms {
            let angle = TAU * (arm as f64 + 0.5) / arms as f64;
            points.push(PupilPoint { at: [r * angle.cos(), r * angle.sin()], weight: weight / arms as f64 });
        }
    }
    points
}

/// Rings with 1, 6, 12, ... points, as spot diagrams show them; equal weights: for the eye, not
/// for figures.
pub fn hexapolar(rings: usize) -> Vec<PupilPoint> {
    let count = 1 + 3 * rings * (rings + 1);
    let weight = 1.0 / count as f64;
    let mut points = vec![PupilPoint { at: [0.0, 0.0], weight }];
    for ring in 1..=rings {
        let r = ring as f64 / rings as f64;
        points.extend((0..6 * ring).map(|i| {
            let angle = TAU * i as f64 / (6 * ring) as f64;
            PupilPoint { at: [r * angle.cos(), r * angle.sin()], weight }
        }));
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Mean of r^2p over the unit disc is 1 / (p + 1); of x^4 it is 1/8; over a ring, closed forms.
    #[test]
    fn moments_of_the_disc_are_exact() {
        let mean = |points: &[PupilPoint], f: &dyn Fn(f64, f64) -> f64| {
            points.iter().map(|p| p.weight * f(p.at[0], p.at[1])).sum::<f64>()
        };
        let points = gaussian(3, 8, 0.0);
        for p in 0..=5 {
            let got = mean(&points, &|x, y| (x * x + y * y).powi(p));
            assert!((got - 1.0 / f64::from(p + 1)).abs() < 1e-14, "r^{}: {got}", 2 * p);
        }
        assert!((mean(&points, &|x, _| x.powi(4)) - 0.125).abs() < 1e-14);
        let ring = gaussian(3, 8, 0.5);
        assert!((mean(&ring, &|x, y| x * x + y * y) - (1.0 - 0.0625) / 2.0 / 0.75).abs() < 1e-14);
        assert_eq!(hexapolar(3).len(), 37);
    }
}
