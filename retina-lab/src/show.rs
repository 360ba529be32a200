//! Showing a frame on a screen, and knowing that it is there.

mod command;
mod dose;
mod folder;
mod guarded;
mod patch;
mod window;

use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::{Arc, Mutex, PoisonError};

use retina_bench::ScreenImage;
use retina_files::InputError;
use retina_geometry::{ScreenLimits, Setup};

use crate::{LabError, ScreenView};

pub use patch::Patch;
pub(crate) use window::find as find_outputs;

/// Which screen shows the frames.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ScreenSpec {
    /// A window over all of an X11 display or over one of its outputs.
    X11 {
        /// The display, `:0`.
        display: String,
        /// The output, `DP-1`; the display's only one of the right size where absent.
        output: Option<String>,
    },
    /// A folder whose file `screen.png` another program shows.
    Folder(PathBuf),
    /// A command that is given the file of each frame and returns when it is shown.
    Command(String),
    /// The virtual bench in this process.
    Bench,
}

impl FromStr for ScreenSpec {
    type Err = InputError;

    fn from_str(text: &str) -> Result<Self, InputError> {
        match text.split_once(':') {
            None if text == "bench" => Ok(Self::Bench),
            Some(("x11", rest)) if !rest.is_empty() => Ok(match rest.split_once('@') {
                None => Self::X11 { display: rest.into(), output: None },
                Some((display, output)) => Self::X11 { display: display.into(), output: Some(output.into()) },
            }),
            Some(("folder", folder)) if !folder.is_empty() => Ok(Self::Folder(folder.into())),
            Some(("exec", command)) if !command.trim().is_empty() => Ok(Self::Command(command.into())),
            _ => Err(InputError::new(Path::new("--screen"), "is no screen")
                .found(format!("`{text}`"))
                .expected("x11:DISPLAY, x11:DISPLAY@OUTPUT, folder:DIR, exec:COMMAND or bench")),
        }
    }
}

impl fmt::Display for ScreenSpec {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::X11 { display, output: None } => write!(to, "x11:{display}"),
            Self::X11 { display, output: Some(output) } => write!(to, "x11:{display}@{output}"),
            Self::Folder(folder) => write!(to, "folder:{}", folder.display()),
            Self::Command(command) => write!(to, "exec:{command}"),
            Self::Bench => write!(to, "bench"),
        }
    }
}

/// A screen that frames are shown on. It is dark when it is opened and after it is dropped.
pub trait Screen: Send {
    /// Shows a frame; returns when it is there.
    ///
    /// # Errors
    /// The frame has another size than the screen; the screen is gone; something covers it.
    fn show(&mut self, image: &ScreenImage) -> Result<(), LabError>;

    /// Keeps the last frame there for `for_s`, s, from now on; true where it had gone dark and was shown again.
    ///
    /// # Errors
    /// The display's limits do not allow this.
    fn hold(&mut self, _for_s: f64) -> Result<bool, LabError> {
        Ok(false)
    }

    /// Whether the last frame is still there: a display with limits goes dark by itself.
    fn is_shown(&self) -> bool {
        true
    }

    /// Whether [`Self::show`] has read the frame back from the screen.
    fn verifies(&self) -> bool;

    /// Whether the photodiode's patch is white in the last frame; `None` where there is none.
    fn patch(&self) -> Option<bool> {
        None
    }

    /// What a user should know of it, a sentence each: settings that change what is shown.
    fn remarks(&self) -> Vec<String> {
        Vec::new()
    }
}

/// Opens the setup's screen, within its limits, with a photodiode's patch where there is one. `bench` is where the virtual
/// bench looks.
///
/// # Errors
/// There is no such screen, it has another size, or another program drives it; the camera sees the patch.
pub fn open_screen(
    spec: &ScreenSpec,
    setup: &Setup,
    patch: Option<Patch>,
    bench: &BenchScreen,
) -> Result<Box<dyn Screen>, LabError> {
    patch.map_or(Ok(()), |patch| patch.check(setup))?;
    let size_px = [setup.screen.width_px, setup.screen.height_px];
    let mut screen: Box<dyn Screen> = match spec {
        ScreenSpec::X11 { display, output } => {
            Box::new(window::Window::open(display, output.as_deref(), size_px)?)
        }
        ScreenSpec::Folder(folder) => Box::new(folder::FolderScreen::open(folder, size_px)?),
        ScreenSpec::Command(command) => Box::new(command::CommandScreen::open(command, size_px)?),
        ScreenSpec::Bench => Box::new(bench.clone()),
    };
    if setup.screen.limits != ScreenLimits::default() {
        // A virtual display does not burn in.
        let counted = *spec != ScreenSpec::Bench;
        screen = Box::new(guarded::Guarded::new(screen, &spec.to_string(), setup, counted)?);
    }
    screen.show(&ScreenImage::dark(size_px[0], size_px[1]))?;
    if let Some(patch) = patch {
        screen = Box::new(patch::Patched::new(screen, patch, setup.screen.limits.most_count));
    }
    Ok(screen)
}

