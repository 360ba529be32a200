//! Where the Sun, the Earth and the Moon are, in ICRF metres from the Solar System's barycentre (the planets:
//! see [`crate::planets`]): from analytical theories, or from the user's own SPK kernels.
//!
//! The theories need no file:
//! - Earth: SOFA's `epv00` (a reduced VSOP2000 fitted to DE405). Against DE405 over 1900-2100 the
//!   heliocentric position is off by 3.7 km rms and 11.2 km at most, the barycentric one by 4.6
//!   and 13.4 km (SOFA's own figures).
//! - Moon: SOFA's `moon98` (Meeus 1998, after ELP-2000/82), rotated from the mean ecliptic of date
//!   into the GCRS by the IAU 2006 precession and bias. Against ELP/MPP02 over 1950-2100 it is off
//!   by 6.1 km rms and 31.7 km at most, 36 mm/s rms (SOFA's own figures).
//!   Its velocity leaves out the turn of the axes by precession, 3 mm/s.
//!
//! Both are taken at TDB where TT is asked for: the 1.7 ms are 2 m of the Moon's way.
//!
//! Kernels (JPL's de421.bsp, de440s.bsp and the like) are evaluated by anise along their own axes, which are
//! ICRF's to a milliarcsecond (Folkner et al. 2009 for DE421; 0.2 mas for DE430 and DE440). Where they lack a
//! body or an epoch there is an error: the theories never stand in for them.

mod kernels;
pub(crate) mod records;
mod spk;
mod table;

use std::path::PathBuf;
use std::sync::Arc;

use glam::{DQuat, DVec3};
use retina_files::InputError;
use sofars::eph::{epv00, moon98};
use thiserror::Error;

pub use self::kernels::KernelFile;
use self::kernels::Kernels;
pub(crate) use self::spk::{SPK_KIND, spans as spk_spans};
pub use self::table::{BODIES, EphemerisTable};
use crate::orientation;
use crate::planets::Planet;
pub use crate::spice::kernel_contents;
use crate::spice::{self, Axes};
use crate::time::{J2000_JD, format_epoch_tdb};
use crate::{CENTURY_D, DAY_S};

/// The astronomical unit, metres (IAU 2012 resolution B2).
pub const ASTRONOMICAL_UNIT_M: f64 = 149_597_870_700.0;
/// The speed of light in vacuum, metres a second.
pub const LIGHT_SPEED_M_S: f64 = 299_792_458.0;
/// Obliquity of the ecliptic at J2000, radians (IAU 2006: 84381.406 arcsec).
pub(crate) const OBLIQUITY_RAD: f64 = 84_381.406 * std::f64::consts::PI / 648_000.0;

/// A place that the ephemeris does not have.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum EphemerisError {
    /// An epoch for which the theories do not hold.
    #[error("no ephemeris at {} (it holds from 1900 to 2100)", format_epoch_tdb(*.tdb_s))]
    Epoch {
        /// The epoch asked for, TDB seconds since J2000.
        tdb_s: f64,
    },
    /// A body that no kernel has.
    #[error("no ephemeris of {body} in {kernels}; add a kernel (.bsp) that has it")]
    NoBody {
        /// The kernels' paths.
        kernels: String,
        /// The body's name and NAIF's number.
        body: String,
    },
    /// A name that neither RETINA nor a kernel gives a number.
    #[error(
        "no ephemeris of {body}: no kernel gives that name a number (NAIF_BODY_NAME); add a frame kernel (.tf) that \
         does, or give NAIF's number instead"
    )]
    NoNumber {
        /// The name.
        body: String,
    },
    /// An epoch that the kernels do not cover.
    #[error("no ephemeris of {body} at {} in {kernels}, which covers it from {covered}", format_epoch_tdb(*.tdb_s))]
    NotCovered {
        /// The paths of those that have the body.
        kernels: String,
        /// The body's name and NAIF's number.
        body: String,
        /// The epoch asked for, TDB seconds since J2000.
        tdb_s: f64,
        /// The spans that are covered.
        covered: String,
    },
    /// A kernel that covers the epoch and cannot be evaluated there.
    #[error("{body} at {} cannot be evaluated from {kernels}: {reason}", format_epoch_tdb(*.tdb_s))]
    Kernel {
        /// The paths of those that have the body.
        kernels: String,
        /// The body's name and NAIF's number.
        body: String,
        /// The epoch asked for, TDB seconds since J2000.
        tdb_s: f64,
        /// What hinders.
        reason: String,
    },
    /// A frame whose axes no kernel turns at an epoch.
    #[error("no axes of {frame} at {}: {reason}", format_epoch_tdb(*.tdb_s))]
    Attitude {
        /// The frame's or the body's name.
        frame: String,
        /// The epoch asked for, TDB seconds since J2000.
        tdb_s: f64,
        /// What is missing.
        reason: String,
    },
    /// An epoch at which no kernel says how a body is turned, though one does at others.
    #[error(
        "no axes of {body} at {} in {kernels}, which has them from {} to {}",
        format_epoch_tdb(*.tdb_s), format_epoch_tdb(*.from_s), format_epoch_tdb(*.to_s)
    )]
    AxesNotCovered {
        /// The paths of those that turn the body.
        kernels: String,
        /// The body's name and NAIF's number.
        body: String,
        /// The epoch asked for, TDB seconds since J2000.
        tdb_s: f64,
        /// The first epoch of the kernels, TDB seconds since J2000.
        from_s: f64,
        /// The last one.
        to_s: f64,
    },
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

