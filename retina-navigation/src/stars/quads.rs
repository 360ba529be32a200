//! Patterns of four stars by a code that neither scale, place nor rotation changes.
//!
//! The two stars farthest apart, A and B, are the diameter of a circle that holds the other two, C and D. On the plane
//! that touches the sky in the middle of A and B, with A at 0 and B at 1, the places of C and D are the code: four
//! numbers (Lang, Hogg, Mierle, Blanton & Roweis 2010, section 2.2). Patterns are made at all scales of a range; at each
//! of them of the stars that are the brightest of their surroundings.

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::sky_index::SkyIndex;

/// C and D on the plane where A is at (0, 0) and B at (1, 0), seen from inside the sphere.
pub(crate) type Code = [f64; 4];

/// Ratio of neighbouring scales' diameters.
const SCALE_STEP: f64 = std::f64::consts::SQRT_2;
/// A star belongs to a scale where fewer brighter ones are within its diameter: 2.9 stars a squared diameter.
const BRIGHTER_WITHIN: usize = 9;
/// Stars that are looked at for each that a scale holds on average: where the sky is dense, faint ones are not needed.
const LOOKED_AT: f64 = 3.0;
/// A star beside a brighter one within this share of the diameter is none of its own.
const BLENDED: f64 = 1.0 / 60.0;
/// Bins of each of the code's four numbers.
const BINS: usize = 32;
/// Steps of a number in the table: 0 to 1 for x, -0.5 to 0.5 for y.
const STEPS: f64 = 65_535.0;

/// The plane of A and B.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Frame {
    a: DVec2,
    along: f64,
    axes: [DVec3; 3],
}

impl Frame {
    pub(crate) fn new(a: DVec3, b: DVec3) -> Option<Self> {
        let middle = (a + b).try_normalize()?;
        let x = (b - a).try_normalize()?;
        let axes = [x, middle.cross(x), middle];
        let flat = |v: DVec3| DVec2::new(v.dot(axes[0]), v.dot(axes[1])) / v.dot(axes[2]);
        let (a, b) = (flat(a), flat(b));
        Some(Self { a, along: b.x - a.x, axes })
    }

    /// Where a star is; `None` outside the circle.
    pub(crate) fn place(&self, star: DVec3) -> Option<DVec2> {
        self.anywhere(star).filter(|at| at.distance_squared(DVec2::new(0.5, 0.0)) <= 0.25)
    }

    fn anywhere(&self, star: DVec3) -> Option<DVec2> {
        let depth = star.dot(self.axes[2]);
        if depth <= 0.1 {
            return None;
        }
        let off = DVec2::new(star.dot(self.axes[0]), star.dot(self.axes[1])) / depth - self.a;
        Some(off / self.along)
    }
}

/// The code of four unit vectors, wherever C and D are.
pub(crate) fn code_of(stars: [DVec3; 4]) -> Option<Code> {
    let frame = Frame::new(stars[0], stars[1])?;
    let [c, d] = [frame.anywhere(stars[2])?, frame.anywhere(stars[3])?];
    Some([c.x, c.y, d.x, d.y])
}

/// The one of a pattern's four codes (A and B, C and D exchanged) that tables hold, and its stars in that order.
fn canonical<T: Copy>(code: Code, stars: [T; 4]) -> (Code, [T; 4]) {
    let ([mut cx, mut cy, mut dx, mut dy], [mut a, mut b, mut c, mut d]) = (code, stars);
    if cx + dx > 1.0 {
        (cx, cy, dx, dy) = (1.0 - cx, -cy, 1.0 - dx, -dy);
        std::mem::swap(&mut a, &mut b);
    }
    if cx > dx {
        (cx, cy, dx, dy) = (dx, dy, cx, cy);
        std::mem::swap(&mut c, &mut d);
    }
    ([cx, cy, dx, dy], [a, b, c, d])
}

/// Patterns by their codes.
#[derive(Debug, Clone)]
pub(crate) struct QuadTable {
    codes: Vec<[u16; 4]>,
    stars: Vec<[u16; 4]>,
    /// First pattern of each cell of codes, and one beyond the last.
    cells: Vec<u32>,
}

