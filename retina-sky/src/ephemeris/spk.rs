//! Which segments an SPK kernel holds, and that they can be evaluated.
//!
//! Evaluating a segment is anise's work; what a wrong or damaged file gets to read is said here, before
//! any epoch is asked for. Layout: NAIF, SPK Required Reading.

use std::path::Path;

use retina_files::InputError;

use super::kernels::{body_name, is_used};
use super::records::flaw;
use crate::spice::daf::{Kind, damaged, summaries};

/// NAIF's number of the axes of J2000, along which the DE ephemerides are.
const FRAME_J2000: i32 = 1;
/// The types of segment that anise evaluates.
const SEGMENT_TYPES: [i32; 7] = [1, 2, 3, 8, 9, 12, 13];
pub(crate) const SPK_KIND: Kind = Kind { identity: b"DAF/SPK ", name: "SPK", integers: 6 };

/// What a segment of a kernel gives.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Segment {
    /// Whose place: NAIF's number of the body.
    pub(super) target: i32,
    /// Epochs that it covers, TDB seconds since J2000.
    pub(super) span_s: [f64; 2],
    /// Why it cannot be evaluated; never of bodies that every scene needs, whose kernel is refused instead.
    pub(super) unread: Option<String>,
}

/// The segments of a kernel, once the file is known to hold them whole.
///
/// # Errors
/// The bytes are no little-endian SPK kernel, are cut short, or place a body along axes, or by a type of segment,
/// that is not read.
pub(super) fn segments(path: &Path, bytes: &[u8]) -> Result<Vec<Segment>, InputError> {
    let mut found = Vec::new();
    for summary in summaries(path, bytes, SPK_KIND)? {
        let [target, _, frame, kind] = summary.integers;
        let readable = check_segment(path, target, frame, kind).and_then(|()| {
            // Whatever evaluates the words trusts them.
            let segment = format!("segment of {}", body_name(target));
            let words = summary.numbers(path, bytes, &segment)?;
            match flaw(kind, summary.span_s, &words) {
                Some(flaw) => Err(damaged(path, flaw).at(segment)),
                None => Ok(()),
            }
        });
        let unread = match readable {
            Err(error) if is_used(target) => return Err(error),
            readable => readable.err().map(|error| error.to_string()),
        };
        found.push(Segment { target, span_s: summary.span_s, unread });
    }
    Ok(found)
}

/// The bodies that a kernel has, with the epochs of each of their segments.
///
/// # Errors
/// As [`segments`].
pub(crate) fn spans(path: &Path, bytes: &[u8]) -> Result<Vec<(String, [f64; 2])>, InputError> {
    let own = segments(path, bytes)?;
    Ok(own.into_iter().map(|segment| (body_name(segment.target), segment.span_s)).collect())
}

fn check_segment(path: &Path, target: i32, frame: i32, kind: i32) -> Result<(), InputError> {
    let place = format!("segment of {}", body_name(target));
    if frame != FRAME_J2000 {
        return Err(InputError::new(path, "the axes of a segment are not read")
            .at(place)
            .found(format!("frame {frame}"))
            .expected(format!("frame {FRAME_J2000}, J2000")));
    }
    if !SEGMENT_TYPES.contains(&kind) {
        return Err(InputError::new(path, "the type of a segment is not read")
            .at(place)
            .found(format!("type {kind}"))
            .expected(format!("one of {}", SEGMENT_TYPES.map(|kind| kind.to_string()).join(", "))));
    }
    Ok(())
}
