//! What is kept of a session on the disk: its inputs, the models that were tried, and where it stands among them.

use std::path::{Path, PathBuf};

use retina_campaign::PointsRecord;
use retina_files::{InputError, read_text, write_atomic};
use serde::{Deserialize, Serialize};

use crate::bench::Recipe;

const SCHEMA: &str = "retina.view-session/1";
const FILE: &str = "session.json";

/// Most models that are kept for undo.
const MOST_MODELS: usize = 200;

/// The effects of a model: ids of the catalogue, or files with formulas.
pub(crate) type Model = Vec<String>;

/// A session as `session.json` keeps it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct State {
    pub(crate) schema: String,
    pub(crate) name: String,
    /// The facility.
    pub(crate) setup: PathBuf,
    /// Tables, read together.
    pub(crate) tables: Vec<PathBuf>,
    /// The calibration that is held fixed.
    pub(crate) calibration: Option<PathBuf>,
    pub(crate) baseline: String,
    /// Models in the order in which they were tried.
    pub(crate) models: Vec<Model>,
    /// The one that is looked at.
    pub(crate) at: usize,
    /// What the bench makes before the first reading.
    pub(crate) recipe: Option<Recipe>,
    /// The campaign by which the bench made the first table.
    pub(crate) campaign: Option<PointsRecord>,
}

impl State {
    pub(crate) fn new(
        name: String,
        setup: PathBuf,
        tables: Vec<PathBuf>,
        calibration: Option<PathBuf>,
    ) -> Self {
        Self {
            schema: SCHEMA.to_owned(),
            name,
            setup,
            tables,
            calibration,
            baseline: "physical".to_owned(),
            models: vec![Vec::new()],
            at: 0,
            recipe: None,
            campaign: None,
        }
    }

    /// The model that is looked at.
    pub(crate) fn model(&self) -> &Model {
        &self.models[self.at]
    }

    /// Goes on to a model; those that were undone are dropped.
    pub(crate) fn push(&mut self, model: Model) {
        self.models.truncate(self.at + 1);
        self.models.push(model);
        if self.models.len() > MOST_MODELS {
            // The first model is the baseline, which stays.
            self.models.remove(1);
        }
        self.at = self.models.len() - 1;
    }

    /// # Errors
    /// The file cannot be read, or is damaged.
    pub(crate) fn read(folder: &Path) -> Result<Self, InputError> {
        let path = folder.join(FILE);
        let broken = |problem: String| {
            InputError::new(&path, problem)
                .help("remove the session's folder to begin anew; its tables stay in it until then")
        };
        let state: Self = serde_json::from_str(&read_text(&path)?)
            .map_err(|error| broken(format!("is no session of the workbench: {error}")))?;
        if state.schema != SCHEMA {
            return Err(broken("is of another version".to_owned()).found(&state.schema).expected(SCHEMA));
        }
        if state.at >= state.models.len() {
            return Err(broken(format!("stands at model {} of {}", state.at, state.models.len())));
        }
        Ok(state)
    }

    /// # Errors
    /// The file cannot be written.
    pub(crate) fn write(&self, folder: &Path) -> Result<(), InputError> {
        let path = folder.join(FILE);
        let text = serde_json::to_string_pretty(self)
            .map_err(|error| InputError::new(&path, format!("cannot be written: {error}")))?;
        write_atomic(&path, text.as_bytes())
            .map_err(|error| InputError::new(&path, format!("cannot be written: {error}")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state() -> State {
        State::new("a".to_owned(), "setup.toml".into(), vec!["points.csv".into()], None)
    }

    #[test]
    fn what_was_undone_is_dropped_by_the_next_step() {
        let mut state = state();
        state.push(vec!["drift".to_owned()]);
        state.push(vec!["drift".to_owned(), "knock".to_owned()]);
        state.at = 0;
        state.push(vec!["flux_coma".to_owned()]);
        assert_eq!(state.models, [vec![], vec!["flux_coma".to_owned()]]);
        assert_eq!(state.at, 1);
    }

    #[test]
    fn long_histories_keep_the_baseline_and_the_last() {
        let mut state = state();
        (0..300).for_each(|k| state.push(vec![k.to_string()]));
        assert_eq!((state.models.len(), state.at), (MOST_MODELS, MOST_MODELS - 1));
        assert!(state.models[0].is_empty() && state.model() == &["299"]);
    }

    #[test]
    fn a_session_is_read_as_it_was_written_and_a_damaged_one_refused() {
        let dir = tempfile::tempdir().unwrap();
        let mut state = state();
        state.push(vec!["flux_coma".to_owned()]);
        state.write(dir.path()).unwrap();
        assert_eq!(State::read(dir.path()).unwrap(), state);
        state.at = 9;
        state.write(dir.path()).unwrap();
        assert!(State::read(dir.path()).unwrap_err().to_string().contains("stands at model 9 of 2"));
        std::fs::write(dir.path().join(FILE), "{").unwrap();
        assert!(State::read(dir.path()).unwrap_err().to_string().contains("no session"));
    }
}
