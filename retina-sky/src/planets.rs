//! The planets and the Moon: where they are, and how a camera sees them.
//!
//! Kernels give a planet's centre where they have it, otherwise the barycentre of it and its satellites (DE440
//! from Mars outwards), as VSOP87's theories do. Jupiter's and Saturn's centres are up to some 200 and 300 km from
//! theirs, Mars' less than a metre.
//!
//! Without kernels, Mercury to Neptune (but the Earth) are VSOP87A (Bretagnon & Francou 1988): heliocentric positions in
//! the dynamical ecliptic of J2000, turned to equatorial axes and set on the Sun of
//! [`SolarSystem`], so that they stand in one frame with the Earth and the Moon. Its own barycentric
//! variant, VSOP87E, is not taken: its barycentre is 1270 km (rms) off that of DE421. Against DE421 over
//! 1950-2050 heliocentric positions are off by at most 10 km for Mercury, 13 Venus, 49 Mars, 310 Jupiter
//! (with a small fitted turn of its orbit), 1920 Saturn, 21 500 Uranus (1.6 arcsec)
//! and 47 900 Neptune (2.2 arcsec); `validation/skyfield_sky.py` measures directions.

use glam::{DMat3, DVec3};
use vsop87::{RectangularCoordinates, vsop87a};

use crate::ephemeris::{
    ASTRONOMICAL_UNIT_M, Ephemeris, EphemerisError, LIGHT_SPEED_M_S, OBLIQUITY_RAD, SolarSystem,
    ecliptic_longitude_rad,
};
use crate::magnitude::{self, Illumination, Magnitude};
use crate::observer::{Observer, separation_rad};
use crate::orientation::RotationalElements;
use crate::time::J2000_JD;
use crate::{CENTURY_D, DAY_S};

/// Days in a Julian year.
const YEAR_D: f64 = CENTURY_D / 100.0;
/// Added to Mars' heliocentric ecliptic longitude gives its solar longitude Ls (Mallama & Hilton 2018).
const MARS_LS_OFFSET_RAD: f64 = -85.0 * std::f64::consts::PI / 180.0;
/// More than light-time moves a planet: v / c is 2e-4 for the fastest, Mercury at perihelion, whatever the
/// distance.
const GREATEST_SHIFT_RAD: f64 = 1e-3;
/// Polar over equatorial radius of Uranus: 24 973 / 25 559 km (IAU).
const URANUS_AXIS_RATIO: f64 = 24_973.0 / 25_559.0;

/// A planet, or the Moon.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Planet {
    /// Mercury.
    Mercury,
    /// Venus.
    Venus,
    /// The Earth.
    Earth,
    /// The Moon.
    Moon,
    /// Mars.
    Mars,
    /// Jupiter.
    Jupiter,
    /// Saturn.
    Saturn,
    /// Uranus.
    Uranus,
    /// Neptune.
    Neptune,
}

impl Planet {
    /// All of them, from the Sun outwards.
    pub const ALL: [Self; 9] = [
        Self::Mercury,
        Self::Venus,
        Self::Earth,
        Self::Moon,
        Self::Mars,
        Self::Jupiter,
        Self::Saturn,
        Self::Uranus,
        Self::Neptune,
    ];

