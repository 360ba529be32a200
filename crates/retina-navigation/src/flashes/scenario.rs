//! The experiment's file, schema `retina.flashes/1`.

use std::path::{Path, PathBuf};

use retina_batch::{FrameRange, Selection};
use retina_files::{InputError, hash_bytes, hash_file, read_text};
use serde::Deserialize;

use super::detect::FlashOptions;
use crate::experiment::Campaign;

/// The experiment.
#[derive(Debug, Clone)]
pub struct FlashScenario {
    /// The scene with its flashes; its compensation is replaced.
    pub scene: PathBuf,
    /// Which of its frames.
    pub selection: Selection,
    /// Seed of the bench.
    pub seed: u64,
    /// The bench's calibration; it is measured where absent.
    pub calibration: Option<PathBuf>,
    /// How it is measured.
    pub campaign: Campaign,
    /// Share of the charge above full well that runs along the sensor's columns.
    pub blooming: f64,
    /// Width of the bins of the rates.
    pub bin_magnitudes: f64,
    /// The detector.
    pub detector: FlashOptions,
    /// Hash of the file and of all that it names.
    pub hash: String,
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
    #[serde(default)]
    blooming: f64,
    #[serde(default = "half")]
    bin_magnitudes: f64,
    #[serde(default)]
    detector: FlashOptions,
}

fn each() -> usize {
    1
}

fn half() -> f64 {
    0.5
}

impl FlashOptions {
    /// Refuses values that a detector cannot have; `path` is whom an error blames, `place` says where a key stands.
    ///
    /// # Errors
    /// A value out of its range.
    pub fn check(&self, path: &Path, place: impl Fn(&str) -> String) -> Result<(), InputError> {
        let margin = |value: f64| (0.0..1e4).contains(&value);
        for (key, value, fits, expected) in [
            (
                "false_alarms_per_frame",
                self.false_alarms_per_frame,
                (1e-12..=1e3).contains(&self.false_alarms_per_frame),
                "1e-12 to 1000",
            ),
            ("limb_margin_px", self.limb_margin_px, margin(self.limb_margin_px), "0 or more"),
            (
                "terminator_margin_px",
                self.terminator_margin_px,
                margin(self.terminator_margin_px),
                "0 or more",
            ),
            ("relief", self.relief, (0.0..1.0).contains(&self.relief), "0 to 1, of the radius"),
            ("mesh_px", self.mesh_px as f64, (16..=1024).contains(&self.mesh_px), "16 to 1024"),
        ] {
            if !fits {
                return Err(InputError::new(path, "the value does not fit")
                    .at(place(key))
                    .found(value)
                    .expected(expected));
            }
        }
        Ok(())
    }
}

impl FlashScenario {
    /// Reads and checks a scenario.
    ///
    /// # Errors
    /// It does not fit.
    pub fn read(path: &Path) -> Result<Self, InputError> {
        let file: File = retina_files::read_toml(path)?;
        if file.schema != "retina.flashes/1" {
            return Err(InputError::new(path, "is not a scenario of flashes")
                .at("key `schema`")
                .found(format!("`{}`", file.schema))
                .expected("`retina.flashes/1`"));
        }
        let c = &file.campaign;
        for (key, value, fits, expected) in [
            ("every", file.every as f64, file.every > 0, "1 or more"),
            ("campaign.exposures", c.exposures as f64, (3..=999).contains(&c.exposures), "3 to 999"),
            ("campaign.points", c.points as f64, (3..=5000).contains(&c.points), "3 to 5000"),
            ("blooming", file.blooming, (0.0..=1.0).contains(&file.blooming), "0 to 1"),
            (
                "bin_magnitudes",
                file.bin_magnitudes,
                (0.01..=10.0).contains(&file.bin_magnitudes),
                "0.01 to 10",
            ),
        ] {
            if !fits {
                return Err(InputError::new(path, "the value does not fit")
                    .at(format!("key `{key}`"))
                    .found(value)
                    .expected(expected));
            }
        }
        file.detector.check(path, |key| format!("key `detector.{key}`"))?;
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
            blooming: file.blooming,
            bin_magnitudes: file.bin_magnitudes,
            detector: file.detector,
            hash: hash_bytes(text.as_bytes()),
        })
    }
}
