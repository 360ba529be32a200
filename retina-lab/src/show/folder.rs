//! A folder as a screen: another program, or the virtual bench's camera, shows its file `screen.png`.

use std::fs::File;
use std::path::{Path, PathBuf};

use retina_bench::ScreenImage;
use retina_files::{InputError, write_atomic};

use super::{Screen, check_size, png};
use crate::LabError;

const FILE: &str = "screen.png";
const LOCK: &str = ".retina-screen.lock";

pub(crate) struct FolderScreen {
    folder: PathBuf,
    size_px: [u32; 2],
    /// Held while this program drives the screen.
    _lock: File,
}

impl FolderScreen {
    pub(crate) fn open(folder: &Path, size_px: [u32; 2]) -> Result<Self, LabError> {
        if !folder.is_dir() {
            return Err(InputError::new(folder, "is no folder")
                .help("make it, or name another screen")
                .into());
        }
        let path = folder.join(LOCK);
        let lock = File::create(&path)
            .map_err(|error| InputError::new(&path, format!("cannot be written: {error}")))?;
        lock.try_lock().map_err(|_| InputError::new(folder, "another program drives this screen"))?;
        Ok(Self { folder: folder.into(), size_px, _lock: lock })
    }
}

impl Screen for FolderScreen {
    fn show(&mut self, image: &ScreenImage) -> Result<(), LabError> {
        check_size(image, self.size_px)?;
        let path = self.folder.join(FILE);
        write_atomic(&path, &png(image)?)
            .map_err(|error| InputError::new(&path, format!("cannot be written: {error}")).into())
    }

    fn verifies(&self) -> bool {
        false
    }
}

impl Drop for FolderScreen {
    fn drop(&mut self) {
        // Where it cannot be written any more there is no screen either.
        let _ = self.show(&ScreenImage::dark(self.size_px[0], self.size_px[1]));
    }
}
