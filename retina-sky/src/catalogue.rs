//! A star catalogue, and the stars in a cone as a camera sees them.
//!
//! The embedded catalogue is Hipparcos: the new reduction (van Leeuwen 2007, CDS I/311) with the
//! Johnson V and B-V of XHIP (Anderson & Francis 2012), 57 479 entries to V 8.4;
//! `validation/build_catalogue.py` makes it. A table of a user's own stars is read by
//! [`StarCatalogue::read`].
//!
//! Where a star is seen: its place at the catalogue's epoch, moved on a straight line through space
//! at constant velocity and looked at from where the camera is,
//! `u = <u0 + t mu - parallax b>`, with the unit vector u0 and the tangential proper motion vector mu at
//! the epoch, t the time since then at which the light that arrives crossed the barycentre's distance
//! (SOFA's `iauPmpx`), b the camera's barycentric position in au. Radial velocities are not known, so
//! motion is across the line of sight (perspective acceleration: 0.1 arcsec for the nearest star in 30
//! years). Then light deflection and aberration, see [`crate::observer`].

mod packed;
mod table;

use std::fmt;
use std::path::Path;
use std::sync::OnceLock;

use glam::{DVec3, Vec3};
use retina_files::{InputError, read_text};

use crate::ephemeris::{ASTRONOMICAL_UNIT_M, LIGHT_SPEED_M_S};
use crate::observer::{Observer, separation_rad};
use crate::{CENTURY_D, DAY_S};

/// A Julian year, seconds.
const YEAR_S: f64 = CENTURY_D / 100.0 * DAY_S;
/// A milliarcsecond, radians.
const MAS_RAD: f64 = std::f64::consts::PI / 648_000_000.0;
/// More than single precision loses in the scalar product of two unit vectors.
const SINGLE_ROUNDING: f64 = 5e-7;

/// What a star is called.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub enum StarId {
    /// Its number in the Hipparcos catalogue.
    Hipparcos(u32),
    /// As a user's own catalogue calls it.
    Named(String),
}

impl fmt::Display for StarId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Hipparcos(number) => write!(f, "HIP {number}"),
            Self::Named(name) => f.write_str(name),
        }
    }
}

/// What to know of an entry before relying on it; all false in a user's own catalogue.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct StarNotes {
    /// The new reduction of Hipparcos has no solution: place and motion are from other sources.
    pub not_in_i311: bool,
    /// No source has its proper motion; it is taken as zero.
    pub no_proper_motion: bool,
    /// There is no parallax, or noise has made it negative; it is taken as zero.
    pub no_parallax: bool,
    /// The place is that of a system of several stars (its photocentre or its primary).
    pub several_components: bool,
    /// Very likely the light of a neighbouring entry once more; it is not seen in any cone.
    pub doubtful: bool,
}

/// One star at its catalogue's epoch.
#[derive(Debug, Clone, PartialEq)]
pub struct Star {
    /// What it is called.
    pub id: StarId,
    /// Epoch of the place, Julian year (TDB).
    pub epoch_jyear: f64,
    /// Place at the epoch: unit vector, ICRF.
    pub direction: DVec3,
    /// Proper motion, tangential, radians a Julian year along ICRF axes.
    pub proper_motion_rad_yr: DVec3,
    /// Annual parallax, radians; zero where there is none.
    pub parallax_rad: f64,
    /// Johnson V magnitude.
    pub v_magnitude: f64,
    /// Johnson B-V colour.
    pub b_v: Option<f64>,
    /// What to know of it.
    pub notes: StarNotes,
}

impl Star {
    /// A star from what catalogues give: right ascension and declination (radians), proper motions (in
    /// right ascension times cos declination) and parallax in milliarcseconds (a year).
    fn new(
        id: StarId,
        epoch_jyear: f64,
        [ra_rad, dec_rad]: [f64; 2],
        [pm_ra, pm_dec, parallax]: [f64; 3],
    ) -> Self {
        let (sin_ra, cos_ra) = ra_rad.sin_cos();
        let (sin_dec, cos_dec) = dec_rad.sin_cos();
        let east = DVec3::new(-sin_ra, cos_ra, 0.0);
        let north = DVec3::new(-sin_dec * cos_ra, -sin_dec * sin_ra, cos_dec);
        Self {
            id,
            epoch_jyear,
            direction: DVec3::new(cos_dec * cos_ra, cos_dec * sin_ra, sin_dec),
            proper_motion_rad_yr: (east * pm_ra + north * pm_dec) * MAS_RAD,
            parallax_rad: parallax.max(0.0) * MAS_RAD,
            v_magnitude: 0.0,
            b_v: None,
            notes: StarNotes::default(),
        }
    }

    /// Where the star is for someone at `position_m` (barycentric ICRF) at an epoch (TDB seconds since
    /// J2000): unit vector, proper motion and parallax in it, aberration and light deflection not.
    pub fn direction_from(&self, position_m: DVec3, tdb_s: f64) -> DVec3 {
        // Light reaches one who is nearer to the star earlier (Roemer), 0.8 mas for Barnard's at 5 au.
        let arrival_s = tdb_s + self.direction.dot(position_m) / LIGHT_SPEED_M_S;
        let years = years_after(self.epoch_jyear, arrival_s);
        let parallax = position_m * (self.parallax_rad / ASTRONOMICAL_UNIT_M);
        (self.direction + self.proper_motion_rad_yr * years - parallax).normalize()
    }
}

/// Julian years from a Julian epoch to an instant.
fn years_after(epoch_jyear: f64, tdb_s: f64) -> f64 {
    tdb_s / YEAR_S - (epoch_jyear - 2000.0)
}

