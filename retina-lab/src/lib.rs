//! The laboratory: real screens and cameras in the loop, and the virtual bench in their place.
//!
//! - [`ScreenView`]: what a screen shows at this moment: an X11 display or a folder.
//! - [`BenchCamera`]: the virtual bench as a camera that photographs a [`ScreenView`], in its own time. `retina_gige`
//!   puts it on the network.

mod bench_camera;
mod error;
mod view;

pub use bench_camera::{BenchCamera, BenchCameraOptions};
pub use error::LabError;
pub use view::{ScreenAddress, ScreenView, open_view};
