//! The shape of `SCENE.toml`, schema `retina.scene/1`: keys and their types, nothing resolved.

use std::fmt;
use std::path::PathBuf;

use retina_model::Body;
use serde::de::value::MapAccessDeserializer;
use serde::de::{Error as _, IgnoredAny, MapAccess, Visitor};
use serde::{Deserialize, Deserializer};

use crate::PhotometryTable;

/// The whole file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SceneFile {
    #[serde(rename = "schema")]
    _schema: IgnoredAny,
    pub(crate) setup: PathBuf,
    pub(crate) trajectory: TrajectoryKey,
    #[serde(default)]
    pub(crate) radiance_scale: ScaleKey,
    /// For what is random; kept in the manifest.
    #[serde(default)]
    pub(crate) seed: u64,
    /// A frame without any body in view is meant.
    #[serde(default)]
    pub(crate) allow_empty_frames: bool,
    #[serde(default)]
    pub(crate) compensation: CompensationTable,
    #[serde(default)]
    pub(crate) body: Vec<BodyTable>,
    #[serde(default)]
    pub(crate) ephemeris: EphemerisTable,
    pub(crate) stars: Option<StarsTable>,
    pub(crate) flashes: Option<FlashesTable>,
    #[serde(default)]
    pub(crate) render: RenderTable,
    #[serde(default)]
    pub(crate) output: OutputTable,
}

/// A trajectory: the path of a table, or what generates one.
#[derive(Debug)]
pub(crate) enum TrajectoryKey {
    Path(PathBuf),
    Generated(Box<GeneratedTable>),
}

/// A generated trajectory.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct GeneratedTable {
    pub(crate) kind: GeneratorKind,
    pub(crate) frames: usize,
    // Of the halo.
    /// Time of the first frame, or of the middle one where `centred`.
    pub(crate) epoch: Option<String>,
    pub(crate) step_s: Option<f64>,
    pub(crate) jacobi: Option<f64>,
    pub(crate) centred: Option<bool>,
    // Of the deep-space poses.
    pub(crate) from: Option<String>,
    pub(crate) until: Option<String>,
    pub(crate) distance_au: Option<[f64; 2]>,
    pub(crate) greatest_latitude_deg: Option<f64>,
    pub(crate) least_sun_angle_deg: Option<f64>,
    pub(crate) planets: Option<Vec<String>>,
    pub(crate) seed: Option<u64>,
    // About one body; `epoch` and `step_s` as above.
    pub(crate) distance_m: Option<f64>,
    pub(crate) distances_m: Option<[f64; 2]>,
    pub(crate) closest_m: Option<f64>,
    pub(crate) speed_m_s: Option<f64>,
    pub(crate) period_h: Option<f64>,
    pub(crate) start_deg: Option<f64>,
    pub(crate) phase_deg: Option<f64>,
    pub(crate) phases_deg: Option<[f64; 2]>,
    pub(crate) direction: Option<[f64; 3]>,
    pub(crate) normal: Option<[f64; 3]>,
    pub(crate) sun_direction: Option<[f64; 3]>,
    pub(crate) sun_distance_au: Option<f64>,
    pub(crate) spin: Option<SpinTable>,
    // Of a spacecraft in kernels; `epoch` and `step_s` as above.
    pub(crate) observer: Option<String>,
    pub(crate) frame: Option<String>,
    pub(crate) axes: Option<[String; 3]>,
}

/// A body's steady rotation.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SpinTable {
    pub(crate) period_h: f64,
    #[serde(default)]
    pub(crate) pole_ra_deg: f64,
    #[serde(default = "north")]
    pub(crate) pole_dec_deg: f64,
    #[serde(default)]
    pub(crate) w_deg: f64,
}

fn north() -> f64 {
    90.0
}

/// What generates a trajectory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum GeneratorKind {
    LumioHalo,
    DeepSpace,
    Orbit,
    Flyby,
    PhaseSweep,
    Approach,
    Spice,
}

