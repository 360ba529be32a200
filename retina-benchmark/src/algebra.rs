//! Small least squares of the generator's own: what of a field is left beside columns.

/// Normal equations solved by elimination with pivots; dependent columns get 0.
pub(crate) fn coefficients(columns: &[Vec<f64>], y: &[f64], weight: &[f64]) -> Vec<f64> {
    let n = columns.len();
    let product =
        |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).zip(weight).map(|((a, b), w)| a * b * w).sum() };
    let mut system: Vec<Vec<f64>> = (0..n)
        .map(|i| {
            let mut row: Vec<f64> = (0..n).map(|j| product(&columns[i], &columns[j])).collect();
            row.push(product(&columns[i], y));
            row
        })
        .collect();
    let scale: Vec<f64> = (0..n).map(|i| system[i][i].abs()).collect();
    let mut used = vec![None; n];
    for column in 0..n {
        let free = (0..n).filter(|row| !used.contains(&Some(*row)));
        let Some(pivot) = free.max_by(|&a, &b| system[a][column].abs().total_cmp(&system[b][column].abs()))
        else {
            continue;
        };
        if system[pivot][column].abs() <= 1e-12 * scale[column] {
            continue;
        }
        used[column] = Some(pivot);
        let top = system[pivot].clone();
        for row in (0..n).filter(|row| *row != pivot) {
            let factor = system[row][column] / top[column];
            system[row].iter_mut().zip(&top).for_each(|(value, top)| *value -= factor * top);
        }
    }
    (0..n)
        .map(|column| used[column].map_or(0.0, |pivot: usize| system[pivot][n] / system[pivot][column]))
        .collect()
}

/// What of `y` the columns leave.
pub(crate) fn beside(columns: &[Vec<f64>], y: &[f64], weight: &[f64]) -> Vec<f64> {
    let found = coefficients(columns, y, weight);
    let mut out = y.to_vec();
    for (column, c) in columns.iter().zip(&found) {
        out.iter_mut().zip(column).for_each(|(value, column)| *value -= c * column);
    }
    out
}

/// Root of the mean square.
pub(crate) fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|v| v * v).sum::<f64>() / values.len().max(1) as f64).sqrt()
}

#[cfg(test)]
mod tests {
    /// By hand: y = 2 + 3 x; the third column is the first twice.
    #[test]
    fn a_line_is_found_beside_a_dependent_column() {
        let x = vec![0.0, 1.0, 2.0, 3.0];
        let columns = [vec![1.0; 4], x.clone(), vec![2.0; 4]];
        let y: Vec<f64> = x.iter().map(|x| 2.0 + 3.0 * x).collect();
        let found = super::coefficients(&columns, &y, &[1.0; 4]);
        assert!((found[0] + 2.0 * found[2] - 2.0).abs() < 1e-9 && (found[1] - 3.0).abs() < 1e-9);
        assert!(super::rms(&super::beside(&columns, &y, &[1.0; 4])) < 1e-9);
    }
}
