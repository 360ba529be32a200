//! Orthonormal bases of columns, grown one by one, and small symmetric systems.

/// A column that keeps less than this of its length beside the ones before it is not independent of them.
const DEPENDENT: f64 = 1e-6;

/// Orthonormal columns q with the triangle R of the columns they were made of.
#[derive(Debug, Clone, Default)]
pub(crate) struct Basis {
    pub(crate) q: Vec<Vec<f64>>,
    /// For each column that was put in: its coefficients on q, the last one its own; `None` if dependent.
    triangle: Vec<Option<Vec<f64>>>,
}

/// Sum of products, in order.
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

impl Basis {
    pub(crate) fn of(columns: impl IntoIterator<Item = Vec<f64>>) -> Self {
        let mut out = Self::default();
        for column in columns {
            out.push(column);
        }
        out
    }

    /// Gram-Schmidt, twice, which keeps orthogonality to rounding (Bjoerck, BIT 7, 1967). False where the column
    /// depends on those before it.
    pub(crate) fn push(&mut self, mut column: Vec<f64>) -> bool {
        let before = dot(&column, &column).sqrt();
        let mut along = vec![0.0; self.q.len()];
        for _ in 0..2 {
            for (q, along) in self.q.iter().zip(&mut along) {
                let part = dot(q, &column);
                *along += part;
                for (c, q) in column.iter_mut().zip(q) {
                    *c -= part * q;
                }
            }
        }
        let left = dot(&column, &column).sqrt();
        if left.is_nan() || left <= DEPENDENT * before || before == 0.0 {
            self.triangle.push(None);
            return false;
        }
        column.iter_mut().for_each(|c| *c /= left);
        along.push(left);
        self.q.push(column);
        self.triangle.push(Some(along));
        true
    }

    /// What is left of a vector beside all columns.
    pub(crate) fn residual(&self, mut vector: Vec<f64>) -> Vec<f64> {
        for q in &self.q {
            let part = dot(q, &vector);
            for (v, q) in vector.iter_mut().zip(q) {
                *v -= part * q;
            }
        }
        vector
    }

    /// Least-squares coefficients of the columns that were put in; 0 for dependent ones.
    pub(crate) fn coefficients(&self, vector: &[f64]) -> Vec<f64> {
        let projections: Vec<f64> = self.q.iter().map(|q| dot(q, vector)).collect();
        self.back_substituted(projections)
    }

    /// Covariance of the coefficients for unit variance: (R^T R)^-1, rows of dependent columns 0.
    pub(crate) fn covariance(&self) -> Vec<Vec<f64>> {
        let n = self.triangle.len();
        let inverse: Vec<Vec<f64>> = (0..self.q.len())
            .map(|k| {
                let mut unit = vec![0.0; self.q.len()];
                unit[k] = 1.0;
                self.back_substituted(unit)
            })
            .collect();
        (0..n).map(|i| (0..n).map(|j| inverse.iter().map(|c| c[i] * c[j]).sum()).collect()).collect()
    }

    fn back_substituted(&self, mut right: Vec<f64>) -> Vec<f64> {
        let mut out = vec![0.0; self.triangle.len()];
        let mut k = self.q.len();
        for (column, entry) in self.triangle.iter().enumerate().rev() {
            let Some(along) = entry else { continue };
            k -= 1;
            let value = right[k] / along[k];
            out[column] = value;
            for (r, a) in right.iter_mut().zip(&along[..k]) {
                *r -= value * a;
            }
        }
        out
    }
}

/// Solves a symmetric positive definite system (row-major, n x n); `None` where it is not.
pub(crate) fn solve_positive(matrix: &[f64], right: &[f64]) -> Option<Vec<f64>> {
    use faer::linalg::solvers::Solve as _;
    let n = right.len();
    let a = faer::Mat::<f64>::from_fn(n, n, |i, j| matrix[i * n + j]);
    let b = faer::Mat::<f64>::from_fn(n, 1, |i, _| right[i]);
    let x = a.llt(faer::Side::Lower).ok()?.solve(&b);
    let out: Vec<f64> = (0..n).map(|i| x[(i, 0)]).collect();
    out.iter().all(|v| v.is_finite()).then_some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// y = 2 + 3 x on x = 0..3, by hand; the third column is the sum of the first two.
    #[test]
    fn a_line_is_found_and_a_dependent_column_left_out() {
        let x = [0.0, 1.0, 2.0, 3.0];
        let basis = Basis::of([vec![1.0; 4], x.to_vec(), x.iter().map(|x| x + 1.0).collect()]);
        let y: Vec<f64> = x.iter().map(|x| 2.0 + 3.0 * x).collect();
        let c = basis.coefficients(&y);
        assert!((c[0] - 2.0).abs() < 1e-12 && (c[1] - 3.0).abs() < 1e-12 && c[2] == 0.0);
        // Textbook: the slope's variance is 1 / sum (x - mean)^2 = 1 / 5, the intercept's 1/4 + 1.5^2 / 5.
        let v = basis.covariance();
        assert!((v[1][1] - 0.2).abs() < 1e-12 && (v[0][0] - 0.7).abs() < 1e-12);
        assert!((v[0][1] + 0.3).abs() < 1e-12);
    }
}
