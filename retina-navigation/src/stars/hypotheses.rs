//! The search: hypotheses in the pyramid's order, until one is verified or as many as may be were looked at.

use glam::DVec3;

use super::camera::{StarPoint, unit};
use super::fit::SkyFit;
use super::pyramid::{AngleTolerance, Search, fit_of, triples};
use super::solver::{LOOSE, StarSolver, TRIANGLE_POINTS};
use super::verify::{Image, Verified};

/// One go over triangles of points.
#[derive(Debug, Clone)]
pub(super) struct Pass {
    pub(super) focal_ratio: f64,
    /// Relative tolerance of angles.
    pub(super) relative: f64,
    /// The first triangles, in the pyramid's order.
    pub(super) triangles: std::ops::Range<usize>,
}

/// What a search came to.
#[derive(Debug)]
pub(super) struct Outcome {
    /// The first hypothesis that keeps the bound.
    pub(super) found: Option<Verified>,
    /// Triangles of stars that were looked at.
    pub(super) hypotheses: usize,
    /// log10 of the best one's chance.
    pub(super) log10_best: f64,
    /// The search ended at its limit.
    pub(super) stopped: bool,
}

impl StarSolver {
    /// Goes over the passes.
    pub(super) fn search(&self, points: &[StarPoint], separate: &[usize], passes: &[Pass]) -> Outcome {
        let chosen: Vec<StarPoint> = separate.iter().map(|&at| points[at]).collect();
        let corner = self.half.length();
        let image = Image {
            catalogue: &self.catalogue,
            points: &chosen,
            half: self.half,
            radii_rad: [
                (LOOSE * corner).max(3.0 * self.pixel_rad),
                (0.4 * LOOSE * corner).max(2.0 * self.pixel_rad),
                1.2 * self.pixel_rad,
            ],
            sigma_rad: self.options.centroid_px * self.pixel_rad,
        };
        let mut search = Search::new(&self.catalogue, self.options.most_hypotheses);
        let mut log10_best = 0.0f64;
        let absolute_rad = 3.0 * 2f64.sqrt() * self.options.centroid_px * self.pixel_rad;
        let used = TRIANGLE_POINTS.min(chosen.len());
        let all: Vec<[usize; 3]> = triples(used).collect();
        for Pass { focal_ratio, relative, triangles } in passes {
            let units: Vec<DVec3> =
                chosen.iter().take(used).map(|p| unit(p.line_of_sight / *focal_ratio)).collect();
            let tolerance = AngleTolerance { absolute_rad, relative: *relative };
            for &triple in all.iter().take(triangles.end).skip(triangles.start) {
                let mut verified = None;
                let mut looked = search.candidates;
                search.triangles(triple, triple.map(|i| units[i]), tolerance, |triangle| {
                    looked += 1;
                    let seen = triangle.points.map(|i| chosen[i].line_of_sight);
                    let directions =
                        triangle.stars.map(|at| self.catalogue.bright().directions()[at as usize]);
                    let Some(fit) = fit_of(seen, directions) else { return false };
                    if !self.confirmed(&fit, &chosen[..used], triangle.points, image.radii_rad[0]) {
                        return false;
                    }
                    let Some(found) = image.verify(fit) else { return false };
                    let log10 = found.log10_chance + (looked as f64).log10();
                    log10_best = log10_best.min(log10);
                    if log10 <= self.options.log10_bound {
                        verified = Some(Verified { log10_chance: log10, ..found });
                    }
                    verified.is_some()
                });
                let found = verified.map(|found| {
                    let matches =
                        found.matches.iter().map(|&(point, star)| (separate[point], star)).collect();
                    Verified { matches, ..found }
                });
                let stopped = found.is_none() && search.exhausted();
                if found.is_some() || stopped {
                    return Outcome { found, hypotheses: search.candidates, log10_best, stopped };
                }
            }
        }
        Outcome { found: None, hypotheses: search.candidates, log10_best, stopped: false }
    }

    /// Whether a bright star stands where a further point is: the pyramid's fourth.
    fn confirmed(&self, fit: &SkyFit, points: &[StarPoint], triangle: [usize; 3], radius_rad: f64) -> bool {
        let inertial_from_camera = fit.camera_from_inertial.inverse();
        points.iter().enumerate().filter(|(at, _)| !triangle.contains(at)).any(|(_, point)| {
            let direction = inertial_from_camera * unit(point.line_of_sight / fit.focal_ratio);
            self.catalogue.bright().nearest_within(direction, radius_rad).is_some()
        })
    }
}
