//! Reports: pages of HTML with everything inside, which open offline, and one page from many.
//!
//! A [`Page`] is a heading and sections; a section has text, tables and figures. Each command that measures
//! or calibrates can write one, and [`join`] makes one page of all those in a folder.

mod join;
mod page;
mod style;

pub use join::join;
pub use page::{Page, Section};