/// A star as a camera sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeenStar<'a> {
    /// The star.
    pub star: &'a Star,
    /// Apparent direction: unit vector along ICRF axes.
    pub direction: DVec3,
    /// V magnitude.
    pub magnitude: f64,
}

/// Stars, the brightest first.
#[derive(Debug, Clone, PartialEq)]
pub struct StarCatalogue {
    stars: Vec<Star>,
    /// Their directions again, close together for the search.
    directions: Vec<Vec3>,
    /// Epochs of the earliest and the latest place, Julian years.
    epochs_jyear: [f64; 2],
    greatest_motion_rad_yr: f64,
    greatest_parallax_rad: f64,
}

impl StarCatalogue {
    /// The catalogue that comes with the program: Hipparcos to V 8.4, places of J1991.25.
    pub fn embedded() -> &'static Self {
        static EMBEDDED: OnceLock<StarCatalogue> = OnceLock::new();
        EMBEDDED.get_or_init(|| {
            let bytes = retina_assets::HIPPARCOS;
            Self::new(packed::read(bytes).expect("the embedded catalogue is whole, as a test checks"))
        })
    }

    /// Reads a user's own catalogue, a CSV table of one star a row.
    ///
    /// Columns: `id` (text, each once), `ra_deg` (-180 to 360), `dec_deg` (ICRF), `pm_ra_mas_yr` (cos
    /// declination in it), `pm_dec_mas_yr`, `parallax_mas` (zero or negative: far away), `v_mag`, `b_v` (may be
    /// empty). Places are those of J1991.25, as in the embedded catalogue, unless a column
    /// `epoch_jyear` says otherwise row by row.
    ///
    /// # Errors
    /// A table that cannot be read or is empty, a column missing or unknown, a cell that is empty or no
    /// finite number, a coordinate outside its range, an id given twice.
    pub fn read(path: impl AsRef<Path>) -> Result<Self, InputError> {
        let path = path.as_ref();
        Self::parse(path, &read_text(path)?)
    }

    /// As [`StarCatalogue::read`], from text already in memory; `path` only names it in errors.
    ///
    /// # Errors
    /// As [`StarCatalogue::read`].
    pub fn parse(path: &Path, text: &str) -> Result<Self, InputError> {
        Ok(Self::new(table::parse(path, text)?))
    }

    fn new(mut stars: Vec<Star>) -> Self {
        stars.sort_by(|a, b| a.v_magnitude.total_cmp(&b.v_magnitude).then_with(|| a.id.cmp(&b.id)));
        let mut catalogue = Self {
            directions: stars.iter().map(|star| star.direction.as_vec3()).collect(),
            stars: Vec::new(),
            epochs_jyear: [f64::INFINITY, f64::NEG_INFINITY],
            greatest_motion_rad_yr: 0.0,
            greatest_parallax_rad: 0.0,
        };
        for star in &stars {
            let [earliest, latest] = &mut catalogue.epochs_jyear;
            (*earliest, *latest) = (earliest.min(star.epoch_jyear), latest.max(star.epoch_jyear));
            let motion_rad_yr = star.proper_motion_rad_yr.length();
            catalogue.greatest_motion_rad_yr = catalogue.greatest_motion_rad_yr.max(motion_rad_yr);
            catalogue.greatest_parallax_rad = catalogue.greatest_parallax_rad.max(star.parallax_rad);
        }
        catalogue.stars = stars;
        catalogue
    }

    /// All entries, the brightest first.
    pub fn stars(&self) -> &[Star] {
        &self.stars
    }

    /// The entry of a Hipparcos number, found by looking through all of them.
    pub fn hipparcos(&self, number: u32) -> Option<&Star> {
        self.stars.iter().find(|star| star.id == StarId::Hipparcos(number))
    }

    /// The stars no fainter than a magnitude whose apparent direction lies within `half_angle_rad` of
    /// `axis` (unit vector, ICRF axes), the brightest first. Doubtful entries are left out.
    pub fn in_cone(
        &self,
        observer: &Observer,
        axis: DVec3,
        half_angle_rad: f64,
        faintest_magnitude: f64,
    ) -> Vec<SeenStar<'_>> {
        // Places of the catalogue pick candidates, in a cone wider by all that can move a star.
        let wide_rad = half_angle_rad + self.greatest_shift_rad(observer);
        let least_cosine = (wide_rad.min(std::f64::consts::PI).cos() - SINGLE_ROUNDING) as f32;
        let bright = self.stars.partition_point(|star| star.v_magnitude <= faintest_magnitude);
        let axis_single = axis.as_vec3();
        let mut seen = Vec::new();
        for (star, direction) in self.stars.iter().zip(&self.directions[..bright]) {
            if direction.dot(axis_single) < least_cosine || star.notes.doubtful {
                continue;
            }
            let direction =
                observer.apparent_star(star.direction_from(observer.position_m(), observer.tdb_s()));
            if separation_rad(direction, axis) <= half_angle_rad {
                seen.push(SeenStar { star, direction, magnitude: star.v_magnitude });
            }
        }
        seen
    }

    /// The most by which a star is seen off its place in the catalogue, radians.
    fn greatest_shift_rad(&self, observer: &Observer) -> f64 {
        let years = self
            .epochs_jyear
            .map(|epoch| years_after(epoch, observer.tdb_s()).abs())
            .into_iter()
            .fold(0.0, f64::max);
        let distance_au = observer.position_m().length() / ASTRONOMICAL_UNIT_M;
        let light_years = distance_au * ASTRONOMICAL_UNIT_M / LIGHT_SPEED_M_S / YEAR_S;
        // A shift across a unit vector turns it by no more than its length.
        self.greatest_motion_rad_yr * (years + light_years)
            + self.greatest_parallax_rad * distance_au
            + observer.greatest_shift_rad()
    }
}

#[cfg(test)]
mod tests;
