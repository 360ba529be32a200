//! What a campaign of points was made with, so that it can be made again with one thing changed.

use std::path::Path;

use retina_bench::BenchError;
use retina_files::{InputError, nearest};
use retina_formats::{Channel, TableKind};
use retina_geometry::Setup;
use retina_image::Centroid;
use serde::{Deserialize, Serialize};

use crate::{Effect, Facility, PointsOptions, TemperatureProfile};

/// A campaign of points as `campaign.json` keeps it (key `options`). The optics have their default detail.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PointsRecord {
    /// Seed of patterns and noise.
    pub seed: u64,
    /// Effects as `--effect` writes them.
    pub effects: Vec<String>,
    /// Exposures.
    pub exposures: usize,
    /// Points in each.
    pub points: usize,
    /// Between exposures, s.
    pub interval_s: f64,
    /// The bench's temperature: `constant`, `warm-up` or `cycle`.
    pub temperature: String,
    /// Exposure time of the faintest group of counts, s; that of well exposed points where absent.
    pub exposure_s: Option<f64>,
    /// Sub-pixels that are lit: `r`, `g`, `b` or `w`.
    pub channel: String,
    /// Digital counts; every 0.75 mag where empty.
    pub counts: Vec<u8>,
    /// The estimator of centroids: `windowed` or `moments`.
    pub centroid: String,
    /// By how much the camera is turned about its boresight, deg.
    #[serde(default)]
    pub camera_roll_deg: f64,
}

const TEMPERATURES: [(&str, TemperatureProfile); 3] = [
    ("constant", TemperatureProfile::Constant),
    ("warm-up", TemperatureProfile::WarmUp),
    ("cycle", TemperatureProfile::Cycle),
];
const CENTROIDS: [(&str, Centroid); 2] = [("windowed", Centroid::Windowed), ("moments", Centroid::Moments)];

fn name_of<T: PartialEq>(list: &[(&'static str, T)], value: &T) -> &'static str {
    list.iter().find(|(_, own)| own == value).map_or(list[0].0, |(name, _)| name)
}

fn named<T: Copy>(list: &[(&'static str, T)], key: &str, name: &str) -> Result<T, InputError> {
    list.iter().find(|(own, _)| *own == name).map(|(_, value)| *value).ok_or_else(|| {
        let names = list.iter().map(|(own, _)| *own);
        let error = InputError::new(Path::new("campaign.json"), "the value is not known")
            .at(format!("key `options.{key}`"))
            .found(format!("`{name}`"))
            .expected(names.clone().collect::<Vec<_>>().join(", "));
        match nearest(name, names) {
            Some(near) => error.help(format!("did you mean `{near}`?")),
            None => error,
        }
    })
}

impl PointsRecord {
    /// Of a facility and the options of a campaign on it.
    pub fn of(facility: &Facility, options: &PointsOptions) -> Self {
        Self {
            seed: facility.seed,
            effects: facility.effects.iter().map(|effect| effect.text.clone()).collect(),
            exposures: options.exposures,
            points: options.points,
            interval_s: options.interval_s,
            temperature: name_of(&TEMPERATURES, &options.temperature).to_owned(),
            exposure_s: options.exposure_s,
            channel: options.channel.letter().to_owned(),
            counts: options.counts.clone(),
            centroid: name_of(&CENTROIDS, &options.centroid).to_owned(),
            camera_roll_deg: facility.wrong.camera_roll_rad.to_degrees(),
        }
    }

    /// The options of the campaign.
    ///
    /// # Errors
    /// A name is not known.
    pub fn options(&self) -> Result<PointsOptions, InputError> {
        let channel = Channel::ALL.map(|channel| (channel.letter(), channel));
        Ok(PointsOptions {
            exposures: self.exposures,
            points: self.points,
            interval_s: self.interval_s,
            temperature: named(&TEMPERATURES, "temperature", &self.temperature)?,
            exposure_s: self.exposure_s,
            channel: named(&channel, "channel", &self.channel)?,
            counts: self.counts.clone(),
            centroid: named(&CENTROIDS, "centroid", &self.centroid)?,
            ..PointsOptions::default()
        })
    }

    /// The facility of the campaign.
    ///
    /// # Errors
    /// An effect is not known, or not of points; the facility cannot be built.
    pub fn facility(&self, setup: &Setup) -> Result<Facility, BenchError> {
        let effects: Vec<Effect> =
            self.effects.iter().map(|text| Effect::parse(text)).collect::<Result<_, _>>()?;
        let length_s = self.options()?.length_s();
        let mut facility = Facility::new(setup, &effects, TableKind::Points, length_s, self.seed)?;
        facility.wrong.camera_roll_rad = self.camera_roll_deg.to_radians();
        Ok(facility)
    }

    /// The same campaign under another condition, if the bench can be brought there: the actions are those that the
    /// workbench proposes. The noise and the places of the points are others.
    pub fn under(&self, action: &str) -> Option<Self> {
        let mut out = Self { seed: self.seed.wrapping_add(1), ..self.clone() };
        match action {
            "camera_roll" => out.camera_roll_deg += 90.0,
            "temperature_cycle" => {
                // Two periods of 90 minutes over the campaign.
                out.temperature = "cycle".to_owned();
                out.interval_s = 2.0 * 5400.0 / out.exposures.max(1) as f64;
            }
            "exposure_s" | "exposure_time" => out.exposure_s = Some(0.25 * out.exposure_s?),
            "repeat" => out.exposures = out.exposures.max(8),
            _ => return None,
        }
        Some(out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record() -> PointsRecord {
        PointsRecord {
            seed: 3,
            effects: vec!["drift=60arcsec/h".to_owned()],
            exposures: 40,
            points: 50,
            interval_s: 60.0,
            temperature: "warm-up".to_owned(),
            exposure_s: Some(0.08),
            channel: "w".to_owned(),
            counts: vec![60, 34],
            centroid: "moments".to_owned(),
            camera_roll_deg: 0.0,
        }
    }

    #[test]
    fn a_campaign_is_what_its_record_says() {
        let setup =
            retina_files::parse_toml(Path::new("wide"), include_str!("../../assets/setups/wide-fov.toml"));
        let facility = record().facility(&setup.unwrap()).unwrap();
        assert_eq!(PointsRecord::of(&facility, &record().options().unwrap()), record());
    }

    #[test]
    fn conditions_change_one_thing() {
        assert_eq!(record().under("camera_roll").unwrap().camera_roll_deg, 90.0);
        let cycle = record().under("temperature_cycle").unwrap();
        assert_eq!(cycle.options().unwrap().length_s(), 10_800.0);
        assert_eq!(cycle.temperature, "cycle");
        assert_eq!(record().under("magnification"), None);
    }

    #[test]
    fn an_unknown_name_is_refused() {
        let said =
            PointsRecord { centroid: "moment".to_owned(), ..record() }.options().unwrap_err().to_string();
        assert!(said.contains("key `options.centroid`") && said.contains("found `moment`"), "{said}");
    }
}
