//! Further files of a frame, beside the screen image, the truth and the EXR.

use retina_render::{Planes, RadianceImage};
use retina_scene::SceneFrame;

use crate::BatchError;

/// Makes further files of each frame from what was rendered. They are hashed, resumed and shared
/// between shards like the others.
pub trait SideProducts: Send + Sync {
    /// What the files depend on besides the scene's inputs, in one line: part of the folder's record.
    fn description(&self) -> String;

    /// The planes that they are made of.
    fn planes(&self) -> Planes;

    /// Paths, in the output folder, of the files of frame `index`, in the order of [`Self::make`].
    fn files(&self, index: usize) -> Vec<String>;

    /// The files' bytes. `image` is what was rendered (in the modes `none` and `direct` the
    /// screen's image), `picture` the PNG of the frame.
    ///
    /// # Errors
    /// A file that cannot be encoded.
    fn make(
        &self,
        frame: &SceneFrame,
        image: &RadianceImage,
        picture: &[u8],
    ) -> Result<Vec<Vec<u8>>, BatchError>;
}