impl GeneratorKind {
    /// As it stands in the file.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::LumioHalo => "lumio-halo",
            Self::DeepSpace => "deep-space",
            Self::Orbit => "orbit",
            Self::Flyby => "flyby",
            Self::PhaseSweep => "phase-sweep",
            Self::Approach => "approach",
            Self::Spice => "spice",
        }
    }

    /// The keys that it has beside `kind` and `frames`.
    pub(crate) fn keys(self) -> &'static [&'static str] {
        match self {
            Self::LumioHalo => &["epoch", "step_s", "jacobi", "centred"],
            Self::DeepSpace => &[
                "from",
                "until",
                "distance_au",
                "greatest_latitude_deg",
                "least_sun_angle_deg",
                "planets",
                "seed",
            ],
            Self::Orbit => &[
                "epoch",
                "step_s",
                "distance_m",
                "period_h",
                "start_deg",
                "normal",
                "sun_direction",
                "sun_distance_au",
                "spin",
            ],
            Self::Flyby => &[
                "epoch",
                "step_s",
                "closest_m",
                "speed_m_s",
                "phase_deg",
                "direction",
                "normal",
                "sun_direction",
                "sun_distance_au",
                "spin",
            ],
            Self::PhaseSweep => &[
                "epoch",
                "step_s",
                "distance_m",
                "phases_deg",
                "normal",
                "sun_direction",
                "sun_distance_au",
                "spin",
            ],
            Self::Approach => &[
                "epoch",
                "step_s",
                "distances_m",
                "phase_deg",
                "normal",
                "sun_direction",
                "sun_distance_au",
                "spin",
            ],
            Self::Spice => &["epoch", "step_s", "observer", "frame", "axes"],
        }
    }
}

impl GeneratedTable {
    /// All keys but `kind` and `frames`, and whether they are given.
    pub(crate) fn given(&self) -> [(&'static str, bool); 27] {
        [
            ("epoch", self.epoch.is_some()),
            ("step_s", self.step_s.is_some()),
            ("jacobi", self.jacobi.is_some()),
            ("centred", self.centred.is_some()),
            ("from", self.from.is_some()),
            ("until", self.until.is_some()),
            ("distance_au", self.distance_au.is_some()),
            ("greatest_latitude_deg", self.greatest_latitude_deg.is_some()),
            ("least_sun_angle_deg", self.least_sun_angle_deg.is_some()),
            ("planets", self.planets.is_some()),
            ("seed", self.seed.is_some()),
            ("distance_m", self.distance_m.is_some()),
            ("distances_m", self.distances_m.is_some()),
            ("closest_m", self.closest_m.is_some()),
            ("speed_m_s", self.speed_m_s.is_some()),
            ("period_h", self.period_h.is_some()),
            ("start_deg", self.start_deg.is_some()),
            ("phase_deg", self.phase_deg.is_some()),
            ("phases_deg", self.phases_deg.is_some()),
            ("direction", self.direction.is_some()),
            ("normal", self.normal.is_some()),
            ("sun_direction", self.sun_direction.is_some()),
            ("sun_distance_au", self.sun_distance_au.is_some()),
            ("spin", self.spin.is_some()),
            ("observer", self.observer.is_some()),
            ("frame", self.frame.is_some()),
            ("axes", self.axes.is_some()),
        ]
    }
}

/// `[ephemeris]`.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct EphemerisTable {
    /// SPK files, relative to the scene; the analytical theories without any.
    pub(crate) kernels: Vec<PathBuf>,
}

/// `[stars]`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct StarsTable {
    #[serde(default = "faint_limit")]
    pub(crate) faintest_magnitude: f64,
    pub(crate) catalogue: Option<PathBuf>,
    #[serde(default = "yes")]
    pub(crate) planets: bool,
}

/// `[flashes]`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct FlashesTable {
    pub(crate) exposure_s: f64,
    pub(crate) body: Option<String>,
    pub(crate) seen_from_m: Option<f64>,
    pub(crate) table: Option<PathBuf>,
    pub(crate) number: Option<usize>,
    pub(crate) magnitudes: Option<[f64; 2]>,
    pub(crate) durations_s: Option<[f64; 2]>,
}

/// The paper's faint limit in the wide configuration (Fig. 7).
fn faint_limit() -> f64 {
    8.25
}

fn yes() -> bool {
    true
}

/// `"auto"` or a number.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) enum ScaleKey {
    #[default]
    Auto,
    Value(f64),
}

/// `[compensation]`.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct CompensationTable {
    /// Without the table nothing is compensated; with it, by the better of the two ways.
    #[serde(default = "direct")]
    pub(crate) mode: Compensation,
    /// Relative to the scene; by default the setup's own.
    pub(crate) calibration: Option<PathBuf>,
}

fn direct() -> Compensation {
    Compensation::Direct
}

/// How the facility's distortion is undone beforehand.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Compensation {
    /// Not at all: the screen shows K_f's image.
    #[default]
    None,
    /// An undistorted image is rendered and resampled through D.
    Resample,
    /// Each screen pixel's line of sight D(K_f^-1 R) is rendered.
    Direct,
}

impl Compensation {
    /// The name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Resample => "resample",
            Self::Direct => "direct",
        }
    }
}

