//! What is to be shown and photographed: a pattern, a plan, rendered frames, or frames of several screens each.

use std::path::{Path, PathBuf};

use retina_bench::ScreenImage;
use retina_calibration::geometry::{MeasurementPlan, PLAN_FILE, Pattern};
use retina_campaign::{read_screen, screens_of};
use retina_files::InputError;
use retina_geometry::Setup;

use crate::LabError;
use crate::split::{FramePart, SPLIT_FILE, read_split};

/// What the images will be taken for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SequenceKind {
    /// Screens of a pattern: the images are listed in `images.csv`.
    Pattern,
    /// Frames: the images are listed in `frames.csv`, beside what was meant to be seen.
    Frames,
}

/// A frame that is to be shown.
#[derive(Debug, Clone, PartialEq)]
pub struct SequenceFrame {
    /// Name of its image, without ending.
    pub name: String,
    /// Its file.
    pub file: PathBuf,
    /// Exposure time over that of the first group of frames.
    pub exposure_ratio: f64,
    /// Exposure time that a plan asks for, s.
    pub exposure_s: Option<f64>,
    /// What a plan asks for besides.
    pub planned: Planned,
    /// Screens that are shown one after the other within its exposure; none where its file is the screen.
    pub parts: Vec<FramePart>,
}

/// Conditions that a plan asks for, as the columns of `images.csv`; what is absent is as it is.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Planned {
    /// Time on the clock of the measurements before, s.
    pub time_s: Option<f64>,
    /// Temperature, degC.
    pub temperature_c: Option<f64>,
    /// Roll of the camera in its mount, deg.
    pub camera_roll_deg: Option<f64>,
    /// Number of the time that the camera was mounted.
    pub mounting: Option<f64>,
}

/// Frames in the order in which they are shown.
#[derive(Debug, Clone, PartialEq)]
pub struct Sequence {
    /// What they are.
    pub kind: SequenceKind,
    /// The frames.
    pub frames: Vec<SequenceFrame>,
}

impl Sequence {
    /// Reads a folder: a pattern of `retina pattern`, a round of `retina decide`, what `retina render` wrote, or PNG
    /// files.
    ///
    /// # Errors
    /// The folder holds none of them, or a name that cannot name an image.
    pub fn read(folder: &Path, setup: &Setup) -> Result<Self, InputError> {
        let sequence = Self::found_in(folder, setup)?;
        sequence.frames.iter().try_for_each(|frame| check_name(&frame.name, folder))?;
        Ok(sequence)
    }

    fn found_in(folder: &Path, setup: &Setup) -> Result<Self, InputError> {
        let stem = |name: &str| name.rsplit_once('.').map_or(name, |(stem, _)| stem).to_owned();
        if folder.join(PLAN_FILE).is_file() {
            let plan = MeasurementPlan::read(folder, setup)?;
            let frames = plan.exposures.iter().map(|exposure| {
                let screen = &plan.pattern.screens[exposure.screen];
                SequenceFrame {
                    name: stem(&exposure.image),
                    file: folder.join("screens").join(&screen.file),
                    exposure_ratio: screen.exposure_ratio,
                    exposure_s: exposure.exposure_s,
                    parts: Vec::new(),
                    planned: Planned {
                        time_s: exposure.time_s,
                        temperature_c: exposure.temperature_c,
                        camera_roll_deg: exposure.camera_roll_deg,
                        mounting: exposure.mounting,
                    },
                }
            });
            return Ok(Self { kind: SequenceKind::Pattern, frames: frames.collect() });
        }
        if folder.join("pattern.toml").is_file() {
            let pattern = Pattern::read(folder, setup)?;
            if pattern.screens.is_empty() {
                return Err(InputError::new(folder, "the pattern has no screens"));
            }
            let frames = pattern.screens.iter().map(|screen| SequenceFrame {
                name: stem(&screen.file),
                file: folder.join("screens").join(&screen.file),
                exposure_ratio: screen.exposure_ratio,
                exposure_s: None,
                planned: Planned::default(),
                parts: Vec::new(),
            });
            return Ok(Self { kind: SequenceKind::Pattern, frames: frames.collect() });
        }
        if folder.join(SPLIT_FILE).is_file() {
            let frames = read_split(folder, setup)?.into_iter().map(|(name, light, parts)| SequenceFrame {
                name,
                file: light,
                exposure_ratio: 1.0,
                exposure_s: None,
                planned: Planned::default(),
                parts,
            });
            return Ok(Self { kind: SequenceKind::Frames, frames: frames.collect() });
        }
        let files = screens_of(folder).map_err(|error| {
            error.expected("a pattern (`retina pattern`), a plan (`retina decide`), frames (`retina render`) or PNG files")
        })?;
        let frames = files.into_iter().map(|file| SequenceFrame {
            name: file.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default(),
            file,
            exposure_ratio: 1.0,
            exposure_s: None,
            planned: Planned::default(),
            parts: Vec::new(),
        });
        Ok(Self { kind: SequenceKind::Frames, frames: frames.collect() })
    }
}

/// Refuses a name that cannot name an image; `place` is named.
pub(crate) fn check_name(name: &str, place: &Path) -> Result<(), InputError> {
    if is_plain(name) {
        return Ok(());
    }
    Err(InputError::new(place, "a frame's name cannot name its image")
        .found(format!("`{name}`"))
        .expected("letters, digits, `_`, `-`, `.` and spaces, a letter or digit first")
        .help("rename the file"))
}

/// Whether a name stays in its folder, and in its cell of a table.
fn is_plain(name: &str) -> bool {
    name.starts_with(|c: char| c.is_alphanumeric())
        && name.chars().all(|c| c.is_alphanumeric() || matches!(c, '_' | '-' | '.' | ' '))
}

impl SequenceFrame {
    /// Its screen image; the first of several.
    ///
    /// # Errors
    /// The file does not read.
    pub fn image(&self) -> Result<ScreenImage, LabError> {
        Ok(read_screen(self.parts.first().map_or(&self.file, |part| &part.file))?)
    }

    /// The screens of its exposure and their shares.
    ///
    /// # Errors
    /// A file does not read.
    pub(crate) fn screens(&self) -> Result<Vec<(ScreenImage, f64)>, LabError> {
        self.parts.iter().map(|part| Ok((read_screen(&part.file)?, part.share))).collect()
    }

    /// All files that are shown.
    pub(crate) fn files(&self) -> impl Iterator<Item = &PathBuf> {
        let own = self.parts.is_empty().then_some(&self.file);
        own.into_iter().chain(self.parts.iter().map(|part| &part.file))
    }
}

#[cfg(test)]
mod tests {
    use super::is_plain;

    #[test]
    fn names_stay_in_their_folder_and_their_cell() {
        assert!(is_plain("000123") && is_plain("Moon 3_b-1.5"));
        for wrong in ["", "../x", "a/b", "a,b", "=1", "-1", "a\"b"] {
            assert!(!is_plain(wrong), "{wrong}");
        }
    }
}
