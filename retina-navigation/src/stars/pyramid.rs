//! Triangles of points among the catalogue's pairs.

use glam::{DMat3, DQuat, DVec2, DVec3};

use super::catalogue::SolverCatalogue;
use super::fit::SkyFit;
use super::pairs::{angle_of_chord2, chord2_of_angle};

/// A triangle of points and the stars that it may be.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Triangle {
    /// Points.
    pub(crate) points: [usize; 3],
    /// Bright entries of the catalogue.
    pub(crate) stars: [u32; 3],
}

/// How well an angle is known beforehand.
#[derive(Debug, Clone, Copy)]
pub(crate) struct AngleTolerance {
    /// Of any angle, rad.
    pub(crate) absolute_rad: f64,
    /// Of the angle itself: focal length and distortion.
    pub(crate) relative: f64,
}

/// Room for looking up triangles, kept between them.
#[derive(Debug)]
pub(crate) struct Search<'a> {
    catalogue: &'a SolverCatalogue,
    /// First entry of each star's list of partners; `stamp` says whether it is of this search.
    heads: Vec<(u32, u32)>,
    partners: Vec<(u32, u32)>,
    stamp: u32,
    /// Triangles of stars that fitted a triangle of points.
    pub(crate) candidates: usize,
    /// No more of them than this.
    most: usize,
}

const NONE: u32 = u32::MAX;

impl<'a> Search<'a> {
    pub(crate) fn new(catalogue: &'a SolverCatalogue, most: usize) -> Self {
        let count = catalogue.bright().directions().len();
        Self { catalogue, heads: vec![(0, NONE); count], partners: Vec::new(), stamp: 0, candidates: 0, most }
    }

    /// Whether as many triangles of stars as may be were looked at.
    pub(crate) fn exhausted(&self) -> bool {
        self.candidates >= self.most
    }

    /// Calls `found` with each triangle of stars whose sides and sense of rotation are those of three points (unit
    /// vectors), until it says true or the limit is reached.
    pub(crate) fn triangles(
        &mut self,
        points: [usize; 3],
        units: [DVec3; 3],
        tolerance: AngleTolerance,
        mut found: impl FnMut(Triangle) -> bool,
    ) -> bool {
        // The two sides with the fewest pairs are looked up; the third is then computed. Rotated so that they meet at 0.
        let range = |a: DVec3, b: DVec3| {
            let angle = angle_of_chord2(a.distance_squared(b));
            let off = tolerance.absolute_rad + tolerance.relative * angle;
            [chord2_of_angle((angle - off).max(0.0)), chord2_of_angle(angle + off)]
        };
        let sides = [range(units[1], units[2]), range(units[2], units[0]), range(units[0], units[1])];
        let longest = (0..3).max_by_key(|&side| self.catalogue.pairs().count(sides[side])).unwrap_or(0);
        let order = [longest, (longest + 1) % 3, (longest + 2) % 3];
        let [p, u] = [order.map(|i| points[i]), order];
        let [low, high] = sides[longest];
        let (to_first, to_second) = (sides[order[2]], sides[order[1]]);
        let sense = units[u[0]].dot(units[u[1]].cross(units[u[2]]));
        // The volume of a flat triangle is within its own error: it says nothing of the sense.
        let flat = 4.0 * tolerance.absolute_rad * (high.sqrt());
        self.list(to_second);
        let pairs = self.catalogue.pairs();
        let directions = self.catalogue.bright().directions();
        for pair in pairs.range(to_first) {
            for [a, b] in [pair, [pair[1], pair[0]]] {
                let (stamp, mut at) = self.heads[a as usize];
                if stamp != self.stamp {
                    continue;
                }
                while at != NONE {
                    let (c, next) = self.partners[at as usize];
                    at = next;
                    let third = directions[b as usize].distance_squared(directions[c as usize]);
                    if c == b || third < low || third > high {
                        continue;
                    }
                    let volume =
                        directions[a as usize].dot(directions[b as usize].cross(directions[c as usize]));
                    if volume * sense < 0.0 && sense.abs() > flat {
                        continue;
                    }
                    if self.exhausted() {
                        return false;
                    }
                    self.candidates += 1;
                    if found(Triangle { points: p, stars: [a, b, c] }) {
                        return true;
                    }
                }
            }
        }
        false
    }

    /// Lists the partners of each star at a distance.
    fn list(&mut self, range: [f64; 2]) {
        self.stamp += 1;
        self.partners.clear();
        for pair in self.catalogue.pairs().range(range) {
            for [a, b] in [pair, [pair[1], pair[0]]] {
                let head = &mut self.heads[a as usize];
                let before = if head.0 == self.stamp { head.1 } else { NONE };
                *head = (self.stamp, self.partners.len() as u32);
                self.partners.push((b, before));
            }
        }
    }
}

/// The attitude and focal ratio of a triangle: the scale from the sum of its sides.
pub(crate) fn fit_of(lines_of_sight: [DVec2; 3], directions: [DVec3; 3]) -> Option<SkyFit> {
    let mut focal_ratio = 1.0;
    // Angles on the tangent plane are not quite in proportion to the scale: two passes.
    for _ in 0..2 {
        let units = lines_of_sight.map(|m| (m / focal_ratio).extend(1.0).normalize());
        let side = |v: &[DVec3; 3], i: usize| v[i].distance(v[(i + 1) % 3]);
        let sum = |v: &[DVec3; 3]| (0..3).map(|i| side(v, i)).sum::<f64>();
        focal_ratio *= sum(&units) / sum(&directions);
    }
    let units = lines_of_sight.map(|m| (m / focal_ratio).extend(1.0).normalize());
    // Two frames from the same three directions (TRIAD, Black 1964): their middle and one side.
    let frame = |v: [DVec3; 3]| {
        let middle = (v[0] + v[1] + v[2]).normalize();
        let side = v[1] - v[0];
        let across = (side - middle * side.dot(middle)).try_normalize()?;
        Some(DMat3::from_cols(middle, across, middle.cross(across)))
    };
    let rotation = frame(units)? * frame(directions)?.transpose();
    Some(SkyFit { camera_from_inertial: DQuat::from_mat3(&rotation).normalize(), focal_ratio, k1: 0.0 })
}

/// The order in which triples of `count` points are tried (Mortari et al. 2004, section "pyramid"): neighbours in
/// brightness move along the list together, so that no single false point is in many triples in a row.
pub(crate) fn triples(count: usize) -> impl Iterator<Item = [usize; 3]> {
    (1..count.saturating_sub(1)).flat_map(move |first| {
        (1..count - first).flat_map(move |second| {
            (0..count - first - second).map(move |i| [i, i + first, i + first + second])
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_triple_comes_once() {
        let mut all: Vec<[usize; 3]> = triples(9).collect();
        assert_eq!(all[..3], [[0, 1, 2], [1, 2, 3], [2, 3, 4]]);
        all.sort_unstable();
        all.dedup();
        // 9 over 3.
        assert_eq!(all.len(), 84);
        assert_eq!(triples(2).count() + triples(0).count(), 0);
    }
}
