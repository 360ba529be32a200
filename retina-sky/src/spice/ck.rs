//! CK kernels: attitudes of spacecraft and their instruments over the spacecraft's clock (NAIF, CK Required Reading, types
//! 1 to 3).
//!
//! A segment turns one set of axes, by NAIF's number of the instrument, from a reference frame. Its quaternions are
//! scalar first; `q v q*` gives the components along the instrument's axes of a vector in the reference frame.

use std::path::Path;

use glam::{DQuat, DVec3};
use retina_files::InputError;

use super::daf::{Kind, damaged, summaries};

pub(super) const CK_KIND: Kind = Kind { identity: b"DAF/CK  ", name: "CK", integers: 6 };

/// Numbers between two entries of a segment's directory.
const DIRECTORY_STEP: usize = 100;
/// Words of a record of constant angular velocity: quaternion, angular velocity, seconds a tick.
const STEADY_WORDS: usize = 8;
/// How far a quaternion's norm may be from 1.
const NORM_TOLERANCE: f64 = 1e-3;

/// What turns the axes within a segment.
#[derive(Debug, Clone, PartialEq)]
enum Turning {
    /// Type 1: an attitude at each instant, and none between them.
    Discrete,
    /// Type 2: constant angular velocities, rad/s along the reference frame's axes, and seconds a tick, up to these
    /// ticks.
    Steady { rates: Vec<(DVec3, f64)>, until_ticks: Vec<f64> },
    /// Type 3: turned evenly from each instant to the next, but not into an instant at which an interval begins.
    Linear { interval_starts_ticks: Vec<f64> },
}

/// The attitude of one set of axes over a span of a spacecraft's clock.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct AttitudeSegment {
    /// NAIF's number of the axes: the class id of a frame of class 3.
    pub(super) instrument: i32,
    /// NAIF's number of the frame that the attitude is counted from.
    pub(super) reference: i32,
    /// What it covers, ticks of the spacecraft's clock.
    pub(super) span_ticks: [f64; 2],
    /// The file's index.
    pub(super) file: usize,
    at_ticks: Vec<f64>,
    attitudes: Vec<DQuat>,
    turning: Turning,
}

/// The segments of a CK kernel.
///
/// # Errors
/// The file is damaged, or a segment is of a type that is not read.
pub(super) fn segments(path: &Path, bytes: &[u8], file: usize) -> Result<Vec<AttitudeSegment>, InputError> {
    let mut found = Vec::new();
    for summary in summaries(path, bytes, CK_KIND)? {
        let [instrument, reference, kind, has_rates] = summary.integers;
        let place = format!("segment of {instrument}");
        let words = summary.numbers(path, bytes, &place)?;
        let record = if has_rates == 0 { 4 } else { 7 };
        let read = match kind {
            1 => discrete(&words, record),
            2 => steady(&words),
            3 => linear(&words, record),
            _ => {
                return Err(InputError::new(path, "the type of a segment is not read")
                    .at(place)
                    .found(format!("type {kind}"))
                    .expected("type 1, 2 or 3")
                    .help("write the attitude into the trajectory's columns; SPICE's `pxform` says it"));
            }
        };
        let (at_ticks, attitudes, turning) =
            read.map_err(|flaw| damaged(path, flaw).at(format!("segment of {instrument}")))?;
        let span_ticks = summary.span_s;
        found.push(AttitudeSegment { instrument, reference, span_ticks, file, at_ticks, attitudes, turning });
    }
    Ok(found)
}

type Read = Result<(Vec<f64>, Vec<DQuat>, Turning), String>;

/// Entries of the directory of so many numbers.
fn directory(count: usize) -> usize {
    count.saturating_sub(1) / DIRECTORY_STEP
}

/// A count that a segment's word states.
fn count(word: Option<&f64>, most: usize) -> Result<usize, String> {
    match word {
        Some(&word) if word.fract() == 0.0 && word >= 1.0 && word <= most as f64 => Ok(word as usize),
        Some(word) => Err(format!("a count of {word}")),
        None => Err("no words".to_owned()),
    }
}

fn quaternion(words: &[f64]) -> Result<DQuat, String> {
    let own = DQuat::from_xyzw(words[1], words[2], words[3], words[0]);
    if (own.length() - 1.0).abs() > NORM_TOLERANCE {
        return Err(format!("a quaternion of norm {}", own.length()));
    }
    Ok(own.normalize())
}

fn rising(ticks: &[f64], what: &str) -> Result<(), String> {
    match ticks.windows(2).position(|pair| pair[1] <= pair[0]) {
        Some(at) => Err(format!("{what} {} at {} ticks after one at {}", at + 2, ticks[at + 1], ticks[at])),
        None => Ok(()),
    }
}

fn discrete(words: &[f64], record: usize) -> Read {
    let number = count(words.last(), words.len())?;
    if words.len() != number * (record + 1) + directory(number) + 1 {
        return Err(format!("{} words for {number} attitudes", words.len()));
    }
    let at_ticks = words[number * record..number * (record + 1)].to_vec();
    rising(&at_ticks, "instant")?;
    let attitudes =
        words[..number * record].chunks_exact(record).map(quaternion).collect::<Result<_, _>>()?;
    Ok((at_ticks, attitudes, Turning::Discrete))
}

