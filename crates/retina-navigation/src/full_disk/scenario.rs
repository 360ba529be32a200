//! The experiment's file, schema `retina.full-disk/1`.

use std::path::{Path, PathBuf};

use retina_batch::{FrameRange, Selection};
use retina_files::{InputError, hash_bytes, hash_file, read_text};
use serde::Deserialize;

use super::filter::FilterOptions;
use crate::experiment::Campaign;

/// The experiment.
#[derive(Debug, Clone)]
pub struct FullDiskScenario {
    /// The scene that is rendered; its compensation is replaced.
    pub scene: PathBuf,
    /// Which of its frames.
    pub selection: Selection,
    /// Seed of the bench.
    pub seed: u64,
    /// The bench's calibration; it is measured where absent.
    pub calibration: Option<PathBuf>,
    /// How it is measured.
    pub campaign: Campaign,
    /// Share of the full well that the screen's brightest light fills.
    pub full_well_share: f64,
    /// What is known of the limb.
    pub limb: LimbTable,
    /// The filter.
    pub filter: FilterOptions,
    /// Hash of the file and of all that it names.
    pub hash: String,
}

/// What is known of the limb and the attitude.
#[derive(Debug, Clone, Copy, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LimbTable {
    /// Mean height of the seen limb above the reference surface, m.
    pub height_m: f64,
    /// Its standard deviation, m.
    pub height_sigma_m: f64,
    /// Standard deviation per axis of the known attitude in a camera image, arcsec; the setup's jitter where absent.
    pub pointing_sigma_arcsec: Option<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    schema: String,
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

fn each() -> usize {
    1
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
        let file: File = retina_files::read_toml(path)?;
        if file.schema != "retina.full-disk/1" {
            return Err(InputError::new(path, "is not a full-disk scenario")
                .at("key `schema`")
                .found(format!("`{}`", file.schema))
                .expected("`retina.full-disk/1`"));
        }
        let (f, l, c) = (&file.filter, &file.limb, &file.campaign);
        let positive = |v: f64| v > 0.0 && v.is_finite();
        let pointing = l.pointing_sigma_arcsec.unwrap_or(0.0);
        for (key, value, fits, expected) in [
            ("every", file.every as f64, file.every > 0, "1 or more"),
            ("campaign.exposures", c.exposures as f64, (3..=999).contains(&c.exposures), "3 to 999"),
            ("campaign.points", c.points as f64, (3..=5000).contains(&c.points), "3 to 5000"),
            (
                "full_well_share",
                file.full_well_share,
                (0.01..=0.95).contains(&file.full_well_share),
                "0.01 to 0.95",
            ),
            ("limb.height_m", l.height_m, l.height_m.is_finite(), "a finite number"),
            ("limb.height_sigma_m", l.height_sigma_m, (0.0..1e9).contains(&l.height_sigma_m), "0 or more"),
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
            ("filter.acceleration_time_h", f.acceleration_time_h, positive(f.acceleration_time_h), "above 0"),
            ("filter.terrain_time_h", f.terrain_time_h, positive(f.terrain_time_h), "above 0"),
            ("filter.settle_h", f.settle_h, (0.0..1e6).contains(&f.settle_h), "0 or more"),
        ] {
            if !fits {
                return Err(InputError::new(path, "the value does not fit")
                    .at(format!("key `{key}`"))
                    .found(value)
                    .expected(expected));
            }
        }
        let range = match &file.frames {
            None => None,
            Some(text) => Some(
                text.parse::<FrameRange>()
                    .map_err(|error| InputError::new(path, error).at("key `frames`"))?,
            ),
        };
        let folder = path.parent().unwrap_or(Path::new(""));
        let scene = folder.join(&file.scene);
        let calibration = file.calibration.as_ref().map(|own| folder.join(own));
        let mut text = read_text(path)?;
        for named in [Some(&scene), calibration.as_ref()].into_iter().flatten() {
            text.push_str(&hash_file(named)?);
        }
        Ok(Self {
            scene,
            selection: Selection { range, every: Some(file.every), shard: None },
            seed: file.seed,
            calibration,
            campaign: file.campaign,
            full_well_share: file.full_well_share,
            limb: file.limb,
            filter: file.filter,
            hash: hash_bytes(text.as_bytes()),
        })
    }
}
