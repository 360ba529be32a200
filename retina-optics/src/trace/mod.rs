//! The exact trace: f64, sequential, scalar and in blocks, by the same arithmetic.
//!
//! [`Tracer::new`] compiles a system for one wavelength into elements: the step from one
//! surface's axes to the next, the figure, the two indices and the clear ring.
//! [`Tracer::trace`] follows one ray and reports every intersection; [`Tracer::trace_batch`]
//! follows many (structure of arrays, AVX-512 or AVX2 where the processor has it). Both call the
//! same inlined arithmetic (`step`), without fused multiply-add, so that their results are equal
//! bit by bit on every processor.

mod batch;
mod compile;
mod step;

use glam::DVec3;

pub use batch::RayBatch;
pub(crate) use compile::indices_behind;
pub use compile::{Clipping, Tracer};
pub(crate) use step::MAX_ASPHERIC_TERMS;

/// A ray in air before the first surface, in the system's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// A point on it, mm.
    pub position_mm: DVec3,
    /// Unit vector along the light.
    pub direction: DVec3,
    /// Optical path accumulated up to `position_mm`, mm.
    pub path_mm: f64,
}

/// A ray where it meets a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Crossing {
    /// The surface, index from 0.
    pub surface: usize,
    /// The point in the surface's own axes (vertex at the origin), mm.
    pub local_mm: DVec3,
    /// The point in the system's frame, mm.
    pub position_mm: DVec3,
    /// Direction cosines behind the surface, in the system's frame.
    pub direction: DVec3,
    /// Direction cosines behind the surface, in the surface's own axes.
    pub local_direction: DVec3,
    /// Cosine of the angle of incidence.
    pub incidence_cos: f64,
    /// Optical path up to here, mm.
    pub path_mm: f64,
}

/// Why a ray did not arrive.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum RayFailure {
    /// It passes the surface by.
    #[error("the ray misses surface {}", surface + 1)]
    Missed {
        /// Index from 0.
        surface: usize,
    },
    /// It meets the surface outside its clear aperture.
    #[error("the ray is stopped by the aperture of surface {}", surface + 1)]
    Vignetted {
        /// Index from 0.
        surface: usize,
    },
    /// It is reflected totally.
    #[error("total internal reflection at surface {}", surface + 1)]
    TotalReflection {
        /// Index from 0.
        surface: usize,
    },
}

impl RayFailure {
    /// The surface at which it happened, index from 0.
    pub fn surface(&self) -> usize {
        match *self {
            Self::Missed { surface } | Self::Vignetted { surface } | Self::TotalReflection { surface } => {
                surface
            }
        }
    }
}
