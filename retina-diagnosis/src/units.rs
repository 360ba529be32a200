//! Parts of a table whose errors are independent of each other: what a draw from the null gives one sign, and what is
//! left out together.
//!
//! As a rule such a part is a group: an exposure, a series, a night. A laboratory often has three series or six nights,
//! which can be flipped in four or in thirty-two ways. Then each group is cut into runs of rows. That supposes that
//! rows of a group share one common error and nothing else, which neighbours within an exposure can contradict: then
//! whole groups are flipped all the same, and little can be said.

use std::ops::Range;

use crate::data::{Dataset, Flip};
use crate::scatter::Noise;

/// With fewer groups than this their rows are cut into runs.
pub(crate) const FEW_GROUPS: usize = 8;
/// So few groups do not say how closely their own errors follow each other.
pub(crate) const VERY_FEW_GROUPS: usize = 16;
/// Runs that are aimed at then.
const RUNS: usize = 24;
/// Fewest rows of a run.
const FEWEST_ROWS: usize = 4;

/// The parts.
#[derive(Debug, Clone)]
pub(crate) struct Units {
    /// Rows, in their order; each range lies in one group.
    pub(crate) ranges: Vec<Range<usize>>,
    /// The part that each range belongs to.
    pub(crate) unit: Vec<usize>,
    /// Number of parts.
    pub(crate) count: usize,
}

impl Units {
    pub(crate) fn of(data: &Dataset) -> Self {
        if data.flip == Flip::Rows {
            return Self::runs_of_rows(data);
        }
        let ranges: Vec<Range<usize>> = data.groups.iter().map(|group| group.rows.clone()).collect();
        let count = ranges.len();
        Self { ranges, unit: (0..count).collect(), count }
    }

    /// Each group cut into runs of rows.
    pub(crate) fn runs_of_rows(data: &Dataset) -> Self {
        let wanted = RUNS.div_ceil(data.groups.len().max(1));
        let mut ranges = Vec::new();
        for group in &data.groups {
            let rows = group.rows.len();
            let runs = wanted.min(rows / FEWEST_ROWS).max(1);
            ranges.extend(
                (0..runs)
                    .map(|k| group.rows.start + k * rows / runs..group.rows.start + (k + 1) * rows / runs),
            );
        }
        let count = ranges.len();
        Self { ranges, unit: (0..count).collect(), count }
    }

    /// Ranges of one part.
    pub(crate) fn of_unit(&self, unit: usize) -> impl Iterator<Item = Range<usize>> + '_ {
        self.unit
            .iter()
            .zip(&self.ranges)
            .filter(move |(own, _)| **own == unit)
            .map(|(_, range)| range.clone())
    }
}

/// What is flipped: rows where groups are few, unless neighbours show that rows of a group share more than one error.
pub(crate) fn flip_of(data: &Dataset, noise: &Noise) -> Flip {
    let few = data.jitters && data.groups.len() < FEW_GROUPS;
    if few && !noise.shared_within { Flip::Rows } else { Flip::Groups }
}

/// Groups in the order of their times, where there are any.
pub(crate) fn in_time(data: &Dataset) -> Vec<usize> {
    let mut order: Vec<usize> = (0..data.groups.len()).collect();
    if let Some(time) = data.varying("time_s") {
        let mean = |g: usize| {
            let rows = data.groups[g].rows.clone();
            time[rows.clone()].iter().sum::<f64>() / rows.len().max(1) as f64
        };
        let times: Vec<f64> = order.iter().map(|&g| mean(g)).collect();
        order.sort_by(|&a, &b| times[a].total_cmp(&times[b]));
    }
    order
}
