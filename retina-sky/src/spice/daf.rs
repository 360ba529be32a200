//! The frame of a binary kernel, a Double precision Array File: which segments it holds, and that it holds them whole.
//!
//! Layout: NAIF, DAF Required Reading. SPK and binary PCK kernels have summaries of 40 bytes each.

use std::path::Path;

use retina_files::InputError;

/// Bytes of a record.
const RECORD_BYTES: usize = 1024;
/// Bytes of a segment's summary: two doubles, and five or six integers that fill three more.
const SUMMARY_BYTES: usize = 40;
/// Before a summary record's summaries: next record, previous one, and how many summaries.
const SUMMARIES_AT: usize = 24;

/// A kind of binary kernel.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Kind {
    /// The first eight bytes.
    pub(crate) identity: &'static [u8; 8],
    /// `SPK` or `binary PCK`.
    pub(crate) name: &'static str,
    /// Integers of a summary.
    pub(crate) integers: usize,
}

/// What a segment's summary says.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Summary {
    /// Epochs that it covers, TDB seconds since J2000.
    pub(crate) span_s: [f64; 2],
    /// Its integers, without the addresses of its words.
    pub(crate) integers: [i32; 4],
    /// Its first and last word, from 1.
    pub(crate) words: [usize; 2],
}

impl Summary {
    /// The segment's words, all of them numbers.
    ///
    /// # Errors
    /// One is none; `what` names the segment.
    pub(crate) fn numbers(&self, path: &Path, bytes: &[u8], what: &str) -> Result<Vec<f64>, InputError> {
        let [first, last] = self.words;
        let own = &bytes[(first - 1) * 8..last * 8];
        let words: Vec<f64> =
            own.chunks_exact(8).map(|word| word.try_into().map_or(f64::NAN, f64::from_le_bytes)).collect();
        match words.iter().position(|word| !word.is_finite()) {
            Some(word) => {
                Err(damaged(path, "what is no number").at(format!("{what}, word {}", first + word)))
            }
            None => Ok(words),
        }
    }
}

/// An error about bytes that cannot be.
pub(crate) fn damaged(path: &Path, what: impl Into<String>) -> InputError {
    InputError::new(path, "the kernel is damaged").found(what.into()).help("fetch the file again")
}

/// The summaries of a kernel, once the file is known to hold their segments whole.
///
/// # Errors
/// The bytes are no little-endian kernel of this kind, or are cut short.
pub(crate) fn summaries(path: &Path, bytes: &[u8], kind: Kind) -> Result<Vec<Summary>, InputError> {
    check_length(path, bytes.len(), RECORD_BYTES)?;
    let order = &bytes[88..96];
    if order != b"LTL-IEEE" {
        return Err(InputError::new(path, "the kernel's byte order is not read")
            .found(format!("`{}`", order.escape_ascii()))
            .expected("`LTL-IEEE`")
            .help("NAIF's program `bingo` converts it"));
    }
    let integer = |at: usize| i32::from_le_bytes(std::array::from_fn(|i| bytes[at + i]));
    let double = |at: usize| f64::from_le_bytes(std::array::from_fn(|i| bytes[at + i]));
    if [integer(8), integer(12)] != [2, kind.integers as i32] {
        return Err(damaged(
            path,
            format!("summaries of {} doubles and {} integers", integer(8), integer(12)),
        )
        .expected(format!("2 and {}, as {} kernels have", kind.integers, kind.name)));
    }
    let mut found = Vec::new();
    // A file cannot hold more summary records than records: a chain that goes on is a ring.
    let mut record = usize::try_from(integer(76)).unwrap_or(0);
    for _ in 0..=bytes.len() / RECORD_BYTES {
        if record == 0 {
            return if found.is_empty() {
                Err(damaged(path, "no segment").expected("one segment at least"))
            } else {
                Ok(found)
            };
        }
        let start = (record - 1).saturating_mul(RECORD_BYTES);
        check_length(path, bytes.len(), start.saturating_add(RECORD_BYTES))?;
        let count = double(start + 16);
        if !(0.0..=((RECORD_BYTES - SUMMARIES_AT) / SUMMARY_BYTES) as f64).contains(&count) {
            return Err(damaged(path, format!("{count} summaries in record {record}")));
        }
        for summary in 0..count as usize {
            let at = start + SUMMARIES_AT + summary * SUMMARY_BYTES;
            let span_s = [double(at), double(at + 8)];
            let described = kind.integers - 2;
            let integers = std::array::from_fn(|i| if i < described { integer(at + 16 + 4 * i) } else { 0 });
            let [first, last] = [0, 1].map(|i| integer(at + 16 + 4 * (described + i)));
            let spans = span_s.iter().all(|epoch_s| epoch_s.is_finite()) && span_s[0] <= span_s[1];
            if !spans || first < 1 || last < first {
                return Err(damaged(
                    path,
                    format!(
                        "segment {} of {} from {} to {} s, words {first} to {last}",
                        found.len() + 1,
                        integers[0],
                        span_s[0],
                        span_s[1]
                    ),
                ));
            }
            check_length(path, bytes.len(), (last as usize).saturating_mul(8))?;
            found.push(Summary { span_s, integers, words: [first as usize, last as usize] });
        }
        record = double(start) as usize;
    }
    Err(damaged(path, "summary records in a ring"))
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
