//! The solver: from points to a verified attitude, or to a reason why not.

use std::f64::consts::PI;

use glam::{DMat3, DVec2, DVec3};
use retina_sky::observer::Observer;

use super::attitude::{DirectionPair, wahba};
use super::camera::{StarCamera, StarPoint, unit};
use super::catalogue::{CatalogueOptions, SolverCatalogue};
use super::fit::{Covariance, Free, Sighting, SkyFit};
use super::hypotheses::{Outcome, Pass};
use super::pyramid::triples;
use super::solution::{Refusal, StarMatch, StarSolution};
use super::verify::{FEWEST_FOR_RADIAL, Verified};

/// What is known and what is asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct SolverOptions {
    /// Epoch of the catalogue's places, TDB seconds since J2000.
    pub tdb_s: f64,
    /// True over nominal focal length: least and greatest value that are tried.
    pub focal_ratio: [f64; 2],
    /// Standard deviation of a centroid that triangles are looked up with, px.
    pub centroid_px: f64,
    /// log10 of the greatest chance of a false answer.
    pub log10_bound: f64,
    /// Stars of the catalogue in a field, on average, of which pairs are made.
    pub stars_in_field: f64,
    /// Hypotheses (triangles of stars that fit one of points) after which an image is given up. A count and no time, so
    /// that answers are the same on each machine.
    pub most_hypotheses: usize,
}

impl Default for SolverOptions {
    fn default() -> Self {
        Self {
            tdb_s: DEFAULT_EPOCH_S,
            focal_ratio: [0.97, 1.03],
            centroid_px: 0.3,
            log10_bound: -7.0,
            stars_in_field: 25.0,
            most_hypotheses: MOST_HYPOTHESES,
        }
    }
}

/// J2020.0, the epoch of places where an image has no time: within ten years of it proper motion moves 99 % of the
/// stars by less than 3 arcsec.
pub const DEFAULT_EPOCH_S: f64 = 20.0 * 365.25 * 86_400.0;
/// Images of a known camera are solved within 100 hypotheses, with a focal length wrong by 2 % within 5000; all of a range
/// of focal lengths of 1 to 4 holds 50 000 to 150 000 (16 deg in the middle), at some 20 us each.
const MOST_HYPOTHESES: usize = 200_000;
/// Fewest points that are tried.
const FEWEST_POINTS: usize = 4;
/// Points that a hypothesis is verified with.
const VERIFIED_POINTS: usize = 60;
/// Points of the final fit.
const FITTED_POINTS: usize = 400;
/// Brightest points that triangles are made of.
pub(super) const TRIANGLE_POINTS: usize = 12;
/// Triangles that are tried at each focal length: one of three stars is among them in 95 % of cases where three fifths
/// of the brightest points are stars, in 99 % where seven tenths are.
const FIRST_TRIANGLES: usize = 60;
/// Passes that look for a mirrored image: close and loose tolerance at the nominal focal length.
const MIRRORED_PASSES: usize = 2;
/// Points closer than this are one, px: a trail or a clump is no evidence of many stars.
const APART_PX: f64 = 4.0;
/// Relative error of an angle by an uncalibrated lens's distortion and half a step of the scan over focal lengths.
pub(super) const LOOSE: f64 = 0.003;
/// How far a fitted focal length may lie beyond what was allowed, beside three of its standard deviations: what is left
/// of a calibrated camera's distortion.
const FOCAL_SLACK: f64 = 0.001;
/// Of a camera that is known.
const TIGHT: f64 = 0.0006;
/// Half the width of the scan's steps is [`LOOSE`].
const SCAN_STEP: f64 = 2.0 * LOOSE;

/// Finds attitudes of one camera's images.
#[derive(Debug, Clone)]
pub struct StarSolver {
    pub(super) catalogue: SolverCatalogue,
    pub(super) options: SolverOptions,
    /// Half the image's width and height on the tangent plane.
    pub(super) half: DVec2,
    pub(super) pixel_rad: f64,
    passes: Vec<Pass>,
}

