//! Which detected point is which point of a pattern, knowing neither rotation, mirroring, scale nor shift.
//!
//! Triangles of neighbours are looked up by their shape; one whose surroundings agree is a seed, and from it matches
//! grow outwards along a polynomial that is fitted to those found. How likely so many matches are by chance is stated.

use std::collections::HashMap;

use glam::{DMat2, DVec2};

use super::nearest::Grid;
use super::warping::Warping;

/// Matched points.
#[derive(Debug, Clone, PartialEq)]
pub struct Recognition {
    /// (pattern point, detected point), by pattern point.
    pub pairs: Vec<(usize, usize)>,
    /// log10 of the bound on the probability that points at random would be matched so well.
    pub log10_chance: f64,
    /// The image is mirrored against the screen.
    pub mirrored: bool,
    /// Root of the mean square of the distances to the polynomial, px.
    pub rms_px: f64,
}

/// A recognition is believed below this chance.
pub const LOG10_CHANCE_LIMIT: f64 = -6.0;

/// Neighbours that triangles are formed with: with three of ten missing and three of ten added, two of a point's
/// nearest four are nearly always among them.
const NEIGHBOURS: usize = 7;
/// Ratios of sides differ by less than this between screen and camera: distortion shears by 2 to 3 %.
const SHAPE: f64 = 0.03;
/// Of so many pattern points around a seed, this many must be met by a detected one.
const AROUND: usize = 14;
const MET: usize = 7;
/// Distance from a predicted place, in units of the distance over which was extrapolated.
const SLACK: f64 = 0.05;
/// Pairs of triangles that are tried: with a third of the points missing one of some hundreds is true.
const MOST_TRIALS: usize = 60_000;
/// Final matches lie within so many typical distances of the polynomial, and within these, px.
const FINAL_SIGMAS: f64 = 5.0;
const FINAL_PX: [f64; 2] = [0.7, 4.0];

/// A triangle: its corners opposite to the longest, middle and shortest side, and the two ratios.
struct Triangle {
    corners: [usize; 3],
    shape: [f64; 2],
}

fn triangles_at(points: &[DVec2], grid: &Grid, at: usize) -> Vec<Triangle> {
    let near = grid.nearest(points, points[at], NEIGHBOURS + 1);
    let mut out = Vec::new();
    for (i, &a) in near.iter().enumerate() {
        for &b in &near[..i] {
            if a == at || b == at {
                continue;
            }
            let corners = [at, a, b];
            let side = |k: usize| (points[corners[(k + 1) % 3]] - points[corners[(k + 2) % 3]]).length();
            let mut sides = [(side(0), at), (side(1), a), (side(2), b)];
            sides.sort_by(|a, b| b.0.total_cmp(&a.0));
            let shape = [sides[1].0 / sides[0].0, sides[2].0 / sides[0].0];
            // Flat triangles say little, and of equal sides it is not known which is which.
            let flat = shape[0] + shape[1] < 1.1;
            if !flat && shape[0] < 1.0 - SHAPE && shape[0] - shape[1] > SHAPE {
                out.push(Triangle { corners: sides.map(|s| s.1), shape });
            }
        }
    }
    out
}

fn cell(shape: [f64; 2]) -> [i32; 2] {
    shape.map(|ratio| (ratio / SHAPE).floor() as i32)
}

