//! Steps of a model that grows effect by effect.

use crate::score::HeldOut;

/// Effects of a model, and its error on groups left out.
#[derive(Debug, Clone)]
pub struct Step {
    /// The effects beside the baseline.
    pub effects: Vec<String>,
    /// Rms per component, weighted by the noise of the last model of the ladder, without that model's outliers.
    pub heldout_rms: f64,
    /// The same without weights.
    pub heldout_rms_unweighted: f64,
}

impl Step {
    pub(crate) fn new(effects: Vec<String>, held_out: &HeldOut) -> Self {
        Self { effects, heldout_rms: held_out.rms, heldout_rms_unweighted: held_out.rms_unweighted }
    }
}
