//! The folder of a data set while it is made: it gets its name when it is whole.

use std::fs;
use std::path::{Path, PathBuf};

use retina_batch::BatchError;
use retina_files::InputError;
use serde_json::Value;

/// A folder beside the wanted one.
pub(crate) struct Out {
    target: PathBuf,
    part: tempfile::TempDir,
}

impl Out {
    pub(crate) fn new(target: &Path) -> Result<Self, BatchError> {
        if target.exists() {
            return Err(InputError::new(target, "is there already").help("give --out another folder").into());
        }
        let beside = match target.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent,
            _ => Path::new("."),
        };
        let failed = |source| BatchError::Write { path: beside.to_path_buf(), source };
        fs::create_dir_all(beside).map_err(failed)?;
        let part = tempfile::Builder::new().prefix(".part-export-").tempdir_in(beside).map_err(failed)?;
        Ok(Self { target: target.to_path_buf(), part })
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.part.path().join(name)
    }

    /// Makes a file, and its folder.
    pub(crate) fn write(&self, name: &str, bytes: &[u8]) -> Result<(), BatchError> {
        let path = self.path(name);
        let failed = |source| BatchError::Write { path: self.target.join(name), source };
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder).map_err(failed)?;
        }
        fs::write(&path, bytes).map_err(failed)
    }

    pub(crate) fn write_json(&self, name: &str, document: &Value) -> Result<(), BatchError> {
        self.write(name, format!("{document:#}\n").as_bytes())
    }

    /// Gives the folder its name.
    pub(crate) fn finish(self) -> Result<PathBuf, BatchError> {
        let failed = |source| BatchError::Write { path: self.target.clone(), source };
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt as _;
            fs::set_permissions(self.part.path(), fs::Permissions::from_mode(0o755)).map_err(failed)?;
        }
        fs::rename(self.part.path(), &self.target).map_err(failed)?;
        // Its old name is gone, so there is nothing left to remove.
        let _ = self.part.keep();
        Ok(self.target)
    }
}
