//! Sun, Earth and Moon from analytical theories, without a kernel, in ICRF metres (the planets: see
//! [`crate::planets`]).
//!
//! - Earth: SOFA's `epv00` (a reduced VSOP2000 fitted to DE405). Against DE405 over 1900-2100 the
//!   heliocentric position is off by 3.7 km rms and 11.2 km at most, the barycentric one by 4.6
//!   and 13.4 km (SOFA's own figures).
//! - Moon: SOFA's `moon98` (Meeus 1998, after ELP-2000/82), rotated from the mean ecliptic of date
//!   into the GCRS by the IAU 2006 precession and bias. Against ELP/MPP02 over 1950-2100 it is off
//!   by 6.1 km rms and 31.7 km at most, 36 mm/s rms (SOFA's own figures).
//!   Its velocity leaves out the turn of the axes by precession, 3 mm/s.
//!
//! Both are taken at TDB where TT is asked for: the 1.7 ms are 2 m of the Moon's way.

use glam::DVec3;
use sofars::eph::{epv00, moon98};
use thiserror::Error;

use crate::time::{J2000_JD, format_epoch_tdb};
use crate::{CENTURY_D, DAY_S};

/// The astronomical unit, metres (IAU 2012 resolution B2).
pub const ASTRONOMICAL_UNIT_M: f64 = 149_597_870_700.0;
/// The speed of light in vacuum, metres a second.
pub const LIGHT_SPEED_M_S: f64 = 299_792_458.0;
/// Obliquity of the ecliptic at J2000, radians (IAU 2006: 84381.406 arcsec).
pub(crate) const OBLIQUITY_RAD: f64 = 84_381.406 * std::f64::consts::PI / 648_000.0;

/// An epoch for which the theories do not hold.
#[derive(Debug, Clone, PartialEq, Error)]
#[error("no ephemeris at {} (it holds from 1900 to 2100)", format_epoch_tdb(*.tdb_s))]
pub struct EphemerisError {
    /// The epoch asked for, TDB seconds since J2000.
    pub tdb_s: f64,
}

/// Position and velocity along ICRF axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct State {
    /// Position, metres.
    pub position_m: DVec3,
    /// Velocity, metres a second.
    pub velocity_m_s: DVec3,
}

impl State {
    /// From SOFA's astronomical units and days.
    fn from_au([position_au, velocity_au_d]: [[f64; 3]; 2]) -> Self {
        Self {
            position_m: DVec3::from_array(position_au) * ASTRONOMICAL_UNIT_M,
            velocity_m_s: DVec3::from_array(velocity_au_d) * (ASTRONOMICAL_UNIT_M / DAY_S),
        }
    }

    /// This state seen from `other`.
    fn minus(self, other: Self) -> Self {
        Self {
            position_m: self.position_m - other.position_m,
            velocity_m_s: self.velocity_m_s - other.velocity_m_s,
        }
    }
}

/// Sun, Earth and Moon at one epoch, geometric (no light-time), from the Solar System's barycentre.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolarSystem {
    /// The Sun.
    pub sun: State,
    /// The Earth.
    pub earth: State,
    /// The Moon.
    pub moon: State,
}

impl SolarSystem {
    /// The three bodies at an epoch (TDB seconds since J2000).
    ///
    /// # Errors
    /// The epoch is outside 1900-2100.
    pub fn at(tdb_s: f64) -> Result<Self, EphemerisError> {
        check(tdb_s)?;
        let (heliocentric, barycentric) = epv00(J2000_JD, tdb_s / DAY_S).ok_or(EphemerisError { tdb_s })?;
        let earth = State::from_au(barycentric);
        let sun = earth.minus(State::from_au(heliocentric));
        let lunar = moon_from_earth(tdb_s)?;
        let moon = State {
            position_m: earth.position_m + lunar.position_m,
            velocity_m_s: earth.velocity_m_s + lunar.velocity_m_s,
        };
        Ok(Self { sun, earth, moon })
    }

    /// The Sun as its light reaches `place_m` (barycentric, metres) at this epoch: vector from there.
    ///
    /// The Sun stands where it was one light-time earlier; aberration is not in it, as that goes
    /// with the velocity of whoever looks.
    pub fn sun_from_m(&self, place_m: DVec3) -> DVec3 {
        let geometric_m = self.sun.position_m - place_m;
        // The Sun crosses 8 km in a light-time of 1 au; a second pass would move it by micrometres.
        geometric_m - self.sun.velocity_m_s * (geometric_m.length() / LIGHT_SPEED_M_S)
    }
}

