//! Attitude from the stars of one image, lost in space.
//!
//! 1. [`StarCamera`]: detected points to lines of sight.
//! 2. Triangles of bright points are looked up among the catalogue's pairs by their angles ([`PairTable`], Mortari's
//!    search-less k-vector), and a triangle that a further star confirms (the pyramid of Mortari, Samaan, Bruccoleri
//!    & Junkins 2004) is a hypothesis.
//! 3. A hypothesis is verified as a whole: the catalogue is projected into the image, and the chance that a wrong one
//!    matches as many points, times the number of hypotheses that were looked at, must be below a bound.
//! 4. Attitude by Davenport's q-method ([`wahba`]), then with focal length and radial distortion by least squares.

mod attitude;
mod camera;
mod catalogue;
mod chance;
mod fit;
mod hypotheses;
mod pairs;
mod pyramid;
mod sky_index;
mod solution;
mod solver;
mod verify;

pub use attitude::{DirectionPair, wahba};
pub use camera::{StarCamera, StarPoint, unit};
pub use catalogue::{CatalogueOptions, Entry, SolverCatalogue};
pub use chance::log10_binomial_tail;
pub use fit::SkyFit;
pub use pairs::{Pair, PairTable, angle_of_chord2, chord2_of_angle};
pub use sky_index::SkyIndex;
pub use solution::{Refusal, StarMatch, StarSolution, ra_dec_roll_rad};
pub use solver::{DEFAULT_EPOCH_S, SolverOptions, StarSolver};
