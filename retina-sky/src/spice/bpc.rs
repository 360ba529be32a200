//! Binary PCK kernels: Euler angles of axes as Chebyshev series (NAIF, PCK Required Reading, types 2 and 3).

use std::f64::consts::FRAC_PI_2;
use std::path::Path;

use glam::DQuat;
use retina_files::InputError;

use super::daf::{Kind, damaged, summaries};
use crate::ephemeris::records::Layout;

pub(super) const PCK_KIND: Kind = Kind { identity: b"DAF/PCK ", name: "binary PCK", integers: 5 };
/// The inertial axes from which the angles may be counted: NAIF's numbers.
pub(super) const J2000: i32 = 1;
pub(super) const ECLIPJ2000: i32 = 17;

/// The turning of one set of axes over a span of time.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct AxesSegment {
    /// NAIF's number of the axes: the class id of a frame of class 2.
    pub(super) axes: i32,
    /// The axes that the angles start from: [`J2000`] or [`ECLIPJ2000`].
    reference: i32,
    /// Epochs that it covers, TDB seconds since J2000.
    pub(super) span_s: [f64; 2],
    /// The file's index.
    pub(super) file: usize,
    components: usize,
    layout: Layout,
    words: Vec<f64>,
}

/// The segments of a binary PCK kernel.
///
/// # Errors
/// The file is damaged, or a segment is of a kind that is not read.
pub(super) fn segments(path: &Path, bytes: &[u8], file: usize) -> Result<Vec<AxesSegment>, InputError> {
    let mut found = Vec::new();
    for summary in summaries(path, bytes, PCK_KIND)? {
        let [axes, reference, kind, _] = summary.integers;
        let place = format!("segment of axes {axes}");
        let unread = |what: &str, found: String, expected: &str| {
            InputError::new(path, format!("the {what} of a segment is not read"))
                .at(place.clone())
                .found(found)
                .expected(expected)
        };
        if ![J2000, ECLIPJ2000].contains(&reference) {
            let expected = "1 (J2000) or 17 (ECLIPJ2000)";
            return Err(unread("reference frame", format!("frame {reference}"), expected));
        }
        let components = match kind {
            2 => 3,
            3 => 6,
            _ => return Err(unread("type", format!("type {kind}"), "type 2 or 3")),
        };
        let words = summary.numbers(path, bytes, &place)?;
        let layout =
            Layout::of(components, summary.span_s, &words).map_err(|flaw| damaged(path, flaw).at(place))?;
        found.push(AxesSegment { axes, reference, span_s: summary.span_s, file, components, layout, words });
    }
    Ok(found)
}

impl AxesSegment {
    /// Whether it covers an epoch.
    pub(super) fn covers(&self, tdb_s: f64) -> bool {
        (self.span_s[0]..=self.span_s[1]).contains(&tdb_s)
    }

    /// The rotation from ICRF axes at an epoch that the segment covers: `[w]_3 [delta]_1 [phi]_3` of its reference.
    pub(super) fn axes_from_inertial(&self, tdb_s: f64) -> DQuat {
        let Layout { first_s, length_s, size, count } = self.layout;
        let record = (((tdb_s - first_s) / length_s).max(0.0) as usize).min(count - 1);
        let record = &self.words[record * size..(record + 1) * size];
        let x = (tdb_s - record[0]) / record[1];
        let each = (size - 2) / self.components;
        let mut series = record[2..].chunks_exact(each).map(|series| chebyshev(series, x));
        let [phi, delta, w] = std::array::from_fn(|_| series.next().unwrap_or(0.0));
        // Turning the axes by an angle turns the coordinates back by it: hence the minus signs.
        let axes_from_reference =
            DQuat::from_rotation_z(-w) * DQuat::from_rotation_x(-delta) * DQuat::from_rotation_z(-phi);
        axes_from_reference * reference_from_inertial(self.reference)
    }
}

/// Axes of J2000 or of its ecliptic, from those of ICRF.
pub(super) fn reference_from_inertial(reference: i32) -> DQuat {
    /// Obliquity of SPICE's ECLIPJ2000, rad: IAU 1976, 84381.448 arcsec.
    const ECLIPJ2000_RAD: f64 = 84_381.448 / 648_000.0 * 2.0 * FRAC_PI_2;
    if reference == ECLIPJ2000 { DQuat::from_rotation_x(-ECLIPJ2000_RAD) } else { DQuat::IDENTITY }
}

/// A Chebyshev series at x (Clenshaw's recurrence).
fn chebyshev(series: &[f64], x: f64) -> f64 {
    let (mut last, mut before) = (0.0, 0.0);
    for coefficient in series[1..].iter().rev() {
        (last, before) = (coefficient + 2.0 * x * last - before, last);
    }
    series[0] + x * last - before
}
