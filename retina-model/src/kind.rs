//! Which reader a model file is for.

use std::path::Path;

use retina_files::InputError;

use crate::body::Body;
use crate::load::load_gltf;

/// Kinds of model files that are read, by the file name's extension.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ModelKind {
    /// `.glb`, `.gltf`.
    Gltf,
    /// `.obj`.
    Obj,
}

impl ModelKind {
    /// The kind of a file, by its extension in capitals or not.
    ///
    /// # Errors
    /// It has another extension, or none.
    pub fn of(path: &Path) -> Result<Self, InputError> {
        let extension = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
        match extension.as_str() {
            "glb" | "gltf" => Ok(Self::Gltf),
            "obj" => Ok(Self::Obj),
            _ => Err(InputError::new(path, "the body's file is of a kind that is not read here")
                .found(if extension.is_empty() {
                    "no extension".to_owned()
                } else {
                    format!("`.{}`", extension.escape_default())
                })
                .expected("`.glb`, `.gltf` or `.obj`")
                .help("export the body in one of these formats")),
        }
    }
}

/// Loads a body from a `.glb`, `.gltf` or `.obj` file; an OBJ's materials are not read (see
/// [`crate::load_obj`]).
///
/// # Errors
/// Another extension; whatever [`crate::load_obj`] or the glTF reader refuses.
pub fn load_body(path: &Path) -> Result<Body, InputError> {
    match ModelKind::of(path)? {
        ModelKind::Gltf => load_gltf(path),
        ModelKind::Obj => Ok(crate::load_obj(path)?.body),
    }
}
