//! Campaigns beyond one machine, on an engine that exists.
//!
//! - [`Plan`]: a scene's frames, a campaign's frames or poses, or runs of a command in shards, and the files that an engine
//!   takes.
//! - [`Runs`]: one command over many values.
//! - [`Format`]: the engines.
//! - [`PlanState`]: which shards are done, torn, missing or slow.
//!
//! A shard is a run of the command `retina` into a folder of its own. It makes what is missing there, so a task may be
//! killed and started again at any time. [`retina_batch::merge_shards`] joins the folders.

mod engine;
mod plan;
mod runs;
mod script;
mod state;

pub use engine::Format;
pub use plan::{Plan, Request, Work};
pub use runs::{RunRecord, Runs, RunsDone};
pub use state::{PlanState, ShardState, StateOfShard};