/// Where bodies are taken from: the analytical theories, or kernels. Cheap to clone; kernels are held once.
///
/// The planets' places are [`Ephemeris::position_m`]'s.
#[derive(Debug, Clone, Default)]
pub struct Ephemeris {
    loaded: Option<Arc<Loaded>>,
}

/// What was read of kernels.
#[derive(Debug)]
struct Loaded {
    files: Vec<KernelFile>,
    /// SPK kernels, if there is one.
    places: Option<Kernels>,
    axes: Axes,
}

impl PartialEq for Ephemeris {
    /// The same theories, or kernels of the same content in the same order.
    fn eq(&self, other: &Self) -> bool {
        let hashes = |own: &Self| own.kernel_files().iter().map(|file| file.hash.clone()).collect::<Vec<_>>();
        hashes(self) == hashes(other)
    }
}

impl Ephemeris {
    /// The theories, 1900 to 2100.
    pub fn analytic() -> Self {
        Self::default()
    }

    /// SPICE kernels, or the theories where none is named. All are held in memory.
    ///
    /// SPK kernels replace the theories of places; where two give a body at the same time, the later one counts. Text
    /// and binary PCK kernels and frame kernels say how bodies are turned, in the stead of the built-in elements, and
    /// how large they are. Leap-second kernels are compared with the leap seconds of [`crate::time`]. A meta-kernel
    /// stands for those that it names.
    ///
    /// # Errors
    /// A file cannot be read, is of another kind, is damaged or cut short, or says what is not read.
    pub fn read(kernels: &[PathBuf]) -> Result<Self, InputError> {
        if kernels.is_empty() {
            return Ok(Self::analytic());
        }
        let mut places = Kernels::new();
        let sorted = spice::read(kernels, |file, bytes| places.add(file, bytes))?;
        let loaded = Loaded { files: sorted.files, places: places.finish()?, axes: sorted.axes };
        Ok(Self { loaded: Some(Arc::new(loaded)) })
    }

    /// The kernels' files in their order, those that a meta-kernel names in its place; none of the theories.
    pub fn kernel_files(&self) -> &[KernelFile] {
        self.loaded.as_ref().map_or(&[], |loaded| &loaded.files)
    }

    /// What results name: `analytic`, or the kernels' names; `analytic` and names where no kernel has places.
    pub fn name(&self) -> String {
        let theories = self.kernels().is_none().then(|| "analytic".to_owned());
        let files = self.kernel_files().iter().map(KernelFile::name);
        theories.into_iter().chain(files).collect::<Vec<_>>().join(", ")
    }

    pub(crate) fn kernels(&self) -> Option<&Kernels> {
        self.loaded.as_ref()?.places.as_ref()
    }

