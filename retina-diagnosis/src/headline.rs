//! The first line of a diagnosis: what was found, with what else it may be, and whether something is left.

use crate::data::Dataset;
use crate::diagnose::Diagnosis;
use crate::verdict::Verdict;

/// What to do first where something is unknown: an effect of the catalogue that was found beside it may be a part of it.
pub(crate) fn investigate_first(result: &Diagnosis) -> Option<&'static str> {
    (result.verdict == Verdict::Unknown).then_some(match result.accepted.as_slice() {
        [] => "look for a formula of what is left: retina investigate with the same tables",
        _ => {
            "first look for a formula of what is left: retina investigate with the same tables. An effect that is found beside something unknown may be only what resembles it"
        }
    })
}

/// Amplitudes of ripples are told at the first wavelength from this on, px of the screen, and px of the image.
const WAVELENGTH_PX: f64 = 200.0;
const WAVELENGTH_OF_IMAGES_PX: f64 = 16.0;

/// One sentence.
pub fn headline(data: &Dataset, result: &Diagnosis) -> String {
    let found = found(result);
    let unit = data.kind.unit();
    match result.verdict {
        Verdict::Adequate => {
            let wavelength = if data.pixels().is_some() { WAVELENGTH_OF_IMAGES_PX } else { WAVELENGTH_PX };
            let seen = result
                .unexplained
                .visible
                .iter()
                .find(|seen| seen[0] >= wavelength && seen[1].is_finite())
                .map_or_else(String::new, |[wavelength, amplitude]| {
                    format!("; a ripple of {amplitude:.2} {unit} and {wavelength:.0} px would have been seen")
                });
            let weak = result.unexplained.weak.as_ref().map_or_else(String::new, |weak| {
                format!(
                    "; a fixed pattern in {} is there, {:.2} of the noise, too weak to count",
                    weak.covariates.join(", "),
                    weak.strength
                )
            });
            format!(
                "No effect and no structure beyond the noise of {:.3} {unit}{seen}{weak}",
                result.noise.floor()
            )
        }
        Verdict::Undecided => "Nothing was found, and these data cannot say that nothing is there".to_owned(),
        Verdict::Named | Verdict::Confounded => format!("{found}; nothing else is left beyond noise"),
        Verdict::Unknown => {
            let columns = result.unexplained.covariates.join(", ");
            let wide = result.unexplained.width_px.map_or_else(String::new, |width| {
                format!(" (neighbours within {width:.0} {} share it)", data.px_name())
            });
            let nothing = result.accepted.is_empty() && result.kept.is_empty();
            match (nothing, columns.is_empty()) {
                (true, true) => "Too many rows are outliers: the model does not describe them".to_owned(),
                (true, false) => {
                    format!("Errors depend on {columns}{wide}, and no effect of the catalogue explains it")
                }
                (false, true) => format!("{found}; and too many rows are outliers"),
                (false, false) => format!("{found}; something is left that depends on {columns}{wide}"),
            }
        }
    }
}

/// The accepted effects in words, each with its rivals.
fn found(result: &Diagnosis) -> String {
    let words = |id: &str| id.replace('_', " ");
    let each: Vec<String> = result
        .accepted
        .iter()
        .zip(&result.rivals)
        .zip(&result.physical)
        .map(|((own, rivals), physical)| {
            let called = physical.as_ref().and_then(|p| p.called);
            (called.map_or_else(|| words(own), str::to_owned), rivals)
        })
        .zip(&result.rival_columns)
        .map(|((own, rivals), column)| {
            let column = column.iter().map(|column| format!("something that follows {column}"));
            let others: Vec<String> = rivals.iter().map(|rival| words(rival)).chain(column).collect();
            if others.is_empty() { own } else { format!("{own} (or {})", others.join(", ")) }
        })
        .collect();
    let kept = result.kept.iter().map(|kept| format!("the kept formula {}", kept.name));
    let mut text = each.into_iter().chain(kept).collect::<Vec<_>>().join(" and ");
    if let Some(first) = text.get(..1).map(str::to_uppercase) {
        text.replace_range(..1, &first);
    }
    text
}