    /// Its name in files, in lower case.
    pub fn name(self) -> &'static str {
        match self {
            Self::Mercury => "mercury",
            Self::Venus => "venus",
            Self::Earth => "earth",
            Self::Moon => "moon",
            Self::Mars => "mars",
            Self::Jupiter => "jupiter",
            Self::Saturn => "saturn",
            Self::Uranus => "uranus",
            Self::Neptune => "neptune",
        }
    }

    /// The planet of a name as [`Planet::name`] gives it, in any case.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|planet| planet.name().eq_ignore_ascii_case(name))
    }

    /// Equatorial radius, metres (IAU: Archinal et al. 2018, tables 4 and 5); the rings are not in it.
    pub fn radius_m(self) -> f64 {
        1e3 * match self {
            Self::Mercury => 2440.53,
            Self::Venus => 6051.8,
            Self::Earth => 6378.1366,
            Self::Moon => 1737.4,
            Self::Mars => 3396.19,
            Self::Jupiter => 71_492.0,
            Self::Saturn => 60_268.0,
            Self::Uranus => 25_559.0,
            Self::Neptune => 24_764.0,
        }
    }

    /// Polar radius, metres (the same tables).
    pub fn polar_radius_m(self) -> f64 {
        1e3 * match self {
            Self::Mercury => 2438.26,
            Self::Venus => 6051.8,
            Self::Earth => 6356.7519,
            Self::Moon => 1737.4,
            Self::Mars => 3376.20,
            Self::Jupiter => 66_854.0,
            Self::Saturn => 54_364.0,
            Self::Uranus => 24_973.0,
            Self::Neptune => 24_341.0,
        }
    }

    /// VSOP87A, where it is what the position comes from.
    fn theory(self) -> Option<fn(f64) -> RectangularCoordinates> {
        match self {
            Self::Mercury => Some(vsop87a::mercury),
            Self::Venus => Some(vsop87a::venus),
            Self::Earth | Self::Moon => None,
            Self::Mars => Some(vsop87a::mars),
            Self::Jupiter => Some(vsop87a::jupiter),
            Self::Saturn => Some(vsop87a::saturn),
            Self::Uranus => Some(vsop87a::uranus),
            Self::Neptune => Some(vsop87a::neptune),
        }
    }
}

impl Ephemeris {
    /// A planet's geometric barycentric position (no light-time), ICRF metres, at an epoch (TDB seconds since
    /// J2000).
    ///
    /// # Errors
    /// The epoch is outside 1900-2100, or kernels lack it or the planet.
    pub fn position_m(&self, planet: Planet, tdb_s: f64) -> Result<DVec3, EphemerisError> {
        match self.kernels() {
            Some(kernels) => Ok(kernels.planet(planet, tdb_s)?.position_m),
            None => self.place_earlier_m(planet, &self.solar_system(tdb_s)?, tdb_s, 0.0),
        }
    }

    /// Barycentric position `earlier_s` before an epoch for which `bodies` are.
    fn place_earlier_m(
        &self,
        planet: Planet,
        bodies: &SolarSystem,
        tdb_s: f64,
        earlier_s: f64,
    ) -> Result<DVec3, EphemerisError> {
        if let Some(kernels) = self.kernels() {
            return Ok(kernels.planet(planet, tdb_s - earlier_s)?.position_m);
        }
        let Some(theory) = planet.theory() else {
            let then = if earlier_s == 0.0 { *bodies } else { self.solar_system(tdb_s - earlier_s)? };
            return Ok(if planet == Planet::Moon { then.moon } else { then.earth }.position_m);
        };
        // In the 5 hours that light takes from Neptune, the Sun leaves this line by 20 m.
        let sun_m = bodies.sun.position_m - bodies.sun.velocity_m_s * earlier_s;
        let RectangularCoordinates { x, y, z } = theory(J2000_JD + (tdb_s - earlier_s) / DAY_S);
        let mut heliocentric_m = equatorial_from_dynamical() * DVec3::new(x, y, z) * ASTRONOMICAL_UNIT_M;
        if planet == Planet::Jupiter {
            heliocentric_m += jupiter_turn_rad((tdb_s - earlier_s) / DAY_S / CENTURY_D).cross(heliocentric_m);
        }
        Ok(sun_m + heliocentric_m)
    }
}

/// What turns VSOP87's orbit of Jupiter onto DE421's, a rotation vector along ICRF axes, at Julian
/// centuries after J2000.
///
/// VSOP87 was fitted to DE200, before Galileo was at Jupiter. Fitted to DE421 over 1950-2050 (least
/// squares, constant and rate), this takes the largest error from 980 to 310 km; over 1900-1950, which the
/// fit has not seen, from 700 to 320 km. Saturn gains nothing that lasts beyond the span of the fit.
fn jupiter_turn_rad(centuries: f64) -> DVec3 {
    const MAS_RAD: f64 = std::f64::consts::PI / 648_000_000.0;
    const AT_J2000_MAS: DVec3 = DVec3::new(-34.5, 131.9, -84.9);
    const PER_CENTURY_MAS: DVec3 = DVec3::new(-10.0, 89.9, -206.0);
    (AT_J2000_MAS + PER_CENTURY_MAS * centuries) * MAS_RAD
}

