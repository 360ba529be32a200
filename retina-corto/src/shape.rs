//! A body of a scenario: its file, texture and photometry, found or guessed; then loaded.

use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};
use retina_files::{InputError, hash_file};
use retina_model::{Layout, ModelKind, external_files, load_body, load_mesh};
use retina_radiometry::{Lambert, PhaseFunction, Photometry};
use retina_scene::{BodyParts, Shading};

use crate::folder::{files_of, names};
use crate::sidecar::{Axes, BodyTable};

const SHAPE_EXTENSIONS: [&str; 3] = ["obj", "glb", "gltf"];
const TEXTURE_EXTENSIONS: [&str; 5] = ["png", "jpg", "jpeg", "tif", "tiff"];
/// Albedo of a body of which nothing is said.
const DEFAULT_ALBEDO: f64 = 0.2;

/// Where a body's mesh comes from and what becomes of it.
#[derive(Debug)]
pub(crate) struct ShapeSource {
    file: PathBuf,
    kind: ModelKind,
    texture: Option<PathBuf>,
    scale: DVec3,
    axes: Axes,
    shading: Shading,
    photometry: Option<Photometry>,
    reference_semi_axes_m: Option<DVec3>,
}

/// The bodies' files: those named, or else what the folder `body/shape` holds.
pub(crate) fn shape_files<'a>(
    folder: &Path,
    count: usize,
    named: impl Fn(usize) -> Option<&'a Path>,
    notes: &mut Vec<String>,
) -> Result<Vec<PathBuf>, InputError> {
    let place = folder.join("body").join("shape");
    if (0..count).all(|number| named(number).is_some()) {
        return Ok((0..count).filter_map(named).map(|file| place.join(file)).collect());
    }
    let found = files_of(&place, &SHAPE_EXTENSIONS)?;
    if found.len() != count {
        return Err(InputError::new(&place, "which files are the bodies cannot be told")
            .found(if found.is_empty() { "no .obj, .glb or .gltf file".to_owned() } else { names(&found) })
            .expected(if count == 1 {
                "one file".to_owned()
            } else {
                format!("{count} files, in the order of their names")
            })
            .help("name them in a sidecar: file = \"NAME.obj\" in [[body]]"));
    }
    let mut files = Vec::new();
    for (number, file) in found.into_iter().enumerate() {
        files.push(match named(number) {
            Some(name) => place.join(name),
            None => {
                notes.push(format!("guessed: body {} is {}", number + 1, file.display()));
                file
            }
        });
    }
    Ok(files)
}

impl ShapeSource {
    /// What the sidecar's table and the folder say of body `number` (from 0) of `count`.
    pub(crate) fn of(
        folder: &Path,
        blamed: &Path,
        number: usize,
        count: usize,
        file: PathBuf,
        table: &BodyTable,
        notes: &mut Vec<String>,
    ) -> Result<Self, InputError> {
        let kind = ModelKind::of(&file)?;
        let body = format!("body {}", number + 1);
        let photometry = table.photometry.as_ref().map(|table| table.resolve(blamed, &body)).transpose()?;
        let mut guess = |what: String| notes.push(format!("guessed: {body} {what}"));
        let albedo = folder.join("body").join("albedo");
        let texture = match &table.texture {
            Some(name) => Some(albedo.join(name)),
            None => {
                let mut found = files_of(&albedo, &TEXTURE_EXTENSIONS)?;
                match (count, found.len()) {
                    (_, 0) => None,
                    (1, 1) => {
                        guess(format!("has the texture {}", found[0].display()));
                        found.pop()
                    }
                    _ => {
                        guess(format!(
                            "has no texture: which of {} is its own cannot be told",
                            names(&found)
                        ));
                        None
                    }
                }
            }
        };
        let scale = table.scale().unwrap_or_else(|| {
            guess("has set_scale = 1".into());
            DVec3::ONE
        });
        let axes = table.axes.unwrap_or(Axes::Blender);
        if table.axes.is_none() && kind == ModelKind::Gltf {
            guess("has the axes of Blender's import: glTF's (x, y, z) is the object's (x, -z, y)".into());
        }
        // CORTO shades an OBJ smoothly after its import; `Auto` keeps an OBJ's own normals.
        let shading = table.shading.unwrap_or(Shading::Auto);
        if photometry.is_none() {
            guess(match &texture {
                Some(_) => "is Lambertian, with the texture's own values as albedo".into(),
                None => format!("is Lambertian, of albedo {DEFAULT_ALBEDO}"),
            });
        }
        if texture.is_some() && !files_of(&folder.join("body").join("uv data"), &["json"])?.is_empty() {
            notes.push(format!("{body}: body/uv data is not read; the texture lies as the mesh has it"));
        }
        Ok(Self {
            file,
            kind,
            texture,
            scale,
            axes,
            shading,
            photometry,
            reference_semi_axes_m: table.reference_semi_axes_m.map(DVec3::from_array),
        })
    }

    /// Roles and hashes of the files that the body is made of.
    pub(crate) fn inputs(&self) -> Result<Vec<(String, String)>, InputError> {
        let mut inputs = vec![(String::new(), hash_file(&self.file)?)];
        for external in external_files(&self.file)?.into_iter().chain(self.texture.clone()) {
            let name = external.file_name().unwrap_or_default().to_string_lossy().into_owned();
            inputs.push((format!(": {name}"), hash_file(&external)?));
        }
        Ok(inputs)
    }
}

/// Loads a body: file, texture, then Blender's axes, `set_scale` and metres.
pub(crate) fn load_shape(
    name: &str,
    source: &ShapeSource,
    scale_m_per_bu: f64,
    notes: &mut Vec<String>,
) -> Result<BodyParts, InputError> {
    let (mut shape, layout) = match source.kind {
        ModelKind::Gltf => {
            let shape = load_body(&source.file)?;
            let layout = match shape.has_texture_coordinates() {
                true => Layout::Coordinates,
                false => Layout::LongitudeLatitude,
            };
            (shape, layout)
        }
        ModelKind::Obj | ModelKind::Icq | ModelKind::Dsk => {
            let loaded = load_mesh(&source.file)?;
            notes.extend(loaded.notes.iter().map(|note| format!("{name}: {note}")));
            let mut shape = loaded.body;
            // CORTO has Blender shade an OBJ smoothly, which normals of its own do too.
            if source.shading == Shading::Auto && shape.surfaces.iter().any(|surface| surface.flat) {
                shape.smooth_normals();
            }
            (shape, loaded.layout)
        }
    };
    source.shading.apply(&mut shape);
    let mut albedo = DEFAULT_ALBEDO;
    if let Some(texture) = &source.texture {
        albedo = shape.paint(texture, layout)?;
        if layout == Layout::LongitudeLatitude {
            notes.push(format!(
                "{name}: its mesh has no texture coordinates; the texture is laid by longitude and latitude \
                 (0 deg in the middle, north up)"
            ));
        }
    }
    let turn = match (source.kind, source.axes) {
        // Columns: where the file's x, y and z axes go.
        (ModelKind::Gltf, Axes::Blender) => DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::NEG_Y),
        _ => DMat3::IDENTITY,
    };
    shape.transform(turn, source.scale * scale_m_per_bu);
    let photometry =
        source.photometry.unwrap_or_else(|| Photometry::new(Lambert, PhaseFunction::CONSTANT, Some(albedo)));
    Ok(BodyParts {
        name: name.to_owned(),
        shape,
        photometry,
        reference_semi_axes_m: source.reference_semi_axes_m,
        // Blender renders frames in which a body is elsewhere, and its users' sequences have them.
        may_be_behind: true,
    })
}
