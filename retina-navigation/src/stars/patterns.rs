//! The points that patterns are made of, and their patterns in the order in which they are tried.

use glam::{DMat3, DQuat, DVec2, DVec3};

use super::camera::StarPoint;
use super::fit::SkyFit;
use super::quads::{Code, Frame};

/// Points that are looked at, brightest first.
const LOOKED_AT: usize = 300;
/// Where fewer points stand clear, those on edges are taken, too.
const FEWEST_CLEAR: usize = 8;
/// Surroundings of a point, of the image's half diagonal.
const SURROUNDINGS: f64 = 0.35;

/// Of points (brightest first) at most `most`, none beside a brighter one: those first that have few brighter ones in
/// their surroundings, so that no bright clump is all there is. Points on edges count only where there is little else.
pub(super) fn spread(points: &[StarPoint], apart: f64, half_diagonal: f64, most: usize) -> Vec<usize> {
    let clear = points.iter().filter(|point| !point.on_edge).count();
    let near2 = (SURROUNDINGS * half_diagonal).powi(2);
    let mut kept: Vec<(usize, usize)> = Vec::with_capacity(LOOKED_AT);
    let used = |point: &StarPoint| !point.on_edge || clear < FEWEST_CLEAR;
    for (at, point) in points.iter().enumerate().filter(|(_, point)| used(point)) {
        let (mut brighter, mut beside) = (0, false);
        for (_, other) in &kept {
            let off2 = points[*other].line_of_sight.distance_squared(point.line_of_sight);
            beside |= off2 < apart * apart;
            brighter += usize::from(off2 < near2);
        }
        if !beside {
            kept.push((brighter, at));
            if kept.len() == LOOKED_AT {
                break;
            }
        }
    }
    kept.sort_unstable();
    kept.into_iter().take(most).map(|(_, at)| at).collect()
}

/// The places of each third point in the frame of two, at each of some focal lengths.
#[derive(Debug)]
pub(super) struct Patterns {
    count: usize,
    focals: usize,
    /// By A, B (A < B), C and focal length; none where C is outside the circle or the pattern is too small.
    places: Vec<Option<DVec2>>,
}

impl Patterns {
    /// Of points as unit vectors, for each focal length, and the least distance of A and B for each, rad.
    pub(super) fn new(units: &[Vec<DVec3>], least_rad: &[f64]) -> Self {
        let (count, focals) = (units.first().map_or(0, Vec::len), units.len());
        let mut places = vec![None; count * count * count * focals];
        for (focal, (units, least)) in units.iter().zip(least_rad).enumerate() {
            for a in 0..count {
                for b in a + 1..count {
                    if units[a].distance(units[b]) < *least {
                        continue;
                    }
                    let Some(frame) = Frame::new(units[a], units[b]) else { continue };
                    for c in (0..count).filter(|c| *c != a && *c != b) {
                        places[((a * count + b) * count + c) * focals + focal] = frame.place(units[c]);
                    }
                }
            }
        }
        Self { count, focals, places }
    }

    fn places(&self, a: usize, b: usize, c: usize) -> &[Option<DVec2>] {
        let first = ((a * self.count + b) * self.count + c) * self.focals;
        &self.places[first..first + self.focals]
    }

    /// Calls `each` with the patterns whose last point is `last`: their points A, B, C and D and their codes at each
    /// focal length. Ends when it says true; says whether it did.
    pub(super) fn with_last(
        &self,
        last: usize,
        mut each: impl FnMut([usize; 4], &[Option<Code>]) -> bool,
    ) -> bool {
        let mut codes = vec![None; self.focals];
        let mut pair = |a: usize, b: usize| {
            // The last point is one of the two, or one of those inside.
            let first = if b == last { 0 } else { last };
            for c in first..=last {
                let of_c = self.places(a, b, c);
                if of_c.iter().all(Option::is_none) {
                    continue;
                }
                for d in 0..c {
                    let mut any = false;
                    for (code, (c, d)) in codes.iter_mut().zip(of_c.iter().zip(self.places(a, b, d))) {
                        *code = c.zip(*d).map(|(c, d)| [c.x, c.y, d.x, d.y]);
                        any |= code.is_some();
                    }
                    if any && each([a, b, c, d], &codes) {
                        return true;
                    }
                }
            }
            false
        };
        (0..=last).any(|b| (0..b).any(|a| pair(a, b)))
    }
}

/// The attitude and focal ratio of four points of which the first two are farthest apart: the scale from the sum of
/// their sides.
pub(super) fn fit_of(lines_of_sight: [DVec2; 4], directions: [DVec3; 4], start: f64) -> Option<SkyFit> {
    let mut focal_ratio = start;
    let sum = |v: &[DVec3; 4]| {
        (0..4).flat_map(|i| (0..i).map(move |j| (i, j))).map(|(i, j)| v[i].distance(v[j])).sum::<f64>()
    };
    let units = |focal_ratio: f64| lines_of_sight.map(|m| (m / focal_ratio).extend(1.0).normalize());
    // Angles on the tangent plane are not quite in proportion to the scale: two passes.
    for _ in 0..2 {
        focal_ratio *= sum(&units(focal_ratio)) / sum(&directions);
    }
    // Two frames from the same directions (TRIAD, Black 1964): their middle and the longest side.
    let frame = |v: [DVec3; 4]| {
        let middle = (v[0] + v[1] + v[2] + v[3]).normalize();
        let side = v[1] - v[0];
        let across = (side - middle * side.dot(middle)).try_normalize()?;
        Some(DMat3::from_cols(middle, across, middle.cross(across)))
    };
    let rotation = frame(units(focal_ratio))? * frame(directions)?.transpose();
    Some(SkyFit::pinhole(DQuat::from_mat3(&rotation).normalize(), focal_ratio))
}
