//! Files to start from, with a comment on every key.

use std::path::{Path, PathBuf};

use retina_files::{InputError, write_atomic};

/// A kind of file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StartingFile {
    /// A facility.
    Setup,
    /// A scene of stars and planets, with a body to fill in.
    Scene,
    /// A far-range campaign.
    Campaign,
}

/// Name under which scenes and campaigns look for the facility, beside themselves.
const SETUP_FILE: &str = "setup.toml";

impl StartingFile {
    /// The file's text.
    pub fn text(self) -> &'static str {
        match self {
            Self::Setup => include_str!("starting/setup.toml"),
            Self::Scene => include_str!("starting/scene.toml"),
            Self::Campaign => include_str!("starting/campaign.toml"),
        }
    }

    /// Writes it, and beside a scene or a campaign a setup where there is none; makes their folder. Returns what was
    /// written.
    ///
    /// # Errors
    /// The file is there already, or cannot be written.
    pub fn write(self, path: &Path) -> Result<Vec<PathBuf>, InputError> {
        if path.exists() {
            return Err(InputError::new(path, "is there already").help("give --out another name"));
        }
        let setup = path.with_file_name(SETUP_FILE);
        let mut written = Vec::new();
        if self != Self::Setup && setup == path {
            return Err(InputError::new(path, "the name is the setup's").help("give --out another name"));
        }
        if self != Self::Setup && !setup.exists() {
            put(&setup, Self::Setup.text())?;
            written.push(setup);
        }
        put(path, self.text())?;
        written.push(path.to_path_buf());
        Ok(written)
    }
}

fn put(path: &Path, text: &str) -> Result<(), InputError> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    folder.map_or(Ok(()), std::fs::create_dir_all).and_then(|()| write_atomic(path, text.as_bytes())).map_err(
        |error| {
            InputError::new(path, format!("cannot be written: {error}")).help("give --out another folder")
        },
    )
}
