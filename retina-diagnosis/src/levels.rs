//! Effects of whole groups in tables of few groups.
//!
//! A dozen exposures can be flipped in a few thousand ways, and an effect that shifts whole exposures is flipped along
//! with them: a channel that is off by ten times the noise in four exposures of twelve has a p-value of 0.1. What is known
//! besides is that an exposure's own error is normal. So an effect is also held against what its fit leaves of the groups'
//! levels (Fisher's F; H. Scheffe, The Analysis of Variance, 1959, sec. 2.4), whose size is then estimated without it. A
//! mount that wanders makes levels that follow each other, and a dozen of them do not say how closely. The test is made
//! with the correlation that was found and with [`WORST`], and the larger p-value counts.

use crate::data::{Dataset, Flip};
use crate::linear::dot;
use crate::noise::{Weights, robust_fit};
use crate::score::Frame;
use crate::series::ratio_beyond;

/// With more groups than this flips of signs tell enough.
const MOST_GROUPS: usize = 40;
/// Fewest degrees of freedom that the levels leave.
const FEWEST_FREE: usize = 6;
/// Correlation of neighbouring groups that no effect may be mistaken for.
const WORST: f64 = 0.9;

/// Whether the levels of a table's groups are to be asked.
pub(crate) fn few_groups(data: &Dataset) -> bool {
    data.jitters && data.flip == Flip::Groups && data.groups.len() <= MOST_GROUPS
}

/// p-value of columns beside a base, of these columns alone.
pub(crate) fn p_value(data: &Dataset, base: &[Vec<f64>], columns: &[Vec<f64>]) -> f64 {
    let all: Vec<Vec<f64>> = base.iter().chain(columns).cloned().collect();
    let mut largest = 0.0f64;
    for wander in [data.wander, WORST] {
        let data = Dataset { wander, ..data.clone() };
        let weights = robust_fit(&data, &all).weights;
        // Groups that do not fit are no outliers here: they would prove whatever fits the others.
        if lost(&data, &weights) > 0 {
            return 1.0;
        }
        let score = Frame::weighted(&data, base, weights.clone()).score(columns);
        let rank = score.rank();
        let left = Frame::weighted(&data, &all, weights);
        let n = data.components();
        let free = (n * (data.groups.len() - 1)).saturating_sub(rank);
        if rank == 0 || free < FEWEST_FREE {
            return 1.0;
        }
        // Levels of unit variance, unless groups share more than their rows' noise and the common error tell.
        let squares: f64 = data
            .groups
            .iter()
            .map(|group| {
                let level = left.weights.level(&data, group.rows.clone());
                let level = level.of(&data, &left.weights, &left.error).to_array();
                dot(&level[..n], &level[..n])
            })
            .sum();
        let unit = (squares / free as f64).max(1.0);
        // A form that is no shift has the scatter of groups in that form.
        let statistic = score.sober.min(score.statistic / unit);
        largest = largest.max(ratio_beyond(statistic / rank as f64, rank, free));
    }
    largest
}

/// Groups of which no row counts.
fn lost(data: &Dataset, weights: &Weights) -> usize {
    data.groups.iter().filter(|group| weights.outlier[group.rows.clone()].iter().all(|out| *out)).count()
}
