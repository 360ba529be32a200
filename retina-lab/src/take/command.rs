//! A command as a camera: a vendor's program that takes one image.

use std::ffi::OsStr;
use std::time::Instant;

use retina_image::{CameraImage, ReadOptions};
use tempfile::TempDir;

use super::{CameraSettings, LabCamera, Taken};
use crate::LabError;
use crate::run_command::run_command;

pub(super) struct CommandCamera {
    command: String,
    folder: TempDir,
    settings: CameraSettings,
    start: Instant,
    bits: u32,
}

impl CommandCamera {
    pub(super) fn open(command: &str, bits: u32) -> Result<Self, LabError> {
        let folder = tempfile::tempdir().map_err(|error| LabError::Command {
            command: command.into(),
            problem: format!("has no temporary folder for its images: {error}"),
        })?;
        let settings = CameraSettings { exposure_s: 0.01, gain_db: 0.0 };
        Ok(Self { command: command.into(), folder, settings, start: Instant::now(), bits })
    }

    fn failed(&self, problem: impl Into<String>) -> LabError {
        LabError::Command { command: self.command.clone(), problem: problem.into() }
    }
}

impl LabCamera for CommandCamera {
    fn name(&self) -> String {
        format!("`{}`", self.command)
    }

    fn set(&mut self, settings: &CameraSettings) -> Result<(), LabError> {
        self.settings = *settings;
        Ok(())
    }

    fn take(&mut self) -> Result<Taken, LabError> {
        // The command may add the ending of its own format to this name.
        let out = self.folder.path().join("image");
        let time_s = self.start.elapsed().as_secs_f64();
        let [exposure, gain] =
            [self.settings.exposure_s, self.settings.gain_db].map(|value| value.to_string());
        run_command(
            &self.command,
            &[
                ("RETINA_OUT", out.as_os_str()),
                ("RETINA_EXPOSURE_S", OsStr::new(&exposure)),
                ("RETINA_GAIN_DB", OsStr::new(&gain)),
            ],
        )?;
        let written: Vec<_> = std::fs::read_dir(self.folder.path())
            .map_err(|error| self.failed(format!("left no folder: {error}")))?
            .filter_map(|entry| entry.ok().map(|entry| entry.path()))
            .collect();
        let [file] = written.as_slice() else {
            return Err(self.failed(format!(
                "wrote {} files; one is expected, at the path in $RETINA_OUT with an ending such as .png, .tif or .fits",
                written.len()
            )));
        };
        let image = CameraImage::read(file, ReadOptions { bits: Some(self.bits), ..ReadOptions::default() })?;
        std::fs::remove_file(file)
            .map_err(|error| self.failed(format!("its image cannot be removed: {error}")))?;
        Ok(Taken { image, time_s, exposure_s: self.settings.exposure_s, temperature_c: None, lost: 0 })
    }
}