impl StarSolver {
    /// Prepares the catalogue for a camera.
    pub fn new(camera: &StarCamera, options: SolverOptions) -> Self {
        let (half, corner) = camera.half_field();
        let [least, greatest] = options.focal_ratio;
        let pixel_rad = 1.0 / camera.pinhole.fx_px;
        let catalogue = SolverCatalogue::new(&CatalogueOptions {
            tdb_s: options.tdb_s,
            diagonal_rad: (2.0 * (corner / least).atan() * 1.01).min(PI),
            field_sr: 4.0 * half.x * half.y / (least * greatest),
            blend_rad: 3.0 * pixel_rad,
            stars_in_field: options.stars_in_field,
        });
        let middle = if least <= 1.0 && 1.0 <= greatest { 1.0 } else { (least * greatest).sqrt() };
        let mut scales = vec![middle];
        for step in 1.. {
            let factor = (1.0 + SCAN_STEP).powi(step);
            let [below, above] = [middle / factor, middle * factor];
            // A step's own width reaches half a step beyond its middle.
            let inside = |s: f64| s * (1.0 + LOOSE) >= least && s / (1.0 + LOOSE) <= greatest;
            scales.extend([below, above].into_iter().filter(|s| inside(*s)));
            if !inside(below) && !inside(above) {
                break;
            }
        }
        let most = triples(TRIANGLE_POINTS).count();
        let pass = |focal_ratio: f64, relative: f64, triangles: std::ops::Range<usize>| Pass {
            focal_ratio,
            relative,
            triangles,
        };
        // A camera that is what it is said to be is solved by the first pass; one that is not is soon found at its own
        // focal length; what is left are images with many false points.
        let mut passes = vec![pass(middle, TIGHT, 0..most)];
        passes.extend(scales.iter().map(|&scale| pass(scale, LOOSE, 0..FIRST_TRIANGLES)));
        passes.push(pass(middle, LOOSE, FIRST_TRIANGLES..most));
        Self { catalogue, options, half, pixel_rad, passes }
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
        let separate = self.separate(points);
        if separate.len() < FEWEST_POINTS {
            return Err(Refusal::TooFewPoints { found: separate.len(), needed: FEWEST_POINTS });
        }
        let Outcome { found, hypotheses, log10_best, stopped } = self.search(points, &separate, &self.passes);
        if let Some(verified) = found {
            let solution = self.finish(points, observer, verified, hypotheses);
            let [least, greatest] = self.options.focal_ratio;
            let (ratio, slack) = (solution.fit.focal_ratio, FOCAL_SLACK + 3.0 * solution.focal_ratio_sigma);
            if !(least - slack..=greatest + slack).contains(&ratio) {
                return Err(Refusal::FocalLength {
                    percent: 100.0 * (ratio - 1.0),
                    allowed: [least, greatest],
                });
            }
            return Ok(solution);
        }
        let flip = |point: &StarPoint| StarPoint {
            line_of_sight: DVec2::new(-point.line_of_sight.x, point.line_of_sight.y),
            ..*point
        };
        let flipped: Vec<StarPoint> = points.iter().map(flip).collect();
        // A mirrored sky is told by its brightest points at the focal length that is given.
        let first = &self.passes[..MIRRORED_PASSES];
        let mirrored = self.search(&flipped, &separate, first);
        if let Some(verified) = mirrored.found {
            let flipped = Box::new(self.finish(&flipped, observer, verified, mirrored.hypotheses));
            return Err(Refusal::Mirrored { flipped });
        }
        Err(Refusal::NoMatch { hypotheses, log10_best, log10_bound: self.options.log10_bound, stopped })
    }

    /// The brightest points, none beside a brighter one.
    fn separate(&self, points: &[StarPoint]) -> Vec<usize> {
        let apart2 = (APART_PX * self.pixel_rad).powi(2);
        let mut kept: Vec<usize> = Vec::with_capacity(VERIFIED_POINTS);
        for (at, point) in points.iter().enumerate() {
            let beside =
                |other: &usize| points[*other].line_of_sight.distance_squared(point.line_of_sight) < apart2;
            if !kept.iter().any(beside) {
                kept.push(at);
                if kept.len() == VERIFIED_POINTS {
                    break;
                }
            }
        }
        kept
    }

