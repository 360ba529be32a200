//! Which reader a model file is for.

use std::path::Path;

use retina_files::InputError;

use crate::body::Body;
use crate::dsk::load_dsk;
use crate::icq::load_icq;
use crate::load::load_gltf;
use crate::obj::load_obj;
use crate::paint::Layout;

/// Kinds of model files that are read, by the file name's extension.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ModelKind {
    /// `.glb`, `.gltf`.
    Gltf,
    /// `.obj`.
    Obj,
    /// `.icq`: R. Gaskell's shapes.
    Icq,
    /// `.bds`, `.dsk`: SPICE's DSK kernels.
    Dsk,
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
            "icq" => Ok(Self::Icq),
            "bds" | "dsk" => Ok(Self::Dsk),
            _ => Err(InputError::new(path, "the body's file is of a kind that is not read here")
                .found(if extension.is_empty() {
                    "no extension".to_owned()
                } else {
                    format!("`.{}`", extension.escape_default())
                })
                .expected("`.glb`, `.gltf`, `.obj`, `.icq`, `.bds` or `.dsk`")
                .help("export the body in one of these formats")),
        }
    }
}

/// Loads a body from a file of any [`ModelKind`]; an OBJ's materials are not read (see [`crate::load_obj`]). glTF and OBJ
/// are in metres, ICQ and DSK in kilometres.
///
/// # Errors
/// Another extension; whatever the kind's reader refuses.
pub fn load_body(path: &Path) -> Result<Body, InputError> {
    match ModelKind::of(path)? {
        ModelKind::Gltf => load_gltf(path),
        ModelKind::Obj | ModelKind::Icq | ModelKind::Dsk => Ok(load_mesh(path)?.body),
    }
}

/// A body from a file that gives it no materials.
#[derive(Debug, Clone)]
pub struct LoadedMesh {
    /// The body, of relative albedo 1 everywhere until it is painted: see [`Body::paint`].
    pub body: Body,
    /// How a texture lies on it: by an OBJ file's `vt`, otherwise by longitude and latitude.
    pub layout: Layout,
    /// What of the file was not read, one sentence each.
    pub notes: Vec<String>,
}

/// Loads a mesh that has no materials: a `.obj`, `.icq`, `.bds` or `.dsk` file.
///
/// # Errors
/// A glTF file or another extension; whatever the kind's reader refuses.
pub fn load_mesh(path: &Path) -> Result<LoadedMesh, InputError> {
    match ModelKind::of(path)? {
        ModelKind::Obj => load_obj(path),
        ModelKind::Icq => load_icq(path),
        ModelKind::Dsk => load_dsk(path),
        ModelKind::Gltf => Err(InputError::new(path, "a glTF file is no mesh without materials")
            .expected("`.obj`, `.icq`, `.bds` or `.dsk`")),
    }
}
