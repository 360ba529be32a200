//! The final fit of a verified hypothesis: all points, all stars.

use std::collections::BTreeMap;

use glam::{DMat3, DVec3};
use retina_sky::observer::Observer;

use super::attitude::{DirectionPair, wahba};
use super::camera::{StarPoint, unit};
use super::fit::{COLUMNS, Covariance, Distortion, Free, Sighting, SkyFit};
use super::sky::Sky;
use super::solution::{StarMatch, StarSolution};
use super::solver::{FEWEST_POINTS, StarSolver};
use super::verify::{FEWEST_FOR_RADIAL, Verified};

/// Points of the final fit.
const FITTED_POINTS: usize = 400;
/// Turns of matching and fitting: five where k1 is enough.
const ROUNDS: usize = 9;
/// Fewest stars from which five parameters of distortion are fitted.
const FEWEST_FOR_FULL: usize = 30;
/// Parts of which each in turn is left out of a fit.
const PARTS: usize = 5;
/// A richer model's gain is larger than this many of its standard errors.
const GAIN_SIGMAS: f64 = 2.5;

impl StarSolver {
    /// The final fit: all points and all stars, the radius following the residuals.
    pub(super) fn finish(
        &self,
        points: &[StarPoint],
        observer: Option<&Observer>,
        verified: Verified,
        hypotheses: usize,
    ) -> StarSolution {
        let points = &points[..points.len().min(FITTED_POINTS)];
        let sky = self.catalogue.sky(self.pixel_rad / verified.fit.focal_ratio);
        let zero_point = zero_point(points, &verified.matches, sky);
        let faintest = points.iter().map(|p| p.flux).fold(f64::INFINITY, f64::min);
        let deepest = zero_point.map_or(f64::INFINITY, |zero| zero - 2.5 * faintest.log10() + 1.0);
        let stars = self.stars_in_field(sky, &verified.fit, observer, deepest);
        // With an observer the whole field has moved against the table: the attitude alone, from what is matched.
        let direction: BTreeMap<usize, DVec3> = stars.iter().copied().collect();
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
            covariance: [[0.0; COLUMNS]; COLUMNS],
            sigma_rad: self.pixel_rad / 3.0,
            excess_rad: 0.0,
        };
        let mut radius = 1.2 * self.pixel_rad;
        let mut free = None;
        let mut full_refused = false;
        for round in 0..ROUNDS {
            let matches = self.match_all(points, sky, &stars, &state.fit, radius, zero_point);
            if matches.len() < FEWEST_POINTS {
                break;
            }
            let distortion = free.unwrap_or(if matches.len() >= FEWEST_FOR_RADIAL {
                Distortion::Radial
            } else {
                Distortion::None
            });
            if distortion == Distortion::None {
                // A distortion that is no longer fitted is none: it would have no uncertainty.
                state.fit.k1 = 0.0;
            }
            let kind = Free { distortion, aspect: self.aspect_step.is_some() };
            let Some(next) = state.refitted(points, &direction, matches, kind, self.pixel_rad) else { break };
            state = next;
            radius = (3.5 * state.sigma_rad).clamp(0.2 * self.pixel_rad, 1.2 * self.pixel_rad);
            match (round, distortion) {
                // Distortion within its noise is left out, and all is fitted again without it.
                (2, Distortion::Radial) if state.fit.k1.abs() < 3.0 * state.covariance[4][4].sqrt() => {
                    state.fit.k1 = 0.0;
                    free = Some(Distortion::None);
                }
                // A richer one is taken where it foretells stars better that it has not seen. Stars of the corners may
                // then come within reach.
                (3.., Distortion::Radial | Distortion::None) if !full_refused => {
                    let simple = Free { distortion, aspect: self.aspect_step.is_some() };
                    let full = Free { distortion: Distortion::Full, aspect: self.aspect_step.is_some() };
                    if state.foretold_better(points, &direction, simple, full) {
                        free = Some(Distortion::Full);
                        radius = 2.0 * self.pixel_rad;
                    } else {
                        full_refused = true;
                    }
                }
                _ => {}
            }
            if round >= 4 && free != Some(Distortion::Full) {
                break;
            }
        }
        if state.covariance[0][0] == 0.0 {
            // Too few match within a pixel: what was verified is all there is, and its scatter says how well it fits.
            let rigid = Free { distortion: Distortion::None, aspect: self.aspect_step.is_some() };
            state = Matched { fit: SkyFit { k1: 0.0, ..state.fit }, ..state };
            let matches = state.matches.clone();
            if let Some(fitted) = state.refitted(points, &direction, matches, rigid, self.pixel_rad) {
                state = fitted;
            }
        }
        let found: Vec<StarMatch> = state
            .matches
            .iter()
            .filter_map(|&(point, entry)| {
                Some(StarMatch {
                    point,
                    star: sky.star(entry),
                    magnitude: sky.entry(entry).magnitude,
                    direction: *direction.get(&entry)?,
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
            higher_sigma: (c[5][5] > 0.0).then(|| [5, 6, 7, 8].map(|i| c[i][i].sqrt())),
            aspect_sigma: self.aspect_step.map(|_| c[9][9].sqrt()),
            fit: state.fit,
            rms_rad: (squares / found.len().max(1) as f64).sqrt(),
            matches: found,
            excess_sigma_rad: state.excess_rad,
            log10_false_probability: verified.log10_chance,
            zero_point_magnitude: zero_point,
            hypotheses,
            mirrored: false,
        }
    }

    /// Entries in the field and their directions for an observer, brightest first.
    fn stars_in_field(
        &self,
        sky: &Sky,
        fit: &SkyFit,
        observer: Option<&Observer>,
        deepest: f64,
    ) -> Vec<(usize, DVec3)> {
        let axis = fit.camera_from_inertial.inverse() * DVec3::Z;
        let mut inside = Vec::new();
        let reach = 1.05 * (self.half.length() / fit.focal_ratio).atan();
        sky.all().for_each_within(axis, reach, |at| {
            if sky.entry(at).magnitude <= deepest {
                inside.push(at);
            }
        });
        inside.sort_unstable();
        inside.into_iter().map(|at| (at, sky.direction(at, observer))).collect()
    }

    /// Points and entries that are each other's nearest within a radius and agree in brightness.
    fn match_all(
        &self,
        points: &[StarPoint],
        sky: &Sky,
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
                let brighter = measured - sky.entry(entry).magnitude;
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
fn zero_point(points: &[StarPoint], matches: &[(usize, usize)], sky: &Sky) -> Option<f64> {
    let mut zeros: Vec<f64> = matches
        .iter()
        .filter(|(point, _)| points.get(*point).is_some_and(|p| !p.saturated))
        .map(|&(point, entry)| sky.entry(entry).magnitude + 2.5 * points[point].flux.log10())
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
        directions: &BTreeMap<usize, DVec3>,
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

impl Matched {
    /// Whether a richer model of the camera foretells stars better that were left out of the fit than a simpler one: by
    /// the difference of their squared residuals in standard deviations, each cut off where outliers begin.
    fn foretold_better(
        &self,
        points: &[StarPoint],
        directions: &BTreeMap<usize, DVec3>,
        simple: Free,
        rich: Free,
    ) -> bool {
        if self.matches.len() < FEWEST_FOR_FULL {
            return false;
        }
        let sightings: Vec<Sighting> = self
            .matches
            .iter()
            .map(|&(point, entry)| Sighting {
                measured: points[point].line_of_sight,
                direction: directions[&entry],
                sigma_rad: points[point].sigma_rad.hypot(self.excess_rad),
            })
            .collect();
        let mut gains = Vec::with_capacity(sightings.len());
        for part in 0..PARTS {
            let rest: Vec<Sighting> =
                sightings.iter().enumerate().filter(|(at, _)| at % PARTS != part).map(|(_, s)| *s).collect();
            let fits = [simple, rich].map(|free| self.fit.refined(&rest, free, 4));
            let [Some((simple, _)), Some((rich, _))] = fits else { return false };
            for left in sightings.iter().skip(part).step_by(PARTS) {
                let off2 = |fit: &SkyFit| {
                    let off = fit.residual(left.measured, left.direction).length() / left.sigma_rad;
                    (off * off).min(16.0)
                };
                gains.push(off2(&simple) - off2(&rich));
            }
        }
        let count = gains.len() as f64;
        let mean = gains.iter().sum::<f64>() / count;
        let scatter = gains.iter().map(|gain| (gain - mean).powi(2)).sum::<f64>() / count;
        mean > GAIN_SIGMAS * (scatter / count).sqrt()
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
