//! Interpolation by products of Chebyshev polynomials.
//!
//! Source: L. N. Trefethen, "Approximation Theory and Approximation Practice" (2013), chs. 3 and 8:
//! interpolation in Chebyshev points of the first kind converges geometrically for analytic functions.

use std::f64::consts::PI;

/// `F` functions of (x, y) on a rectangle about the origin, smooth everywhere.
#[derive(Debug, Clone)]
pub struct Chebyshev2<const F: usize> {
    half: [f64; 2],
    nodes: usize,
    /// Coefficients of T_i(x) T_j(y), index j * nodes + i.
    coefficients: Vec<[f64; F]>,
}

/// Highest number of nodes along an axis.
const MOST_NODES: usize = 32;

impl<const F: usize> Chebyshev2<F> {
    /// Interpolates `function` on `|x| <= half[0]`, `|y| <= half[1]` with `nodes` (at most 32) points along
    /// each axis.
    ///
    /// # Errors
    /// The first of `function`'s.
    pub fn new<E>(
        half: [f64; 2],
        nodes: usize,
        function: impl Fn([f64; 2]) -> Result<[f64; F], E>,
    ) -> Result<Self, E> {
        let nodes = nodes.clamp(1, MOST_NODES);
        let angle = |k: usize| PI * (k as f64 + 0.5) / nodes as f64;
        let mut samples = Vec::with_capacity(nodes * nodes);
        for j in 0..nodes {
            for i in 0..nodes {
                samples.push(function([half[0] * angle(i).cos(), half[1] * angle(j).cos()])?);
            }
        }
        let factor = |order: usize, k: usize| {
            let scale = if order == 0 { 1.0 } else { 2.0 };
            scale / nodes as f64 * (order as f64 * angle(k)).cos()
        };
        let mut coefficients = vec![[0.0; F]; nodes * nodes];
        for (place, coefficient) in coefficients.iter_mut().enumerate() {
            let (i, j) = (place % nodes, place / nodes);
            for (sample, values) in samples.iter().enumerate() {
                let weight = factor(i, sample % nodes) * factor(j, sample / nodes);
                coefficient.iter_mut().zip(values).for_each(|(c, v)| *c += weight * v);
            }
        }
        Ok(Self { half, nodes, coefficients })
    }

    /// The sum of tables on one rectangle, each times its weight.
    pub(super) fn weighted_sum(tables: &[Self], weights: &[f64]) -> Self {
        let mut out = tables[0].clone();
        out.coefficients.iter_mut().flatten().for_each(|c| *c = 0.0);
        for (table, weight) in tables.iter().zip(weights) {
            let values = table.coefficients.iter().flatten();
            out.coefficients.iter_mut().flatten().zip(values).for_each(|(c, v)| *c += weight * v);
        }
        out
    }

    /// T_0 .. T_n-1 and their derivatives at u.
    fn basis(&self, u: f64) -> ([f64; MOST_NODES], [f64; MOST_NODES]) {
        let (mut t, mut d) = ([0.0; MOST_NODES], [0.0; MOST_NODES]);
        (t[0], t[1], d[1]) = (1.0, u, 1.0);
        for k in 2..self.nodes {
            t[k] = 2.0 * u * t[k - 1] - t[k - 2];
            d[k] = 2.0 * t[k - 1] + 2.0 * u * d[k - 1] - d[k - 2];
        }
        (t, d)
    }

    fn sum(&self, x: &[f64; MOST_NODES], y: &[f64; MOST_NODES]) -> [f64; F] {
        let mut total = [0.0; F];
        for (row, y) in self.coefficients.chunks_exact(self.nodes).zip(y) {
            let mut line = [0.0; F];
            for (coefficient, x) in row.iter().zip(x) {
                line.iter_mut().zip(coefficient).for_each(|(l, c)| *l += x * c);
            }
            total.iter_mut().zip(line).for_each(|(t, l)| *t += y * l);
        }
        total
    }

    /// The functions at a point.
    pub fn at(&self, at: [f64; 2]) -> [f64; F] {
        self.sum(&self.basis(at[0] / self.half[0]).0, &self.basis(at[1] / self.half[1]).0)
    }

    /// Derivatives along x and along y.
    pub fn gradient(&self, at: [f64; 2]) -> [[f64; F]; 2] {
        let (x, dx) = self.basis(at[0] / self.half[0]);
        let (y, dy) = self.basis(at[1] / self.half[1]);
        [self.sum(&dx, &y).map(|v| v / self.half[0]), self.sum(&x, &dy).map(|v| v / self.half[1])]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A polynomial below the number of nodes is reproduced; exp(x) cos(y) converges to rounding, which
    /// derivatives multiply by up to the square of the degree.
    #[test]
    fn interpolates_values_and_derivatives() {
        let function = |[x, y]: [f64; 2]| Ok::<_, ()>([x * x * x * y - 2.0 * y, x.exp() * y.cos()]);
        let table = Chebyshev2::new([0.5, 0.8], 16, function).unwrap();
        for [x, y] in [[0.1, -0.7], [-0.5, 0.8], [0.33, 0.02]] {
            let [p, q] = table.at([x, y]);
            assert!((p - (x * x * x * y - 2.0 * y)).abs() < 1e-14 && (q - x.exp() * y.cos()).abs() < 1e-14);
            let [dx, dy] = table.gradient([x, y]);
            assert!((dx[0] - 3.0 * x * x * y).abs() < 1e-11 && (dy[0] - (x * x * x - 2.0)).abs() < 1e-11);
            assert!((dx[1] - x.exp() * y.cos()).abs() < 1e-11 && (dy[1] + x.exp() * y.sin()).abs() < 1e-11);
        }
    }
}
