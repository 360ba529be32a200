//! What a sequence says of a detector.

use serde::Serialize;

use super::rates::{Logistic, RateBin, Trial, fit_logistic, rate_bins};
use super::sequence::{FlashFrame, FlashOutcome};

/// Rates and errors of a sequence.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FlashSummary {
    /// Frames.
    pub frames: usize,
    /// Pixels of the night side that are looked at, mean over the frames.
    pub watched_px: f64,
    /// Flashes of the truth.
    pub flashes: usize,
    /// Of those, hidden by relief or behind a body.
    pub hidden: usize,
    /// Of the others, outside of where flashes are looked for: the margins, the day side.
    pub outside: usize,
    /// The rest, by which rates are formed.
    pub watched: usize,
    /// Of those, found.
    pub found: usize,
    /// Rate against magnitude (mean over the exposure).
    pub rates: Vec<RateBin>,
    /// A curve through them; `None` where all or none are found.
    pub logistic: Option<Logistic>,
    /// Candidates that are no flash.
    pub false_detections: usize,
    /// In a frame.
    pub false_per_frame: f64,
    /// As the threshold has it for normal noise.
    pub expected_false_per_frame: f64,
    /// Mean and standard deviation of measured less true magnitude.
    pub magnitude_error: Option<[f64; 2]>,
    /// Mean square of the same over its standard deviation: 1 where that is right.
    pub magnitude_chi2: Option<f64>,
    /// Root mean square of the place in the image, px an axis.
    pub rms_px: Option<f64>,
    /// 50, 68 and 95 % of the places on the surface are nearer, m.
    pub place_percentiles_m: Option<[f64; 3]>,
}

fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// The flashes by which rates are formed: visible, and where they are looked for.
pub fn trials(frames: &[FlashFrame]) -> Vec<Trial> {
    watched(frames).map(|(_, flash)| (flash.magnitude, flash.candidate.is_some())).collect()
}

fn watched(frames: &[FlashFrame]) -> impl Iterator<Item = (&FlashFrame, &FlashOutcome)> {
    let all = frames.iter().flat_map(|frame| frame.flashes.iter().map(move |flash| (frame, flash)));
    all.filter(|(_, flash)| flash.watched && !flash.hidden)
}

/// Summarises a sequence; rates in bins of `bin_magnitudes`, the threshold having been set for so many false detections.
pub fn summarise(frames: &[FlashFrame], bin_magnitudes: f64, false_alarms_per_frame: f64) -> FlashSummary {
    let trials = trials(frames);
    let flashes = || frames.iter().flat_map(|frame| &frame.flashes);
    let false_detections: usize = frames.iter().map(|frame| frame.false_candidates.len()).sum();
    let count = frames.len().max(1) as f64;
    let errors: Vec<f64> = watched(frames).filter_map(|(_, flash)| flash.error_magnitude).collect();
    let relative: Vec<f64> = watched(frames)
        .filter_map(|(frame, flash)| {
            let sigma = frame.candidates.get(flash.candidate?)?.sigma_magnitude?;
            Some((flash.error_magnitude? / sigma).powi(2))
        })
        .collect();
    let squares: Vec<f64> =
        watched(frames).filter_map(|(_, flash)| flash.error_px.map(|[x, y]| 0.5 * (x * x + y * y))).collect();
    let mut places: Vec<f64> = watched(frames).filter_map(|(_, flash)| flash.error_m).collect();
    places.sort_by(f64::total_cmp);
    let percentile = |share: f64| places[((places.len() as f64 * share) as usize).min(places.len() - 1)];
    FlashSummary {
        frames: frames.len(),
        watched_px: frames.iter().map(|frame| frame.watched_px as f64).sum::<f64>() / count,
        flashes: flashes().count(),
        hidden: flashes().filter(|flash| flash.hidden).count(),
        outside: flashes().filter(|flash| !flash.hidden && !flash.watched).count(),
        watched: trials.len(),
        found: trials.iter().filter(|trial| trial.1).count(),
        rates: rate_bins(&trials, bin_magnitudes),
        logistic: fit_logistic(&trials),
        false_detections,
        false_per_frame: false_detections as f64 / count,
        expected_false_per_frame: false_alarms_per_frame,
        magnitude_error: mean(&errors).map(|centre| {
            let squares: Vec<f64> = errors.iter().map(|error| (error - centre).powi(2)).collect();
            [centre, mean(&squares).unwrap_or(0.0).sqrt()]
        }),
        magnitude_chi2: mean(&relative),
        rms_px: mean(&squares).map(f64::sqrt),
        place_percentiles_m: (!places.is_empty()).then(|| [0.5, 0.68, 0.95].map(percentile)),
    }
}
