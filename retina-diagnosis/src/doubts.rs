//! What the noise of a table says of the table itself, whatever the verdict.

use retina_formats::TableKind;

use crate::data::Dataset;
use crate::noise::Weights;
use crate::scatter::{Noise, group_name, stated};
use crate::units::VERY_FEW_GROUPS;

/// A stated figure and what rows scatter by may differ by this factor before it is told.
pub(crate) const OFF_STATED: f64 = 3.0;
/// So many times their rows' noise groups may differ as wholes before it is told.
const BEYOND_ROWS: f64 = 3.0;

/// Remarks about figures that a table states, and about groups that differ by far more than their rows scatter.
pub(crate) fn doubts(data: &Dataset, noise: &Noise, weights: &Weights) -> Vec<String> {
    let (white, unit) = (noise.white, data.kind.unit());
    let rows = row_name(data);
    let mut out = Vec::new();
    if let Some(stated) = stated(data, weights)
        && stated > 0.0
        && white > 0.0
        && !(1.0 / OFF_STATED..OFF_STATED).contains(&(white / stated))
    {
        let (factor, than) = match white > stated {
            true => (white / stated, "more"),
            false => (stated / white, "less"),
        };
        out.push(format!(
            "{rows} scatter by {white:.3} {unit}, {factor:.1} times {than} than the {stated:.3} {unit} that the table states: what was found counts here; look whether the stated figure has the right unit"
        ));
    }
    if data.jitters && data.groups.len() > VERY_FEW_GROUPS && noise.group > BEYOND_ROWS * white {
        let group = group_name(data);
        let groups = if group.ends_with('s') { group.to_owned() } else { format!("{group}s") };
        out.push(format!(
            "whole {groups} differ by {:.3} {unit}, {:.1} times what their {rows} scatter by: {}. The number of {groups} ({}), not that of {rows}, decides which effect of whole {groups} can be seen",
            noise.group,
            noise.group / white,
            match data.kind {
                TableKind::Points => "air or a mount that moves between them",
                _ => "light or a meter that changes between them",
            },
            data.groups.len()
        ));
    }
    out
}

fn row_name(data: &Dataset) -> &'static str {
    match data.kind {
        TableKind::Points => "points",
        TableKind::Power | TableKind::Phase => "readings",
        TableKind::Frames => "pixels",
    }
}
