//! Attitudes by CK kernels at an epoch: their segments, and the clocks that they are counted in.

use std::collections::{BTreeMap, BTreeSet};

use glam::DQuat;
use retina_files::InputError;

use super::ck::AttitudeSegment;
use super::clock::{Clock, clock};
use super::text::Pool;
use crate::ephemeris::KernelFile;
use crate::time::format_epoch_tdb;

/// An attitude that a kernel states at instants alone holds so long before and after, s.
const TOLERANCE_S: f64 = 1.0;

/// All attitudes of CK kernels.
#[derive(Debug, Clone, Default)]
pub(super) struct Attitudes {
    segments: Vec<AttitudeSegment>,
    /// By NAIF's number of the instrument; of those whose clock a kernel has.
    clocks: BTreeMap<i32, Clock>,
}

impl Attitudes {
    pub(super) fn extend(&mut self, segments: Vec<AttitudeSegment>) {
        self.segments.extend(segments);
    }

    /// Finds the clocks, once all text kernels are read: `CK_nnn_SCLK` names an instrument's, otherwise it is the one of
    /// the instrument's number over 1000 (NAIF, CK Required Reading).
    ///
    /// # Errors
    /// A clock's kernel does not read.
    pub(super) fn find_clocks(&mut self, pool: &Pool) -> Result<(), InputError> {
        for instrument in self.instruments() {
            let named = pool.integer(&format!("CK_{instrument}_SCLK"))?;
            if let Some(found) = clock(pool, named.unwrap_or(instrument / 1000))? {
                self.clocks.insert(instrument, found);
            }
        }
        Ok(())
    }

    /// The instruments that have attitudes.
    pub(super) fn instruments(&self) -> BTreeSet<i32> {
        self.segments.iter().map(|segment| segment.instrument).collect()
    }

    /// The files that have attitudes of an instrument.
    pub(super) fn files(&self, instrument: i32) -> BTreeSet<usize> {
        self.of(instrument).map(|segment| segment.file).collect()
    }

    fn of(&self, instrument: i32) -> impl DoubleEndedIterator<Item = &AttitudeSegment> {
        self.segments.iter().filter(move |segment| segment.instrument == instrument)
    }

    /// The rotation from a reference frame's axes to an instrument's, and that frame's number; where several segments
    /// have it, the last one counts.
    ///
    /// # Errors
    /// There is none at this epoch: says why.
    pub(super) fn at(
        &self,
        instrument: i32,
        tdb_s: f64,
        files: &[KernelFile],
    ) -> Result<(i32, DQuat), String> {
        if self.of(instrument).next().is_none() {
            return Err(format!(
                "no CK kernel has attitudes of {instrument}; name the one (.bc) that has them"
            ));
        }
        let Some(clock) = self.clocks.get(&instrument) else {
            return Err(format!(
                "no kernel has the clock of {instrument}; name the spacecraft's clock kernel (.tsc) too"
            ));
        };
        let ticks = clock.ticks(tdb_s);
        let tolerance_ticks = TOLERANCE_S * clock.ticks_a_second();
        let found = self.of(instrument).rev().find_map(|segment| {
            Some((segment.reference, segment.axes_from_reference(ticks, tolerance_ticks)?))
        });
        found.ok_or_else(|| {
            let names: Vec<String> =
                self.files(instrument).into_iter().map(|file| files[file].name()).collect();
            let [first, last] = [
                self.of(instrument).map(|own| own.span_ticks[0]).fold(f64::INFINITY, f64::min),
                self.of(instrument).map(|own| own.span_ticks[1]).fold(f64::NEG_INFINITY, f64::max),
            ]
            .map(|ticks| format_epoch_tdb(clock.tdb_s(ticks)));
            let around: Vec<[Option<f64>; 2]> = self.of(instrument).map(|own| own.around(ticks)).collect();
            let before = around.iter().filter_map(|[before, _]| *before).reduce(f64::max);
            let after = around.iter().filter_map(|[_, after]| *after).reduce(f64::min);
            let gaps = match [before, after].map(|end| end.map(|ticks| format_epoch_tdb(clock.tdb_s(ticks))))
            {
                [Some(before), Some(after)] => format!(", with a gap from {before} to {after}"),
                _ => String::new(),
            };
            format!("{} has attitudes of {instrument} from {first} to {last}{gaps}", names.join(", "))
        })
    }
}
