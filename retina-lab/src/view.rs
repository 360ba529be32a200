//! What a screen shows at this moment.

mod folder;
mod x11;

use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::Arc;

use retina_bench::ScreenImage;
use retina_files::InputError;

use crate::LabError;

/// Which screen.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ScreenAddress {
    /// All of an X11 display, for example `:77`.
    X11(String),
    /// The image that was written last into a folder.
    Folder(PathBuf),
}

impl FromStr for ScreenAddress {
    type Err = InputError;

    fn from_str(text: &str) -> Result<Self, InputError> {
        match text.split_once(':') {
            Some(("x11", display)) if !display.is_empty() => Ok(Self::X11(display.into())),
            Some(("folder", folder)) if !folder.is_empty() => Ok(Self::Folder(folder.into())),
            _ => Err(InputError::new(Path::new("--screen"), "is no screen")
                .found(format!("`{text}`"))
                .expected("x11:DISPLAY or folder:DIR, for example x11::77")),
        }
    }
}

impl fmt::Display for ScreenAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::X11(display) => write!(f, "x11:{display}"),
            Self::Folder(folder) => write!(f, "folder:{}", folder.display()),
        }
    }
}

/// A refresh of 60 Hz, s.
const REFRESH_S: f64 = 1.0 / 60.0;

/// Reads what a screen shows.
pub trait ScreenView: Send {
    /// The image that is shown now; the same one as before where nothing has changed.
    ///
    /// # Errors
    /// The display is gone, or shows an image that is no screen image.
    fn read(&mut self) -> Result<Arc<ScreenImage>, LabError>;

    /// Time between two looks during an exposure, s.
    fn look_s(&self) -> f64 {
        REFRESH_S
    }
}

/// Opens a screen of `size_px` for reading.
///
/// # Errors
/// There is no such display or folder, or it has another size.
pub fn open_view(address: &ScreenAddress, size_px: [u32; 2]) -> Result<Box<dyn ScreenView>, LabError> {
    Ok(match address {
        ScreenAddress::X11(display) => Box::new(x11::X11View::open(display, size_px)?),
        ScreenAddress::Folder(folder) => Box::new(folder::FolderView::open(folder, size_px)?),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_read() {
        let read = |text: &str| text.parse::<ScreenAddress>();
        assert_eq!(read("x11::77").unwrap(), ScreenAddress::X11(":77".into()));
        assert_eq!(read("x11:host:0.1").unwrap().to_string(), "x11:host:0.1");
        assert_eq!(read("folder:a/b").unwrap(), ScreenAddress::Folder("a/b".into()));
        for wrong in ["", "x11:", "folder:", "a/b", "wayland:0"] {
            assert!(read(wrong).is_err(), "{wrong}");
        }
    }
}