/// The screen of the virtual bench in this process: what is shown is what its camera sees.
#[derive(Debug, Clone)]
pub struct BenchScreen {
    shown: Arc<Mutex<Arc<ScreenImage>>>,
}

impl BenchScreen {
    /// A dark one.
    pub fn new(size_px: [u32; 2]) -> Self {
        Self { shown: Arc::new(Mutex::new(Arc::new(ScreenImage::dark(size_px[0], size_px[1])))) }
    }
}

impl Screen for BenchScreen {
    fn show(&mut self, image: &ScreenImage) -> Result<(), LabError> {
        let mut shown = self.shown.lock().unwrap_or_else(PoisonError::into_inner);
        check_size(image, [shown.width_px, shown.height_px])?;
        if **shown != *image {
            *shown = Arc::new(image.clone());
        }
        Ok(())
    }

    fn verifies(&self) -> bool {
        true
    }
}

impl ScreenView for BenchScreen {
    fn read(&mut self) -> Result<Arc<ScreenImage>, LabError> {
        Ok(Arc::clone(&self.shown.lock().unwrap_or_else(PoisonError::into_inner)))
    }

    /// A look costs nothing.
    fn look_s(&self) -> f64 {
        0.002
    }
}

/// Refuses a frame of another size.
fn check_size(image: &ScreenImage, size_px: [u32; 2]) -> Result<(), LabError> {
    let found = [image.width_px, image.height_px];
    if found == size_px {
        return Ok(());
    }
    Err(InputError::new(Path::new("the frame"), "has another size than the setup's screen")
        .found(format!("{} x {} px", found[0], found[1]))
        .expected(format!("{} x {} px", size_px[0], size_px[1]))
        .into())
}

/// A frame as a PNG file of 8 bits: grey where its channels are equal.
pub(crate) fn png(image: &ScreenImage) -> Result<Vec<u8>, LabError> {
    let grey = image.counts.iter().all(|[r, g, b]| r == g && g == b);
    let (samples, color): (Vec<u8>, _) = if grey {
        (image.counts.iter().map(|counts| counts[0]).collect(), image::ExtendedColorType::L8)
    } else {
        (image.counts.iter().flatten().copied().collect(), image::ExtendedColorType::Rgb8)
    };
    let mut bytes = Vec::new();
    let encoder = image::codecs::png::PngEncoder::new(&mut bytes);
    image::ImageEncoder::write_image(encoder, &samples, image.width_px, image.height_px, color)
        .map_err(|error| InputError::new(Path::new("the frame"), format!("cannot be encoded: {error}")))?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn screens_read_and_wrong_sizes_are_refused() {
        let read = |text: &str| text.parse::<ScreenSpec>();
        let x11 = |display: &str, output: Option<&str>| ScreenSpec::X11 {
            display: display.into(),
            output: output.map(Into::into),
        };
        assert_eq!(read("x11::77").unwrap(), x11(":77", None));
        assert_eq!(read("x11::0@DP-1").unwrap(), x11(":0", Some("DP-1")));
        assert_eq!(read("exec:show --now").unwrap(), ScreenSpec::Command("show --now".into()));
        assert_eq!(read("bench").unwrap(), ScreenSpec::Bench);
        for wrong in ["", "x11:", "bench:1", "exec: ", "hdmi"] {
            assert!(read(wrong).is_err(), "{wrong}");
        }
        let mut screen = BenchScreen::new([4, 2]);
        screen.show(&ScreenImage::grey(4, 2, &[9; 8])).unwrap();
        assert_eq!(screen.clone().read().unwrap().counts[0], [9; 3]);
        assert!(screen.show(&ScreenImage::dark(2, 4)).is_err());
    }
}
