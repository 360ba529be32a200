//! What a search has done so far, in a file that is replaced as a whole.

use std::collections::BTreeSet;
use std::path::Path;

use retina_files::{InputError, hash_bytes, read_text, write_atomic};
use serde::{Deserialize, Serialize};

use super::candidate::{FacilityDesign, Library};
use super::limits::Removed;
use super::request::SearchRequest;
use crate::OpticsError;

const SCHEMA: &str = "retina.optics-search-state/2";

/// A design and its worst RMS on the coarse pupil of the refit, um.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Scored {
    pub(crate) merit_um: f64,
    pub(crate) design: FacilityDesign,
}

/// Progress of a search.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct State {
    schema: String,
    /// Hash of the request: a state continues the same search only.
    request: String,
    /// Ranked pairs that have been refitted.
    pub(crate) refitted: usize,
    /// Leaders whose neighbours have all been tried.
    pub(crate) swapped: usize,
    /// Random double swaps that have been tried.
    pub(crate) kicks: usize,
    /// Lenses of the swaps that have been tried, by their place in the library.
    pub(crate) tried: BTreeSet<Vec<u16>>,
    /// Pairs of groups that limits ruled out.
    pub(crate) removed: Vec<Removed>,
    /// The best designs, best first.
    pub(crate) best: Vec<Scored>,
}

/// Of the request and of the lenses on the shelf, whose places the state holds.
fn hash(request: &SearchRequest, library: &Library) -> Result<String, OpticsError> {
    let parts: Vec<&str> = library.oriented.iter().map(|oriented| oriented.lens.part.as_str()).collect();
    let text =
        serde_json::to_vec(&(request, parts)).map_err(|error| OpticsError::Undefined(error.to_string()))?;
    Ok(hash_bytes(&text))
}

impl State {
    pub(crate) fn new(request: &SearchRequest, library: &Library) -> Result<Self, OpticsError> {
        Ok(Self {
            schema: SCHEMA.to_owned(),
            request: hash(request, library)?,
            refitted: 0,
            swapped: 0,
            kicks: 0,
            tried: BTreeSet::new(),
            removed: Vec::new(),
            best: Vec::new(),
        })
    }

    /// The state in a file, if it is there.
    pub(crate) fn read(
        path: &Path,
        request: &SearchRequest,
        library: &Library,
    ) -> Result<Option<Self>, InputError> {
        if !path.exists() {
            return Ok(None);
        }
        let text = read_text(path)?;
        let state: Self = serde_json::from_str(&text).map_err(|error| {
            InputError::new(path, format!("is not the state of a search: {error}")).line(error.line())
        })?;
        if state.schema != SCHEMA {
            return Err(InputError::new(path, "is not the state of a search")
                .at("key `schema`")
                .found(format!("`{}`", state.schema))
                .expected(format!("`{SCHEMA}`")));
        }
        let expected = hash(request, library).map_err(|error| InputError::new(path, error.to_string()))?;
        if state.request != expected {
            return Err(InputError::new(path, "belongs to another search")
                .at("key `request`")
                .found(state.request)
                .expected(expected)
                .help("repeat the search's flags, or name another state file"));
        }
        Ok(Some(state))
    }

    pub(crate) fn write(&self, path: &Path) -> Result<(), InputError> {
        let text = serde_json::to_vec(self).map_err(|error| InputError::new(path, error.to_string()))?;
        write_atomic(path, &text)
            .map_err(|error| InputError::new(path, format!("cannot be written: {error}")))
    }
}
