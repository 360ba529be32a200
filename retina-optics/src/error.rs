//! What a computation can fail of. Input that does not fit is a `retina_files::InputError`.

use crate::glass::IndexError;
use crate::trace::RayFailure;

/// A computation that has no result.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum OpticsError {
    /// A medium has no index at the wavelength or temperature asked for.
    #[error(transparent)]
    Index(#[from] IndexError),
    /// A ray on which the result rests does not arrive.
    #[error("{what}: {failure}")]
    Ray {
        /// Which ray.
        what: String,
        /// What became of it.
        failure: RayFailure,
    },
    /// Too few rays of a field arrive.
    #[error("field {field}: none of the {rays} rays arrives, the first because: {failure}")]
    NoRays {
        /// The field, counted from 1.
        field: usize,
        /// Rays launched.
        rays: usize,
        /// Why the first one failed.
        failure: RayFailure,
    },
    /// Rays could not be aimed at the stop.
    #[error("rays cannot be aimed at the stop: {0}")]
    Aiming(String),
    /// The figure asked for does not exist for this system.
    #[error("{0}")]
    Undefined(String),
}
