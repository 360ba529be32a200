//! Formulas for what no known effect explains, proven on data that the search has not seen.
//!
//! - [`investigate`]: forms are looked for in one half of a table's groups, and judged by the other half.
//! - [`Term`]: a formula as a user's effect, with its proof, its rivals and what it says in words.
//! - [`investigation_text`], [`investigation_json`], [`investigation_page`]: for people and programs.
//! - [`write_formulas`]: each formula as a file that `--effect` takes.

#[cfg(test)]
#[path = "../../retina-diagnosis/tests/common/mod.rs"]
mod campaign;
mod columns;
mod delays;
mod direction;
mod form;
mod half;
mod investigate;
mod law;
mod outcome;
mod output;
mod page;
mod refine;
mod rivals;
mod search;
mod words;

pub use direction::Direction;
pub use investigate::{Options, investigate};
pub use law::Law;
pub use outcome::{Formula, Investigation, KnownEffect, Rival, Term, Unproven, WeakEffect};
pub use output::{investigation_json, investigation_text, write_formulas};
pub use page::investigation_page;
pub use words::{Origin, Words};
