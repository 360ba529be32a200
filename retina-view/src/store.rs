//! All sessions, each in a folder of its own below the folder of the state.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use retina_files::{InputError, hash_bytes, write_atomic};
use serde::{Deserialize, Serialize};

use crate::bench::{Example, Made};
use crate::failure::Refusal;
use crate::served::{Kind, kind_of};
use crate::session::{Session, file_name};
use crate::state::State;

/// A file that was dropped on the page.
#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Dropped {
    pub(crate) name: String,
    pub(crate) text: String,
}

/// A session of the start page's list.
#[derive(Debug, Serialize)]
pub(crate) struct Listed {
    id: String,
    name: String,
    effects: Vec<String>,
}

/// Inputs by their kinds.
#[derive(Debug, Default)]
pub(crate) struct Inputs {
    pub(crate) setup: Option<PathBuf>,
    pub(crate) tables: Vec<PathBuf>,
    pub(crate) calibration: Option<PathBuf>,
}

impl Inputs {
    /// # Errors
    /// There are two setups, or two calibrations; it is of another kind.
    pub(crate) fn put(&mut self, kind: Kind, path: PathBuf) -> Result<(), InputError> {
        let place = match kind {
            Kind::Table => {
                self.tables.push(path);
                return Ok(());
            }
            Kind::Setup => &mut self.setup,
            Kind::Calibration => &mut self.calibration,
            _ => {
                return Err(InputError::new(&path, "is nothing that a session of the workbench takes")
                    .expected("a setup, tables and a calibration"));
            }
        };
        match place {
            Some(first) => Err(InputError::new(&path, "is a second one of its kind")
                .found(first.display())
                .expected("one setup, one calibration at most, and tables")),
            None => {
                *place = Some(path);
                Ok(())
            }
        }
    }
}

/// See the module.
pub(crate) struct Store {
    folder: PathBuf,
    open: Mutex<BTreeMap<String, Arc<Session>>>,
}

/// Whether a session may have this id: it is a folder's name.
fn is_id(id: &str) -> bool {
    let plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
    (1..=40).contains(&id.len()) && id.chars().all(plain)
}

impl Store {
    pub(crate) fn new(folder: PathBuf) -> Self {
        Self { folder, open: Mutex::default() }
    }

    fn sessions(&self) -> std::sync::MutexGuard<'_, BTreeMap<String, Arc<Session>>> {
        self.open.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sessions on the disk, by name. Damaged ones are left out; opening one says why.
    pub(crate) fn list(&self) -> Vec<Listed> {
        let entries = std::fs::read_dir(&self.folder).into_iter().flatten().flatten();
        let mut out: Vec<Listed> = entries
            .filter_map(|entry| {
                let state = State::read(&entry.path()).ok()?;
                let effects =
                    state.model().iter().map(|text| crate::session::effect_name(text).to_owned()).collect();
                Some(Listed { id: entry.file_name().into_string().ok()?, name: state.name, effects })
            })
            .collect();
        out.sort_by(|a, b| (&a.name, &a.id).cmp(&(&b.name, &b.id)));
        out
    }

    /// A session that is open, or on the disk.
    pub(crate) fn get(&self, id: &str) -> Result<Arc<Session>, Refusal> {
        let mut sessions = self.sessions();
        if let Some(session) = sessions.get(id) {
            return Ok(Arc::clone(session));
        }
        let folder = self.folder.join(id);
        if !is_id(id) || !folder.is_dir() {
            return Err(Refusal::not_found("such session"));
        }
        let session = Session::new(id.to_owned(), folder.clone(), State::read(&folder)?);
        sessions.insert(id.to_owned(), Arc::clone(&session));
        Ok(session)
    }

    /// The session of these inputs: the one that is there, or a new one.
    fn put(
        &self,
        id: String,
        state: impl FnOnce(&Path) -> Result<State, Refusal>,
    ) -> Result<Arc<Session>, Refusal> {
        let folder = self.folder.join(&id);
        if !folder.join("session.json").is_file() {
            std::fs::create_dir_all(&folder)
                .map_err(|error| InputError::new(&folder, format!("the folder cannot be made: {error}")))?;
            state(&folder)?.write(&folder)?;
        }
        self.get(&id)
    }

    /// # Errors
    /// A setup or a table is missing; the folder cannot be written.
    pub(crate) fn open(&self, inputs: Inputs) -> Result<Arc<Session>, Refusal> {
        let Inputs { setup, tables, calibration } = inputs;
        let setup = setup.ok_or_else(|| missing("setup", "a setup, schema retina.setup/1"))?;
        let first = tables
            .first()
            .ok_or_else(|| missing("table", "a table of points, power readings or a phase curve"))?;
        let name = file_name(first);
        let id = id_of(&format!("{setup:?} {tables:?} {calibration:?}"));
        self.put(id, |_| Ok(State::new(name, setup, tables, calibration)))
    }

