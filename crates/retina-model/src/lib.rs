//! Bodies: glTF meshes and textures, and the builder that makes them from maps and elevation models.
//!
//! - [`load_body`]: a `.glb` or `.gltf` file into a [`Body`]: one mesh in body-fixed axes (x prime
//!   meridian, z north, metres), with linear albedo maps whose mean over the surface is 1.
//! - [`build_body`]: an even cube-sphere mesh from a plate carree relief and albedo map, as a `.glb`.
//! - [`external_files`]: what else a model reads, for hashing it.

mod body;
mod build;
mod cube;
mod document;
mod load;
mod maps;
mod normalise;
mod plate;
mod textures;
mod uri;

pub use body::{Body, Surface, Vertex};
pub use build::{AlbedoSource, BuildReport, BuildSpec, BuiltBody, Relief, build_body};
pub use document::external_files;
pub use load::load_body;
pub use maps::{AlbedoMap, SlopeMap, Wrap};
