//! Places on the Earth, and what a camera there looks at.

use std::collections::BTreeMap;

use glam::{DMat3, DQuat, DVec3};
use sofars::pnp::c2t00b;

use crate::DAY_S;
use crate::ephemeris::{Ephemeris, EphemerisError};
use crate::observer::{Observer, ObserverError};
use crate::planets::{Planet, seen_planet};
use crate::time::{J2000_JD, TT_MINUS_TAI_S, tai_minus_utc_s};
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

/// From ICRF to the Earth's axes (ITRF), by precession, nutation (IAU 2000B) and the Earth rotation angle (IAU 2000):
/// SOFA's `c2t00b`. UT1 is taken for UTC, from which it is at most 0.9 s away: 420 m at the equator, 100 m since 2017.
/// Polar motion, 10 m, is left out. Before 1972 there is no UTC of this kind; UT1 is then taken 42.2 s behind TT, as in
/// 1972: 4 km at the equator in 1960.
fn earth_from_inertial(tdb_s: f64) -> DQuat {
    const TAI_MINUS_UTC_1972_S: f64 = 10.0;
    let days = ((tdb_s + 0.5 * DAY_S) / DAY_S).floor() as i64;
    // The second about a leap second is as uncertain as UT1 is.
    let tai_minus_utc_s = tai_minus_utc_s(days).unwrap_or(TAI_MINUS_UTC_1972_S);
    let ut1_s = tdb_s - TT_MINUS_TAI_S - tai_minus_utc_s;
    let rows = c2t00b(J2000_JD, tdb_s / DAY_S, J2000_JD, ut1_s / DAY_S, 0.0, 0.0);
    DQuat::from_mat3(&DMat3::from_cols_array_2d(&rows).transpose()).normalize()
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

    /// Place (m) and velocity (m/s) from the Solar System's barycentre, ICRF. The Earth is turned by a kernel, if one has
    /// its axes; otherwise by SOFA's precession, nutation and rotation angle, 100 m off (UT1 is taken for UTC).
    ///
    /// # Errors
    /// The epoch (TDB seconds since J2000) is outside the ephemeris.
    pub fn state(&self, ephemeris: &Ephemeris, tdb_s: f64) -> Result<(DVec3, DVec3), EphemerisError> {
        let earth = ephemeris.solar_system(tdb_s)?.earth;
        let by_kernel = match ephemeris.axes_source("earth") {
            Some(_) => ephemeris.body_from_inertial("earth", tdb_s)?,
            None => None,
        };
        let inertial_from_earth = by_kernel.unwrap_or_else(|| earth_from_inertial(tdb_s)).inverse();
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

    /// Skyfield 1.53 with its own UT1 (built-in tables): geocentric places of two sites, ICRF, m.
    #[test]
    fn sites_turn_with_the_earth_as_in_skyfield() {
        let cases = [
            (
                "2023-12-22T19:21:25 UTC",
                [8.381_019, 45.848_510, 455.0],
                [3_883_529.916, 2_193_089.381, 4_544_803.510],
            ),
            (
                "2001-06-01T03:00:00 UTC",
                [-70.0, -30.0, 2400.0],
                [-3_934_512.126, -3_886_722.544, -3_171_196.695],
            ),
        ];
        for (epoch, [longitude_deg, latitude_deg, altitude_m], expected_m) in cases {
            let (longitude_rad, latitude_rad) =
                (f64::to_radians(longitude_deg), f64::to_radians(latitude_deg));
            let site = Site { longitude_rad, latitude_rad, altitude_m };
            let tdb_s = parse_epoch(epoch).unwrap();
            let ephemeris = Ephemeris::analytic();
            let earth = ephemeris.solar_system(tdb_s).unwrap().earth;
            let (place_m, velocity_m_s) = site.state(&ephemeris, tdb_s).unwrap();
            let off_m = (place_m - earth.position_m - DVec3::from_array(expected_m)).length();
            // UT1 - UTC is 0.009 and -0.025 s there: 3 and 10 m.
            assert!(off_m < 40.0, "{epoch}: {off_m} m");
            // The axis of the date is 0.13 deg from ICRF's pole in 2023: up to 0.8 m/s.
            let speed_m_s = (velocity_m_s - earth.velocity_m_s).length();
            assert!((speed_m_s - expected_speed(expected_m)).abs() < 2.0, "{speed_m_s} m/s");
        }
    }

    fn expected_speed([x, y, _]: [f64; 3]) -> f64 {
        EARTH_RATE_RAD_S * x.hypot(y)
    }

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