/// Matches detected points (camera px, brightest first) to a pattern's (screen px). `None` where nothing fits that
/// chance could not do as well.
pub fn recognise(pattern: &[DVec2], detected: &[DVec2]) -> Option<Recognition> {
    if pattern.len() < AROUND + 1 || detected.len() < MET + 3 {
        return None;
    }
    let (pattern_grid, detected_grid) = (Grid::new(pattern), Grid::new(detected));
    let mut shapes: HashMap<[i32; 2], Vec<Triangle>> = HashMap::new();
    let mut known = 0usize;
    for at in 0..pattern.len() {
        for triangle in triangles_at(pattern, &pattern_grid, at) {
            known += 1;
            shapes.entry(cell(triangle.shape)).or_default().push(triangle);
        }
    }
    let mut tried = 0usize;
    let mut refused = 0usize;
    for at in 0..detected.len() {
        for seen in triangles_at(detected, &detected_grid, at) {
            let [i, j] = cell(seen.shape);
            for key in (i - 1..=i + 1).flat_map(|i| (j - 1..=j + 1).map(move |j| [i, j])) {
                for model in shapes.get(&key).into_iter().flatten() {
                    if (0..2).any(|k| (model.shape[k] - seen.shape[k]).abs() > SHAPE) {
                        continue;
                    }
                    tried += 1;
                    if tried > MOST_TRIALS {
                        return None;
                    }
                    let Some(seed) = seed(pattern, detected, &pattern_grid, &detected_grid, model, &seen)
                    else {
                        continue;
                    };
                    let grown = grow(pattern, detected, &pattern_grid, &detected_grid, seed);
                    // What could have been tried counts, not what was.
                    let trials = (known as f64) * (detected.len() * 21) as f64;
                    if let Some(found) = grown
                        .and_then(|warping| conclude(pattern, detected, &detected_grid, &warping, trials))
                    {
                        return Some(found);
                    }
                    refused += 1;
                    // Seeds that lead nowhere are rare unless the points are of another pattern.
                    if refused > 200 {
                        return None;
                    }
                }
            }
        }
    }
    None
}

/// The pairs around a triangle that agree with its similarity, where there are enough.
fn seed(
    pattern: &[DVec2],
    detected: &[DVec2],
    pattern_grid: &Grid,
    detected_grid: &Grid,
    model: &Triangle,
    seen: &Triangle,
) -> Option<Vec<(usize, usize)>> {
    let from = model.corners.map(|i| pattern[i]);
    let to = seen.corners.map(|i| detected[i]);
    let edges = |p: [DVec2; 3]| DMat2::from_cols(p[1] - p[0], p[2] - p[0]);
    let base = edges(from);
    let matrix = edges(to) * base.inverse();
    // An affine map of three points is exact; it must be nearly a similarity.
    let (a, b) = (matrix.x_axis, matrix.y_axis);
    let sizes = [a.length(), b.length()];
    if !(sizes[0] > 0.0
        && (sizes[0] / sizes[1] - 1.0).abs() < 0.1
        && a.dot(b).abs() < 0.1 * sizes[0] * sizes[1])
    {
        return None;
    }
    let centre = (from[0] + from[1] + from[2]) / 3.0;
    let seen_centre = (to[0] + to[1] + to[2]) / 3.0;
    let size = (from[0] - from[1]).length();
    let around = pattern_grid.nearest(pattern, centre, AROUND + 3);
    let mut pairs: Vec<(usize, usize)> = model.corners.iter().copied().zip(seen.corners).collect();
    let (mut met, mut asked) = (0, 0);
    for i in around {
        if model.corners.contains(&i) {
            continue;
        }
        let off = pattern[i] - centre;
        let slack = SLACK * (off.length() + size) * sizes[0];
        asked += 1;
        if let Some(j) = detected_grid.within(detected, seen_centre + matrix * off, slack) {
            met += 1;
            pairs.push((i, j));
        }
        // Not enough are left to be met.
        if met + AROUND < MET + asked {
            return None;
        }
    }
    (met >= MET).then_some(pairs)
}

/// Grows matches outwards from a seed until no more are found.
fn grow(
    pattern: &[DVec2],
    detected: &[DVec2],
    pattern_grid: &Grid,
    detected_grid: &Grid,
    seed: Vec<(usize, usize)>,
) -> Option<Warping> {
    let spacing = pattern_grid.spacing();
    let mut pairs = seed;
    let mut warping = Warping::fit(pattern, detected, &pairs)?;
    let mut last = 0;
    for round in 0..60 {
        let scale = warping.scale();
        let matched: Vec<DVec2> = pairs.iter().map(|pair| pattern[pair.0]).collect();
        let matched_grid = Grid::new(&matched);
        let slack = (0.08 * spacing * scale).min((6.0 * warping.rms_px).max(0.03 * spacing * scale));
        pairs.clear();
        for (i, &at) in pattern.iter().enumerate() {
            // No further than the next neighbours of what is matched: a polynomial goes astray beyond its points.
            if matched_grid.within(&matched, at, 1.8 * spacing).is_some()
                && let Some(j) = detected_grid.within(detected, warping.apply(at), slack)
            {
                pairs.push((i, j));
            }
        }
        pairs = one_to_one(pattern, detected, &pairs, &warping);
        warping = Warping::fit(pattern, detected, &pairs)?;
        if pairs.len() <= last && round > 2 {
            break;
        }
        last = pairs.len();
    }
    Some(warping)
}

