//! The experiment's file, schema `retina.full-disk/1`.

use std::path::{Path, PathBuf};

use retina_files::{InputError, read_schema};
use serde::Deserialize;
use serde::de::IgnoredAny;

use super::filter::FilterOptions;
use crate::experiment::{Campaign, ChainKeys, ChainScenario, check_values, each};

/// The experiment.
#[derive(Debug, Clone)]
pub struct FullDiskScenario {
    /// The scene that is rendered, the bench and its calibration.
    pub chain: ChainScenario,
    /// Share of the full well that the screen's brightest light fills.
    pub full_well_share: f64,
    /// What is known of the limb.
    pub limb: LimbTable,
    /// Mesh whose silhouette is fitted instead of the reference ellipsoid's outline.
    pub silhouette: Option<PathBuf>,
    /// The filter.
    pub filter: FilterOptions,
}

/// What is known of the limb and the attitude.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LimbTable {
    /// Mean height of the seen limb above the reference surface, m.
    pub height_m: f64,
    /// Its standard deviation, m.
    pub height_sigma_m: f64,
    /// Standard deviation per axis of the known attitude in a camera image, arcsec; the setup's jitter where absent.
    pub pointing_sigma_arcsec: Option<f64>,
    /// Mesh of the body, relative to the scenario: its silhouette is fitted. Without it, the outline of the reference
    /// ellipsoid is.
    pub silhouette: Option<PathBuf>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    #[serde(rename = "schema")]
    _schema: IgnoredAny,
    scene: PathBuf,
    #[serde(default = "each")]
    every: usize,
    frames: Option<String>,
    #[serde(default)]
    seed: u64,
    calibration: Option<PathBuf>,
    #[serde(default)]
    campaign: Campaign,
    #[serde(default = "share")]
    full_well_share: f64,
    #[serde(default)]
    limb: LimbTable,
    #[serde(default)]
    filter: FilterOptions,
}

fn share() -> f64 {
    0.8
}

impl FullDiskScenario {
    /// Reads and checks a scenario.
    ///
    /// # Errors
    /// It does not fit.
    pub fn read(path: &Path) -> Result<Self, InputError> {
        let file: File = read_schema(path, "retina.full-disk/1", "a full-disk scenario")?;
        let (f, l) = (&file.filter, &file.limb);
        let positive = |v: f64| v > 0.0 && v.is_finite();
        let terrain_time_h = f.terrain_time_h.unwrap_or(1.0);
        let pointing = l.pointing_sigma_arcsec.unwrap_or(0.0);
        check_values(
            path,
            &[
                (
                    "full_well_share",
                    file.full_well_share,
                    (0.01..=0.95).contains(&file.full_well_share),
                    "0.01 to 0.95",
                ),
                ("limb.height_m", l.height_m, l.height_m.is_finite(), "a finite number"),
                (
                    "limb.height_sigma_m",
                    l.height_sigma_m,
                    (0.0..1e9).contains(&l.height_sigma_m),
                    "0 or more",
                ),
                ("limb.pointing_sigma_arcsec", pointing, (0.0..3600.0).contains(&pointing), "0 to 3600"),
                (
                    "filter.initial_position_3_sigma_km",
                    f.initial_position_3_sigma_km,
                    positive(f.initial_position_3_sigma_km),
                    "above 0",
                ),
                (
                    "filter.initial_velocity_3_sigma_m_s",
                    f.initial_velocity_3_sigma_m_s,
                    positive(f.initial_velocity_3_sigma_m_s),
                    "above 0",
                ),
                (
                    "filter.acceleration_sigma_m_s2",
                    f.acceleration_sigma_m_s2,
                    positive(f.acceleration_sigma_m_s2),
                    "above 0",
                ),
                (
                    "filter.acceleration_time_h",
                    f.acceleration_time_h,
                    positive(f.acceleration_time_h),
                    "above 0",
                ),
                (
                    "filter.pressure_area_m2_kg",
                    f.pressure_area_m2_kg,
                    (0.0..1e3).contains(&f.pressure_area_m2_kg),
                    "0 or more",
                ),
                ("filter.terrain_tilt_deg", f.terrain_tilt_deg, positive(f.terrain_tilt_deg), "above 0"),
                ("filter.terrain_roll_deg", f.terrain_roll_deg, positive(f.terrain_roll_deg), "above 0"),
                ("filter.terrain_time_h", terrain_time_h, positive(terrain_time_h), "above 0"),
                ("filter.settle_h", f.settle_h, (0.0..1e6).contains(&f.settle_h), "0 or more"),
            ],
        )?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let silhouette = file.limb.silhouette.as_ref().map(|mesh| folder.join(mesh));
        if let Some(missing) = silhouette.as_ref().filter(|mesh| !mesh.is_file()) {
            return Err(InputError::new(missing, "is not there")
                .expected("the mesh of the body")
                .help("mend the key `limb.silhouette`, which is relative to the scenario, or leave it out"));
        }
        let keys = ChainKeys {
            scene: file.scene,
            every: file.every,
            frames: file.frames,
            seed: file.seed,
            calibration: file.calibration,
            campaign: file.campaign,
        };
        Ok(Self {
            chain: ChainScenario::new(path, keys)?,
            full_well_share: file.full_well_share,
            silhouette,
            limb: file.limb,
            filter: file.filter,
        })
    }
}
