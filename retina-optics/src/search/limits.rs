//! What rules candidates out, and how many.

use serde::{Deserialize, Serialize};

/// A limit that a candidate exceeds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Limit {
    /// No gap within its bounds gives a group its focal length.
    FocalLength,
    /// A group has no room before the camera's pupil or the screen.
    Room,
    /// The beams fill a group's lenses by more than their clear part.
    LensRims,
    /// s_oc, screen to collimator, is too long.
    TotalLength,
    /// s_or, screen to relay, is too short.
    ScreenRelayDistance,
    /// s_rc, relay to collimator, is too short.
    InterLensDistance,
    /// The first lens would stand before the camera's pupil.
    PupilDistance,
    /// The relay's glass stands too near the screen.
    ScreenGap,
    /// A ray misses a lens or is totally reflected.
    RaysFail,
    /// Lenses cut too much of a field's beam.
    Vignetting,
}

impl Limit {
    /// As a part of a sentence.
    pub fn words(self) -> &'static str {
        match self {
            Self::FocalLength => "no gap within its bounds gives the focal length",
            Self::Room => "no room before the pupil or the screen",
            Self::LensRims => "beams wider than the lenses",
            Self::TotalLength => "too long from screen to collimator (--max-length-mm)",
            Self::ScreenRelayDistance => "screen and relay too near",
            Self::InterLensDistance => "relay and collimator too near",
            Self::PupilDistance => "the collimator before the camera's pupil (--s-cam-mm)",
            Self::ScreenGap => "the relay's glass too near the screen (--min-screen-gap-mm)",
            Self::RaysFail => "rays that miss a lens or are totally reflected",
            Self::Vignetting => "too much of a beam cut (--max-vignetted, --clear)",
        }
    }
}

/// How far a design is beyond a limit: mm, or a share of the beam for [`Limit::Vignetting`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Excess {
    /// The limit.
    pub limit: Limit,
    /// By how much it is exceeded.
    pub by: f64,
}

/// Candidates that a limit ruled out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Removed {
    /// The limit.
    pub limit: Limit,
    /// Candidates: groups for the first three limits, pairs of groups for the others.
    pub candidates: u64,
}

/// Adds to a limit's count.
pub(crate) fn count(removed: &mut Vec<Removed>, limit: Limit, candidates: u64) {
    match removed.binary_search_by_key(&limit, |entry| entry.limit) {
        Ok(place) => removed[place].candidates += candidates,
        Err(place) => removed.insert(place, Removed { limit, candidates }),
    }
}
