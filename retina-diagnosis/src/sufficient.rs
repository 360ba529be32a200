//! Whether data that show nothing could have shown something.

use crate::data::{Dataset, Flip};
use crate::doubts::OFF_STATED;
use crate::next::NextMeasurement;
use crate::noise::Weights;
use crate::scatter::{Noise, group_name, stated};
use crate::units::{FEW_GROUPS, Units, VERY_FEW_GROUPS};

/// Fewer parts than this can be flipped in too few ways for any p-value to be small.
const FEWEST_UNITS: usize = 8;

/// Why nothing can be concluded from finding nothing, and what to measure instead; `None` where it can.
pub(crate) fn too_little(
    data: &Dataset,
    noise: &Noise,
    weights: &Weights,
) -> Option<(String, NextMeasurement)> {
    let groups = data.groups.len();
    let group = group_name(data);
    let repeat = NextMeasurement {
        action: "repeat",
        value: match data.components() {
            2 => "at least 8 exposures of the same points",
            _ => "at least 8 series or nights",
        },
        separates: Vec::new(),
        expected_sigma: None,
    };
    if Units::of(data).count < FEWEST_UNITS {
        let why = if noise.shared_within {
            format!(
                "neighbours of one {group} share {:.3} {} that those of different ones do not: with {groups} of them, air cannot be told from the facility",
                noise.group,
                data.kind.unit()
            )
        } else {
            format!("{} rows in {groups} group(s) are too few to show an effect", data.len())
        };
        return Some((why, repeat));
    }
    if data.jitters && groups <= VERY_FEW_GROUPS && noise.group > noise.white {
        let why = format!(
            "{group}s differ by {:.3} {unit}, more than their rows ({:.3}): {groups} of them do not tell {these}",
            noise.group,
            noise.white,
            these = match data.components() {
                2 => "a mount that moves from a knock or a drift",
                _ => "a meter that repeats badly from a display that changes",
            },
            group = group.trim_end_matches('s'),
            unit = data.kind.unit()
        );
        return Some((why, repeat));
    }
    if noise.structured > noise.floor() {
        let why = format!(
            "errors scatter by {:.3} {unit} beyond a noise of {:.3} {unit}, and nothing that was found says why: {groups} {group} are too few",
            noise.structured,
            noise.floor(),
            unit = data.kind.unit()
        );
        return Some((why, repeat));
    }
    if let Some(stated) = stated(data, weights)
        && noise.floor().hypot(noise.structured) > OFF_STATED * stated
    {
        return Some((
            format!(
                "errors scatter by {:.3} {unit}, and the table states {stated:.3} {unit}: either the stated figure is too small, or something varies that these rows do not show",
                noise.floor().hypot(noise.structured),
                unit = data.kind.unit()
            ),
            repeat,
        ));
    }
    None
}

/// What a cut into runs of rows supposes.
pub(crate) fn note_of_runs(data: &Dataset) -> Option<String> {
    (data.flip == Flip::Rows).then(|| {
        format!(
            "{} {} (fewer than {FEW_GROUPS}) were cut into {} runs of rows, whose signs were flipped: this supposes that rows of one {} share one common error and nothing else",
            data.groups.len(),
            if data.groups.len() == 1 { "group" } else { "groups" },
            Units::of(data).count,
            group_name(data)
        )
    })
}
