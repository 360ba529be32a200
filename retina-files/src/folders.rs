//! The user's own folders.

use std::path::{Path, PathBuf};

/// Where the system has what a program keeps for its user: the folder that `variable` names (`XDG_STATE_HOME`,
/// `XDG_CACHE_HOME`), else Windows' own, else `below_home` in the home folder; in it `retina`. `None` where none is set.
pub fn user_folder(variable: &str, below_home: impl AsRef<Path>) -> Option<PathBuf> {
    let folder = |name: &str| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let base = folder(variable)
        .or_else(|| folder("LOCALAPPDATA"))
        .or_else(|| folder("HOME").map(|home| home.join(below_home)))?;
    Some(base.join("retina"))
}