impl QuadTable {
    /// Patterns of stars (unit vectors, brightest first; the first 65 535 count) with diameters in a range, rad.
    pub(crate) fn new(directions: &[DVec3], [least_rad, greatest_rad]: [f64; 2]) -> Self {
        let directions = &directions[..directions.len().min(usize::from(u16::MAX))];
        let mut found: Vec<(Code, [u16; 4])> = Vec::new();
        let mut diameter = greatest_rad / SCALE_STEP;
        loop {
            found.extend(of_scale(directions, diameter));
            if diameter <= least_rad {
                break;
            }
            diameter /= SCALE_STEP;
        }
        let keys: Vec<u32> = found.par_iter().map(|(code, _)| cell(stepped(*code)) as u32).collect();
        let mut cells = vec![0u32; BINS.pow(4) + 1];
        for &key in &keys {
            cells[key as usize + 1] += 1;
        }
        for at in 1..cells.len() {
            cells[at] += cells[at - 1];
        }
        let mut next = cells.clone();
        let (mut codes, mut stars) = (vec![[0u16; 4]; found.len()], vec![[0u16; 4]; found.len()]);
        for ((code, four), key) in found.into_iter().zip(keys) {
            let slot = &mut next[key as usize];
            codes[*slot as usize] = stepped(code);
            stars[*slot as usize] = four;
            *slot += 1;
        }
        Self { codes, stars, cells }
    }

    /// Number of patterns.
    pub(crate) fn len(&self) -> usize {
        self.codes.len()
    }

    /// Calls `found` with the stars (A, B, C, D) of each pattern whose code is within `off` of one on the line from
    /// `code - along` to `code + along` in each number, as `code` has its points in order, until it says true; says
    /// whether it did.
    pub(crate) fn look_up(
        &self,
        code: Code,
        along: Code,
        off: f64,
        mut found: impl FnMut([u16; 4]) -> bool,
    ) -> bool {
        // The order in the table is that of the stars, which noise may exchange.
        let slack = 2.0 * along.iter().fold(off, |most, v| most.max(off + v.abs()));
        let turned = [1.0 - code[0], -code[1], 1.0 - code[2], -code[3]];
        for (ends, places, along) in [(false, code, along), (true, turned, along.map(|v| -v))] {
            if places[0] + places[2] > 1.0 + slack {
                continue;
            }
            for inner in [false, true] {
                let exchanged = |v: Code| if inner { [v[2], v[3], v[0], v[1]] } else { v };
                let (places, along) = (exchanged(places), exchanged(along));
                if places[0] > places[2] + slack {
                    continue;
                }
                let restored = |[a, b, c, d]: [u16; 4]| {
                    let [a, b] = if ends { [b, a] } else { [a, b] };
                    let [c, d] = if inner { [d, c] } else { [c, d] };
                    found([a, b, c, d])
                };
                if self.near(places, along, off, restored) {
                    return true;
                }
            }
        }
        false
    }

    fn near(&self, code: Code, along: Code, off: f64, mut found: impl FnMut([u16; 4]) -> bool) -> bool {
        let middle = place_of(code);
        let reach: [f64; 4] = along.map(|v| off + v.abs());
        let range = |k: usize| {
            let bin = |v: f64| ((v.clamp(0.0, 1.0) * BINS as f64) as usize).min(BINS - 1);
            bin(middle[k] - reach[k])..=bin(middle[k] + reach[k])
        };
        let wanted = middle.map(|v| (v * STEPS).round() as i32);
        let within = reach.map(|v| (v * STEPS).ceil() as i32);
        let length2: f64 = along.iter().map(|v| v * v).sum();
        let beside = |held: &[u16; 4]| {
            if length2 == 0.0 {
                return true;
            }
            let away: [f64; 4] = std::array::from_fn(|n| f64::from(i32::from(held[n]) - wanted[n]) / STEPS);
            let share = away.iter().zip(&along).map(|(a, b)| a * b).sum::<f64>() / length2;
            let share = share.clamp(-1.0, 1.0);
            (0..4).all(|n| (away[n] - share * along[n]).abs() <= off)
        };
        let last = range(3);
        for i in range(0) {
            for j in range(1) {
                for k in range(2) {
                    // Cells of the last number stand side by side.
                    let row = ((i * BINS + j) * BINS + k) * BINS;
                    let patterns =
                        self.cells[row + last.start()] as usize..self.cells[row + last.end() + 1] as usize;
                    for (at, held) in self.codes[patterns.clone()].iter().enumerate() {
                        let close = (0..4).all(|n| (i32::from(held[n]) - wanted[n]).abs() <= within[n]);
                        if close && beside(held) && found(self.stars[patterns.start + at]) {
                            return true;
                        }
                    }
                }
            }
        }
        false
    }
}

