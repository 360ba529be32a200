//! Random poses among the planets: a camera anywhere between the orbits, with a planet in its field.
//!
//! The experiment of the facility's paper: random positions in the Solar System, a random planet
//! observed in each. The choices made here:
//!
//! - epoch uniform within a span;
//! - position: distance from the Sun uniform, ecliptic longitude (J2000) uniform, latitude uniform within
//!   a band about the ecliptic, as spacecraft keep near it;
//! - velocity: that of a circular prograde orbit about the Sun along the ecliptic, with the Sun's own;
//! - planet: uniform among those asked for that stand far enough from the Sun, as seen from there;
//!   where none does, epoch and position are drawn anew;
//! - attitude: the planet's apparent centre uniform over the image plane, and the camera turned about
//!   that line of sight by a uniform angle, so that each roll is as likely.
//!
//! A frame draws from its own ChaCha8 stream, so it is the same whatever the number of frames.

use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};
use std::path::Path;

use glam::{DQuat, DVec3};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use rayon::prelude::*;
use thiserror::Error;

use crate::ephemeris::{ASTRONOMICAL_UNIT_M, Ephemeris, EphemerisError};
use crate::observer::{Observer, ObserverError, separation_rad};
use crate::planets::{Planet, from_ecliptic, seen_planet};
use crate::trajectory::{FramePose, Trajectory};

/// Heliocentric gravitational constant, m^3/s^2 (IAU 2015 nominal GM of the Sun).
const SUN_GM_M3_S2: f64 = 1.327_124_4e20;
/// 2025-01-01 and 2035-01-01, TDB seconds since J2000.
const DEFAULT_EPOCHS_TDB_S: [f64; 2] = [788_961_600.0, 1_104_494_400.0];
/// Draws of epoch and position before a frame is given up.
const ATTEMPTS: usize = 1000;

/// Poses that cannot be made.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum DeepSpaceError {
    /// No frames or no planets.
    #[error("a deep-space sequence needs one of its {what} at least")]
    Empty {
        /// `frames` or `planets`.
        what: &'static str,
    },
    /// A parameter is outside its range.
    #[error("{name} of a deep-space sequence must be {expected} (found {found})")]
    Range {
        /// The parameter's name.
        name: &'static str,
        /// What is wanted of it.
        expected: &'static str,
        /// The value found.
        found: String,
    },
    /// No planet is far enough from the Sun, wherever the camera stands.
    #[error(
        "frame {frame}: in {ATTEMPTS} draws no planet was far enough from the Sun; lower the exclusion angle"
    )]
    NoPlanet {
        /// The frame.
        frame: usize,
    },
    /// The epoch is outside the ephemeris.
    #[error(transparent)]
    Observer(#[from] ObserverError),
}

impl From<EphemerisError> for DeepSpaceError {
    fn from(error: EphemerisError) -> Self {
        Self::Observer(error.into())
    }
}

/// What to generate.
#[derive(Debug, Clone, PartialEq)]
pub struct DeepSpace {
    /// Number of frames.
    pub frames: usize,
    /// Seed of the random numbers.
    pub seed: u64,
    /// First and last epoch, TDB seconds since J2000.
    pub epochs_tdb_s: [f64; 2],
    /// Least and greatest distance from the Sun, au.
    pub sun_distance_au: [f64; 2],
    /// Greatest ecliptic latitude to either side, radians.
    pub greatest_latitude_rad: f64,
    /// The planets to choose from; each once.
    pub planets: Vec<Planet>,
    /// Least angle between the planet and the Sun's centre, radians.
    pub sun_exclusion_rad: f64,
    /// Field of view, full angles: horizontal and vertical, radians.
    pub field_rad: [f64; 2],
}

impl Default for DeepSpace {
    /// The paper's: 5000 frames in the wide field of 16.09 x 12.10 deg, from 0.7 to 5.2 au, Mercury to Saturn.
    fn default() -> Self {
        Self {
            frames: 5000,
            seed: 0,
            epochs_tdb_s: DEFAULT_EPOCHS_TDB_S,
            sun_distance_au: [0.7, 5.2],
            greatest_latitude_rad: 5.0_f64.to_radians(),
            planets: vec![
                Planet::Mercury,
                Planet::Venus,
                Planet::Earth,
                Planet::Mars,
                Planet::Jupiter,
                Planet::Saturn,
            ],
            sun_exclusion_rad: 20.0_f64.to_radians(),
            // 2048 x 1536 pixels of 3.45 um behind 25 mm: 16.09 x 12.10 deg.
            field_rad: [2048.0, 1536.0]
                .map(|pixels: f64| 2.0 * (0.5 * (pixels / (25.0 * 1e3 / 3.45))).atan()),
        }
    }
}

impl DeepSpace {
    /// The frames (barycentric, ICRF axes, no body columns), and each frame's planet.
    ///
    /// # Errors
    /// No frames or planets, parameters outside their ranges, epochs outside the ephemeris, an
    /// exclusion angle that leaves no planet.
    pub fn generate(&self, ephemeris: &Ephemeris) -> Result<(Trajectory, Vec<Planet>), DeepSpaceError> {
        self.check()?;
        let drawn: Vec<(FramePose, Planet)> = (0..self.frames)
            .into_par_iter()
            .map(|frame| self.frame(ephemeris, frame))
            .collect::<Result<_, _>>()?;
        let (frames, planets) = drawn.into_iter().unzip();
        Ok((Trajectory::new(Path::new("deep-space"), frames), planets))
    }

