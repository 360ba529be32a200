//! Which exposures decide between rival models, and which rival is left after them.
//!
//! - [`Decision`]: rivals ruled out by the odds.
//! - [`Design`]: the exposures that tell those that are left apart, by T-optimality (A. C. Atkinson, V. V. Fedorov,
//!   Biometrika 62, 1975), within [`Freedom`].
//! - [`Rounds`]: a folder of plans and their measurements.

mod conditions;
mod design;
mod judge;
mod light;
mod output;
mod places;
mod rounds;
mod sequence;

pub use conditions::{Factor, Freedom};
pub use design::{Choice, Design, MakeData, Separation, Wanted};
pub use judge::Decision;
pub use output::{Outcome, decision_json, decision_text};
pub use rounds::{Round, Rounds};
pub use sequence::Planned;