/// The Moon seen from the Earth's centre: geometric state, ICRF axes.
///
/// # Errors
/// The epoch is outside 1900-2100.
pub fn moon_from_earth(tdb_s: f64) -> Result<State, EphemerisError> {
    check(tdb_s)?;
    Ok(State::from_au(moon98(J2000_JD, tdb_s / DAY_S)))
}

/// Vector from the body's centre to the Sun, ICRF metres; `None` for a body other than `moon` and
/// `earth`. Light-time of the Sun is in it, aberration (20 arcsec) is not: see
/// [`SolarSystem::sun_from_m`].
///
/// # Errors
/// The epoch is outside 1900-2100.
pub fn sun_from_body_m(name: &str, tdb_s: f64) -> Result<Option<DVec3>, EphemerisError> {
    let place_m: fn(&SolarSystem) -> DVec3 = match name {
        "moon" => |bodies| bodies.moon.position_m,
        "earth" => |bodies| bodies.earth.position_m,
        _ => return Ok(None),
    };
    let bodies = SolarSystem::at(tdb_s)?;
    Ok(Some(bodies.sun_from_m(place_m(&bodies))))
}

/// The first new Moon after an epoch (TDB seconds since J2000), to about ten seconds: equal
/// apparent geocentric ecliptic longitudes of Moon and Sun, as almanacs define it.
///
/// # Errors
/// The epoch, or the new Moon, is outside 1900-2100.
pub fn next_new_moon_s(after_tdb_s: f64) -> Result<f64, EphemerisError> {
    use std::f64::consts::{PI, TAU};
    const SYNODIC_MONTH_S: f64 = 29.530_589 * DAY_S;
    let behind_rad = elongation_rad(after_tdb_s)?.rem_euclid(TAU);
    let mut tdb_s = after_tdb_s + (TAU - behind_rad) / TAU * SYNODIC_MONTH_S;
    // The true rate keeps within 20 % of the mean one, so each pass gains a factor of five at least.
    for _ in 0..16 {
        let elongation_rad = (elongation_rad(tdb_s)? + PI).rem_euclid(TAU) - PI;
        tdb_s -= elongation_rad / TAU * SYNODIC_MONTH_S;
    }
    Ok(tdb_s)
}

/// Apparent ecliptic longitude of the Moon less that of the Sun, seen from the Earth's centre.
fn elongation_rad(tdb_s: f64) -> Result<f64, EphemerisError> {
    // Geocentric vectors one light-time back carry the annual aberration too (planetary aberration).
    let light_s = |distance_m: f64| distance_m / LIGHT_SPEED_M_S;
    let moon = moon_from_earth(tdb_s)?;
    let moon_m = moon.position_m - moon.velocity_m_s * light_s(moon.position_m.length());
    let bodies = SolarSystem::at(tdb_s)?;
    let sun = bodies.sun.minus(bodies.earth);
    let sun_m = sun.position_m - sun.velocity_m_s * light_s(sun.position_m.length());
    Ok(ecliptic_longitude_rad(moon_m) - ecliptic_longitude_rad(sun_m))
}

/// Longitude along the ecliptic of J2000.
pub(crate) fn ecliptic_longitude_rad(vector: DVec3) -> f64 {
    let (sin, cos) = OBLIQUITY_RAD.sin_cos();
    (vector.y * cos + vector.z * sin).atan2(vector.x)
}

