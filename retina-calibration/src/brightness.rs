//! Noise that depends on brightness and on the place in the field, estimated from residuals.

use glam::{DMat2, DVec2};

/// How residuals are grouped by brightness.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoiseGroups {
    /// Rows of a group; there are at most 16 groups.
    pub rows: usize,
    /// Parameters that were fitted to the rows, in rows: what residuals are too small by.
    pub fitted: f64,
    /// Median length of a residual of unit standard deviation: 0.67449 in one dimension, 1.17741 in two.
    pub median_of_normal: f64,
    /// Smallest standard deviation: exact data have no noise, and weights must stay finite.
    pub least: f64,
}

/// Variance of a normal error of unit variance that is known to lie within 3 of 0.
const VARIANCE_WITHIN_3: f64 = 0.973_34;
/// Clippings about a new standard deviation each.
const CLIPPINGS: usize = 5;
/// Groups of like brightness in a ring of the field, at least, and most rings.
const GROUPS_OF_RING: usize = 4;
const MOST_RINGS: usize = 10;
/// Most groups.
const MOST_GROUPS: usize = 16;

impl NoiseGroups {
    /// Standard deviation of each row: medians of the residuals' `length` over groups of like brightness `key`,
    /// log-linear in between, level beyond. Outliers do not count, unless all are.
    pub fn sigmas(&self, key: &[f64], length: &[f64], outlier: &[bool]) -> Vec<f64> {
        let mut order: Vec<usize> = (0..key.len()).filter(|&i| !outlier[i]).collect();
        if order.is_empty() {
            order = (0..key.len()).collect();
        }
        self.at_rows(key, key, length, order, |median, _| median / self.median_of_normal)
    }

    /// Standard deviation of each row by its brightness, from rows at a like `distance` from the field's middle; log-linear
    /// between those rings, level beyond. The field changes how the noise follows the light: where spots are long, bright
    /// ones scatter by more than their photons.
    pub fn sigmas_in_field(
        &self,
        key: &[f64],
        distance: &[f64],
        length: &[f64],
        outlier: &[bool],
    ) -> Vec<f64> {
        let mut order: Vec<usize> = (0..key.len()).filter(|&i| !outlier[i]).collect();
        if order.is_empty() {
            order = (0..key.len()).collect();
        }
        order.sort_by(|&a, &b| distance[a].total_cmp(&distance[b]));
        let rings = (order.len() / (GROUPS_OF_RING * self.rows)).clamp(1, MOST_RINGS);
        let free = self.fitted / order.len() as f64;
        let nodes: Vec<(f64, Vec<f64>)> = (0..rings)
            .map(|ring| {
                let members = &order[ring * order.len() / rings..(ring + 1) * order.len() / rings];
                let middle = members.iter().map(|&i| distance[i]).sum::<f64>() / members.len() as f64;
                let of_ring = Self { fitted: free * members.len() as f64, ..*self };
                (
                    middle,
                    of_ring.at_rows(key, key, length, members.to_vec(), |median, _| {
                        median / self.median_of_normal
                    }),
                )
            })
            .collect();
        let at = |row: usize| -> f64 {
            let next = nodes.partition_point(|node| node.0 < distance[row]);
            let (below, above) = (next.saturating_sub(1), next.min(rings - 1));
            let (x0, x1) = (nodes[below].0, nodes[above].0);
            let part = if x1 > x0 { (distance[row] - x0) / (x1 - x0) } else { 0.0 };
            let (low, high) = (nodes[below].1[row].ln(), nodes[above].1[row].ln());
            (low + part.clamp(0.0, 1.0) * (high - low)).exp()
        };
        (0..key.len()).map(at).collect()
    }

    /// Standard deviations at other brightnesses than those of the residuals; roots of mean squares without what is
    /// beyond three standard deviations, since the median of values that were rounded is one of few.
    pub fn clipped_at(&self, wanted: &[f64], key: &[f64], length: &[f64]) -> Vec<f64> {
        let clipped = |median: f64, members: &[f64]| {
            let mut sigma = median / self.median_of_normal;
            for _ in 0..CLIPPINGS {
                let within = members.iter().filter(|v| **v <= 3.0 * sigma);
                let (count, squares) = within.fold((0.0, 0.0), |(n, s), v| (n + 1.0, s + v * v));
                if count > 0.0 {
                    sigma = (squares / count / VARIANCE_WITHIN_3).sqrt();
                }
            }
            sigma
        };
        self.at_rows(wanted, key, length, (0..key.len()).collect(), clipped)
    }

    fn at_rows(
        &self,
        wanted: &[f64],
        key: &[f64],
        length: &[f64],
        mut order: Vec<usize>,
        scale: impl Fn(f64, &[f64]) -> f64,
    ) -> Vec<f64> {
        order.sort_by(|&a, &b| key[a].total_cmp(&key[b]));
        let count = order.len() as f64;
        let free = (count / (count - self.fitted).max(1.0)).sqrt();
        let groups = (order.len() / self.rows).clamp(1, MOST_GROUPS);
        let nodes: Vec<(f64, f64)> = (0..groups)
            .map(|group| {
                let members = &order[group * order.len() / groups..(group + 1) * order.len() / groups];
                let mut lengths: Vec<f64> = members.iter().map(|&i| length[i]).collect();
                let middle = lengths.len() / 2;
                let median = *lengths.select_nth_unstable_by(middle, f64::total_cmp).1;
                let mean_key = members.iter().map(|&i| key[i]).sum::<f64>() / members.len() as f64;
                (mean_key, (free * scale(median, &lengths)).max(self.least).ln())
            })
            .collect();
        wanted.iter().map(|&k| interpolate(&nodes, k).exp()).collect()
    }
}

/// The directions away from the field's middle and across it, as columns: spots are long along one of them.
pub fn outwards(place: DVec2) -> DMat2 {
    let out = place.normalize_or(DVec2::X);
    DMat2::from_cols(out, out.perp())
}

/// Linear between nodes, level beyond them.
fn interpolate(nodes: &[(f64, f64)], at: f64) -> f64 {
    let next = nodes.partition_point(|node| node.0 < at);
    if next == 0 {
        return nodes[0].1;
    }
    let Some(&(x1, y1)) = nodes.get(next) else { return nodes[nodes.len() - 1].1 };
    let (x0, y0) = nodes[next - 1];
    if x1 > x0 { y0 + (at - x0) / (x1 - x0) * (y1 - y0) } else { y1 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Residuals that alternate in sign have their median length for standard deviation, whatever their brightness.
    #[test]
    fn noise_follows_the_brightness_and_outliers_do_not_count() {
        let groups = NoiseGroups { rows: 50, fitted: 0.0, median_of_normal: 1.0, least: 1e-9 };
        let key: Vec<f64> = (0..400).map(f64::from).collect();
        let mut length: Vec<f64> = key.iter().map(|k| (k / 100.0).exp()).collect();
        let mut outlier = vec![false; 400];
        (length[30], outlier[30]) = (1e6, true);
        let sigma = groups.sigmas(&key, &length, &outlier);
        assert!((sigma[200] / 2f64.exp() - 1.0).abs() < 0.03 && (sigma[100] / 1f64.exp() - 1.0).abs() < 0.03);
        assert!(groups.sigmas(&key, &vec![0.0; 400], &outlier).iter().all(|s| (s / 1e-9 - 1.0).abs() < 1e-6));
    }
}