    /// The rotation from ICRF axes to a body's (x prime meridian, z north): by kernels that turn it, otherwise by the
    /// built-in elements ([`orientation::body_from_inertial`]); `None` for a body that neither knows.
    ///
    /// # Errors
    /// Kernels turn the body, but not at this epoch (TDB seconds since J2000).
    pub fn body_from_inertial(&self, name: &str, tdb_s: f64) -> Result<Option<DQuat>, EphemerisError> {
        if let Some(loaded) = &self.loaded
            && let Some(turn) = loaded.axes.body_from_inertial(name, tdb_s)?
        {
            return Ok(Some(turn));
        }
        Ok(orientation::body_from_inertial(name, tdb_s))
    }

    /// The rotation from ICRF axes to those of a frame at an epoch (TDB seconds since J2000): of a spacecraft or an
    /// instrument, by its name or NAIF's number. CK and frame kernels say it.
    ///
    /// # Errors
    /// No kernel defines the frame, or turns it at this epoch.
    pub fn frame_from_inertial(&self, frame: &str, tdb_s: f64) -> Result<DQuat, EphemerisError> {
        match &self.loaded {
            Some(loaded) => loaded.axes.frame_from_inertial(frame, tdb_s),
            None => Err(EphemerisError::Attitude {
                frame: frame.to_owned(),
                tdb_s,
                reason: "there are no kernels".to_owned(),
            }),
        }
    }

    /// The geometric state of a body or spacecraft that kernels know, by its name or NAIF's number, from the Solar System's
    /// barycentre at an epoch (TDB seconds since J2000).
    ///
    /// # Errors
    /// No SPK kernel has it at this epoch, or leads from it to the barycentre.
    pub fn state(&self, body: &str, tdb_s: f64) -> Result<State, EphemerisError> {
        let unknown = |kernels: String| EphemerisError::NoBody { kernels, body: body.to_owned() };
        let Some(loaded) = &self.loaded else { return Err(unknown("the analytical theories".to_owned())) };
        let Some(kernels) = &loaded.places else { return Err(unknown(self.name())) };
        if let Some(planet) = Planet::from_name(body) {
            return kernels.planet(planet, tdb_s);
        }
        match loaded.axes.number(body) {
            Some(number) => kernels.body(number, tdb_s),
            None => Err(EphemerisError::NoNumber { body: body.to_owned() }),
        }
    }

    /// What turns a body where it is a kernel: the frame or the constants, and their files.
    pub fn axes_source(&self, name: &str) -> Option<String> {
        self.loaded.as_ref()?.axes.source(name)
    }

    /// The bodies that kernels turn, by name and NAIF's number.
    pub fn turned_bodies(&self) -> Vec<String> {
        self.loaded.as_ref().map(|loaded| loaded.axes.bodies()).unwrap_or_default()
    }

    /// A body's semi-axes by kernels, m, along its own axes.
    pub fn semi_axes_m(&self, name: &str) -> Option<DVec3> {
        self.loaded.as_ref()?.axes.semi_axes_m(name)
    }

    /// A planet's equatorial and polar radius, m: by kernels, otherwise [`Planet::radius_m`].
    pub fn radii_m(&self, planet: Planet) -> [f64; 2] {
        match self.semi_axes_m(planet.name()) {
            Some(axes_m) => [axes_m.x.max(axes_m.y), axes_m.z],
            None => [planet.radius_m(), planet.polar_radius_m()],
        }
    }

    /// Sun, Earth and Moon at an epoch (TDB seconds since J2000).
    ///
    /// # Errors
    /// The epoch is outside 1900-2100, or kernels lack it or a body.
    pub fn solar_system(&self, tdb_s: f64) -> Result<SolarSystem, EphemerisError> {
        if let Some(kernels) = self.kernels() {
            let [earth, moon] = [Planet::Earth, Planet::Moon].map(|planet| kernels.planet(planet, tdb_s));
            return Ok(SolarSystem { sun: kernels.sun(tdb_s)?, earth: earth?, moon: moon? });
        }
        check(tdb_s)?;
        let (heliocentric, barycentric) =
            epv00(J2000_JD, tdb_s / DAY_S).ok_or(EphemerisError::Epoch { tdb_s })?;
        let earth = State::from_au(barycentric);
        let sun = earth.minus(State::from_au(heliocentric));
        let lunar = self.moon_from_earth(tdb_s)?;
        let moon = State {
            position_m: earth.position_m + lunar.position_m,
            velocity_m_s: earth.velocity_m_s + lunar.velocity_m_s,
        };
        Ok(SolarSystem { sun, earth, moon })
    }

