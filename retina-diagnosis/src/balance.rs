//! Two halves of a table whose columns have the same means.

use crate::data::{Dataset, Flip};
use crate::screens::screened;
use crate::units::{Units, in_time};

/// For each unit whether it is in the first half: of each pair of neighbours in time the one that keeps the halves' means
/// of all columns nearest to each other.
pub(crate) fn balanced(data: &Dataset, units: &Units) -> Vec<bool> {
    let mut order: Vec<usize> = (0..units.count).collect();
    if data.flip == Flip::Groups {
        order = in_time(data);
    }
    let means: Vec<Vec<f64>> = screened(data)
        .iter()
        .map(|name| {
            let values = data.values(name);
            let of_unit = |unit: usize| {
                let (mut sum, mut count) = (0.0, 0.0);
                for row in units.of_unit(unit).flatten().filter(|&row| !values[row].is_nan()) {
                    sum += values[row];
                    count += 1.0;
                }
                if count > 0.0 { sum / count } else { 0.0 }
            };
            let means: Vec<f64> = (0..units.count).map(of_unit).collect();
            let middle = means.iter().sum::<f64>() / means.len() as f64;
            let spread =
                (means.iter().map(|m| (m - middle).powi(2)).sum::<f64>() / means.len() as f64).sqrt();
            means.iter().map(|m| if spread > 0.0 { (m - middle) / spread } else { 0.0 }).collect()
        })
        .collect();
    let mut first = vec![false; units.count];
    let mut off = vec![0.0; means.len()];
    for pair in order.chunks(2) {
        let [a, b] = *pair else {
            first[pair[0]] = true;
            continue;
        };
        let distance = |sign: f64| -> f64 {
            off.iter().zip(&means).map(|(off, m)| (off + sign * (m[a] - m[b])).powi(2)).sum()
        };
        let sign = if distance(1.0) <= distance(-1.0) { 1.0 } else { -1.0 };
        off.iter_mut().zip(&means).for_each(|(off, m)| *off += sign * (m[a] - m[b]));
        first[if sign > 0.0 { a } else { b }] = true;
    }
    first
}