    fn check(&self) -> Result<(), DeepSpaceError> {
        for (what, empty) in [("frames", self.frames == 0), ("planets", self.planets.is_empty())] {
            if empty {
                return Err(DeepSpaceError::Empty { what });
            }
        }
        let ordered = |[low, high]: [f64; 2]| low.is_finite() && high.is_finite() && low <= high;
        let [widest, highest] = self.field_rad;
        for (name, fits, expected, found) in [
            (
                "epochs_tdb_s",
                ordered(self.epochs_tdb_s),
                "two epochs in order",
                format!("{:?}", self.epochs_tdb_s),
            ),
            (
                "sun_distance_au",
                ordered(self.sun_distance_au) && self.sun_distance_au[0] > 0.0,
                "two distances above zero in order",
                format!("{:?}", self.sun_distance_au),
            ),
            (
                "greatest_latitude_rad",
                (0.0..=PI / 2.0).contains(&self.greatest_latitude_rad),
                "0 to pi / 2",
                self.greatest_latitude_rad.to_string(),
            ),
            (
                "sun_exclusion_rad",
                (0.0..PI).contains(&self.sun_exclusion_rad),
                "from 0 to below pi",
                self.sun_exclusion_rad.to_string(),
            ),
            (
                "field_rad",
                [widest, highest].iter().all(|angle| *angle > 0.0 && *angle < PI),
                "two angles between 0 and pi",
                format!("{:?}", self.field_rad),
            ),
        ] {
            if !fits {
                return Err(DeepSpaceError::Range { name, expected, found });
            }
        }
        Ok(())
    }

    fn frame(&self, ephemeris: &Ephemeris, frame: usize) -> Result<(FramePose, Planet), DeepSpaceError> {
        let mut random = ChaCha8Rng::seed_from_u64(self.seed);
        random.set_stream(frame as u64);
        for _ in 0..ATTEMPTS {
            let observer_and_velocity = self.observer(ephemeris, &mut random)?;
            if let Some(found) = self.pose(&observer_and_velocity, &mut random)? {
                return Ok(found);
            }
        }
        Err(DeepSpaceError::NoPlanet { frame })
    }

    /// Somewhere, at some time, and the velocity there.
    fn observer(
        &self,
        ephemeris: &Ephemeris,
        random: &mut ChaCha8Rng,
    ) -> Result<(Observer, DVec3), DeepSpaceError> {
        let tdb_s = between(random, self.epochs_tdb_s);
        let distance_m = between(random, self.sun_distance_au) * ASTRONOMICAL_UNIT_M;
        let longitude_rad = between(random, [0.0, TAU]);
        let latitude_rad = between(random, [-self.greatest_latitude_rad, self.greatest_latitude_rad]);
        let sun = ephemeris.solar_system(tdb_s)?.sun;
        let position_m = sun.position_m + from_ecliptic(longitude_rad, latitude_rad) * distance_m;
        let eastward = from_ecliptic(longitude_rad + PI / 2.0, 0.0);
        let velocity_m_s = sun.velocity_m_s + eastward * (SUN_GM_M3_S2 / distance_m).sqrt();
        Ok((Observer::new(ephemeris, tdb_s, position_m, Some(velocity_m_s))?, velocity_m_s))
    }

    /// The pose of a camera there that has a planet in its field; `None` where all are near the Sun.
    fn pose(
        &self,
        (observer, velocity_m_s): &(Observer, DVec3),
        random: &mut ChaCha8Rng,
    ) -> Result<Option<(FramePose, Planet)>, DeepSpaceError> {
        let sun_m = observer.bodies().sun_from_m(observer.position_m());
        let sun_direction = observer.apparent_source(sun_m);
        let mut left = self.planets.clone();
        while !left.is_empty() {
            let planet = left.swap_remove((uniform(random) * left.len() as f64) as usize);
            let Some(seen) = seen_planet(observer, planet).map_err(ObserverError::from)? else { continue };
            if separation_rad(seen.direction, sun_direction) < self.sun_exclusion_rad {
                continue;
            }
            let [x, y] = self.field_rad.map(|angle| (angle / 2.0).tan()).map(|t| between(random, [-t, t]));
            let line_of_sight = DVec3::new(x, y, 1.0).normalize();
            let turn = DQuat::from_rotation_z(between(random, [0.0, TAU]));
            let camera_from_inertial = (DQuat::from_rotation_arc(DVec3::Z, line_of_sight)
                * turn
                * DQuat::from_rotation_arc(seen.direction, DVec3::Z))
            .normalize();
            let pose = FramePose {
                time_s: observer.tdb_s(),
                camera_position_m: observer.position_m(),
                camera_from_inertial,
                camera_velocity_m_s: Some(*velocity_m_s),
                sun_position_m: Some(observer.position_m() + sun_m),
                bodies: BTreeMap::new(),
            };
            return Ok(Some((pose, planet)));
        }
        Ok(None)
    }
}

/// Uniform in 0 <= x < 1: 53 random bits.
fn uniform(random: &mut ChaCha8Rng) -> f64 {
    (random.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
}

fn between(random: &mut ChaCha8Rng, [low, high]: [f64; 2]) -> f64 {
    low + (high - low) * uniform(random)
}

#[cfg(test)]
mod tests;
