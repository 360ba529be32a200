//! Phase functions f(phase) that multiply a law, f(0) = 1.
//!
//! A phase function is one Rust file here and one WGSL file beside it, registered in this file.

mod constant;
mod exponential;
mod henyey_greenstein;
mod magnitudes;

pub use constant::Constant;
pub use exponential::Exponential;
pub use henyey_greenstein::HenyeyGreenstein;
pub use magnitudes::Magnitudes;

use crate::registry::register;
use crate::{Definition, PHASE_PARAMETERS};

/// What a phase function has besides its keys.
pub trait PhaseCurve: Definition {
    /// f(phase), f(0) = 1.
    fn value(&self, phase_rad: f64) -> f64;

    /// What the WGSL function reads from the body's `phase_parameters`.
    fn shader_parameters(&self) -> [f32; PHASE_PARAMETERS];
}

register! {
    /// A phase function f(phase) that multiplies the law, f(0) = 1.
    PhaseFunction, functions "phase" {
        /// f = 1.
        "constant" => constant::Constant,
        /// f = exp(-phase / scale).
        "exponential" => exponential::Exponential,
        /// Henyey and Greenstein (1941).
        "henyey-greenstein" => henyey_greenstein::HenyeyGreenstein,
        /// A phase curve in magnitudes.
        "magnitudes" => magnitudes::Magnitudes,
    }
}

impl PhaseFunction {
    /// f = 1.
    pub const CONSTANT: Self = Self::Constant(Constant);

    /// f(phase).
    pub fn value(&self, phase_rad: f64) -> f64 {
        each!(self, function => function.value(phase_rad))
    }

    /// What the WGSL function reads from the body's `phase_parameters`.
    pub fn shader_parameters(&self) -> [f32; PHASE_PARAMETERS] {
        each!(self, function => function.shader_parameters())
    }
}
