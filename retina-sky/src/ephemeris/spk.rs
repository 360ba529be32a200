//! The frame of an SPK kernel: which segments it holds, and that it holds them whole.
//!
//! Evaluating a segment is anise's work; what a wrong or damaged file gets to read is said here, before
//! any epoch is asked for. Layout: NAIF, DAF Required Reading and SPK Required Reading.

use std::path::Path;

use retina_files::InputError;

use super::kernels::{body_name, is_used};
use super::records::flaw;

/// Bytes of a record of a Double precision Array File.
const RECORD_BYTES: usize = 1024;
/// Bytes of a segment's summary: two doubles, six integers.
const SUMMARY_BYTES: usize = 40;
/// Before a summary record's summaries: next record, previous one, and how many summaries.
const SUMMARIES_AT: usize = 24;
/// NAIF's number of the axes of J2000, along which the DE ephemerides are.
const FRAME_J2000: i32 = 1;
/// The types of segment that anise evaluates.
const SEGMENT_TYPES: [i32; 7] = [1, 2, 3, 8, 9, 12, 13];

/// What a segment of a kernel gives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Segment {
    /// Whose place: NAIF's number of the body.
    pub(super) target: i32,
    /// Epochs that it covers, TDB seconds since J2000.
    pub(super) span_s: [f64; 2],
}

/// The segments of a kernel, once the file is known to hold them whole.
///
/// # Errors
/// The bytes are no little-endian SPK kernel, are cut short, or place a body along axes, or by a type of segment,
/// that is not read.
pub(super) fn segments(path: &Path, bytes: &[u8]) -> Result<Vec<Segment>, InputError> {
    check_kind(path, bytes)?;
    let integer = |at: usize| i32::from_le_bytes(std::array::from_fn(|i| bytes[at + i]));
    let double = |at: usize| f64::from_le_bytes(std::array::from_fn(|i| bytes[at + i]));
    let damaged = |what: String| {
        InputError::new(path, "the kernel is damaged").found(what).help("fetch the file again")
    };
    if [integer(8), integer(12)] != [2, 6] {
        return Err(damaged(format!("summaries of {} doubles and {} integers", integer(8), integer(12)))
            .expected("2 and 6, as SPK kernels have"));
    }
    let mut found = Vec::new();
    // A file cannot hold more summary records than records: a chain that goes on is a ring.
    let mut record = usize::try_from(integer(76)).unwrap_or(0);
    for _ in 0..=bytes.len() / RECORD_BYTES {
        if record == 0 {
            return if found.is_empty() {
                Err(damaged("no segment".to_owned()).expected("one segment at least"))
            } else {
                Ok(found)
            };
        }
        let start = (record - 1).saturating_mul(RECORD_BYTES);
        check_length(path, bytes.len(), start.saturating_add(RECORD_BYTES))?;
        let count = double(start + 16);
        if !(0.0..=((RECORD_BYTES - SUMMARIES_AT) / SUMMARY_BYTES) as f64).contains(&count) {
            return Err(damaged(format!("{count} summaries in record {record}")));
        }
        for summary in 0..count as usize {
            let at = start + SUMMARIES_AT + summary * SUMMARY_BYTES;
            let span_s = [double(at), double(at + 8)];
            let [target, _, frame, kind, first, last] = std::array::from_fn(|i| integer(at + 16 + 4 * i));
            let spans = span_s.iter().all(|epoch_s| epoch_s.is_finite()) && span_s[0] <= span_s[1];
            if !spans || first < 1 || last < first {
                return Err(damaged(format!(
                    "a segment of {} from {} to {} s, words {first} to {last}",
                    body_name(target),
                    span_s[0],
                    span_s[1]
                )));
            }
            check_length(path, bytes.len(), (last as usize).saturating_mul(8))?;
            if is_used(target) {
                check_segment(path, target, frame, kind)?;
                // Whatever evaluates the words trusts them.
                let words = &bytes[(first as usize - 1) * 8..last as usize * 8];
                let words: Vec<f64> = words.chunks_exact(8).map(double_of).collect();
                let segment = format!("segment of {}", body_name(target));
                if let Some(word) = words.iter().position(|word| !word.is_finite()) {
                    let place = format!("{segment}, word {}", first as usize + word);
                    return Err(damaged("what is no number".to_owned()).at(place));
                }
                if let Some(flaw) = flaw(kind, span_s, &words) {
                    return Err(damaged(flaw).at(segment));
                }
            }
            found.push(Segment { target, span_s });
        }
        record = double(start) as usize;
    }
    Err(damaged("summary records in a ring".to_owned()))
}

/// A little-endian double.
fn double_of(word: &[u8]) -> f64 {
    word.try_into().map_or(f64::NAN, f64::from_le_bytes)
}

/// What the file's first record says that it is.
fn check_kind(path: &Path, bytes: &[u8]) -> Result<(), InputError> {
    let begins = bytes.get(..8).unwrap_or(bytes);
    if begins == b"DAF/SPK " {
        check_length(path, bytes.len(), RECORD_BYTES)?;
    } else {
        let error = InputError::new(path, "is no SPK kernel")
            .found(format!("{} bytes that begin with `{}`", bytes.len(), begins.escape_ascii()))
            .expected("a binary kernel, which begins with `DAF/SPK `");
        return Err(if begins.starts_with(b"DAFETF") {
            error.help("this is a transfer file: NAIF's program `tobin` makes a binary kernel of it")
        } else {
            error.help("give a planetary ephemeris such as de440s.bsp, as JPL publishes it")
        });
    }
    let order = &bytes[88..96];
    if order != b"LTL-IEEE" {
        return Err(InputError::new(path, "the kernel's byte order is not read")
            .found(format!("`{}`", order.escape_ascii()))
            .expected("`LTL-IEEE`")
            .help("NAIF's program `bingo` converts it"));
    }
    Ok(())
}

fn check_length(path: &Path, found: usize, needed: usize) -> Result<(), InputError> {
    if needed <= found {
        return Ok(());
    }
    Err(InputError::new(path, "the kernel is cut short")
        .found(format!("{found} bytes"))
        .expected(format!("{needed} bytes at least"))
        .help("fetch the file again"))
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