    /// The Moon seen from the Earth's centre: geometric state, ICRF axes.
    ///
    /// # Errors
    /// As [`Ephemeris::solar_system`].
    pub fn moon_from_earth(&self, tdb_s: f64) -> Result<State, EphemerisError> {
        if let Some(kernels) = self.kernels() {
            return Ok(kernels.planet(Planet::Moon, tdb_s)?.minus(kernels.planet(Planet::Earth, tdb_s)?));
        }
        check(tdb_s)?;
        Ok(State::from_au(moon98(J2000_JD, tdb_s / DAY_S)))
    }

    /// Vector from the body's centre to the Sun, ICRF metres; `None` for a body other than `moon` and
    /// `earth`. Light-time of the Sun is in it, aberration (20 arcsec) is not: see
    /// [`SolarSystem::sun_from_m`].
    ///
    /// # Errors
    /// As [`Ephemeris::solar_system`].
    pub fn sun_from_body_m(&self, name: &str, tdb_s: f64) -> Result<Option<DVec3>, EphemerisError> {
        let place_m: fn(&SolarSystem) -> DVec3 = match name {
            "moon" => |bodies| bodies.moon.position_m,
            "earth" => |bodies| bodies.earth.position_m,
            _ => return Ok(None),
        };
        let bodies = self.solar_system(tdb_s)?;
        Ok(Some(bodies.sun_from_m(place_m(&bodies))))
    }

    /// The first new Moon after an epoch (TDB seconds since J2000), to about ten seconds: equal
    /// apparent geocentric ecliptic longitudes of Moon and Sun, as almanacs define it.
    ///
    /// # Errors
    /// As [`Ephemeris::solar_system`], for the epoch or the new Moon.
    pub fn next_new_moon_s(&self, after_tdb_s: f64) -> Result<f64, EphemerisError> {
        use std::f64::consts::{PI, TAU};
        const SYNODIC_MONTH_S: f64 = 29.530_589 * DAY_S;
        let behind_rad = self.elongation_rad(after_tdb_s)?.rem_euclid(TAU);
        let mut tdb_s = after_tdb_s + (TAU - behind_rad) / TAU * SYNODIC_MONTH_S;
        // The true rate keeps within 20 % of the mean one, so each pass gains a factor of five at least.
        for _ in 0..16 {
            let elongation_rad = (self.elongation_rad(tdb_s)? + PI).rem_euclid(TAU) - PI;
            tdb_s -= elongation_rad / TAU * SYNODIC_MONTH_S;
        }
        Ok(tdb_s)
    }

    /// Apparent ecliptic longitude of the Moon less that of the Sun, seen from the Earth's centre.
    fn elongation_rad(&self, tdb_s: f64) -> Result<f64, EphemerisError> {
        // Geocentric vectors one light-time back carry the annual aberration too (planetary aberration).
        let light_s = |distance_m: f64| distance_m / LIGHT_SPEED_M_S;
        let moon = self.moon_from_earth(tdb_s)?;
        let moon_m = moon.position_m - moon.velocity_m_s * light_s(moon.position_m.length());
        let bodies = self.solar_system(tdb_s)?;
        let sun = bodies.sun.minus(bodies.earth);
        let sun_m = sun.position_m - sun.velocity_m_s * light_s(sun.position_m.length());
        Ok(ecliptic_longitude_rad(moon_m) - ecliptic_longitude_rad(sun_m))
    }
}

/// Longitude along the ecliptic of J2000.
pub(crate) fn ecliptic_longitude_rad(vector: DVec3) -> f64 {
    let (sin, cos) = OBLIQUITY_RAD.sin_cos();
    (vector.y * cos + vector.z * sin).atan2(vector.x)
}

/// An error unless the epoch lies in 1900-2100, where the theories were fitted.
pub(crate) fn check(tdb_s: f64) -> Result<(), EphemerisError> {
    if tdb_s.abs() <= CENTURY_D * DAY_S { Ok(()) } else { Err(EphemerisError::Epoch { tdb_s }) }
}

#[cfg(test)]
mod tests;