    /// A session of files that were dropped; they are kept in its folder. What is missing is taken from `beside`.
    pub(crate) fn drop_in(&self, files: &[Dropped], beside: Option<&State>) -> Result<Arc<Session>, Refusal> {
        let mut files = files.to_vec();
        let mut kinds = Vec::new();
        for file in &files {
            kinds.push(kind_of(Path::new(&file.name), &file.text)?);
        }
        let given = kinds.clone();
        let has = |kind: Kind| given.contains(&kind);
        // What lies in another session's folder goes when that is removed: this one has its own.
        let mut own = |path: &Path, kind: Kind| -> Result<bool, Refusal> {
            let theirs = path.starts_with(&self.folder);
            if theirs {
                files.push(Dropped { name: file_name(path), text: retina_files::read_text(path)? });
                kinds.push(kind);
            }
            Ok(theirs)
        };
        let mut inputs = Inputs::default();
        if let Some(beside) = beside {
            if !has(Kind::Setup) {
                if !own(&beside.setup, Kind::Setup)? {
                    inputs.setup = Some(beside.setup.clone());
                }
                if let Some(calibration) = beside.calibration.as_ref().filter(|_| !has(Kind::Calibration))
                    && !own(calibration, Kind::Calibration)?
                {
                    inputs.calibration = Some(calibration.clone());
                }
            }
            if !has(Kind::Table) {
                for table in &beside.tables {
                    if !own(table, Kind::Table)? {
                        inputs.tables.push(table.clone());
                    }
                }
            }
        }
        let has = |kind: Kind| kinds.contains(&kind);
        let all: Vec<(&str, String)> =
            files.iter().map(|f| (f.name.as_str(), hash_bytes(f.text.as_bytes()))).collect();
        if inputs.setup.is_none() && !has(Kind::Setup) {
            return Err(missing("setup", "a setup (retina.setup/1), dropped together with the table").into());
        }
        if inputs.tables.is_empty() && !has(Kind::Table) {
            return Err(missing("table", "a table (.csv), dropped together with the setup").into());
        }
        let id = id_of(&format!("{all:?} {inputs:?}"));
        let folder = self.folder.join(&id);
        for (number, (file, kind)) in files.iter().zip(&kinds).enumerate() {
            let path = folder.join(kept_name(number, &file.name));
            inputs.put(*kind, path)?;
        }
        let name = files
            .iter()
            .zip(&kinds)
            .find(|(_, kind)| **kind == Kind::Table)
            .map(|(file, _)| file.name.clone());
        self.put(id, |folder| {
            for (number, file) in files.iter().enumerate() {
                let path = folder.join(kept_name(number, &file.name));
                write_atomic(&path, file.text.as_bytes())
                    .map_err(|error| InputError::new(&path, format!("cannot be written: {error}")))?;
            }
            let Inputs { setup, tables, calibration } = inputs;
            let setup = setup.ok_or_else(|| missing("setup", "a setup"))?;
            Ok(State::new(name.unwrap_or_else(|| file_name(&setup)), setup, tables, calibration))
        })
    }

    pub(crate) fn example(&self, example: &Example) -> Result<Arc<Session>, Refusal> {
        self.put(format!("example-{}", example.id), |folder| {
            let (made, recipe) = (Made::of(folder), (example.recipe)());
            let mut state =
                State::new(example.title.to_owned(), made.setup, vec![made.table], Some(made.calibration));
            state.campaign = Some(recipe.data.clone());
            state.recipe = Some(recipe);
            Ok(state)
        })
    }

    /// Removes a session with what lies in its folder.
    pub(crate) fn remove(&self, id: &str) -> Result<(), Refusal> {
        let session = self.get(id)?;
        session.cancel();
        self.sessions().remove(id);
        std::fs::remove_dir_all(&session.folder)
            .map_err(|error| InputError::new(&session.folder, format!("cannot be removed: {error}")).into())
    }
}

fn missing(what: &str, expected: &str) -> InputError {
    InputError::new(Path::new("the session"), format!("has no {what}")).expected(expected)
}

fn id_of(text: &str) -> String {
    hash_bytes(text.as_bytes())[..16].to_owned()
}

/// Names of dropped files are the browser's: what could be a path is taken out.
fn kept_name(number: usize, name: &str) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() || "._-".contains(c) { c } else { '_' };
    let name: String = name.chars().map(plain).collect();
    format!("{number}-{}", name.chars().skip(name.chars().count().saturating_sub(60)).collect::<String>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_and_names_are_no_paths() {
        for id in ["..", "a/b", "", "A", "a.b", &"a".repeat(41)] {
            assert!(!is_id(id), "{id}");
        }
        assert!(is_id("example-fig-10"));
        assert_eq!(kept_name(0, "../../etc/passwd"), "0-.._.._etc_passwd");
    }

    #[test]
    fn the_same_inputs_are_the_same_session() {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::new(dir.path().to_path_buf());
        let files = [
            Dropped { name: "setup.toml".to_owned(), text: retina_assets::WIDE_FOV_SETUP.to_owned() },
            Dropped { name: "phase.csv".to_owned(), text: "phase_deg,magnitude\n1,2\n".to_owned() },
        ];
        let first = store.drop_in(&files, None).unwrap();
        assert!(Arc::ptr_eq(&first, &store.drop_in(&files, None).unwrap()));
        let lone = store.drop_in(&files[1..], None).err().unwrap();
        assert!(lone.body()["problem"].as_str().unwrap().contains("has no setup"), "{}", lone.body());
        let other = Dropped { name: "b.csv".to_owned(), text: "phase_deg,magnitude\n3,4\n".to_owned() };
        let beside = store.drop_in(&[other], Some(&first.state())).unwrap();
        // Another program that starts on the same folder finds all.
        assert_eq!(Store::new(dir.path().to_path_buf()).list().len(), store.list().len());
        // What was dropped beside a session needs nothing of it.
        let own = std::fs::read_to_string(&beside.state().setup).unwrap();
        assert_eq!(own, std::fs::read_to_string(&first.state().setup).unwrap());
        store.remove(&first.id).unwrap();
        assert!(store.get(&first.id).is_err());
        assert!(beside.state().setup.is_file());
        assert!(beside.state().setup.starts_with(&beside.folder));
    }
}
