//! No phase function.

use crate::{Definition, Key, PHASE_PARAMETERS, PhaseCurve};

/// f = 1. No keys.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Constant;

impl Definition for Constant {
    const KEYS: &'static [Key] = &[];

    fn from_values(_: &[f64]) -> Self {
        Self
    }
}

impl PhaseCurve for Constant {
    fn value(&self, _: f64) -> f64 {
        1.0
    }

    fn shader_parameters(&self) -> [f32; PHASE_PARAMETERS] {
        [0.0; PHASE_PARAMETERS]
    }
}
