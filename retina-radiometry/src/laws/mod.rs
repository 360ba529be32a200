//! Photometric laws: how I/F depends on incidence, emission and phase.
//!
//! A law is one Rust file here and one WGSL file beside it, registered in this file. The equations, their units and
//! their sources stand in the Rust files; the WGSL functions are their f32 twins.

mod akimov;
mod hapke;
mod lambert;
mod lommel_seeliger;
mod lunar_lambert;
mod minnaert;
mod oren_nayar;
mod rolo;

pub use akimov::Akimov;
pub use hapke::Hapke;
pub use lambert::Lambert;
pub use lommel_seeliger::LommelSeeliger;
pub use lunar_lambert::LunarLambert;
pub use minnaert::Minnaert;
pub use oren_nayar::OrenNayar;
pub use rolo::Rolo;

use crate::registry::register;
use crate::{Definition, Geometry, LAW_PARAMETERS};

/// What a law has besides its keys.
pub trait Reflectance: Definition {
    /// I/F of a surface element. `geometry.mu0` and `.mu` must be positive. I/F over mu0 stays as it is when light and
    /// observer change places.
    fn radiance_factor(&self, geometry: Geometry) -> f64;

    /// What the WGSL function reads from the body's `law_parameters`, four of them an entry.
    fn shader_parameters(&self) -> [f32; LAW_PARAMETERS];

    /// [a, b] where the law is I/F = a mu0 + b mu0 / (mu0 + mu) at a phase angle: Lambert's law and Lommel and
    /// Seeliger's, mixed. `None` where it has another form. With it a law costs some additions a sample.
    fn lambert_and_seeliger(&self, _phase_rad: f64) -> Option<[f64; 2]> {
        None
    }
}

register! {
    /// A photometric law. Its value at incidence = emission = phase = 0 is 1, except Hapke's and ROLO's.
    Law, functions "law" {
        /// mu0.
        "lambert" => lambert::Lambert,
        /// Lommel and Seeliger.
        "lommel-seeliger" => lommel_seeliger::LommelSeeliger,
        /// McEwen (1991, 1996).
        "lunar-lambert" => lunar_lambert::LunarLambert,
        /// Oren and Nayar (1994).
        "oren-nayar" => oren_nayar::OrenNayar,
        /// Hapke (2012).
        "hapke" => hapke::Hapke,
        /// Minnaert (1941).
        "minnaert" => minnaert::Minnaert,
        /// Akimov, in Shkuratov et al. (2011).
        "akimov" => akimov::Akimov,
        /// Buratti et al. (2011).
        "rolo" => rolo::Rolo,
    }
}

impl Law {
    /// I/F of a surface element. `geometry.mu0` and `.mu` must be positive.
    pub fn radiance_factor(&self, geometry: Geometry) -> f64 {
        each!(self, law => law.radiance_factor(geometry))
    }

    /// [a, b] where the law is I/F = a mu0 + b mu0 / (mu0 + mu) at a phase angle; `None` where it has another form.
    pub fn lambert_and_seeliger(&self, phase_rad: f64) -> Option<[f64; 2]> {
        each!(self, law => law.lambert_and_seeliger(phase_rad))
    }

    /// What the WGSL function reads from the body's `law_parameters`, four of them an entry.
    pub fn shader_parameters(&self) -> [f32; LAW_PARAMETERS] {
        each!(self, law => law.shader_parameters())
    }
}
