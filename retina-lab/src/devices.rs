//! What is there: cameras and displays.

use crate::LabError;

/// A camera that can be opened.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FoundCamera {
    /// How `--camera` names it.
    pub spec: String,
    /// Its address, where it has one.
    pub address: String,
}

/// An output of a display.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FoundScreen {
    /// How `--screen` names it.
    pub spec: String,
    /// Width and height, px.
    pub size_px: [u32; 2],
}

/// The GenICam cameras that Aravis finds; `None` where the program was built without it.
pub fn find_cameras() -> Option<Vec<FoundCamera>> {
    #[cfg(feature = "aravis")]
    return Some(crate::take::find_aravis());
    #[cfg(not(feature = "aravis"))]
    None
}

/// A display and its outputs.
///
/// # Errors
/// It cannot be opened.
pub fn find_screens(display: &str) -> Result<Vec<FoundScreen>, LabError> {
    crate::show::find_outputs(display)
}
