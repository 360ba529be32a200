//! Scenes: from files to what a renderer is asked for.
//!
//! - [`Scene`]: `SCENE.toml` and everything it names, read and checked before anything is rendered.
//! - [`SceneFrame`]: camera, bodies and Sun of one frame, as the renderer takes them.
//! - [`Scene::truth`]: the ground truth of a frame, schema `retina.truth/1`.
//! - [`Scene::sky`]: the stars and planets of a frame.
//! - [`Scene::flashes_of`]: the flashes of impacts that shine during a frame.
//! - [`FrameChecks`]: what must hold of each frame.
//! - [`Scene::brightest_frames`]: where the brightest pixel of the sequence is to be looked for.

mod brightness;
mod checks;
mod file;
mod flashes;
mod frame;
mod inside;
mod keys;
mod near_body;
mod occult;
mod photometry;
mod photometry_table;
mod read;
mod read_flashes;
mod scene;
mod sequence;
mod sky;
mod spacecraft;
mod truth;

pub use checks::FrameChecks;
pub use file::{Compensation, Layer, Shading};
pub use flashes::{Flash, Flashes, RandomFlashes, SeenFlash, ShownFlash};
pub use frame::SceneFrame;
pub use photometry_table::PhotometryTable;
pub use read::Given;
pub use scene::{BodyParts, Display, Output, RadianceScale, Scene, SceneBody, SceneInput, SceneParts};
pub use sky::{DisplayedPoint, PlanetPoint, ShownPoint, SkyPoint, Stars};
