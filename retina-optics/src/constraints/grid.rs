//! The field range over a grid of focal lengths (paper, Fig. 2).

use serde::Serialize;

use super::{BenchLimits, FieldRange, PaperModel};

/// The fields that a facility is to serve, full diagonal angles.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FieldRequirement {
    /// Smallest, deg.
    pub min_deg: f64,
    /// Largest, deg.
    pub max_deg: f64,
}

impl FieldRequirement {
    /// The paper's operational range.
    pub const PAPER: Self = Self { min_deg: 4.0, max_deg: 22.0 };

    /// Whether a range holds the smallest and the largest field, in this order.
    pub fn met_by(&self, range: Option<FieldRange>) -> [bool; 2] {
        range.map_or([false; 2], |range| {
            [range.min_rad.to_degrees() <= self.min_deg, range.max_rad.to_degrees() >= self.max_deg]
        })
    }
}

/// Field ranges over focal lengths.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FieldGrid {
    /// f_c of the columns, mm, at equal steps.
    pub collimator_focal_mm: Vec<f64>,
    /// f_r of the rows, mm, at equal steps.
    pub relay_focal_mm: Vec<f64>,
    /// Row by row; `None` where no field is within the limits.
    pub ranges: Vec<Option<FieldRange>>,
}

/// `count` values at equal steps from `from` to `to`, both included; `from` alone for a count of 1.
fn steps([from, to]: [f64; 2], count: usize) -> Vec<f64> {
    (0..count).map(|i| from + (to - from) * i as f64 / (count.max(2) - 1) as f64).collect()
}

/// Field ranges for f_c and f_r (mm, first and last value) on `count` x `count` points. `model` turns
/// a pair into the bench's model, so that s_cam may follow f_c.
pub fn field_grid(
    collimator_focal_mm: [f64; 2],
    relay_focal_mm: [f64; 2],
    count: usize,
    bench: &BenchLimits,
    model: impl Fn(f64, f64) -> PaperModel,
) -> FieldGrid {
    let (columns, rows) = (steps(collimator_focal_mm, count), steps(relay_focal_mm, count));
    let ranges = rows
        .iter()
        .flat_map(|&f_r| columns.iter().map(move |&f_c| (f_c, f_r)))
        .map(|(f_c, f_r)| model(f_c, f_r).field_range(bench));
    FieldGrid { ranges: ranges.collect(), collimator_focal_mm: columns, relay_focal_mm: rows }
}
