//! The sidecar, schema `retina.corto-sidecar/1`: what CORTO keeps in its users' scripts.

use std::path::{Path, PathBuf};

use glam::DVec3;
use retina_files::{InputError, parse_schema, read_text};
use retina_scene::{PhotometryTable, Shading};
use serde::Deserialize;
use serde::de::IgnoredAny;

/// The whole file; every key has a default or a guess.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Sidecar {
    #[serde(rename = "schema")]
    _schema: IgnoredAny,
    /// Name in the scenario's folder `scene`.
    pub(crate) scene: Option<PathBuf>,
    /// Name in the scenario's folder `geometry`.
    pub(crate) geometry: Option<PathBuf>,
    /// Metres in a Blender unit.
    pub(crate) scale_m_per_bu: Option<f64>,
    /// In the order of `body_1` to `body_n`.
    #[serde(default)]
    pub(crate) body: Vec<BodyTable>,
}

/// `[[body]]`.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct BodyTable {
    pub(crate) name: Option<String>,
    /// Name in the scenario's folder `body/shape`.
    pub(crate) file: Option<PathBuf>,
    /// What the script gives to `set_scale`.
    pub(crate) set_scale: Option<ScaleKey>,
    pub(crate) axes: Option<Axes>,
    /// Name in the scenario's folder `body/albedo`.
    pub(crate) texture: Option<PathBuf>,
    pub(crate) photometry: Option<PhotometryTable>,
    pub(crate) shading: Option<Shading>,
    /// Blender units would change with the scale: the reference ellipsoid is in metres.
    pub(crate) reference_semi_axes_m: Option<[f64; 3]>,
}

/// One factor, or one along each axis.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(untagged, expecting = "a number, or a list [x, y, z] of three")]
pub(crate) enum ScaleKey {
    All(f64),
    Each([f64; 3]),
}

/// How the file's axes become the object's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Axes {
    /// As Blender's importers do: glTF (x, y, z) becomes (x, -z, y), OBJ stays.
    Blender,
    /// They are the object's.
    File,
}

impl Sidecar {
    pub(crate) fn read(path: &Path) -> Result<(Self, String), InputError> {
        let text = read_text(path)?;
        let sidecar: Self =
            parse_schema(path, &text, "retina.corto-sidecar/1", "a sidecar of a CORTO scenario")?;
        if let Some(scale) = sidecar.scale_m_per_bu
            && !(scale.is_finite() && (1e-9..=1e9).contains(&scale))
        {
            return Err(InputError::new(path, "the size of a Blender unit is out of its range")
                .at("key `scale_m_per_bu`")
                .found(scale)
                .expected("metres, 1e-9 to 1e9"));
        }
        for (number, body) in sidecar.body.iter().enumerate() {
            let place = |key: &str| format!("body {}, key `{key}`", number + 1);
            if let Some(scale) = body.scale().filter(|s| !(s.is_finite() && s.min_element() > 0.0)) {
                return Err(InputError::new(path, "the scale leaves the body without extent")
                    .at(place("set_scale"))
                    .found(scale)
                    .expected("factors above 0"));
            }
        }
        Ok((sidecar, text))
    }
}

impl BodyTable {
    pub(crate) fn scale(&self) -> Option<DVec3> {
        self.set_scale.map(|scale| match scale {
            ScaleKey::All(factor) => DVec3::splat(factor),
            ScaleKey::Each(factors) => DVec3::from_array(factors),
        })
    }
}