/// An error unless the epoch lies in 1900-2100, where the theories were fitted.
pub(crate) fn check(tdb_s: f64) -> Result<(), EphemerisError> {
    if tdb_s.abs() <= CENTURY_D * DAY_S { Ok(()) } else { Err(EphemerisError { tdb_s }) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::parse_epoch;

    #[test]
    fn earth_and_moon_agree_with_sofas_published_checks() {
        // t_sofa_c.c, iauMoon98 (JD 2400000.5 + 43999.9) and iauEpv00 (+ 53411.52501161).
        let epoch_s = |mjd: f64| (mjd + 2_400_000.5 - J2000_JD) * DAY_S;
        let moon = moon_from_earth(epoch_s(43_999.9)).unwrap();
        let expected_au =
            DVec3::new(-2.601_295_959_971_044e-3, 6.139_750_944_302_742e-4, 2.640_794_528_229_828e-4);
        assert!((moon.position_m - expected_au * ASTRONOMICAL_UNIT_M).length() < 0.1);
        let bodies = SolarSystem::at(epoch_s(53_411.525_011_61)).unwrap();
        let expected_au =
            DVec3::new(-0.775_723_880_929_770_7, 0.559_805_224_136_334, 0.242_699_846_648_168_7);
        let heliocentric_m = bodies.earth.position_m - bodies.sun.position_m;
        assert!((heliocentric_m - expected_au * ASTRONOMICAL_UNIT_M).length() < 1.0);
    }

    #[test]
    fn the_moon_of_meeus_example_47a() {
        // 1992 April 12, 0h TD: distance 368409.7 km, longitude 133.162655 and latitude -3.229126 deg
        // of the mean ecliptic and equinox of date; precessed to J2000 the longitude gains
        // 5029.0966 arcsec a century (IAU 1976) times 0.0772.
        let tdb_s = parse_epoch("1992-04-12").unwrap();
        let moon_m = moon_from_earth(tdb_s).unwrap().position_m;
        assert!((moon_m.length() - 368_409_700.0).abs() < 1000.0);
        let precessed_deg = 133.162_655 - 5029.0966 / 3600.0 * (tdb_s / DAY_S / CENTURY_D);
        assert!((ecliptic_longitude_rad(moon_m).to_degrees() - precessed_deg).abs() < 1e-3);
    }

    #[test]
    fn velocities_are_the_rates_of_the_positions() {
        let (t, h) = (parse_epoch("2027-08-02").unwrap(), 60.0);
        let pick: [fn(&SolarSystem) -> State; 3] = [|b| b.sun, |b| b.earth, |b| b.moon];
        let [before, now, after] = [t - h, t, t + h].map(|t| SolarSystem::at(t).unwrap());
        for state in pick {
            let rate_m_s = (state(&after).position_m - state(&before).position_m) / (2.0 * h);
            let off_m_s = (rate_m_s - state(&now).velocity_m_s).length();
            assert!(off_m_s < 5e-3, "{off_m_s}");
        }
    }

    #[test]
    fn new_moons_of_published_solar_eclipses() {
        // Times of new Moon to the minute (UT), U.S. Naval Observatory, phases of the Moon.
        for (after, published) in [
            ("2026-08-01", "2026-08-12T17:37Z"),
            ("2026-08-12T12:00", "2026-08-12T17:37Z"),
            ("2027-07-10", "2027-08-02T10:05Z"),
            ("2028-01-01", "2028-01-26T15:12Z"),
            ("2017-07-24", "2017-08-21T18:30Z"),
        ] {
            let found_s = next_new_moon_s(parse_epoch(after).unwrap()).unwrap();
            let off_s = found_s - parse_epoch(published).unwrap();
            assert!(off_s.abs() < 60.0, "{published}: {off_s} s");
        }
    }

    #[test]
    fn the_sun_is_seen_where_it_was_one_light_time_ago() {
        let tdb_s = parse_epoch("2027-08-02").unwrap();
        let bodies = SolarSystem::at(tdb_s).unwrap();
        let geometric_m = bodies.sun.position_m - bodies.moon.position_m;
        let earlier = SolarSystem::at(tdb_s - geometric_m.length() / LIGHT_SPEED_M_S).unwrap();
        let seen_m = sun_from_body_m("moon", tdb_s).unwrap().unwrap();
        assert!((seen_m - (earlier.sun.position_m - bodies.moon.position_m)).length() < 10.0);
        assert!((seen_m - geometric_m).length() > 5000.0);
        assert_eq!(sun_from_body_m("phobos", tdb_s).unwrap(), None);
    }

    #[test]
    fn epochs_outside_the_theories_are_refused() {
        for tdb_s in [3.2e9, -3.2e9, f64::NAN, f64::INFINITY] {
            assert!(SolarSystem::at(tdb_s).is_err() && moon_from_earth(tdb_s).is_err());
        }
        assert!(moon_from_earth(3.2e9).unwrap_err().to_string().contains("2101"));
    }
}
