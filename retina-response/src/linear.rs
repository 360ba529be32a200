//! Weighted least squares of a dozen unknowns.

/// Solution and covariance of a least-squares problem.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Solution {
    /// The unknowns.
    pub(crate) x: Vec<f64>,
    /// Inverse of the normal matrix: the covariance where the rows are in units of their sigma.
    pub(crate) covariance: Vec<Vec<f64>>,
}

/// A pivot of the scaled normal matrix below this is no information: columns agree to 5 digits.
const SMALLEST_PIVOT: f64 = 1e-10;

/// Normal equations, gathered row by row.
#[derive(Debug, Clone)]
pub(crate) struct Normal {
    matrix: Vec<Vec<f64>>,
    right: Vec<f64>,
}

impl Normal {
    /// None yet, of `unknowns` unknowns.
    pub(crate) fn new(unknowns: usize) -> Self {
        Self { matrix: vec![vec![0.0; unknowns]; unknowns], right: vec![0.0; unknowns] }
    }

    /// A row (already divided by its sigma), its right side, and a weight.
    pub(crate) fn add(&mut self, row: &[f64], right: f64, weight: f64) {
        for (i, &a) in row.iter().enumerate() {
            self.right[i] += weight * a * right;
            for (j, &b) in row.iter().enumerate().take(i + 1) {
                self.matrix[i][j] += weight * a * b;
            }
        }
    }

    /// Solves by Cholesky's method after each unknown is scaled to a unit diagonal; the diagonal is raised
    /// by `damping` (Levenberg). `None` where the rows do not tell the unknowns apart.
    pub(crate) fn solve(&self, damping: f64) -> Option<Solution> {
        let n = self.right.len();
        let scale: Vec<f64> = (0..n).map(|i| self.matrix[i][i].sqrt()).collect();
        if scale.iter().any(|&s| !(s > 0.0 && s.is_finite())) {
            return None;
        }
        let mut lower = vec![vec![0.0; n]; n];
        for i in 0..n {
            for j in 0..=i {
                let mut sum = self.matrix[i][j] / (scale[i] * scale[j]);
                if i == j {
                    sum += damping;
                }
                sum -= (0..j).map(|k| lower[i][k] * lower[j][k]).sum::<f64>();
                if i == j {
                    if sum < SMALLEST_PIVOT {
                        return None;
                    }
                    lower[i][i] = sum.sqrt();
                } else {
                    lower[i][j] = sum / lower[j][j];
                }
            }
        }
        let back = |right: &[f64]| -> Vec<f64> {
            let mut y = right.to_vec();
            for i in 0..n {
                y[i] = (y[i] - (0..i).map(|k| lower[i][k] * y[k]).sum::<f64>()) / lower[i][i];
            }
            for i in (0..n).rev() {
                y[i] = (y[i] - (i + 1..n).map(|k| lower[k][i] * y[k]).sum::<f64>()) / lower[i][i];
            }
            y
        };
        let scaled: Vec<f64> = (0..n).map(|i| self.right[i] / scale[i]).collect();
        let x = back(&scaled).iter().zip(&scale).map(|(y, s)| y / s).collect();
        let covariance = (0..n)
            .map(|i| {
                let unit: Vec<f64> = (0..n).map(|k| f64::from(u8::from(k == i))).collect();
                back(&unit).iter().enumerate().map(|(k, y)| y / (scale[i] * scale[k])).collect()
            })
            .collect();
        Some(Solution { x, covariance })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A straight line through (0, 1), (1, 3), (2, 4) by hand: slope 3/2, intercept 7/6; the covariance for
    /// unit sigmas is [[5/6, -1/2], [-1/2, 1/2]].
    #[test]
    fn a_line_worked_out_by_hand() {
        let mut normal = Normal::new(2);
        for (x, y) in [(0.0, 1.0), (1.0, 3.0), (2.0, 4.0)] {
            normal.add(&[1.0, x], y, 1.0);
        }
        let solution = normal.solve(0.0).unwrap();
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a} {b}");
        near(solution.x[0], 7.0 / 6.0);
        near(solution.x[1], 1.5);
        near(solution.covariance[0][0], 5.0 / 6.0);
        near(solution.covariance[0][1], -0.5);
        near(solution.covariance[1][1], 0.5);
        let mut same = Normal::new(2);
        same.add(&[1.0, 2.0], 1.0, 1.0);
        same.add(&[2.0, 4.0], 1.0, 1.0);
        assert_eq!(same.solve(0.0), None);
    }
}
