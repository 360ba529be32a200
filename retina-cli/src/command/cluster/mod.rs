//! `retina plan`, `retina status`, `retina merge` and `retina runs`: long campaigns in shards.

pub(crate) mod merge;
pub(crate) mod plan;
pub(crate) mod runs;
pub(crate) mod status;