    /// The final fit: all points and all stars, the radius following the residuals.
    fn finish(
        &self,
        points: &[StarPoint],
        observer: Option<&Observer>,
        verified: Verified,
        hypotheses: usize,
    ) -> StarSolution {
        let points = &points[..points.len().min(FITTED_POINTS)];
        let zero_point = zero_point(points, &verified.matches, &self.catalogue);
        let faintest = points.iter().map(|p| p.flux).fold(f64::INFINITY, f64::min);
        let deepest = zero_point.map_or(f64::INFINITY, |zero| zero - 2.5 * faintest.log10() + 1.0);
        let stars = self.stars_in_field(&verified.fit, observer, deepest);
        // With an observer the whole field has moved against the table: the attitude alone, from what is matched.
        let direction: std::collections::BTreeMap<usize, DVec3> = stars.iter().copied().collect();
        let mut fit = verified.fit;
        let known: Vec<DirectionPair> = verified
            .matches
            .iter()
            .filter_map(|&(point, entry)| {
                let camera = unit(fit.corrected(points.get(point)?.line_of_sight));
                Some(DirectionPair { camera, inertial: *direction.get(&entry)?, weight: 1.0 })
            })
            .collect();
        if let Some(moved) = wahba(&known) {
            fit.camera_from_inertial = moved;
        }
        let mut state = Matched {
            fit,
            matches: verified.matches,
            covariance: [[0.0; 5]; 5],
            sigma_rad: self.pixel_rad / 3.0,
            excess_rad: 0.0,
        };
        let mut radius = 1.2 * self.pixel_rad;
        let mut free = None;
        for round in 0..5 {
            let matches = self.match_all(points, &stars, &state.fit, radius, zero_point);
            if matches.len() < FEWEST_POINTS {
                break;
            }
            let kind =
                free.unwrap_or(if matches.len() >= FEWEST_FOR_RADIAL { Free::Radial } else { Free::Focal });
            if kind == Free::Focal {
                // A distortion that is no longer fitted is none: it would have no uncertainty.
                state.fit.k1 = 0.0;
            }
            let Some(next) = state.refitted(points, &direction, matches, kind, self.pixel_rad) else { break };
            state = next;
            radius = (3.5 * state.sigma_rad).clamp(0.2 * self.pixel_rad, 1.2 * self.pixel_rad);
            // Distortion within its noise is left out, and all is fitted again without it.
            if round == 2 && kind == Free::Radial && state.fit.k1.abs() < 3.0 * state.covariance[4][4].sqrt()
            {
                state.fit.k1 = 0.0;
                free = Some(Free::Focal);
            }
        }
        let found: Vec<StarMatch> = state
            .matches
            .iter()
            .filter_map(|&(point, entry)| {
                Some(StarMatch {
                    point,
                    star: self.catalogue.star(entry),
                    magnitude: self.catalogue.entry(entry).magnitude,
                    residual_rad: state
                        .fit
                        .residual(points.get(point)?.line_of_sight, *direction.get(&entry)?),
                })
            })
            .collect();
        let squares: f64 = found.iter().map(|m| m.residual_rad.length_squared()).sum();
        let c = &state.covariance;
        StarSolution {
            attitude_covariance_rad2: DMat3::from_cols_array_2d(
                &[0, 1, 2].map(|i| [c[0][i], c[1][i], c[2][i]]),
            ),
            focal_ratio_sigma: c[3][3].sqrt(),
            k1_sigma: (state.fit.k1 != 0.0).then(|| c[4][4].sqrt()),
            fit: state.fit,
            rms_rad: (squares / found.len().max(1) as f64).sqrt(),
            matches: found,
            excess_sigma_rad: state.excess_rad,
            log10_false_probability: verified.log10_chance,
            zero_point_magnitude: zero_point,
            hypotheses,
        }
    }

    /// Entries in the field and their directions for an observer, brightest first.
    fn stars_in_field(&self, fit: &SkyFit, observer: Option<&Observer>, deepest: f64) -> Vec<(usize, DVec3)> {
        let axis = fit.camera_from_inertial.inverse() * DVec3::Z;
        let mut inside = Vec::new();
        let reach = 1.05 * (self.half.length() / fit.focal_ratio).atan();
        self.catalogue.all().for_each_within(axis, reach, |at| {
            if self.catalogue.entry(at).magnitude <= deepest {
                inside.push(at);
            }
        });
        inside.sort_unstable();
        inside.into_iter().map(|at| (at, self.catalogue.direction(at, observer))).collect()
    }

    /// Points and entries that are each other's nearest within a radius and agree in brightness.
    fn match_all(
        &self,
        points: &[StarPoint],
        stars: &[(usize, DVec3)],
        fit: &SkyFit,
        radius_rad: f64,
        zero_point: Option<f64>,
    ) -> Vec<(usize, usize)> {
        let mut order: Vec<usize> = (0..points.len()).collect();
        order.sort_by(|&a, &b| points[a].line_of_sight.x.total_cmp(&points[b].line_of_sight.x));
        let xs: Vec<f64> = order.iter().map(|&at| points[at].line_of_sight.x).collect();
        let mut of_point: Vec<Option<(f64, usize)>> = vec![None; points.len()];
        for &(entry, direction) in stars {
            let Some(at) = fit.project(direction) else { continue };
            let first = xs.partition_point(|x| *x < at.x - radius_rad);
            let nearest = order[first..]
                .iter()
                .take_while(|&&point| points[point].line_of_sight.x <= at.x + radius_rad)
                .map(|&point| (points[point].line_of_sight.distance_squared(at), point))
                .min_by(|a, b| a.0.total_cmp(&b.0));
            let Some((off, point)) = nearest.filter(|(off, _)| *off <= radius_rad * radius_rad) else {
                continue;
            };
            let agrees = zero_point.is_none_or(|zero| {
                let measured = zero - 2.5 * points[point].flux.log10();
                let brighter = measured - self.catalogue.entry(entry).magnitude;
                brighter.abs() < GREATEST_MAGNITUDE_ERROR || (points[point].saturated && brighter > 0.0)
            });
            if agrees && of_point[point].is_none_or(|(least, _)| off < least) {
                of_point[point] = Some((off, entry));
            }
        }
        of_point.iter().enumerate().filter_map(|(point, of)| of.map(|(_, entry)| (point, entry))).collect()
    }
}

