//! Orthonormal bases of columns, grown one by one, and small symmetric systems.

use faer::linalg::matmul::matmul;
use faer::linalg::matmul::triangular::{self, BlockStructure};
use rayon::prelude::*;

/// A column that keeps less than this of its length beside the ones before it is not independent of them.
const DEPENDENT: f64 = 1e-6;

/// Orthonormal columns q with the triangle R of the columns they were made of. Those of [`Basis::spanning`] come first
/// and have no coefficients.
#[derive(Debug, Clone, Default)]
pub(crate) struct Basis {
    pub(crate) q: Vec<Vec<f64>>,
    /// For each column that was put in: its coefficients on q, the last one its own; `None` if dependent.
    triangle: Vec<Option<Vec<f64>>>,
}

/// Partial sums of [`dot`]: additions that need not wait for each other.
const LANES: usize = 8;

/// Sum of products, always in the same order: `LANES` partial sums, then these.
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let (mut a_parts, mut b_parts) = (a.chunks_exact(LANES), b.chunks_exact(LANES));
    let mut sums = [0.0; LANES];
    for (a, b) in (&mut a_parts).zip(&mut b_parts) {
        for k in 0..LANES {
            sums[k] += a[k] * b[k];
        }
    }
    let rest: f64 = a_parts.remainder().iter().zip(b_parts.remainder()).map(|(a, b)| a * b).sum();
    sums.iter().sum::<f64>() + rest
}

/// Columns side by side as a matrix.
pub(crate) fn matrix(columns: &[Vec<f64>]) -> faer::Mat<f64> {
    let rows = columns.first().map_or(0, Vec::len);
    let mut out = faer::Mat::<f64>::zeros(rows, columns.len());
    for (j, column) in columns.iter().enumerate() {
        for (to, from) in out.col_as_slice_mut(j).iter_mut().zip(column) {
            *to = *from;
        }
    }
    out
}

/// A^T A, its lower triangle alone: the sum over blocks of rows, always the same ones in the same order.
pub(crate) fn gram_lower(a: &faer::Mat<f64>) -> faer::Mat<f64> {
    const ROWS: usize = 1024;
    let starts: Vec<usize> = (0..a.nrows()).step_by(ROWS).collect();
    let of_rows = |&start: &usize| {
        let rows = a.subrows(start, ROWS.min(a.nrows() - start));
        let mut out = faer::Mat::<f64>::zeros(a.ncols(), a.ncols());
        triangular::matmul(
            out.as_mut(),
            BlockStructure::TriangularLower,
            faer::Accum::Replace,
            rows.transpose(),
            BlockStructure::Rectangular,
            rows,
            BlockStructure::Rectangular,
            1.0,
            faer::Par::Seq,
        );
        out
    };
    let parts: Vec<faer::Mat<f64>> = starts.par_iter().map(of_rows).collect();
    parts.into_iter().fold(faer::Mat::zeros(a.ncols(), a.ncols()), |sum, part| sum + part)
}

/// The lower triangle L of a positive definite matrix, L L^T.
pub(crate) fn cholesky(a: &faer::Mat<f64>) -> Option<faer::Mat<f64>> {
    let factor = a.llt(faer::Side::Lower).ok()?;
    Some(factor.L().to_owned())
}

/// Which columns of a Gram matrix are independent of those before them, and L^-1 of these, L L^T their Gram matrix.
/// `before` are the squares of the columns before a base was taken out of them, of which they keep at least a part
/// `least` of the root.
pub(crate) fn independent(gram: &faer::Mat<f64>, before: &[f64], least: f64) -> (Vec<usize>, faer::Mat<f64>) {
    let mut kept: Vec<usize> = Vec::new();
    let mut rows: Vec<Vec<f64>> = Vec::new();
    for column in 0..gram.ncols() {
        let mut row = Vec::with_capacity(kept.len() + 1);
        for (other, &k) in rows.iter().zip(&kept) {
            let known = dot(&row, &other[..row.len()]);
            row.push((gram[(column, k)] - known) / other[row.len()]);
        }
        let left = gram[(column, column)] - dot(&row, &row);
        if left > least * least * before[column] && left.is_finite() {
            row.push(left.sqrt());
            rows.push(row);
            kept.push(column);
        }
    }
    // Rows of the inverse by forward substitution.
    let n = kept.len();
    let mut inverse = faer::Mat::<f64>::zeros(n, n);
    for column in 0..n {
        for i in column..n {
            let known: f64 = (column..i).map(|k| rows[i][k] * inverse[(k, column)]).sum();
            inverse[(i, column)] = (f64::from(u8::from(i == column)) - known) / rows[i][i];
        }
    }
    (kept, inverse)
}

/// Coefficients of columns, 0 of those that depend on the ones before them, and the number of the others: normal
/// equations, refined once by what they leave.
pub(crate) fn least_squares(columns: &[Vec<f64>], y: &[f64]) -> (Vec<f64>, usize) {
    let square: Vec<f64> = columns.iter().map(|column| dot(column, column)).collect();
    let a = matrix(columns);
    let (kept, inverse) = independent(&gram_lower(&a), &square, DEPENDENT);
    let mut out = vec![0.0; columns.len()];
    let mut left = y.to_vec();
    for _ in 0..2 {
        let right = faer::Mat::<f64>::from_fn(kept.len(), 1, |i, _| dot(&columns[kept[i]], &left));
        let step = inverse.transpose() * (&inverse * right);
        for (i, &k) in kept.iter().enumerate() {
            out[k] += step[(i, 0)];
            left.iter_mut().zip(&columns[k]).for_each(|(l, v)| *l -= step[(i, 0)] * v);
        }
    }
    (out, kept.len())
}

