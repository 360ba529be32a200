//! The search: patterns of points among those of the catalogue, until one is verified.

use glam::{DVec2, DVec3};

use super::camera::{StarPoint, unit};
use super::fit::{Distortion, Free, Sighting, SkyFit};
use super::patterns::{Patterns, fit_of};
use super::quads::{Code, code_of};
use super::sky::Sky;
use super::solver::{LOOSE, StarSolver};
use super::verify::{Image, Verified};

/// Points that patterns are made of.
pub(super) const PATTERN_POINTS: usize = 28;
/// Patterns up to each of these points are tried at all focal lengths before further points are.
const STAGES: [usize; 4] = [8, 12, 18, PATTERN_POINTS];
/// Relative error of a pattern's shape by an uncalibrated lens's distortion and the focal length's step.
const LOOSE_SHAPE: f64 = 0.003;
/// Least diameter of a pattern, of the image's diagonal: the code of a smaller one says little.
pub(super) const LEAST_DIAMETER: f64 = 0.16;
/// Greatest step of the secant at the image's corner between focal lengths: a pattern there changes its shape by as much.
const SECANT_STEP: f64 = 0.03;
/// Codes at neighbouring focal lengths are one within this share of what they may be off by.
const SAME_CODE: f64 = 0.4;
/// Relative error of the focal length by a pattern's diameter.
const SCALE_SLACK: f64 = 0.04;

/// A focal length at which patterns are looked up, and those that it stands for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Focal {
    pub(super) ratio: f64,
    pub(super) range: [f64; 2],
}

/// The focal lengths at which the patterns of a range of them are looked up. The shape of a pattern on the sky hardly
/// depends on the focal length where the field is small.
pub(super) fn focal_steps([least, greatest]: [f64; 2], half_diagonal: f64) -> Vec<Focal> {
    let secant = |ratio: f64| (half_diagonal / ratio).hypot(1.0);
    let ratio_of = |secant: f64| half_diagonal / (secant * secant - 1.0).max(1e-12).sqrt();
    let (low, high) = (secant(greatest), secant(least));
    let count = ((high - low) / SECANT_STEP).ceil().max(1.0);
    let at = |step: f64| {
        if step == 0.0 {
            greatest
        } else if step == count {
            least
        } else {
            ratio_of(low + step * (high - low) / count)
        }
    };
    (0..count as usize)
        .map(|step| {
            let step = step as f64;
            let range = [at(step + 1.0), at(step)];
            Focal { ratio: (range[0] * range[1]).sqrt(), range }
        })
        .collect()
}

fn chord_angle(a: DVec3, b: DVec3) -> f64 {
    2.0 * (0.5 * a.distance(b)).min(1.0).asin()
}

/// What a search came to.
#[derive(Debug)]
pub(super) struct Outcome {
    /// The first hypothesis that keeps the bound, and whether it is of the flipped image.
    pub(super) found: Option<(Verified, bool)>,
    /// Patterns of stars that were looked at.
    pub(super) hypotheses: usize,
    /// log10 of the best one's chance.
    pub(super) log10_best: f64,
    /// The search ended at its limit.
    pub(super) stopped: bool,
}

/// A search that is under way.
struct Search<'a> {
    solver: &'a StarSolver,
    /// As they are, and flipped.
    points: [Vec<StarPoint>; 2],
    image_radii: [f64; 3],
    hypotheses: usize,
    before: usize,
    log10_best: f64,
    found: Option<(Verified, bool)>,
}

impl StarSolver {
    /// Looks up the patterns of the first points of `chosen`, after so many hypotheses of the image.
    pub(super) fn search(&self, points: &[StarPoint], chosen: &[usize], before: usize) -> Outcome {
        let as_seen: Vec<StarPoint> = chosen.iter().map(|&at| points[at]).collect();
        let flipped = as_seen.iter().map(StarPoint::flipped).collect();
        let corner = self.half.length();
        let mut search = Search {
            solver: self,
            points: [as_seen, flipped],
            image_radii: [
                (LOOSE * corner).max(3.0 * self.pixel_rad),
                (0.4 * LOOSE * corner).max(2.0 * self.pixel_rad),
                1.2 * self.pixel_rad,
            ],
            hypotheses: before,
            before,
            log10_best: 0.0,
            found: None,
        };
        let used = self.pattern_points.min(chosen.len());
        let mut first = 3;
        'stages: for stage in STAGES {
            let end = stage.min(used);
            let patterns = search.patterns(end);
            for last in first..end {
                if patterns.with_last(last, |four, codes| search.look_up(four, codes)) {
                    break 'stages;
                }
            }
            first = end.max(3);
        }
        let Search { hypotheses, log10_best, found, .. } = search;
        let stopped = found.is_none() && hypotheses - before >= self.options.most_hypotheses;
        let found = found.map(|(verified, flipped)| {
            let matches = verified.matches.iter().map(|&(point, star)| (chosen[point], star)).collect();
            (Verified { matches, ..verified }, flipped)
        });
        Outcome { found, hypotheses, log10_best, stopped }
    }
}