/// All four numbers from 0 to 1.
fn place_of([cx, cy, dx, dy]: Code) -> [f64; 4] {
    [cx, cy + 0.5, dx, dy + 0.5]
}

fn stepped(code: Code) -> [u16; 4] {
    place_of(code).map(|v| (v.clamp(0.0, 1.0) * STEPS).round() as u16)
}

fn cell(stepped: [u16; 4]) -> usize {
    // The same bins as a look-up has.
    let bin = |v: u16| ((f64::from(v) / STEPS * BINS as f64) as usize).min(BINS - 1);
    stepped.iter().fold(0, |at, &v| at * BINS + bin(v))
}

/// Patterns with diameters from `diameter` to the next scale's.
fn of_scale(directions: &[DVec3], diameter: f64) -> Vec<(Code, [u16; 4])> {
    let chosen = brightest_of_surroundings(directions, diameter);
    let places: Vec<DVec3> = chosen.iter().map(|&at| directions[usize::from(at)]).collect();
    let index = SkyIndex::new(places.clone(), diameter);
    let greatest = diameter * SCALE_STEP;
    let chord2 = |angle: f64| (2.0 * (0.5 * angle).sin()).powi(2);
    let (low, high) = (chord2(diameter), chord2(greatest));
    let of_star = |a: usize| {
        let mut near: Vec<usize> = Vec::new();
        index.for_each_within(places[a], greatest, |at| {
            if at != a {
                near.push(at);
            }
        });
        near.sort_unstable();
        let mut found = Vec::new();
        for &b in near.iter().filter(|b| **b > a) {
            let apart2 = places[a].distance_squared(places[b]);
            if apart2 < low || apart2 >= high {
                continue;
            }
            let Some(frame) = Frame::new(places[a], places[b]) else { continue };
            let inside: Vec<(usize, DVec2)> = near
                .iter()
                .filter(|&&at| at != b)
                .filter_map(|&at| Some((at, frame.place(places[at])?)))
                .collect();
            for (k, (c, c_at)) in inside.iter().enumerate() {
                for (d, d_at) in &inside[k + 1..] {
                    let code = [c_at.x, c_at.y, d_at.x, d_at.y];
                    found.push(canonical(code, [a, b, *c, *d].map(|at| chosen[at])));
                }
            }
        }
        found
    };
    (0..places.len()).into_par_iter().map(of_star).flatten_iter().collect()
}

