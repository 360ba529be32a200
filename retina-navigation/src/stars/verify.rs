//! A hypothesis as a whole: the catalogue projected into the image, and the chance of as many matches.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};

use super::camera::StarPoint;
use super::chance::log10_binomial_tail;
use super::fit::{Distortion, Free, Sighting, SkyFit};
use super::sky::Sky;

/// The image as hypotheses are verified against it.
#[derive(Debug)]
pub(crate) struct Image<'a> {
    pub(crate) sky: &'a Sky,
    /// Points, none beside another.
    pub(crate) points: &'a [StarPoint],
    /// Half the width and height on the tangent plane.
    pub(crate) half: DVec2,
    /// Matching radii, rad: for a pattern's own attitude, after a first fit, after a second.
    pub(crate) radii_rad: [f64; 3],
    /// Standard deviation per axis that all points are given here, rad.
    pub(crate) sigma_rad: f64,
    /// The shape of the pixels is fitted, too.
    pub(crate) aspect: bool,
}

/// A hypothesis that was fitted to all it matches.
#[derive(Debug, Clone)]
pub(crate) struct Verified {
    pub(crate) fit: SkyFit,
    /// Points and entries of the catalogue.
    pub(crate) matches: Vec<(usize, usize)>,
    /// log10 of the chance that one wrong hypothesis matches as many.
    pub(crate) log10_chance: f64,
}

/// Stars that make the hypothesis, and the parameters fitted to it (attitude, focal length, k1, the pixels' shape: 6 of
/// the 8 numbers that four stars give): their matches are no evidence, since a hypothesis is looked at only where they match.
const MATCHES_SPENT: usize = 4;
/// Fewest matches after which radial distortion is fitted.
pub(crate) const FEWEST_FOR_RADIAL: usize = 12;
/// A hypothesis is dropped where a wrong one would do as well this often.
const FIRST_LOOK_LOG10: f64 = -1.0;

/// A star as it would be seen.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Predicted {
    pub(crate) entry: usize,
    pub(crate) at: DVec2,
}

impl Image<'_> {
    /// The catalogue in the image by a fit, brightest first, at most `depth`.
    pub(crate) fn predicted(&self, fit: &SkyFit, depth: usize) -> Vec<Predicted> {
        let axis = fit.camera_from_inertial.inverse() * DVec3::Z;
        let reach = 1.1 * (self.half.length() / fit.focal_ratio).atan();
        let mut inside = Vec::with_capacity(2 * depth);
        self.sky.brightest(reach, 3 * depth).for_each_within(axis, reach, |at| inside.push(at));
        inside.sort_unstable();
        let mut out = Vec::with_capacity(depth);
        for entry in inside {
            if let Some(at) = fit.project(self.sky.all().directions()[entry])
                && at.x.abs() <= self.half.x
                && at.y.abs() <= self.half.y
            {
                out.push(Predicted { entry, at });
                if out.len() == depth {
                    break;
                }
            }
        }
        out
    }

    /// Each point's nearest star within a radius, each star with its nearest point.
    fn matches(&self, predicted: &[Predicted], radius_rad: f64) -> Vec<(usize, usize)> {
        let radius2 = radius_rad * radius_rad;
        let mut of_star: Vec<Option<(f64, usize)>> = vec![None; predicted.len()];
        for (point, seen) in self.points.iter().enumerate() {
            let nearest = predicted
                .iter()
                .map(|star| star.at.distance_squared(seen.line_of_sight))
                .enumerate()
                .min_by(|a, b| a.1.total_cmp(&b.1));
            if let Some((star, off)) = nearest
                && off <= radius2
                && of_star[star].is_none_or(|(least, _)| off < least)
            {
                of_star[star] = Some((off, point));
            }
        }
        let matched = of_star.iter().zip(predicted);
        matched.filter_map(|(of, star)| of.map(|(_, point)| (point, star.entry))).collect()
    }

    fn refined(&self, fit: SkyFit, matches: &[(usize, usize)]) -> Option<SkyFit> {
        let sightings: Vec<Sighting> = matches
            .iter()
            .map(|&(point, entry)| Sighting {
                measured: self.points[point].line_of_sight,
                direction: self.sky.all().directions()[entry],
                sigma_rad: self.sigma_rad,
            })
            .collect();
        let radial = matches.len() >= FEWEST_FOR_RADIAL;
        let distortion = if radial { Distortion::Radial } else { Distortion::None };
        let free = Free { distortion, aspect: self.aspect };
        Some(fit.refined(&sightings, free, 2)?.0)
    }

    /// log10 of the chance that a wrong attitude matches as many points within a radius.
    ///
    /// A point is hit where a star falls within the radius: the density of stars around the point, the greater of
    /// the mean one and that within a tenth of the field's width, times the disc's area.
    fn log10_chance(&self, predicted: &[Predicted], matched: usize, radius_rad: f64) -> f64 {
        let mean = predicted.len() as f64 / (4.0 * self.half.x * self.half.y);
        let around = 0.2 * self.half.x.max(self.half.y);
        let density = |at: DVec2| {
            let near = predicted.iter().filter(|star| star.at.distance_squared(at) < around * around).count();
            mean.max(near as f64 / (PI * around * around))
        };
        let disc = PI * radius_rad * radius_rad;
        let sum: f64 = self.points.iter().map(|point| (density(point.line_of_sight) * disc).min(1.0)).sum();
        log10_binomial_tail(
            self.points.len() - MATCHES_SPENT.min(self.points.len()),
            matched.saturating_sub(MATCHES_SPENT),
            sum / self.points.len() as f64,
        )
    }

    /// Fits a hypothesis to all that it matches, round by round closer; `None` where a wrong one would do as well.
    pub(crate) fn verify(&self, start: SkyFit) -> Option<Verified> {
        let depth = self.points.len() + self.points.len() / 2 + 10;
        let mut fit = start;
        let mut best: Option<Verified> = None;
        for (round, &radius) in self.radii_rad.iter().enumerate() {
            let predicted = self.predicted(&fit, depth);
            let matches = self.matches(&predicted, radius);
            if matches.len() <= MATCHES_SPENT {
                break;
            }
            let log10_chance = self.log10_chance(&predicted, matches.len(), radius);
            if round == 0 && log10_chance > FIRST_LOOK_LOG10 {
                break;
            }
            let Some(next) = self.refined(fit, &matches) else { break };
            fit = next;
            if best.as_ref().is_none_or(|known| log10_chance < known.log10_chance || round == 2) {
                let least = best.map_or(0.0, |known| known.log10_chance);
                best = Some(Verified { fit, matches, log10_chance: log10_chance.min(least) });
            }
        }
        // Three radii were looked at.
        best.map(|found| Verified { log10_chance: found.log10_chance + 3f64.log10(), ..found })
    }
}
