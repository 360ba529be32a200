//! Attitude from the stars of one image, lost in space.
//!
//! 1. [`StarCamera`]: detected points to lines of sight.
//! 2. Patterns of four points are looked up among the catalogue's by a code that does not depend on the scale, so that
//!    the focal length need not be known. A pattern that a further star confirms is a hypothesis.
//! 3. A hypothesis is verified as a whole: the catalogue is projected into the image, and the chance that a wrong one
//!    matches as many points, times the number of hypotheses that were looked at, must be below a bound.
//! 4. Attitude by Davenport's q-method ([`wahba`]), then with focal length and radial distortion by least squares.

mod attitude;
mod camera;
mod catalogue;
mod chance;
mod finish;
mod fit;
mod hypotheses;
mod patterns;
mod quads;
mod sky;
mod sky_index;
mod solution;
mod solver;
mod verify;

pub use attitude::{DirectionPair, wahba};
pub use camera::{StarCamera, StarPoint, unit};
pub use catalogue::{CatalogueOptions, SolverCatalogue};
pub use chance::log10_binomial_tail;
pub use fit::SkyFit;
pub use sky_index::SkyIndex;
pub use solution::{Refusal, StarMatch, StarSolution, ra_dec_roll_rad};
pub use solver::{ASPECT_STEP, DEFAULT_EPOCH_S, SolverOptions, StarSolver};
