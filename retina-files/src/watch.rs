//! Who wants to know which files are read and written.

use std::path::Path;
use std::sync::OnceLock;

/// What was done with a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Deed {
    /// It was read.
    Read,
    /// It was written, whole.
    Wrote,
}

/// Is told a deed, the file, and its bytes; from any thread.
pub type Watcher = fn(Deed, &Path, usize);

static WATCHER: OnceLock<Watcher> = OnceLock::new();

/// Has `watcher` told of every file that is read or written from here on, in this process. The first one stays.
pub fn watch_files(watcher: Watcher) {
    let _ = WATCHER.set(watcher);
}

pub(crate) fn tell(deed: Deed, path: &Path, bytes: usize) {
    if let Some(watcher) = WATCHER.get() {
        watcher(deed, path, bytes);
    }
}