fn steady(words: &[f64]) -> Read {
    // Ten words an interval, and one of the directory for each hundred but the last.
    let number = DIRECTORY_STEP * (words.len() + 1) / (DIRECTORY_STEP * (STEADY_WORDS + 2) + 1);
    if number == 0 || words.len() != number * (STEADY_WORDS + 2) + directory(number) {
        return Err(format!("{} words, which hold no whole number of intervals", words.len()));
    }
    let (records, times) = words.split_at(number * STEADY_WORDS);
    let (at_ticks, until_ticks) = (times[..number].to_vec(), times[number..2 * number].to_vec());
    rising(&at_ticks, "interval")?;
    if let Some(at) = (0..number).find(|&at| until_ticks[at] < at_ticks[at]) {
        return Err(format!("interval {} that ends before it begins", at + 1));
    }
    let records = records.chunks_exact(STEADY_WORDS);
    let attitudes = records.clone().map(quaternion).collect::<Result<_, _>>()?;
    let rates = records.map(|record| (DVec3::from_slice(&record[4..7]), record[7])).collect();
    Ok((at_ticks, attitudes, Turning::Steady { rates, until_ticks }))
}

fn linear(words: &[f64], record: usize) -> Read {
    let number = count(words.last(), words.len())?;
    let intervals = count(words.len().checked_sub(2).and_then(|at| words.get(at)), number)?;
    let needed = number * (record + 1) + directory(number) + intervals + directory(intervals) + 2;
    if words.len() != needed {
        return Err(format!("{} words for {number} attitudes in {intervals} intervals", words.len()));
    }
    let at_ticks = words[number * record..number * (record + 1)].to_vec();
    rising(&at_ticks, "instant")?;
    let starts_at = number * (record + 1) + directory(number);
    let interval_starts_ticks = words[starts_at..starts_at + intervals].to_vec();
    rising(&interval_starts_ticks, "interval")?;
    let attitudes =
        words[..number * record].chunks_exact(record).map(quaternion).collect::<Result<_, _>>()?;
    Ok((at_ticks, attitudes, Turning::Linear { interval_starts_ticks }))
}

impl AttitudeSegment {
    /// The ends of a gap at `ticks`: the last instant before that has an attitude, and the first after it.
    pub(super) fn around(&self, ticks: f64) -> [Option<f64>; 2] {
        let after = self.at_ticks.partition_point(|&own| own <= ticks);
        let before = after.checked_sub(1).map(|at| match &self.turning {
            Turning::Steady { until_ticks, .. } => until_ticks[at].min(ticks),
            _ => self.at_ticks[at],
        });
        [before, self.at_ticks.get(after).copied()]
    }

    /// The rotation from the reference frame's axes to the instrument's; `None` where the segment does not say it.
    /// Attitudes at instants alone hold within `tolerance_ticks` of them.
    pub(super) fn axes_from_reference(&self, ticks: f64, tolerance_ticks: f64) -> Option<DQuat> {
        let after = self.at_ticks.partition_point(|&own| own <= ticks);
        let off = |at: usize| (self.at_ticks[at] - ticks).abs();
        match &self.turning {
            Turning::Discrete => {
                let nearest = [after.checked_sub(1), Some(after)]
                    .into_iter()
                    .flatten()
                    .filter(|&at| at < self.at_ticks.len())
                    .min_by(|&a, &b| off(a).total_cmp(&off(b)))?;
                (off(nearest) <= tolerance_ticks).then(|| self.attitudes[nearest])
            }
            Turning::Steady { rates, until_ticks } => {
                let at = after.checked_sub(1).filter(|&at| ticks <= until_ticks[at])?;
                let (rate_rad_s, seconds_a_tick) = rates[at];
                let turn_rad = rate_rad_s * ((ticks - self.at_ticks[at]) * seconds_a_tick);
                // The axes turn along the reference frame's vector: a fixed vector turns back along them.
                Some(self.attitudes[at] * DQuat::from_scaled_axis(-turn_rad))
            }
            Turning::Linear { interval_starts_ticks } => {
                let at = after.checked_sub(1)?;
                if off(at) == 0.0 {
                    return Some(self.attitudes[at]);
                }
                let next = *self.at_ticks.get(after)?;
                let begins = interval_starts_ticks.binary_search_by(|own| own.total_cmp(&next)).is_ok();
                let share = (ticks - self.at_ticks[at]) / (next - self.at_ticks[at]);
                (!begins).then(|| turned_evenly(self.attitudes[at], self.attitudes[after], share))
            }
        }
    }
}

/// From one attitude towards another by a share of the shorter turn. glam's `slerp` is linear for small angles.
fn turned_evenly(from: DQuat, to: DQuat, share: f64) -> DQuat {
    let mut turn = to * from.inverse();
    if turn.w < 0.0 {
        turn = -turn;
    }
    let axis = DVec3::new(turn.x, turn.y, turn.z);
    let half_rad = axis.length().atan2(turn.w);
    match axis.try_normalize() {
        Some(axis) => (DQuat::from_axis_angle(axis, 2.0 * half_rad * share) * from).normalize(),
        None => from,
    }
}
