//! The workbench's benchmark: tables with a hidden effect, made by physics that shares no code with the fit; their truth,
//! sealed; the workbench's answers; and the scorer, which alone opens the truth.
//!
//! - [`generate`] writes sets and truth, [`run`] asks the workbench, [`score`] compares.

mod algebra;
mod decided;
mod forms;
mod formulas;
mod generate;
mod investigated;
mod lists;
mod plan;
mod points;
mod power_formulas;
mod readings;
mod run;
mod score;
mod templates;

pub use decided::decide_pairs;
pub use generate::generate;
pub use investigated::{investigate_sets, score_investigated};
pub use lists::Part;
pub use points::campaign_table;
pub use run::run;
pub use score::{Outcome, Target, score};
