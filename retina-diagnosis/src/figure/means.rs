//! Means of errors over a column, with how sure they are.

use crate::data::Dataset;
use crate::noise::Weights;

/// Bins of about equal numbers of rows; a column of fewer values has one for each.
const BINS: usize = 15;

/// Means of an axis's errors over a column: its mean value, the error's and the error's standard deviation, bin by bin.
/// Rows count by their noise. The standard deviation is that of the rows' noise and of what the rows of a group share.
pub(crate) fn means(
    data: &Dataset,
    weights: &Weights,
    rows: &[usize],
    value: impl Fn(usize) -> f64,
    error: impl Fn(usize) -> f64,
) -> Vec<[f64; 3]> {
    let mut group = vec![0; data.len()];
    for (g, own) in data.groups.iter().enumerate() {
        group[own.rows.clone()].fill(g);
    }
    bins(rows, &value)
        .iter()
        .map(|bin| mean_of(bin, &group, &weights.sigma, weights.jitter_variance, &value, &error))
        .collect()
}

/// Rows sorted by a value, in bins that do not part equal values.
fn bins(rows: &[usize], value: &impl Fn(usize) -> f64) -> Vec<Vec<usize>> {
    let mut order: Vec<usize> = rows.iter().copied().filter(|&row| value(row).is_finite()).collect();
    order.sort_by(|&a, &b| value(a).total_cmp(&value(b)));
    let mut distinct: Vec<Vec<usize>> = Vec::new();
    for row in order {
        match distinct.last_mut().filter(|last| value(last[0]) == value(row)) {
            Some(last) => last.push(row),
            None => distinct.push(vec![row]),
        }
    }
    if distinct.len() <= BINS {
        return distinct;
    }
    let least = distinct.iter().map(Vec::len).sum::<usize>().div_ceil(BINS);
    let mut out: Vec<Vec<usize>> = Vec::new();
    for own in distinct {
        match out.last_mut().filter(|last| last.len() < least) {
            Some(last) => last.extend(own),
            None => out.push(own),
        }
    }
    out
}

fn mean_of(
    bin: &[usize],
    group: &[usize],
    sigma: &[f64],
    jitter_variance: f64,
    value: &impl Fn(usize) -> f64,
    error: &impl Fn(usize) -> f64,
) -> [f64; 3] {
    let weight = |row: usize| 1.0 / (sigma[row] * sigma[row]);
    let total: f64 = bin.iter().map(|&row| weight(row)).sum();
    let mean = |of: &dyn Fn(usize) -> f64| bin.iter().map(|&row| weight(row) * of(row)).sum::<f64>() / total;
    // The weighted mean has 1 / total of the rows' own noise, and of a group's the square of its weights' share.
    let mut own: Vec<(usize, f64)> = bin.iter().map(|&row| (group[row], weight(row))).collect();
    own.sort_by_key(|&(group, _)| group);
    let shared: f64 = own
        .chunk_by(|a, b| a.0 == b.0)
        .map(|rows| (rows.iter().map(|(_, weight)| weight).sum::<f64>() / total).powi(2))
        .sum();
    [mean(value), mean(error), (1.0 / total + jitter_variance * shared).sqrt()]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sixteen rows of sigma 2 in four groups that share an error of sigma 1: 4 / 16 + 4 (4 / 16)^2 = 0.5. Rows of half
    /// the sigma count four times.
    #[test]
    fn a_mean_and_its_bar_are_those_of_the_closed_form() {
        let bin: Vec<usize> = (0..16).collect();
        let group: Vec<usize> = bin.iter().map(|row| row / 4).collect();
        let [x, y, sigma] =
            mean_of(&bin, &group, &[2.0; 16], 1.0, &|row| row as f64, &|row| 3.0 * row as f64);
        assert!((x - 7.5).abs() < 1e-12 && (y - 22.5).abs() < 1e-12);
        assert!((sigma - 0.5f64.sqrt()).abs() < 1e-12);
        let [_, y, sigma] = mean_of(&[0, 1], &[0, 1], &[1.0, 2.0], 0.0, &|_| 0.0, &|row| row as f64);
        assert!((y - 0.2).abs() < 1e-12 && (sigma - 0.8f64.sqrt()).abs() < 1e-12);
    }

    /// Few values have a bin each; many are parted evenly, equal ones never.
    #[test]
    fn bins_keep_equal_values_together() {
        let rows: Vec<usize> = (0..3000).collect();
        let few = bins(&rows, &|row| (row % 3) as f64);
        assert_eq!(few.iter().map(Vec::len).collect::<Vec<_>>(), [1000, 1000, 1000]);
        let many = bins(&rows, &|row| (row / 7) as f64);
        assert!((BINS - 1..=BINS).contains(&many.len()));
        for pair in many.windows(2) {
            assert!(pair[0].last().unwrap() / 7 < pair[1][0] / 7);
        }
    }
}
