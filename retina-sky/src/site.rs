//! Places on the Earth, and what a camera there looks at.

use std::collections::BTreeMap;

use glam::{DMat3, DQuat, DVec3};

use crate::ephemeris::{Ephemeris, EphemerisError};
use crate::observer::{Observer, ObserverError};
use crate::planets::{Planet, seen_planet};
use crate::trajectory::FramePose;

/// WGS 84: equatorial radius, m, and flattening.
const EARTH_RADIUS_M: f64 = 6_378_137.0;
const FLATTENING: f64 = 1.0 / 298.257_223_563;
/// The Earth's rate of rotation (IERS Conventions 2010), rad/s.
const EARTH_RATE_RAD_S: f64 = 7.292_115e-5;

/// A place on the Earth: geodetic longitude and latitude (WGS 84).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Site {
    /// East longitude, rad.
    pub longitude_rad: f64,
    /// Latitude, rad.
    pub latitude_rad: f64,
    /// Height above the ellipsoid, m.
    pub altitude_m: f64,
}

/// A camera on the Earth for which no pose can be given.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SiteError {
    /// The epoch is outside the ephemeris.
    #[error(transparent)]
    Ephemeris(#[from] EphemerisError),
    /// There is no such observer.
    #[error(transparent)]
    Observer(#[from] ObserverError),
    /// The Earth itself, or a planet that cannot be seen from here.
    #[error("{0} cannot be seen from the Earth's surface")]
    Unseen(&'static str),
}

impl Site {
    /// Where it is in Earth-fixed axes, m.
    fn earth_fixed_m(&self) -> DVec3 {
        let e2 = FLATTENING * (2.0 - FLATTENING);
        let (sin, cos) = self.latitude_rad.sin_cos();
        let normal_m = EARTH_RADIUS_M / (1.0 - e2 * sin * sin).sqrt();
        let across_m = (normal_m + self.altitude_m) * cos;
        let up_m = (normal_m * (1.0 - e2) + self.altitude_m) * sin;
        DVec3::new(across_m * self.longitude_rad.cos(), across_m * self.longitude_rad.sin(), up_m)
    }

    /// Place (m) and velocity (m/s) from the Solar System's barycentre, ICRF. The Earth is turned by its rotational
    /// elements: the place is good to some 2 km, as UT1 and nutation are not in them.
    ///
    /// # Errors
    /// The epoch (TDB seconds since J2000) is outside the ephemeris.
    pub fn state(&self, ephemeris: &Ephemeris, tdb_s: f64) -> Result<(DVec3, DVec3), EphemerisError> {
        let earth = ephemeris.solar_system(tdb_s)?.earth;
        let inertial_from_earth =
            ephemeris.body_from_inertial("earth", tdb_s)?.map_or(DQuat::IDENTITY, |turn| turn.inverse());
        let offset_m = inertial_from_earth * self.earth_fixed_m();
        let rate = inertial_from_earth * DVec3::new(0.0, 0.0, EARTH_RATE_RAD_S);
        Ok((earth.position_m + offset_m, earth.velocity_m_s + rate.cross(offset_m)))
    }

    /// A camera here that has a planet or the Moon on its axis and celestial north up; positions are barycentric, as a
    /// scene with stars has them.
    ///
    /// # Errors
    /// The epoch is outside the ephemeris, or the target cannot be seen.
    pub fn looking_at(
        &self,
        ephemeris: &Ephemeris,
        target: Planet,
        tdb_s: f64,
    ) -> Result<FramePose, SiteError> {
        let (position_m, velocity_m_s) = self.state(ephemeris, tdb_s)?;
        let observer = Observer::new(ephemeris, tdb_s, position_m, Some(velocity_m_s))?;
        let seen = seen_planet(&observer, target)?.ok_or(SiteError::Unseen(target.name()))?;
        let forward = seen.direction;
        let right = forward.cross(DVec3::Z).normalize();
        let camera_from_inertial = DMat3::from_cols(right, forward.cross(right), forward).transpose();
        Ok(FramePose {
            time_s: tdb_s,
            camera_position_m: position_m,
            camera_from_inertial: DQuat::from_mat3(&camera_from_inertial),
            camera_velocity_m_s: Some(velocity_m_s),
            sun_position_m: None,
            bodies: BTreeMap::new(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::parse_epoch;

    /// Skyfield with DE421: topocentric apparent place of the Moon (ICRF, km), 2023-12-22T19:21:25 UTC, 45.848510 N
    /// 8.381019 E, 455 m. Aberration by the observer's own velocity is in both.
    #[test]
    fn the_moon_over_a_site_is_that_of_skyfield() {
        let expected_m = 1e3 * DVec3::new(289_833.723_4, 212_435.872_6, 99_020.776);
        let site = Site {
            longitude_rad: 8.381_019f64.to_radians(),
            latitude_rad: 45.848_510f64.to_radians(),
            altitude_m: 455.0,
        };
        let tdb_s = parse_epoch("2023-12-22T19:21:25 UTC").unwrap();
        let ephemeris = Ephemeris::analytic();
        let pose = site.looking_at(&ephemeris, Planet::Moon, tdb_s).unwrap();
        let forward = pose.camera_from_inertial.inverse() * DVec3::Z;
        // 20 km at the Moon are 11 arcsec.
        assert!(forward.angle_between(expected_m).to_degrees() * 3600.0 < 15.0);
        let observer =
            Observer::new(&ephemeris, tdb_s, pose.camera_position_m, pose.camera_velocity_m_s).unwrap();
        let seen = seen_planet(&observer, Planet::Moon).unwrap().unwrap();
        assert!((seen.distance_m - expected_m.length()).abs() < 20e3, "{}", seen.distance_m);
        assert!((seen.phase_angle_rad.to_degrees() - 51.288).abs() < 0.01);
        // The camera's y axis runs south.
        assert!((pose.camera_from_inertial * DVec3::Z).y < 0.0);
    }
}
