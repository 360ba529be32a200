//! The transfer of a scenario: its table in the file, and what it comes to.

use std::path::Path;

use retina_files::InputError;
use retina_sky::planets::Planet;
use retina_sky::time::parse_epoch;
use serde::{Deserialize, Serialize};

use super::scenario::{Images, refuse};

/// Which images a transfer's filter is run on, besides the Monte Carlo.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TransferImages {
    /// None.
    None,
    /// As [`Images::Ideal`].
    Ideal,
    /// As [`Images::Bench`].
    Bench,
}

impl TransferImages {
    /// How they are taken, where there are any.
    pub fn taken(self) -> Option<Images> {
        match self {
            Self::None => None,
            Self::Ideal => Some(Images::Ideal),
            Self::Bench => Some(Images::Bench),
        }
    }
}

/// A transfer that ends near Mars.
#[derive(Debug, Clone)]
pub struct Transfer {
    /// Epoch at its end, TDB seconds since J2000.
    pub arrival_tdb_s: f64,
    /// Its length, s.
    pub length_s: f64,
    /// Between sessions, s.
    pub session_s: f64,
    /// Images of each session, half of them of either planet.
    pub images_per_session: usize,
    /// Between images, s.
    pub interval_s: f64,
    /// Monte Carlo samples.
    pub samples: usize,
    /// The images of one more run of the filter.
    pub images: TransferImages,
    /// How many of each session's images are taken for it, evenly among them.
    pub imaged_per_session: usize,
    /// Planets that may be looked at.
    pub planets: Vec<Planet>,
    /// Least angle between a planet and the Sun, rad.
    pub sun_exclusion_rad: f64,
    /// Standard deviation of a planet's line of sight per axis, rad; absent: what the random poses gave.
    pub line_of_sight_sigma_rad: Option<f64>,
    /// From Mars to the spacecraft at the end, ICRF, m.
    pub arrival_offset_m: [f64; 3],
    /// Velocity relative to Mars at the end, ICRF, m/s.
    pub arrival_velocity_m_s: [f64; 3],
    /// Standard deviations per axis at the beginning: m, m/s.
    pub initial_sigma: [f64; 2],
    /// Reflectivity coefficient times area over mass, m^2/kg.
    pub pressure_area_m2_kg: f64,
    /// Standard deviation per axis of the unknown acceleration, m/s^2.
    pub acceleration_sigma_m_s2: f64,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct TransferFile {
    arrival: String,
    days: f64,
    #[serde(default = "ten")]
    session_days: f64,
    #[serde(default = "images")]
    images_per_session: usize,
    #[serde(default = "interval")]
    interval_s: f64,
    #[serde(default = "samples")]
    pub(super) samples: usize,
    #[serde(default = "none")]
    pub(super) images: TransferImages,
    #[serde(default = "four")]
    imaged_per_session: usize,
    planets: Vec<String>,
    #[serde(default = "exclusion")]
    sun_exclusion_deg: f64,
    pub(super) line_of_sight_sigma_arcsec: Option<f64>,
    arrival_offset_km: [f64; 3],
    arrival_velocity_m_s: [f64; 3],
    initial_position_3_sigma_km: f64,
    initial_velocity_3_sigma_m_s: f64,
    pressure_area_m2_kg: f64,
    acceleration_sigma_m_s2: f64,
}

fn ten() -> f64 {
    10.0
}
fn images() -> usize {
    72
}
fn interval() -> f64 {
    100.0
}
fn samples() -> usize {
    100
}
fn none() -> TransferImages {
    TransferImages::None
}
fn four() -> usize {
    4
}
fn exclusion() -> f64 {
    20.0
}

impl TransferFile {
    /// The transfer, checked.
    pub(super) fn read(&self, path: &Path) -> Result<Transfer, InputError> {
        let arrival_tdb_s = parse_epoch(&self.arrival)
            .map_err(|error| InputError::new(path, error.to_string()).at("key `transfer.arrival`"))?;
        let positive = |v: f64| v > 0.0 && v.is_finite();
        let session_length_s = self.images_per_session as f64 * self.interval_s;
        for (key, value, fits, expected) in [
            ("days", self.days, (1.0..=3650.0).contains(&self.days), "1 to 3650"),
            (
                "session_days",
                self.session_days,
                positive(self.session_days) && self.session_days <= self.days,
                "above 0, at most `days`",
            ),
            ("images_per_session", self.images_per_session as f64, self.images_per_session >= 2, "2 or more"),
            (
                "imaged_per_session",
                self.imaged_per_session as f64,
                (2..=self.images_per_session).contains(&self.imaged_per_session),
                "2 to `images_per_session`",
            ),
            (
                "interval_s",
                self.interval_s,
                positive(self.interval_s) && session_length_s < 86_400.0 * self.session_days,
                "above 0, a session shorter than `session_days`",
            ),
            ("samples", self.samples as f64, (2..=100_000).contains(&self.samples), "2 to 100000"),
            (
                "sun_exclusion_deg",
                self.sun_exclusion_deg,
                (0.0..180.0).contains(&self.sun_exclusion_deg),
                "0 to below 180",
            ),
            (
                "line_of_sight_sigma_arcsec",
                self.line_of_sight_sigma_arcsec.unwrap_or(1.0),
                positive(self.line_of_sight_sigma_arcsec.unwrap_or(1.0)),
                "above 0",
            ),
            (
                "initial_position_3_sigma_km",
                self.initial_position_3_sigma_km,
                positive(self.initial_position_3_sigma_km),
                "above 0",
            ),
            (
                "initial_velocity_3_sigma_m_s",
                self.initial_velocity_3_sigma_m_s,
                positive(self.initial_velocity_3_sigma_m_s),
                "above 0",
            ),
            (
                "pressure_area_m2_kg",
                self.pressure_area_m2_kg,
                (0.0..100.0).contains(&self.pressure_area_m2_kg),
                "0 to 100",
            ),
            (
                "acceleration_sigma_m_s2",
                self.acceleration_sigma_m_s2,
                (0.0..1.0).contains(&self.acceleration_sigma_m_s2),
                "0 to 1",
            ),
        ] {
            if !fits {
                return Err(refuse(path, &format!("transfer.{key}"), value, expected));
            }
        }
        let mut planets = Vec::new();
        for name in &self.planets {
            let Some(planet) = Planet::from_name(name) else {
                return Err(InputError::new(path, "is not a planet")
                    .at("key `transfer.planets`")
                    .found(format!("`{name}`"))
                    .expected(Planet::ALL.map(Planet::name).join(", ")));
            };
            if planets.contains(&planet) {
                return Err(InputError::new(path, "a planet is named twice")
                    .at("key `transfer.planets`")
                    .found(format!("`{name}`")));
            }
            planets.push(planet);
        }
        if planets.len() < 2 {
            return Err(InputError::new(path, "a session looks at two planets")
                .at("key `transfer.planets`")
                .found(planets.len())
                .expected("two names at least"));
        }
        Ok(Transfer {
            arrival_tdb_s,
            length_s: self.days * 86_400.0,
            session_s: self.session_days * 86_400.0,
            images_per_session: self.images_per_session,
            interval_s: self.interval_s,
            samples: self.samples,
            images: self.images,
            imaged_per_session: self.imaged_per_session,
            planets,
            sun_exclusion_rad: self.sun_exclusion_deg.to_radians(),
            line_of_sight_sigma_rad: self.line_of_sight_sigma_arcsec.map(|s| (s / 3600.0).to_radians()),
            arrival_offset_m: self.arrival_offset_km.map(|v| v * 1e3),
            arrival_velocity_m_s: self.arrival_velocity_m_s,
            initial_sigma: [
                self.initial_position_3_sigma_km * 1e3 / 3.0,
                self.initial_velocity_3_sigma_m_s / 3.0,
            ],
            pressure_area_m2_kg: self.pressure_area_m2_kg,
            acceleration_sigma_m_s2: self.acceleration_sigma_m_s2,
        })
    }
}