impl Search<'_> {
    fn patterns(&self, count: usize) -> Patterns {
        let half_diagonal = self.solver.half.length();
        let units = |focal: &Focal| -> Vec<DVec3> {
            self.points[0][..count].iter().map(|p| unit(p.line_of_sight / focal.ratio)).collect()
        };
        let least = |focal: &Focal| LEAST_DIAMETER * 2.0 * (half_diagonal / focal.ratio).atan();
        let focals = &self.solver.focal_steps;
        Patterns::new(
            &focals.iter().map(units).collect::<Vec<_>>(),
            &focals.iter().map(least).collect::<Vec<_>>(),
        )
    }

    /// Looks up four points, once for all neighbouring focal lengths at which their code is nearly the same. Says
    /// whether the search is at its end: a hypothesis is verified, or there have been too many.
    fn look_up(&mut self, four: [usize; 4], codes: &[Option<Code>]) -> bool {
        let points = &self.points[0];
        let length = points[four[0]].line_of_sight.distance(points[four[1]].line_of_sight);
        let off = LOOSE_SHAPE + 3.0 * self.solver.options.centroid_px * self.solver.pixel_rad / length;
        let mut first = 0;
        while first < codes.len() {
            let Some(code) = codes[first] else {
                first += 1;
                continue;
            };
            let same = |other: &Option<Code>| {
                other.is_some_and(|other| (0..4).all(|n| (other[n] - code[n]).abs() <= SAME_CODE * off))
            };
            let run = codes[first..].iter().take_while(|code| same(code)).count();
            let last = first + run - 1;
            let middle = codes[(first + last) / 2].unwrap_or(code);
            if self.look_up_code(four, middle, off, [first, last]) {
                return true;
            }
            first = last + 1;
        }
        false
    }

    /// Looks up the code that four points have at some focal lengths, and flipped.
    fn look_up_code(&mut self, four: [usize; 4], code: Code, off: f64, [first, last]: [usize; 2]) -> bool {
        let solver = self.solver;
        let catalogue = &solver.catalogue;
        let range = [solver.focal_steps[last].range[0], solver.focal_steps[first].range[1]];
        let at = solver.focal_steps[(first + last) / 2].ratio;
        let [a, b] = [0, 1].map(|k| unit(self.points[0][four[k]].line_of_sight / at));
        let diameter = at * chord_angle(a, b);
        let along = solver.aspect_step.map_or([0.0; 4], |step| self.by_aspect(four, at, code, 0.5 * step));
        let mirror = |[cx, cy, dx, dy]: Code| [cx, -cy, dx, -dy];
        for (flipped, code, along) in [(false, code, along), (true, mirror(code), mirror(along))] {
            let end = catalogue.quads().look_up(code, along, off, |stars| {
                let directions = stars.map(|star| catalogue.direction(star));
                let ratio = diameter / chord_angle(directions[0], directions[1]);
                if ratio < range[0] * (1.0 - SCALE_SLACK) || ratio > range[1] * (1.0 + SCALE_SLACK) {
                    return false;
                }
                self.hypotheses += 1;
                self.verified(four, directions, ratio, flipped)
                    || self.hypotheses - self.before >= solver.options.most_hypotheses
            });
            if end {
                return true;
            }
        }
        false
    }

    /// By how much the code of four points changes where pixels are higher by a share.
    fn by_aspect(&self, four: [usize; 4], focal_ratio: f64, code: Code, share: f64) -> Code {
        let stretched = four.map(|at| {
            let seen = self.points[0][at].line_of_sight / focal_ratio;
            unit(DVec2::new(seen.x, seen.y * (1.0 + share)))
        });
        match code_of(stretched) {
            Some(other) => std::array::from_fn(|n| other[n] - code[n]),
            None => [0.0; 4],
        }
    }

    /// Whether four points are four stars.
    fn verified(&mut self, four: [usize; 4], directions: [DVec3; 4], ratio: f64, flipped: bool) -> bool {
        let solver = self.solver;
        let points = &self.points[usize::from(flipped)];
        let Some(fit) = fit_of(four.map(|at| points[at].line_of_sight), directions, ratio) else {
            return false;
        };
        let fit = if let Some(step) = solver.aspect_step {
            let own = four.into_iter().zip(directions).map(|(at, direction)| Sighting {
                measured: points[at].line_of_sight,
                direction,
                sigma_rad: solver.options.centroid_px * solver.pixel_rad,
            });
            let shape = Free { distortion: Distortion::None, aspect: true };
            match fit.refined(&own.collect::<Vec<_>>(), shape, 3) {
                Some((fit, _)) if (fit.aspect - 1.0).abs() <= step => fit,
                _ => return false,
            }
        } else {
            fit
        };
        let sky = solver.catalogue.sky(solver.pixel_rad / fit.focal_ratio);
        if !solver.confirmed(
            &fit,
            sky,
            &points[..points.len().min(PATTERN_POINTS)],
            four,
            self.image_radii[0],
        ) {
            return false;
        }
        let image = Image {
            sky,
            points,
            half: solver.half,
            radii_rad: self.image_radii,
            sigma_rad: solver.options.centroid_px * solver.pixel_rad,
            aspect: solver.aspect_step.is_some(),
        };
        let Some(found) = image.verify(fit) else { return false };
        let log10 = found.log10_chance + (self.hypotheses as f64).log10();
        self.log10_best = self.log10_best.min(log10);
        if log10 > solver.options.log10_bound {
            return false;
        }
        self.found = Some((Verified { log10_chance: log10, ..found }, flipped));
        true
    }
}

impl StarSolver {
    /// Whether a bright star stands where a further point is.
    fn confirmed(
        &self,
        fit: &SkyFit,
        sky: &Sky,
        points: &[StarPoint],
        four: [usize; 4],
        radius: f64,
    ) -> bool {
        let inertial_from_camera = fit.camera_from_inertial.inverse();
        let cone_rad = (self.half.length() / fit.focal_ratio).atan();
        let bright = sky.brightest(cone_rad, 3 * points.len());
        points.iter().enumerate().filter(|(at, _)| !four.contains(at)).any(|(_, point)| {
            let place: DVec2 = fit.corrected(point.line_of_sight);
            let direction = inertial_from_camera * unit(place);
            // Off the boresight the plane stretches angles, the least across the radius.
            let radius_rad = radius / (fit.focal_ratio * place.length().hypot(1.0));
            bright.nearest_within(direction, radius_rad).is_some()
        })
    }
}