/// Equatorial axes of J2000 from VSOP87's dynamical ecliptic and equinox (Bretagnon & Francou 1988, file
/// vsop87.doc). They are FK5's; what is left to ICRF is 0.02 arcsec (fitted to DE421's inner planets).
fn equatorial_from_dynamical() -> DMat3 {
    DMat3::from_cols(
        DVec3::new(1.0, -0.000_000_479_966, 0.0),
        DVec3::new(0.000_000_440_360, 0.917_482_137_087, 0.397_776_982_902),
        DVec3::new(-0.000_000_190_919, -0.397_776_982_902, 0.917_482_137_087),
    )
}

impl Observer {
    /// A planet's barycentric position `earlier_s` before the observer's epoch.
    fn place_earlier_m(&self, planet: Planet, earlier_s: f64) -> Result<DVec3, EphemerisError> {
        self.ephemeris().place_earlier_m(planet, self.bodies(), self.tdb_s(), earlier_s)
    }
}

/// A planet as a camera sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeenPlanet {
    /// Which.
    pub planet: Planet,
    /// Apparent direction of its centre: unit vector along ICRF axes, with light-time, deflection
    /// by the Sun and aberration.
    pub direction: DVec3,
    /// Distance that the light came, metres.
    pub distance_m: f64,
    /// Distance from the Sun when it left, metres.
    pub sun_distance_m: f64,
    /// Angle Sun - planet - observer when it left, radians.
    pub phase_angle_rad: f64,
    /// Apparent radius of the equator, radians.
    pub angular_radius_rad: f64,
    /// V magnitude of the whole, see [`crate::magnitude`]. Nothing is taken to stand before it.
    pub magnitude: f64,
    /// Whether the magnitude lies outside what was observed.
    pub magnitude_extrapolated: bool,
}

/// The planets as an observer sees them, from Mercury outwards; one inside which the observer
/// stands (at the Earth's centre, say) is left out.
///
/// # Errors
/// The epoch, or that at which the light left, is outside 1900-2100, or kernels lack it or the planet.
pub fn seen_planets(observer: &Observer) -> Result<Vec<SeenPlanet>, EphemerisError> {
    Planet::ALL.into_iter().filter_map(|planet| seen_planet(observer, planet).transpose()).collect()
}

/// As [`seen_planets`], those whose disc reaches into a cone about `axis` (unit vector, ICRF axes).
///
/// # Errors
/// As [`seen_planets`].
pub fn planets_in_cone(
    observer: &Observer,
    axis: DVec3,
    half_angle_rad: f64,
) -> Result<Vec<SeenPlanet>, EphemerisError> {
    let mut found = Vec::new();
    for planet in Planet::ALL {
        // The theories are slow: where a planet is now says whether it may be seen in the cone.
        let now_m = observer.place_earlier_m(planet, 0.0)? - observer.position_m();
        let radius_rad = (observer.ephemeris().radii_m(planet)[0] / now_m.length()).min(1.0).asin();
        if separation_rad(now_m, axis)
            > half_angle_rad + radius_rad + GREATEST_SHIFT_RAD + observer.greatest_shift_rad()
        {
            continue;
        }
        if let Some(seen) = seen_from_now(observer, planet, now_m)?
            && separation_rad(seen.direction, axis) <= half_angle_rad + seen.angular_radius_rad
        {
            found.push(seen);
        }
    }
    Ok(found)
}

/// One planet as an observer sees it; `None` where he stands inside it.
///
/// # Errors
/// As [`seen_planets`].
pub fn seen_planet(observer: &Observer, planet: Planet) -> Result<Option<SeenPlanet>, EphemerisError> {
    let now_m = observer.place_earlier_m(planet, 0.0)? - observer.position_m();
    seen_from_now(observer, planet, now_m)
}

