//! Taking an image with a camera.

#[cfg(feature = "aravis")]
mod aravis;
mod bench;
mod command;
mod folder;

use std::path::{Path, PathBuf};
use std::str::FromStr;

use retina_files::InputError;
use retina_image::CameraImage;

use crate::{BenchCamera, LabError, Turns};

#[cfg(feature = "aravis")]
pub(crate) use aravis::find as find_aravis;

/// Which camera.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum CameraSpec {
    /// A GenICam camera by Aravis: its name, or the first that is found.
    Aravis(Option<String>),
    /// A folder into which another program writes each image.
    Folder(PathBuf),
    /// A command that takes an image and writes it to the file that it is given.
    Command(String),
    /// The virtual bench in this process.
    Bench,
}

impl FromStr for CameraSpec {
    type Err = InputError;

    fn from_str(text: &str) -> Result<Self, InputError> {
        match text.split_once(':') {
            None if text == "bench" => Ok(Self::Bench),
            None if text == "aravis" => Ok(Self::Aravis(None)),
            Some(("aravis", name)) if !name.is_empty() => Ok(Self::Aravis(Some(name.into()))),
            Some(("folder", folder)) if !folder.is_empty() => Ok(Self::Folder(folder.into())),
            Some(("exec", command)) if !command.trim().is_empty() => Ok(Self::Command(command.into())),
            _ => Err(InputError::new(Path::new("--camera"), "is no camera")
                .found(format!("`{text}`"))
                .expected("aravis, aravis:NAME, folder:DIR, exec:COMMAND or bench")),
        }
    }
}

/// What a camera is told before it takes an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraSettings {
    /// Exposure time, s.
    pub exposure_s: f64,
    /// Gain, dB.
    pub gain_db: f64,
}

/// An image and what the camera says of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Taken {
    /// The image.
    pub image: CameraImage,
    /// When its exposure began, s on the camera's clock; since the camera was opened where it has none.
    pub time_s: f64,
    /// The exposure time that was used, s: cameras round it to their own steps.
    pub exposure_s: f64,
    /// Temperature of the camera, degC; `None` where it does not tell.
    pub temperature_c: Option<f64>,
    /// Images that came torn or not at all, and were taken again.
    pub lost: u32,
}

/// A camera that takes an image when it is told to.
pub trait LabCamera {
    /// What it is, for people.
    fn name(&self) -> String;

    /// Sets it.
    ///
    /// # Errors
    /// The camera cannot do this; it says what it can.
    fn set(&mut self, settings: &CameraSettings) -> Result<(), LabError>;

    /// Takes an image of what is shown now: its exposure begins after the call does.
    ///
    /// # Errors
    /// The camera is gone, or its images do not arrive whole.
    fn take(&mut self) -> Result<Taken, LabError>;

    /// Turns the screws of the bench in front of it, by so much more. Virtual benches have such a motor.
    ///
    /// # Errors
    /// It has none.
    fn turn(&mut self, _by: &Turns) -> Result<(), LabError> {
        Err(LabError::Camera {
            camera: self.name(),
            problem: "has no motors at the bench's screws. Turn them by hand: leave --turn out".into(),
        })
    }
}

/// Opens a camera that gives counts of `bits`. `bench` is the virtual bench in this process, where it is asked for.
///
/// # Errors
/// There is no such camera, or another program uses it.
pub fn open_camera(
    spec: &CameraSpec,
    bits: u32,
    bench: Option<BenchCamera>,
) -> Result<Box<dyn LabCamera>, LabError> {
    Ok(match (spec, bench) {
        (CameraSpec::Folder(folder), _) => Box::new(folder::FolderCamera::open(folder, bits)?),
        (CameraSpec::Command(command), _) => Box::new(command::CommandCamera::open(command, bits)?),
        (CameraSpec::Bench, Some(bench)) => Box::new(bench::InProcess::new(bench)),
        (CameraSpec::Bench, None) => {
            return Err(InputError::new(Path::new("--camera"), "the bench photographs its own screen")
                .found("bench with another screen")
                .help("give --screen bench, too; `retina lab camera` photographs a real display")
                .into());
        }
        #[cfg(feature = "aravis")]
        (CameraSpec::Aravis(name), _) => Box::new(aravis::AravisCamera::open(name.as_deref(), bits)?),
        #[cfg(not(feature = "aravis"))]
        (CameraSpec::Aravis(_), _) => {
            return Err(InputError::new(Path::new("--camera"), "this program was built without Aravis")
                .help(
                    "install libaravis-dev and build with --features aravis; or take images by exec:COMMAND",
                )
                .into());
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_read() {
        let read = |text: &str| text.parse::<CameraSpec>();
        assert_eq!(read("aravis").unwrap(), CameraSpec::Aravis(None));
        assert_eq!(read("aravis:A-b (1)").unwrap(), CameraSpec::Aravis(Some("A-b (1)".into())));
        assert_eq!(
            read("exec:grab \"$RETINA_OUT\"").unwrap(),
            CameraSpec::Command("grab \"$RETINA_OUT\"".into())
        );
        for wrong in ["", "aravis:", "folder:", "gige"] {
            assert!(read(wrong).is_err(), "{wrong}");
        }
    }
}
