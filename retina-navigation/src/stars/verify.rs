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

    fn refined(&self, fit: SkyFit, matches: &[(usize, usize)], distortion: Distortion) -> Option<SkyFit> {
        let sightings: Vec<Sighting> = matches
            .iter()
            .map(|&(point, entry)| Sighting {
                measured: self.points[point].line_of_sight,
                direction: self.sky.all().directions()[entry],
                sigma_rad: self.sigma_rad,
            })
            .collect();
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
    ///
    /// A pattern's own attitude may be several pixels off, so that some of its few matches are wrong. While matches
    /// within a radius become more, attitude and focal length alone are fitted: a distortion would follow the wrong ones.
    pub(crate) fn verify(&self, start: SkyFit) -> Option<Verified> {
        let depth = self.points.len() + self.points.len() / 2 + 10;
        let mut fit = start;
        let mut best: Option<Verified> = None;
        let mut looks = 0u32;
        'radii: for (round, &radius) in self.radii_rad.iter().enumerate() {
            let last = round + 1 == self.radii_rad.len();
            let mut most = 0;
            loop {
                let predicted = self.predicted(&fit, depth);
                let matches = self.matches(&predicted, radius);
                if matches.len() <= MATCHES_SPENT {
                    break 'radii;
                }
                let log10_chance = self.log10_chance(&predicted, matches.len(), radius);
                if looks == 0 && log10_chance > FIRST_LOOK_LOG10 {
                    break 'radii;
                }
                looks += 1;
                let grows = !last && matches.len() > most;
                most = most.max(matches.len());
                let radial = !grows && matches.len() >= FEWEST_FOR_RADIAL;
                let distortion = if radial { Distortion::Radial } else { Distortion::None };
                let Some(next) = self.refined(fit, &matches, distortion) else { break 'radii };
                fit = next;
                if best.as_ref().is_none_or(|known| log10_chance < known.log10_chance || last) {
                    let least = best.map_or(0.0, |known| known.log10_chance);
                    best = Some(Verified { fit, matches, log10_chance: log10_chance.min(least) });
                }
                if !grows {
                    break;
                }
            }
        }
        best.map(|found| Verified { log10_chance: found.log10_chance + f64::from(looks).log10(), ..found })
    }
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;
    use crate::stars::catalogue::{CatalogueOptions, SolverCatalogue};
    use crate::stars::solver::DEFAULT_EPOCH_S;

    /// A pattern with a wrong star gives an attitude that is some pixels and a focal length that is a per cent off.
    /// Whatever is accepted from there is the camera's attitude, and not one a few pixels beside it that has a distortion
    /// fitted to the first matches. A tenth of the points are no stars.
    #[test]
    fn what_is_accepted_from_a_start_some_pixels_off_is_the_truth() {
        let (half, pixel_rad) = (DVec2::new(0.14, 0.105), 1.37e-4);
        let catalogue = SolverCatalogue::new(&CatalogueOptions {
            tdb_s: DEFAULT_EPOCH_S,
            diameters_rad: [0.06, 0.28],
            pixel_rad: [0.97 * pixel_rad, 1.03 * pixel_rad],
        });
        let point = |at: DVec2| StarPoint {
            pixel: DVec2::ZERO,
            line_of_sight: at,
            sigma_rad: 0.1 * pixel_rad,
            flux: 1.0,
            saturated: false,
            on_edge: false,
        };
        let (mut accepted, mut worst_px) = (0, 0.0f64);
        for k in 0..400u32 {
            // Evenly between -0.5 and 0.5.
            let turn = |i: u32| f64::from(k * (7 + 4 * i) % 97) / 97.0 - 0.5;
            let attitude = DQuat::from_scaled_axis(6.0 * DVec3::new(turn(0), turn(1), turn(2)));
            let truth = SkyFit::pinhole(attitude, 1.0 + 0.001 * turn(3));
            let mut image = Image {
                sky: catalogue.sky(pixel_rad),
                points: &[],
                half,
                radii_rad: [3.8, 2.0, 1.2].map(|px| px * pixel_rad),
                sigma_rad: 0.3 * pixel_rad,
                aspect: false,
            };
            let seen = |(at, star): (usize, &Predicted)| {
                let draw = |m: u32| f64::from((at as u32 + 61 * k) * m % 211) / 211.0 - 0.5;
                let strange = draw(47) < -0.4;
                let place = 2.0 * half * DVec2::new(draw(83), draw(119));
                point(if strange { place } else { star.at + pixel_rad * DVec2::new(draw(29), draw(71)) })
            };
            let points: Vec<StarPoint> = image.predicted(&truth, 60).iter().enumerate().map(seen).collect();
            image.points = &points;
            let off = pixel_rad * DVec3::new(16.0 * turn(4), 16.0 * turn(5), 50.0 * turn(6));
            let start = DQuat::from_scaled_axis(off) * truth.camera_from_inertial;
            let start = SkyFit::pinhole(start, truth.focal_ratio + 0.02 * turn(7));
            if let Some(found) = image.verify(start).filter(|found| found.log10_chance < -7.0) {
                accepted += 1;
                let direction = truth.camera_from_inertial.inverse() * DVec3::new(0.1, 0.05, 1.0);
                let [found, truth] = [found.fit, truth].map(|fit| fit.project(direction).unwrap());
                worst_px = worst_px.max(found.distance(truth) / pixel_rad);
            }
        }
        assert!(accepted > 200 && worst_px < 0.5, "{accepted} accepted, {worst_px} px off at worst");
    }
}