/// Stars with fewer than [`BRIGHTER_WITHIN`] brighter ones within a diameter, none of which it melts into.
fn brightest_of_surroundings(directions: &[DVec3], diameter: f64) -> Vec<u16> {
    // Mean number on the whole sky: BRIGHTER_WITHIN a disc of this radius.
    let mean = BRIGHTER_WITHIN as f64 * 2.0 / (1.0 - diameter.cos());
    let count = directions.len().min((LOOKED_AT * mean) as usize);
    let index = SkyIndex::new(directions[..count].to_vec(), diameter);
    let apart2 = (BLENDED * diameter).powi(2);
    let belongs = |at: usize| {
        let (mut brighter, mut alone) = (0, true);
        index.for_each_within(directions[at], diameter, |other| {
            if other < at {
                brighter += 1;
                alone &= directions[other].distance_squared(directions[at]) > apart2;
            }
        });
        alone && brighter < BRIGHTER_WITHIN
    };
    (0..count).into_par_iter().filter(|&at| belongs(at)).map(|at| at as u16).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;
    use proptest::prelude::*;

    /// Directions that fill a sphere evenly, in no order of place.
    fn sphere(count: usize) -> Vec<DVec3> {
        (0..count)
            .map(|i| {
                let z = 1.0 - 2.0 * (i as f64 * 0.754_877_666_2).fract();
                let turn = (i as f64 * 0.569_840_291_0).fract() * std::f64::consts::TAU;
                DVec3::new((1.0 - z * z).sqrt() * turn.cos(), (1.0 - z * z).sqrt() * turn.sin(), z)
            })
            .collect()
    }

    #[test]
    fn every_pattern_is_found_in_any_order_turned_and_scaled() {
        let stars = sphere(1000);
        let table = QuadTable::new(&stars, [0.1, 0.4]);
        assert!(table.len() > 1000, "{}", table.len());
        let turn = DQuat::from_scaled_axis(DVec3::new(0.4, 2.0, -0.7));
        for at in (0..table.len()).step_by(97) {
            let four = table.stars[at];
            let [a, b, c, d] = four.map(|star| turn * stars[usize::from(star)]);
            for order in [[a, b, c, d], [b, a, c, d], [a, b, d, c], [b, a, d, c]] {
                let mut seen = Vec::new();
                table.look_up(code_of(order).unwrap(), [0.0; 4], 1e-4, |stars| {
                    seen.push(stars);
                    false
                });
                // The stars come back as they were asked for.
                let expected =
                    order.map(|v| (0..1000).find(|&s| (turn * stars[s]).distance(v) < 1e-12).unwrap() as u16);
                assert!(seen.contains(&expected), "{seen:?} {expected:?}");
            }
        }
        // The shape seen in a mirror is another.
        let four = table.stars[0].map(|star| stars[usize::from(star)]);
        let mirrored = code_of(four).map(|[cx, cy, dx, dy]| [cx, -cy, dx, -dy]).unwrap();
        assert!(!table.look_up(mirrored, [0.0; 4], 1e-4, |stars| stars == table.stars[0]));
    }

    #[test]
    fn a_line_of_codes_is_looked_up_beside_its_length() {
        let stars = sphere(1000);
        let table = QuadTable::new(&stars, [0.1, 0.4]);
        for at in (0..table.len()).step_by(211) {
            let held = code_of(table.stars[at].map(|star| stars[usize::from(star)])).unwrap();
            let along = [0.01, -0.02, 0.005, 0.015];
            let asked: Code = std::array::from_fn(|n| held[n] + 0.9 * along[n]);
            let found = |asked: Code, along: Code| {
                table.look_up(asked, along, 1e-3, |stars| stars == table.stars[at])
            };
            assert!(found(asked, along));
            assert!(!found(asked, [0.0; 4]) && !found(asked, [along[0], -along[1], along[2], along[3]]));
        }
    }

    proptest! {
        /// Against comparing with all.
        #[test]
        fn look_ups_hold_what_comparing_with_all_finds(
            cx in 0.05_f64..0.5, cy in -0.3_f64..0.3, dx in 0.5_f64..0.9, dy in -0.2_f64..0.2,
        ) {
            let table = QuadTable::new(&sphere(400), [0.2, 0.5]);
            let (asked, off) = ([cx, cy, dx, dy], 0.05);
            let mut found = 0;
            table.look_up(asked, [0.0; 4], off, |_| { found += 1; false });
            let near = |held: Code| (0..4).all(|n| (held[n] - asked[n]).abs() <= off + 1e-9);
            let all: usize = table
                .codes
                .iter()
                .map(|&[a, b, c, d]| {
                    let [a, b, c, d] = [a, b, c, d].map(|v| f64::from(v) / STEPS);
                    let [b, d] = [b - 0.5, d - 0.5];
                    let turned = [1.0 - a, -b, 1.0 - c, -d];
                    let orders = [[a, b, c, d], [c, d, a, b], turned, [turned[2], turned[3], turned[0], turned[1]]];
                    orders.into_iter().filter(|held| near(*held)).count()
                })
                .sum();
            // Steps of the table may let one in.
            prop_assert!(found >= all && found <= all + 2 + all / 50, "{found} {all}");
        }
    }
}
