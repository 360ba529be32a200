//! The stock-lens search: which doublets, which way round, how far apart.
//!
//! A facility is traced from the camera's pupil through the collimator and the relay to the screen,
//! the groups held at their focal lengths exactly by one of their gaps, the distances between them by
//! the paper's eqs. 4-6 between principal planes. With these fixed, the paraxial rays that enter a
//! group do not depend on how the other one is built, so that third-order aberrations of the groups
//! add: `third_order` ranks every pair of groups, `exact` refits the gaps of the best with exact rays,
//! and `run` then swaps single lenses of the leaders until nothing improves.

mod candidate;
mod enumerate;
mod exact;
mod figure;
mod limits;
mod prescription;
mod refit;
mod report;
mod request;
mod run;
mod state;
mod third_order;

#[cfg(test)]
mod tests;

pub use candidate::{Element, FacilityDesign, GroupDesign};
pub use exact::{ConfigurationResult, FieldResult, ScreenFocus, evaluate};
pub use figure::pareto_figure;
pub use limits::{Excess, Limit, Removed};
pub use report::{NearestMiss, SearchReport, SearchedConfiguration, SearchedDesign, SearchedLens};
pub use request::{Configuration, SearchRequest};
pub use run::{Phase, SearchObserver, SearchProgress, search};
