//! A folder as a camera: another program writes an image into it now and then.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use retina_files::InputError;
use retina_image::{CameraImage, ReadOptions};

use super::{CameraSettings, LabCamera, Taken};
use crate::LabError;

/// Between two looks at the folder.
const LOOK: Duration = Duration::from_millis(50);
/// How long an image may take beyond its exposure.
const PATIENCE: Duration = Duration::from_secs(60);

pub(super) struct FolderCamera {
    folder: PathBuf,
    seen: BTreeSet<PathBuf>,
    exposure_s: f64,
    start: Instant,
    bits: u32,
}

impl FolderCamera {
    pub(super) fn open(folder: &Path, bits: u32) -> Result<Self, LabError> {
        let mut camera = Self {
            folder: folder.into(),
            seen: BTreeSet::new(),
            exposure_s: 0.0,
            start: Instant::now(),
            bits,
        };
        camera.seen = camera.files()?;
        Ok(camera)
    }

    fn files(&self) -> Result<BTreeSet<PathBuf>, InputError> {
        let entries = std::fs::read_dir(&self.folder)
            .map_err(|error| InputError::new(&self.folder, format!("cannot be read: {error}")))?;
        let visible = |path: &PathBuf| {
            path.is_file() && path.file_name().is_some_and(|name| !name.to_string_lossy().starts_with('.'))
        };
        Ok(entries.filter_map(|entry| entry.ok().map(|entry| entry.path())).filter(visible).collect())
    }

    /// The first file that was not there before, once it does not grow any more.
    fn next(&mut self) -> Result<PathBuf, LabError> {
        let limit = PATIENCE + Duration::from_secs_f64(self.exposure_s);
        let start = Instant::now();
        let mut growing: Option<(PathBuf, u64)> = None;
        while start.elapsed() < limit {
            let new = self.files()?.into_iter().find(|file| !self.seen.contains(file));
            let found = new.and_then(|file| Some((file.clone(), file.metadata().ok()?.len())));
            match found {
                Some((file, bytes)) if bytes > 0 && growing.as_ref() == Some(&(file.clone(), bytes)) => {
                    self.seen.insert(file.clone());
                    return Ok(file);
                }
                found => growing = found,
            }
            std::thread::sleep(LOOK);
        }
        Err(InputError::new(&self.folder, "no image came")
            .found(format!("nothing new in {} s", limit.as_secs()))
            .help("is the program running that takes the images? It is to write one file for each")
            .into())
    }
}

impl LabCamera for FolderCamera {
    fn name(&self) -> String {
        format!("folder {}", self.folder.display())
    }

    fn set(&mut self, settings: &CameraSettings) -> Result<(), LabError> {
        self.exposure_s = settings.exposure_s;
        Ok(())
    }

    fn take(&mut self) -> Result<Taken, LabError> {
        // What came before was taken of an earlier frame.
        self.seen = self.files()?;
        let time_s = self.start.elapsed().as_secs_f64();
        let file = self.next()?;
        let image =
            CameraImage::read(&file, ReadOptions { bits: Some(self.bits), ..ReadOptions::default() })?;
        Ok(Taken { image, time_s, exposure_s: self.exposure_s, temperature_c: None, lost: 0 })
    }
}
