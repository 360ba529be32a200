//! The catalogue as the identification wants it: places at an epoch, patterns of four, and the sky at each scale.

use std::sync::OnceLock;

use glam::DVec3;
use retina_sky::catalogue::{Star, StarCatalogue};
use retina_sky::observer::Observer;

use super::quads::QuadTable;
use super::sky::Sky;

/// What a table of stars is made for.
#[derive(Debug, Clone, PartialEq)]
pub struct CatalogueOptions {
    /// Epoch of the places, TDB seconds since J2000.
    pub tdb_s: f64,
    /// Least and greatest diameter of a pattern, rad.
    pub diameters_rad: [f64; 2],
    /// Least and greatest angle of a pixel, rad.
    pub pixel_rad: [f64; 2],
}

/// Stars closer together than this are seen as one, px.
const BLENDED_PX: f64 = 3.0;

/// The sky of a [`super::StarSolver`].
#[derive(Debug, Clone)]
pub struct SolverCatalogue {
    stars: &'static [Star],
    /// Stars that are used, brightest first, as indices into all, and their directions.
    used: Vec<u32>,
    directions: Vec<DVec3>,
    quads: QuadTable,
    /// One for each half octave of the pixel's angle, made when it is wanted.
    skies: Vec<OnceLock<Sky>>,
    pixel_rad: [f64; 2],
}

impl SolverCatalogue {
    /// Builds it: places at the epoch as seen from the Sun's surroundings without aberration, which shifts a whole
    /// field alike to a few arcseconds.
    pub fn new(options: &CatalogueOptions) -> Self {
        let stars = StarCatalogue::embedded().stars();
        let used: Vec<u32> =
            (0..stars.len() as u32).filter(|&at| !stars[at as usize].notes.doubtful).collect();
        let directions: Vec<DVec3> =
            used.iter().map(|&at| stars[at as usize].direction_from(DVec3::ZERO, options.tdb_s)).collect();
        let quads = QuadTable::new(&directions, options.diameters_rad);
        let [least, greatest] = options.pixel_rad;
        let steps = (2.0 * (greatest / least).log2()).ceil().max(1.0) as usize;
        let skies = (0..steps).map(|_| OnceLock::new()).collect();
        let catalogue = Self { stars, used, directions, quads, skies, pixel_rad: options.pixel_rad };
        if steps == 1 {
            // Of a known camera it is wanted in any case.
            catalogue.sky(least);
        }
        catalogue
    }

    /// Number of patterns of four stars.
    pub fn patterns(&self) -> usize {
        self.quads.len()
    }

    pub(crate) fn quads(&self) -> &QuadTable {
        &self.quads
    }

    /// The direction of a pattern's star.
    pub(crate) fn direction(&self, star: u16) -> DVec3 {
        self.directions[usize::from(star)]
    }

    /// The sky of pixels of an angle.
    pub(crate) fn sky(&self, pixel_rad: f64) -> &Sky {
        let [least, greatest] = self.pixel_rad;
        let count = self.skies.len() as f64;
        let step = (greatest / least).powf(1.0 / count);
        let at = if step > 1.0 { (pixel_rad / least).ln() / step.ln() } else { 0.0 };
        let at = at.clamp(0.0, count - 1.0).floor();
        self.skies[at as usize].get_or_init(|| {
            let middle_rad = least * step.powf(at + 0.5);
            Sky::new(self.stars, &self.used, &self.directions, BLENDED_PX * middle_rad)
        })
    }
}

impl Sky {
    /// The apparent direction of an entry: with an observer as it is seen there and then, otherwise at the epoch of
    /// the table without aberration.
    pub(crate) fn direction(&self, at: usize, observer: Option<&Observer>) -> DVec3 {
        match observer {
            None => self.all().directions()[at],
            Some(observer) => {
                let geometric = self.star(at).direction_from(observer.position_m(), observer.tdb_s());
                observer.apparent_star((geometric + self.entry(at).offset).normalize())
            }
        }
    }
}