/// [`seen_planet`], given the vector to where it is now.
fn seen_from_now(
    observer: &Observer,
    planet: Planet,
    now_m: DVec3,
) -> Result<Option<SeenPlanet>, EphemerisError> {
    let (tdb_s, bodies) = (observer.tdb_s(), observer.bodies());
    if now_m.length() <= observer.ephemeris().radii_m(planet)[0] {
        return Ok(None);
    }
    // Light-time: one step back by the theory, the second order by the mean velocity in between. A third
    // call would move Mercury by metres.
    let first_s = now_m.length() / LIGHT_SPEED_M_S;
    let then_m = observer.place_earlier_m(planet, first_s)? - observer.position_m();
    let light_s = then_m.length() / LIGHT_SPEED_M_S;
    let source_m = then_m - (now_m - then_m) / first_s * (light_s - first_s);

    let from_sun_m =
        observer.position_m() + source_m - (bodies.sun.position_m - bodies.sun.velocity_m_s * light_s);
    let distance_m = source_m.length();
    let illumination = Illumination {
        sun_distance_au: from_sun_m.length() / ASTRONOMICAL_UNIT_M,
        observer_distance_au: distance_m / ASTRONOMICAL_UNIT_M,
        phase_rad: separation_rad(from_sun_m, source_m),
    };
    let Magnitude { value, extrapolated } =
        magnitude_of(planet, tdb_s - light_s, &illumination, -from_sun_m, -source_m);
    Ok(Some(SeenPlanet {
        planet,
        direction: observer.apparent_source(source_m),
        distance_m,
        sun_distance_m: from_sun_m.length(),
        phase_angle_rad: illumination.phase_rad,
        angular_radius_rad: (observer.ephemeris().radii_m(planet)[0] / distance_m).min(1.0).asin(),
        magnitude: value,
        magnitude_extrapolated: extrapolated,
    }))
}

/// The magnitude of a planet from which the Sun and the observer lie at the given vectors (ICRF axes).
fn magnitude_of(planet: Planet, tdb_s: f64, seen: &Illumination, sun: DVec3, observer: DVec3) -> Magnitude {
    match planet {
        Planet::Mercury => magnitude::mercury(seen),
        Planet::Venus => magnitude::venus(seen),
        Planet::Earth => magnitude::earth(seen),
        Planet::Moon => magnitude::moon(seen),
        Planet::Mars => {
            let body_from_inertial = RotationalElements::mars(tdb_s).body_from_inertial();
            let [sun_west, observer_west] = [sun, observer].map(|to| {
                let to = body_from_inertial * to;
                (-to.y).atan2(to.x)
            });
            // Midway on the shorter arc.
            let apart = (observer_west - sun_west + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU)
                - std::f64::consts::PI;
            let ls_rad = ecliptic_longitude_rad(-sun) + MARS_LS_OFFSET_RAD;
            magnitude::mars(seen, sun_west + apart / 2.0, ls_rad)
        }
        Planet::Jupiter => magnitude::jupiter(seen),
        Planet::Saturn => {
            let [sun, observer] = [sun, observer].map(latitude_rad(RotationalElements::saturn(tdb_s)));
            magnitude::saturn(seen, sun, observer)
        }
        Planet::Uranus => {
            // Planetographic from planetocentric latitude: tan is divided by the axes' ratio squared.
            let [sun, observer] = [sun, observer]
                .map(latitude_rad(RotationalElements::uranus(tdb_s)))
                .map(|latitude| (latitude.tan() / URANUS_AXIS_RATIO.powi(2)).atan());
            magnitude::uranus(seen, sun, observer)
        }
        Planet::Neptune => magnitude::neptune(seen, 2000.0 + tdb_s / DAY_S / YEAR_D),
    }
}

/// Planetocentric latitude under a direction.
fn latitude_rad(elements: RotationalElements) -> impl Fn(DVec3) -> f64 {
    let north = elements.body_from_inertial().inverse() * DVec3::Z;
    move |to| std::f64::consts::FRAC_PI_2 - separation_rad(north, to)
}

/// The unit vector at an ecliptic longitude and latitude of J2000, along ICRF axes.
pub(crate) fn from_ecliptic(longitude_rad: f64, latitude_rad: f64) -> DVec3 {
    let (sin, cos) = OBLIQUITY_RAD.sin_cos();
    let along = DVec3::new(
        latitude_rad.cos() * longitude_rad.cos(),
        latitude_rad.cos() * longitude_rad.sin(),
        latitude_rad.sin(),
    );
    DVec3::new(along.x, along.y * cos - along.z * sin, along.y * sin + along.z * cos)
}

#[cfg(test)]
mod tests;