/// `[[body]]`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct BodyTable {
    pub(crate) name: String,
    pub(crate) model: PathBuf,
    pub(crate) photometry: PhotometryTable,
    #[serde(default)]
    pub(crate) shading: Shading,
    pub(crate) reference_radius_m: Option<f64>,
    pub(crate) reference_semi_axes_m: Option<[f64; 3]>,
    #[serde(default)]
    pub(crate) may_be_behind: bool,
}

/// Which normals the light meets.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Shading {
    /// As the model says.
    #[default]
    Auto,
    /// Vertex normals averaged over the triangles.
    Smooth,
    /// Each triangle's own.
    Flat,
}

/// `[render]`.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RenderTable {
    #[serde(default)]
    pub(crate) quality: QualityName,
}

/// Name of a quality.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum QualityName {
    Draft,
    #[default]
    Default,
    Best,
}

impl Shading {
    /// Applies it to a body.
    pub fn apply(self, shape: &mut Body) {
        match self {
            Self::Auto => {}
            Self::Smooth => shape.smooth_normals(),
            Self::Flat => shape.surfaces.iter_mut().for_each(|surface| surface.flat = true),
        }
    }
}

/// `[output]`.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct OutputTable {
    #[serde(default)]
    pub(crate) radiance_exr: bool,
    #[serde(default)]
    pub(crate) layers: Vec<Layer>,
    #[serde(default)]
    pub(crate) quantisation: QuantisationName,
}

/// Name of a quantisation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum QuantisationName {
    Nearest,
    #[default]
    Diffused,
}

/// A by-product that goes into the EXR.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Layer {
    /// Depth along the boresight, m.
    Depth,
    /// Coverage, 0..1.
    Mask,
    /// Normal in the camera's frame, three channels.
    Normal,
    /// Incidence angle, deg.
    Incidence,
    /// Emission angle, deg.
    Emission,
    /// Phase angle, deg.
    Phase,
    /// 0 lit .. 1 dark.
    Shadow,
}

impl Layer {
    /// All of them.
    pub const ALL: [Self; 7] =
        [Self::Depth, Self::Mask, Self::Normal, Self::Incidence, Self::Emission, Self::Phase, Self::Shadow];

    /// Its name in a scene.
    pub fn name(self) -> &'static str {
        ["depth", "mask", "normal", "incidence", "emission", "phase", "shadow"][self as usize]
    }

    /// From its name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|layer| layer.name() == name)
    }

    /// The EXR channels of the layer, as the renderer names its planes.
    pub fn channels(self) -> &'static [&'static str] {
        match self {
            Self::Depth => &["depth"],
            Self::Mask => &["mask"],
            Self::Normal => &["normal.x", "normal.y", "normal.z"],
            Self::Incidence => &["incidence_deg"],
            Self::Emission => &["emission_deg"],
            Self::Phase => &["phase_deg"],
            Self::Shadow => &["shadow"],
        }
    }
}

impl<'de> Deserialize<'de> for TrajectoryKey {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Key;
        impl<'de> Visitor<'de> for Key {
            type Value = TrajectoryKey;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(
                    "the path of a trajectory table, or { kind = \"lumio-halo\", frames = .., step_s = .. }, or { kind = \"deep-space\", frames = .. }",
                )
            }
            fn visit_str<E>(self, path: &str) -> Result<Self::Value, E> {
                Ok(TrajectoryKey::Path(path.into()))
            }
            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Self::Value, A::Error> {
                let table = GeneratedTable::deserialize(MapAccessDeserializer::new(map))?;
                Ok(TrajectoryKey::Generated(Box::new(table)))
            }
        }
        deserializer.deserialize_any(Key)
    }
}

impl<'de> Deserialize<'de> for ScaleKey {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Key;
        impl Visitor<'_> for Key {
            type Value = ScaleKey;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("\"auto\" or a number above 0 for `radiance_scale`")
            }
            fn visit_str<E: serde::de::Error>(self, text: &str) -> Result<Self::Value, E> {
                if text == "auto" {
                    Ok(ScaleKey::Auto)
                } else {
                    Err(E::invalid_value(serde::de::Unexpected::Str(text), &self))
                }
            }
            fn visit_f64<E: serde::de::Error>(self, value: f64) -> Result<Self::Value, E> {
                if value.is_finite() && value > 0.0 {
                    Ok(ScaleKey::Value(value))
                } else {
                    Err(E::invalid_value(serde::de::Unexpected::Float(value), &self))
                }
            }
            fn visit_i64<E: serde::de::Error>(self, value: i64) -> Result<Self::Value, E> {
                self.visit_f64(value as f64)
            }
        }
        deserializer.deserialize_any(Key).map_err(D::Error::custom)
    }
}