/// Of several pattern points that claim one detected point the nearest stays.
fn one_to_one(
    pattern: &[DVec2],
    detected: &[DVec2],
    pairs: &[(usize, usize)],
    warping: &Warping,
) -> Vec<(usize, usize)> {
    let distance = |pair: &(usize, usize)| (warping.apply(pattern[pair.0]) - detected[pair.1]).length();
    let mut nearest: HashMap<usize, (f64, usize)> = HashMap::new();
    for pair in pairs {
        let own = (distance(pair), pair.0);
        nearest
            .entry(pair.1)
            .and_modify(|best| {
                if own.0 < best.0 {
                    *best = own
                }
            })
            .or_insert(own);
    }
    pairs.iter().filter(|pair| nearest[&pair.1].1 == pair.0).copied().collect()
}

/// Matches with the final tolerance, and how likely they are by chance.
fn conclude(
    pattern: &[DVec2],
    detected: &[DVec2],
    detected_grid: &Grid,
    warping: &Warping,
    trials: f64,
) -> Option<Recognition> {
    let tolerance = (FINAL_SIGMAS * warping.rms_px).clamp(FINAL_PX[0], FINAL_PX[1]);
    let mut pairs = Vec::new();
    for (i, &at) in pattern.iter().enumerate() {
        let place = warping.apply(at);
        // Two candidates: neither is certain.
        if let Some(j) = detected_grid.within(detected, place, tolerance)
            && detected_grid.count(detected, place, 2.0 * tolerance) == 1
        {
            pairs.push((i, j));
        }
    }
    pairs = one_to_one(pattern, detected, &pairs, warping);
    let (low, high) = bounds(detected);
    let area = ((high - low).x * (high - low).y).max(1.0);
    let inside = pattern
        .iter()
        .filter(|at| {
            let place = warping.apply(**at);
            place.cmpge(low).all() && place.cmple(high).all()
        })
        .count();
    let by_chance = (detected.len() as f64 * std::f64::consts::PI * tolerance * tolerance / area).min(1.0);
    // A polynomial can be made to meet as many points as it has coefficients an axis.
    let free = pairs.len().saturating_sub(warping.coefficients());
    let log10_chance = trials.log10() + log10_binomial_tail(inside.max(pairs.len()), free, by_chance);
    (log10_chance < LOG10_CHANCE_LIMIT).then(|| Recognition {
        rms_px: warping.rms_px,
        mirrored: warping.mirrored(),
        pairs,
        log10_chance,
    })
}

fn bounds(points: &[DVec2]) -> (DVec2, DVec2) {
    let low = points.iter().copied().fold(DVec2::INFINITY, DVec2::min);
    let high = points.iter().copied().fold(DVec2::NEG_INFINITY, DVec2::max);
    (low, high)
}

/// Chernoff's bound on log10 of the probability of at least `hits` of `count` at probability `p` each:
/// exp(-n KL(h/n, p)) (W. Hoeffding, J. Am. Stat. Assoc. 58, 1963, eq. 2.1).
fn log10_binomial_tail(count: usize, hits: usize, p: f64) -> f64 {
    let share = hits as f64 / count.max(1) as f64;
    if share <= p || count == 0 {
        return 0.0;
    }
    let term = |a: f64, b: f64| if a > 0.0 { a * (a / b).ln() } else { 0.0 };
    let divergence = term(share, p) + term(1.0 - share, 1.0 - p);
    -(count as f64) * divergence / std::f64::consts::LN_10
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_chance_bounds_the_binomial_tail() {
        // P(X >= 8) of Binomial(10, 0.3) is 0.001590 (tables); the bound is above it and no more than an order.
        let bound = 10f64.powf(log10_binomial_tail(10, 8, 0.3));
        assert!(bound > 0.001_59 && bound < 0.02, "{bound}");
        assert_eq!(log10_binomial_tail(10, 2, 0.3), 0.0);
    }
}