impl Basis {
    pub(crate) fn of(columns: impl IntoIterator<Item = Vec<f64>>) -> Self {
        let mut out = Self::default();
        for column in columns {
            out.push(column);
        }
        out
    }

    /// Of many well-conditioned columns: Cholesky's factor of their Gram matrix, twice (Y. Yamamoto et al., Electronic
    /// Transactions on Numerical Analysis 44, 2015). Their coefficients are not kept.
    pub(crate) fn spanning(columns: &[Vec<f64>]) -> Self {
        if columns.is_empty() {
            return Self::default();
        }
        let mut q = matrix(columns);
        for _ in 0..2 {
            let gram = gram_lower(&q);
            // Without a factor the columns are dependent; Gram and Schmidt leave those out.
            let Some(l) = cholesky(&gram) else {
                let mut out = Self::of(columns.iter().cloned());
                out.triangle.clear();
                return out;
            };
            let mut transposed = q.transpose().to_owned();
            faer::linalg::triangular_solve::solve_lower_triangular_in_place(
                l.as_ref(),
                transposed.as_mut(),
                faer::Par::Seq,
            );
            q = transposed.transpose().to_owned();
        }
        Self { q: (0..q.ncols()).map(|j| q.col_as_slice(j).to_vec()).collect(), triangle: Vec::new() }
    }

    /// R, a row for each q and a column for each that was put in; dependent ones are 0.
    pub(crate) fn triangle_rows(&self) -> Vec<Vec<f64>> {
        let mut out = vec![vec![0.0; self.triangle.len()]; self.q.len()];
        for (column, along) in self.triangle.iter().enumerate() {
            for (row, value) in along.iter().flatten().enumerate() {
                out[row][column] = *value;
            }
        }
        out
    }

    /// Gram-Schmidt, twice, which keeps orthogonality to rounding (Bjoerck, BIT 7, 1967). False where the column
    /// depends on those before it.
    pub(crate) fn push(&mut self, column: Vec<f64>) -> bool {
        let before = dot(&column, &column).sqrt();
        self.push_of(column, before)
    }

    /// The same of a column that had the length `before`.
    fn push_of(&mut self, mut column: Vec<f64>, before: f64) -> bool {
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

    /// The directions, of `rows` rows, side by side.
    pub(crate) fn side_by_side(&self, rows: usize) -> faer::Mat<f64> {
        if self.q.is_empty() { faer::Mat::zeros(rows, 0) } else { matrix(&self.q) }
    }

    /// [`Self::push`] of several columns; `all` are the directions that there are, side by side.
    pub(crate) fn push_all(&mut self, all: &faer::Mat<f64>, columns: &[Vec<f64>]) {
        if columns.is_empty() {
            return;
        }
        let before: Vec<f64> = columns.iter().map(|column| dot(column, column).sqrt()).collect();
        let mut c = matrix(columns);
        let mut along = faer::Mat::<f64>::zeros(all.ncols(), columns.len());
        for _ in 0..2 {
            let part = all.transpose() * &c;
            matmul(c.as_mut(), faer::Accum::Add, all, &part, -1.0, faer::Par::Seq);
            along += part;
        }
        let mut own = Self::default();
        for (k, before) in before.into_iter().enumerate() {
            if before == 0.0 || !own.push_of(c.col_as_slice(k).to_vec(), before) {
                self.triangle.push(None);
                continue;
            }
            let mut row = along.col_as_slice(k).to_vec();
            row.extend(own.triangle.last().into_iter().flatten().flatten());
            self.triangle.push(Some(row));
        }
        self.q.append(&mut own.q);
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
        let rows = self.inverse_rows();
        rows.iter().map(|a| rows.iter().map(|b| dot(a, b)).collect()).collect()
    }

    /// R^-1, a row for each column that was put in, over all q; 0 for dependent ones.
    pub(crate) fn inverse_rows(&self) -> Vec<Vec<f64>> {
        let mut rows = vec![vec![0.0; self.q.len()]; self.triangle.len()];
        for k in 0..self.q.len() {
            let mut unit = vec![0.0; self.q.len()];
            unit[k] = 1.0;
            for (row, value) in rows.iter_mut().zip(self.back_substituted(unit)) {
                row[k] = value;
            }
        }
        rows
    }

    /// Coefficients of the columns that were put in, of what a vector is along each q.
    pub(crate) fn back_substituted(&self, mut right: Vec<f64>) -> Vec<f64> {
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

    /// Columns one by one and together give the same coefficients, of dependent ones too.
    #[test]
    fn columns_pushed_together_are_those_pushed_one_by_one() {
        let column = |a: f64| -> Vec<f64> { (0..9).map(|i| (a * f64::from(i)).sin() + 0.1 * a).collect() };
        let mut one = Basis::of([column(0.3), column(1.1)]);
        let mut other = one.clone();
        let sum: Vec<f64> = column(0.3).iter().zip(column(2.0)).map(|(a, b)| 2.0 * a - b).collect();
        let more = [column(2.0), sum, column(1.7)];
        let all = matrix(&other.q);
        other.push_all(&all, &more);
        for column in more {
            one.push(column);
        }
        let y = column(0.77);
        let (a, b) = (one.coefficients(&y), other.coefficients(&y));
        assert_eq!((one.q.len(), a.len(), a[3]), (4, 5, 0.0));
        assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-11), "{a:?} {b:?}");
    }

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
