//! What can go wrong in a run.

use std::path::{Path, PathBuf};

use retina_files::InputError;
use retina_render::RenderError;

/// A run that could not be done or finished.
#[derive(Debug, thiserror::Error)]
pub enum BatchError {
    /// Input that does not fit.
    #[error(transparent)]
    Input(#[from] InputError),
    /// The renderer failed.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// A file or folder could not be written.
    #[error("{} cannot be written: {source}", path.display())]
    Write {
        /// Which.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// An image could not be encoded.
    #[error("{what} could not be encoded: {reason}")]
    Encode {
        /// Which.
        what: String,
        /// Why.
        reason: String,
    },
    /// The renderer gave a value that is no number.
    #[error("frame {frame}: {pixels} pixels are not finite: a fault of the renderer, please report it")]
    NotFinite {
        /// The frame.
        frame: usize,
        /// How many.
        pixels: usize,
    },
}

impl BatchError {
    /// For `map_err` on file operations.
    pub(crate) fn write(path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_path_buf();
        move |source| Self::Write { path, source }
    }

    pub(crate) fn encode(what: impl Into<String>, reason: &dyn std::fmt::Display) -> Self {
        Self::Encode { what: what.into(), reason: reason.to_string() }
    }
}
