//! Why a bench cannot be built or used.

use retina_files::InputError;
use retina_optics::OpticsError;

/// A bench that cannot be.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// A file or setting does not fit.
    #[error(transparent)]
    Input(#[from] InputError),
    /// The optics cannot be traced.
    #[error(transparent)]
    Optics(#[from] OpticsError),
    /// A screen image has another size than the screen.
    #[error("the screen image is {found_px:?} pixels, the setup's screen {expected_px:?}")]
    ScreenSize {
        /// Width and height of the image.
        found_px: [u32; 2],
        /// Width and height of the screen.
        expected_px: [u32; 2],
    },
}
