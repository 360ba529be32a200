//! The experiment's file, schema `retina.flashes/1`.

use std::path::{Path, PathBuf};

use retina_files::{InputError, read_schema};
use serde::Deserialize;
use serde::de::IgnoredAny;

use crate::experiment::{Campaign, ChainKeys, ChainScenario, check_values, each};
use retina_navigation::flashes::FlashOptions;

/// The experiment.
#[derive(Debug, Clone)]
pub struct FlashScenario {
    /// The scene with its flashes, the bench and its calibration.
    pub chain: ChainScenario,
    /// Share of the charge above full well that runs along the sensor's columns.
    pub blooming: f64,
    /// Width of the bins of the rates.
    pub bin_magnitudes: f64,
    /// The detector.
    pub detector: FlashOptions,
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
    #[serde(default)]
    blooming: f64,
    #[serde(default = "half")]
    bin_magnitudes: f64,
    #[serde(default)]
    detector: FlashOptions,
}

fn half() -> f64 {
    0.5
}

impl FlashScenario {
    /// Reads and checks a scenario.
    ///
    /// # Errors
    /// It does not fit.
    pub fn read(path: &Path) -> Result<Self, InputError> {
        let file: File = read_schema(path, "retina.flashes/1", "a scenario of flashes")?;
        let bins = file.bin_magnitudes;
        check_values(
            path,
            &[
                ("blooming", file.blooming, (0.0..=1.0).contains(&file.blooming), "0 to 1"),
                ("bin_magnitudes", bins, (0.01..=10.0).contains(&bins), "0.01 to 10"),
            ],
        )?;
        file.detector.check(path, |key| format!("key `detector.{key}`"))?;
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
            blooming: file.blooming,
            bin_magnitudes: file.bin_magnitudes,
            detector: file.detector,
        })
    }
}
