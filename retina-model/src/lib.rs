//! Bodies: glTF, OBJ, ICQ and DSK meshes, textures, and the builder that makes bodies from maps and
//! elevation models.
//!
//! - [`load_body`]: a `.glb`, `.gltf`, `.obj`, `.icq`, `.bds` or `.dsk` file into a [`Body`]: one mesh in body-fixed axes (x prime
//!   meridian, z north, metres), with linear albedo maps whose mean over the surface is 1.
//! - [`load_mesh`]: a file without materials, with what of it was not read; [`Body::paint`]: a texture laid on a body.
//! - [`build_body`]: an even cube-sphere mesh from a plate carree relief and albedo map, as a `.glb`.
//! - [`external_files`]: what else a model reads, for hashing it.

mod body;
mod build;
mod cube;
mod document;
mod dsk;
mod ellipsoid;
mod icq;
mod kind;
mod load;
mod maps;
mod normalise;
mod obj;
mod paint;
mod plate;
mod textures;
mod uri;

pub use body::{Body, Surface, Vertex};
pub use build::{AlbedoSource, BuildReport, BuildSpec, BuiltBody, Relief, build_body};
pub use document::external_files;
pub use ellipsoid::Ellipsoid;
pub use kind::{LoadedMesh, ModelKind, load_body, load_mesh};
pub use maps::{AlbedoMap, SlopeMap, Wrap};
pub use obj::load_obj;
pub use paint::Layout;
