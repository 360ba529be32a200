//! What a segment's words say, looked at before they are trusted: a kernel whose bytes have changed is still a kernel.
//!
//! Layout of segments of types 2 and 3: NAIF, SPK Required Reading. Records [middle, half length, coefficients of each
//! component], all of one size and of one length in time; then the first epoch, that length, the size and the number of
//! records.

/// Farthest that anything of the Solar System is from what it goes round, km: some 70 times Neptune's distance.
const FARTHEST_KM: f64 = 3e11;
/// Rounding of epochs, as a part of a record's length.
const EPOCH_SHARE: f64 = 1e-6;
/// Gap between two records where they meet: metres in the DE ephemerides, this part of the distance and a kilometre at
/// most. A coefficient that has changed by more opens one at both ends of its record.
const GAP_SHARE: f64 = 1e-8;
const GAP_KM: f64 = 1.0;
/// A record's last coefficient over its largest beyond the constant one: a fit that ends there has not converged.
const LAST_SHARE: f64 = 1e-2;

/// Words after the records.
const DIRECTORY_WORDS: usize = 4;

/// How the records of a segment of equal lengths of time lie.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Layout {
    /// The first record's beginning, TDB seconds since J2000.
    pub(crate) first_s: f64,
    /// A record's length, s.
    pub(crate) length_s: f64,
    /// Words of a record.
    pub(crate) size: usize,
    /// How many there are.
    pub(crate) count: usize,
}

impl Layout {
    /// The layout of a segment's words, whose records hold series of so many components.
    ///
    /// # Errors
    /// Says what cannot be.
    pub(crate) fn of(components: usize, span_s: [f64; 2], words: &[f64]) -> Result<Self, String> {
        let Some((records, &[first_s, length_s, size, count])) = words
            .len()
            .checked_sub(DIRECTORY_WORDS)
            .map(|at| words.split_at(at))
            .and_then(|(records, rest)| Some((records, <&[f64; DIRECTORY_WORDS]>::try_from(rest).ok()?)))
        else {
            return Err(format!("{} words", words.len()));
        };
        let whole = |value: f64| value.fract() == 0.0 && value >= 1.0 && value <= words.len() as f64;
        let fits = whole(size) && whole(count) && size * count == records.len() as f64;
        let record_words = if fits { size as usize } else { 0 };
        if record_words < 2 + components || !(record_words - 2).is_multiple_of(components) {
            return Err(format!("{} words in {count} records of {size}", records.len()));
        }
        let slack_s = EPOCH_SHARE * length_s;
        let end_s = first_s + count * length_s;
        if !(length_s > 0.0 && span_s[0] >= first_s - slack_s && span_s[1] <= end_s + slack_s) {
            return Err(format!("records from {first_s} to {end_s} s for {} to {} s", span_s[0], span_s[1]));
        }
        for (index, record) in records.chunks_exact(record_words).enumerate() {
            let middle_s = first_s + (index as f64 + 0.5) * length_s;
            if (record[0] - middle_s).abs() > slack_s || (record[1] - 0.5 * length_s).abs() > slack_s {
                return Err(format!(
                    "record {} of {} s about {} s, expected {length_s} s about {middle_s} s",
                    index + 1,
                    2.0 * record[1],
                    record[0],
                ));
            }
        }
        Ok(Self { first_s, length_s, size: record_words, count: count as usize })
    }
}

/// Says what of a segment's words cannot be, if anything: `kind` is the type of segment, `span_s` what its summary says
/// that it covers.
pub(super) fn flaw(kind: i32, span_s: [f64; 2], words: &[f64]) -> Option<String> {
    if let Some(far) = words.iter().position(|word| word.abs() > FARTHEST_KM) {
        return Some(format!("the number {:e} at its word {}", words[far], far + 1));
    }
    let components = match kind {
        2 => 3,
        3 => 6,
        _ => return None,
    };
    let size = match Layout::of(components, span_s, words) {
        Ok(layout) => layout.size,
        Err(flaw) => return Some(flaw),
    };
    let records = &words[..words.len() - DIRECTORY_WORDS];
    let each = (size - 2) / components;
    let mut last: Option<[f64; 6]> = None;
    for (index, record) in records.chunks_exact(size).enumerate() {
        let (mut begins, mut ends) = ([0.0; 6], [0.0; 6]);
        for (component, series) in record[2..].chunks_exact(each).enumerate() {
            // Chebyshev polynomials are (-1)^k at -1 and 1 at 1.
            let sum = |sign: f64| series.iter().rev().fold(0.0, |sum, coefficient| coefficient + sign * sum);
            (begins[component], ends[component]) = (sum(-1.0), sum(1.0));
            let largest = series[1..].iter().fold(0.0f64, |most, c| most.max(c.abs()));
            if each > 3 && series[each - 1].abs() > LAST_SHARE * largest {
                return Some(format!("a last coefficient {:e} in record {}", series[each - 1], index + 1));
            }
        }
        // Velocities, the last three of type 3, are as continuous, in smaller numbers.
        let gap = |last: [f64; 6], at: usize| {
            let part = |values: [f64; 6]| glam::DVec3::new(values[at], values[at + 1], values[at + 2]);
            (part(last) - part(begins)).length() / (GAP_KM + GAP_SHARE * part(begins).length())
        };
        if let Some(last) = last
            && !(gap(last, 0) <= 1.0 && gap(last, 3) <= 1.0)
        {
            return Some(format!("a leap of the body between the records {index} and {}", index + 1));
        }
        last = Some(ends);
    }
    None
}