/// V is not the camera's own band, and flux is measured in a window: a point that differs by more is another star.
const GREATEST_MAGNITUDE_ERROR: f64 = 1.5;

/// Magnitude of flux 1: the median over the matched stars that are not saturated.
fn zero_point(points: &[StarPoint], matches: &[(usize, usize)], catalogue: &SolverCatalogue) -> Option<f64> {
    let mut zeros: Vec<f64> = matches
        .iter()
        .filter(|(point, _)| points.get(*point).is_some_and(|p| !p.saturated))
        .map(|&(point, entry)| catalogue.entry(entry).magnitude + 2.5 * points[point].flux.log10())
        .collect();
    zeros.sort_by(f64::total_cmp);
    zeros.get(zeros.len() / 2).copied()
}

/// A fit and what it was made of.
struct Matched {
    fit: SkyFit,
    matches: Vec<(usize, usize)>,
    covariance: Covariance,
    /// Standard deviation of the residuals per axis, rad.
    sigma_rad: f64,
    /// What of it the points' own noise does not explain, rad.
    excess_rad: f64,
}

impl Matched {
    /// Fits anew to matches; points weigh by their noise and what the residuals show beyond it.
    fn refitted(
        &self,
        points: &[StarPoint],
        directions: &std::collections::BTreeMap<usize, DVec3>,
        matches: Vec<(usize, usize)>,
        free: Free,
        pixel_rad: f64,
    ) -> Option<Self> {
        let noise2 = |point: usize| points[point].sigma_rad.powi(2);
        let off2: Vec<(f64, f64)> = matches
            .iter()
            .map(|&(point, entry)| {
                let off = self.fit.residual(points[point].line_of_sight, directions[&entry]);
                (off.length_squared(), noise2(point))
            })
            .collect();
        let freedom = (2.0 * matches.len() as f64 - free.parameters() as f64).max(1.0);
        // No centroid is better than a fiftieth of a pixel before the camera has been calibrated.
        let excess2 = excess_variance(&off2, freedom).max((0.02 * pixel_rad).powi(2));
        let sightings: Vec<Sighting> = matches
            .iter()
            .map(|&(point, entry)| Sighting {
                measured: points[point].line_of_sight,
                direction: directions[&entry],
                sigma_rad: (noise2(point) + excess2).sqrt(),
            })
            .collect();
        let (fit, mut covariance) = self.fit.refined(&sightings, free, 3)?;
        let mut squares = Vec::with_capacity(2 * sightings.len());
        let mut chi2 = 0.0;
        for sighting in &sightings {
            let off = fit.residual(sighting.measured, sighting.direction);
            squares.extend([off.x * off.x, off.y * off.y]);
            chi2 += off.length_squared() / sighting.sigma_rad.powi(2);
        }
        squares.sort_by(f64::total_cmp);
        // Median of a squared normal deviate: 0.6745^2. Fitted parameters make residuals too small.
        let sigma_rad = squares[squares.len() / 2].sqrt() / 0.6745 * (squares.len() as f64 / freedom).sqrt();
        let excess = (chi2 / freedom).max(1.0);
        covariance.iter_mut().flatten().for_each(|value| *value *= excess);
        Some(Self { fit, matches, covariance, sigma_rad, excess_rad: excess2.sqrt() })
    }
}

/// The variance per axis that, added to each point's own, makes the weighted squares of residuals (squared length, own
/// variance) equal the degrees of freedom; zero where the own variances are enough.
fn excess_variance(off2: &[(f64, f64)], freedom: f64) -> f64 {
    let chi2 = |excess: f64| off2.iter().map(|(square, own)| square / (own + excess)).sum::<f64>();
    // All of the residuals' mean square is more than is needed.
    let mut high = off2.iter().map(|(square, _)| square).sum::<f64>() / freedom;
    let mut low = 0.0;
    for _ in 0..30 {
        let middle = 0.5 * (low + high);
        if chi2(middle) > freedom { low = middle } else { high = middle }
    }
    low
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_own_noise_does_not_explain_is_found() {
        // Equal own variances 4 and mean square 10 an axis: 6 are left; where they explain more than all, nothing is.
        let off2 = vec![(20.0, 4.0); 50];
        assert!((excess_variance(&off2, 100.0) - 6.0).abs() < 1e-6);
        assert!(excess_variance(&[(20.0, 40.0); 50], 100.0) < 1e-6);
    }
}
