//! `retina plan`, `retina status` and `retina merge`: long campaigns in shards.

pub(crate) mod merge;
pub(crate) mod plan;
pub(crate) mod status;
