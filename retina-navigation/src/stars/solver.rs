//! The solver: from points to a verified attitude, or to a reason why not.

use std::f64::consts::PI;
use std::sync::Arc;

use glam::DVec2;
use retina_sky::observer::Observer;

use super::camera::{StarCamera, StarPoint};
use super::catalogue::{CatalogueOptions, SolverCatalogue};
use super::hypotheses::{Focal, LEAST_DIAMETER, Outcome, PATTERN_POINTS, focal_steps};
use super::patterns::spread;
use super::solution::{Refusal, StarSolution};

/// What is known and what is asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct SolverOptions {
    /// Epoch of the catalogue's places, TDB seconds since J2000.
    pub tdb_s: f64,
    /// True over nominal focal length: least and greatest value that are tried.
    pub focal_ratio: [f64; 2],
    /// Standard deviation of a centroid that patterns are looked up with, px.
    pub centroid_px: f64,
    /// log10 of the greatest chance of a false answer.
    pub log10_bound: f64,
    /// Hypotheses (patterns of stars that fit one of points) after which an image is given up. A count and no time, so
    /// that answers are the same on each machine.
    pub most_hypotheses: usize,
    /// Whether an image that fits when it is flipped is solved; otherwise it is refused as mirrored.
    pub mirrored_too: bool,
}

impl Default for SolverOptions {
    fn default() -> Self {
        Self {
            tdb_s: DEFAULT_EPOCH_S,
            focal_ratio: [0.97, 1.03],
            centroid_px: 0.3,
            log10_bound: -7.0,
            most_hypotheses: MOST_HYPOTHESES,
            mirrored_too: false,
        }
    }
}

/// J2020.0, the epoch of places where an image has no time: within ten years of it proper motion moves 99 % of the
/// stars by less than 3 arcsec.
pub const DEFAULT_EPOCH_S: f64 = 20.0 * 365.25 * 86_400.0;
/// Far more than an image of any field of view holds.
const MOST_HYPOTHESES: usize = 200_000;
/// Fewest points that are tried: four make a hypothesis, and one that confirms it is no proof yet.
pub(super) const FEWEST_POINTS: usize = 5;
/// Points that a hypothesis is verified with.
const VERIFIED_POINTS: usize = 60;
/// Points closer than this are one, px: a trail or a clump is no evidence of many stars.
const APART_PX: f64 = 4.0;
/// Relative error of an angle by an uncalibrated lens's distortion.
pub(super) const LOOSE: f64 = 0.003;
/// How far a fitted focal length may lie beyond what was allowed, beside three of its standard deviations: what is left
/// of a calibrated camera's distortion.
const FOCAL_SLACK: f64 = 0.001;
/// Greatest diameter of a pattern, of the image's diagonal.
const GREATEST_DIAMETER: f64 = 0.8;
/// No pattern of the catalogue's stars is smaller, rad: a circle of 0.35 deg hardly ever holds four.
const LEAST_PATTERN_RAD: f64 = 0.006;

/// Points that patterns are made of where the shape of the pixels is not known.
const ASPECT_POINTS: usize = 12;
/// Step between shapes of pixels that are tried, relative.
pub const ASPECT_STEP: f64 = 0.025;

/// Finds attitudes of one camera's images.
#[derive(Debug, Clone)]
pub struct StarSolver {
    pub(super) catalogue: Arc<SolverCatalogue>,
    pub(super) options: SolverOptions,
    /// Half the image's width and height on the tangent plane.
    pub(super) half: DVec2,
    pub(super) pixel_rad: f64,
    pub(super) focal_steps: Vec<Focal>,
    /// Points that patterns are made of.
    pub(super) pattern_points: usize,
    /// The shape of the pixels is known to half of this, relative, and fitted; `None` where it is known.
    pub(super) aspect_step: Option<f64>,
}

