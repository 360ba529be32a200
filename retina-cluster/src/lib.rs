//! Campaigns beyond one machine, on an engine that exists.
//!
//! - [`Plan`]: a scene's frames or a far-range campaign's poses in shards, and the files that an engine takes.
//! - [`Format`]: the engines.
//! - [`PlanState`]: which shards are done, torn, missing or slow.
//!
//! A shard is a run of the command `retina` into a folder of its own. It makes what is missing there, so a task may be
//! killed and started again at any time. [`retina_batch::merge_shards`] joins the folders.

mod engine;
mod plan;
mod script;
mod state;

pub use engine::Format;
pub use plan::{Plan, Request, Work};
pub use state::{PlanState, ShardState, StateOfShard};
