//! The workbench and the facility in a browser: a server on this machine, and the page that it serves.
//!
//! - [`View`]: binds to the loopback address, keeps the sessions, serves the page.
//! - [`ViewOptions`]: folders that may be read, the folder of the sessions, the port.
//!
//! Panes beside the workbench show rendered sequences, live scenes, the virtual bench, lens systems and results of
//! navigation.
//!
//! Nothing is served without the random token that the address carries, and nothing outside the given folders. What the
//! page shows is computed by the libraries that the commands `compare`, `diagnose` and `fit` call.

mod api;
mod bench;
mod columns;
mod export;
mod failure;
mod guard;
mod job;
mod page;
mod panes;
mod served;
mod session;
mod state;
mod store;
mod view;

pub use failure::ViewError;
pub use view::{View, ViewOptions, default_state_folder};