impl StarSolver {
    /// Prepares the catalogue for a camera.
    pub fn new(camera: &StarCamera, options: SolverOptions) -> Self {
        let (half, corner) = camera.half_field();
        let [least, greatest] = options.focal_ratio;
        let pixel_rad = camera.pixel_rad();
        let diagonal_rad = |ratio: f64| 2.0 * (corner / ratio).atan();
        let catalogue = Arc::new(SolverCatalogue::new(&CatalogueOptions {
            tdb_s: options.tdb_s,
            diameters_rad: [
                (LEAST_DIAMETER * diagonal_rad(greatest)).max(LEAST_PATTERN_RAD),
                (GREATEST_DIAMETER * diagonal_rad(least)).min(0.5 * PI),
            ],
            pixel_rad: [pixel_rad / greatest, pixel_rad / least],
        }));
        let focal_steps = focal_steps([least, greatest], corner);
        Self {
            catalogue,
            options,
            half,
            pixel_rad,
            focal_steps,
            pattern_points: PATTERN_POINTS,
            aspect_step: None,
        }
    }

    /// The solver of a camera whose pixels have about another shape, which it fits: half of [`ASPECT_STEP`] on
    /// either side. It makes patterns of the first points alone, since shapes that are not known let more of them pass.
    pub fn of_pixel_aspect(&self, camera: &StarCamera) -> Self {
        let (half, corner) = camera.half_field();
        Self {
            half,
            pixel_rad: camera.pixel_rad(),
            focal_steps: focal_steps(self.options.focal_ratio, corner),
            pattern_points: ASPECT_POINTS,
            aspect_step: Some(ASPECT_STEP),
            ..self.clone()
        }
    }

    /// The catalogue.
    pub fn catalogue(&self) -> &SolverCatalogue {
        &self.catalogue
    }

    /// The attitude that explains the points (brightest first). With an observer the stars' directions are those
    /// that it sees (aberration, parallax, proper motion to its time), and the attitude is that of the inertial axes;
    /// without one the attitude is that of the apparent sky, up to 21 arcsec off near the Earth.
    ///
    /// # Errors
    /// Why there is no answer.
    pub fn solve(&self, points: &[StarPoint], observer: Option<&Observer>) -> Result<StarSolution, Refusal> {
        self.solve_again(points, observer, 0)
    }

    /// As [`Self::solve`], for other points of an image of which so many hypotheses have been looked at before.
    ///
    /// # Errors
    /// Why there is no answer.
    pub fn solve_again(
        &self,
        points: &[StarPoint],
        observer: Option<&Observer>,
        hypotheses_before: usize,
    ) -> Result<StarSolution, Refusal> {
        let chosen = spread(points, APART_PX * self.pixel_rad, self.half.length(), VERIFIED_POINTS);
        if chosen.len() < FEWEST_POINTS {
            return Err(Refusal::TooFewPoints { found: chosen.len(), needed: FEWEST_POINTS });
        }
        let Outcome { found, hypotheses, log10_best, stopped } =
            self.search(points, &chosen, hypotheses_before);
        let Some((verified, flipped)) = found else {
            return Err(Refusal::NoMatch {
                hypotheses,
                log10_best,
                log10_bound: self.options.log10_bound,
                stopped,
            });
        };
        let solution = if flipped {
            let points: Vec<StarPoint> = points.iter().map(StarPoint::flipped).collect();
            self.finish(&points, observer, verified, hypotheses)
        } else {
            self.finish(points, observer, verified, hypotheses)
        };
        let solution = StarSolution { mirrored: flipped, ..solution };
        let [least, greatest] = self.options.focal_ratio;
        let (ratio, slack) = (solution.fit.focal_ratio, FOCAL_SLACK + 3.0 * solution.focal_ratio_sigma);
        if !(least - slack..=greatest + slack).contains(&ratio) {
            return Err(Refusal::FocalLength { percent: 100.0 * (ratio - 1.0), allowed: [least, greatest] });
        }
        if flipped && !self.options.mirrored_too {
            return Err(Refusal::Mirrored { flipped: Box::new(solution) });
        }
        Ok(solution)
    }
}
