//! A command as a screen: it is given each frame's file, and returns when the frame is shown.

use retina_bench::ScreenImage;
use tempfile::TempDir;

use super::{Screen, check_size, png};
use crate::LabError;
use crate::run_command::run_command;

pub(crate) struct CommandScreen {
    command: String,
    size_px: [u32; 2],
    folder: TempDir,
}

impl CommandScreen {
    pub(crate) fn open(command: &str, size_px: [u32; 2]) -> Result<Self, LabError> {
        let folder = tempfile::tempdir().map_err(|error| LabError::Command {
            command: command.into(),
            problem: format!("has no temporary folder for its frames: {error}"),
        })?;
        Ok(Self { command: command.into(), size_px, folder })
    }
}

impl Screen for CommandScreen {
    fn show(&mut self, image: &ScreenImage) -> Result<(), LabError> {
        check_size(image, self.size_px)?;
        let path = self.folder.path().join("screen.png");
        std::fs::write(&path, png(image)?).map_err(|error| LabError::Command {
            command: self.command.clone(),
            problem: format!("cannot be given its frame: {error}"),
        })?;
        run_command(&self.command, &[("RETINA_FRAME", path.as_os_str())])
    }

    fn verifies(&self) -> bool {
        false
    }
}

impl Drop for CommandScreen {
    fn drop(&mut self) {
        // A command that fails here has failed before, and was told of.
        let _ = self.show(&ScreenImage::dark(self.size_px[0], self.size_px[1]));
    }
}
