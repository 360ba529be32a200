//! Pairs of stars by their angle: Mortari's search-less k-vector.

use glam::DVec3;

/// Two stars by their index.
pub type Pair = [u32; 2];

/// Pairs of stars up to a greatest angle, in the order of their angle, with the k-vector that says without a search
/// where an angle's pairs stand (Mortari 1997).
///
/// The key is the squared chord 2 (1 - cos angle): stars being spread evenly over the sky, its values are spread
/// evenly over their range, for which a k-vector is best. Pairs that share a step of the k-vector stand in no order.
#[derive(Debug, Clone)]
pub struct PairTable {
    chord2: Vec<f32>,
    pairs: Vec<Pair>,
    /// Entries before each step.
    k: Vec<u32>,
    step: f64,
}

/// What a squared chord loses when it is held in single precision, relative.
const SINGLE_ROUNDING: f64 = 1.2e-7;

impl PairTable {
    /// All pairs of unit vectors not farther apart than `greatest_rad`.
    pub fn new(directions: &[DVec3], greatest_rad: f64) -> Self {
        let greatest = chord2_of_angle(greatest_rad);
        let reach = greatest.sqrt();
        // Sorted by z, a star's partners stand within the chord's length of it.
        let mut order: Vec<u32> = (0..directions.len() as u32).collect();
        order.sort_by(|&a, &b| directions[a as usize].z.total_cmp(&directions[b as usize].z).then(a.cmp(&b)));
        let sorted: Vec<DVec3> = order.iter().map(|&at| directions[at as usize]).collect();
        let mut found: Vec<(f32, Pair)> = Vec::new();
        for (i, a) in sorted.iter().enumerate() {
            for (j, b) in sorted.iter().enumerate().skip(i + 1) {
                if b.z - a.z > reach {
                    break;
                }
                let chord2 = a.distance_squared(*b);
                if chord2 <= greatest {
                    found.push((chord2 as f32, [order[i], order[j]]));
                }
            }
        }
        // One step a pair, and sorted by counting: the count is the k-vector.
        let steps = found.len().max(1);
        let step = greatest / steps as f64;
        let mut k = vec![0u32; steps + 2];
        for (chord2, _) in &found {
            k[step_of(*chord2, step, steps) + 1] += 1;
        }
        for i in 0..=steps {
            k[i + 1] += k[i];
        }
        let mut next = k.clone();
        let (mut chord2, mut pairs) = (vec![0f32; found.len()], vec![[0u32; 2]; found.len()]);
        for (value, pair) in found {
            let slot = &mut next[step_of(value, step, steps)];
            (chord2[*slot as usize], pairs[*slot as usize]) = (value, pair);
            *slot += 1;
        }
        Self { chord2, pairs, k, step }
    }

    /// Number of pairs.
    pub fn len(&self) -> usize {
        self.pairs.len()
    }

    /// Whether there are no pairs.
    pub fn is_empty(&self) -> bool {
        self.pairs.is_empty()
    }

    /// The entries that hold all pairs of a range of squared chords, and a few beyond its ends.
    fn entries(&self, [low, high]: [f64; 2]) -> std::ops::Range<usize> {
        let steps = self.k.len() - 2;
        let last = steps as f64 * self.step;
        if high < 0.0 || low > last {
            return 0..0;
        }
        let at = |value: f64| step_of(value as f32, self.step, steps);
        self.k[at(low.max(0.0))] as usize..self.k[at(high.min(last)) + 1] as usize
    }

    /// About how many pairs a range of squared chords holds.
    pub fn count(&self, range: [f64; 2]) -> usize {
        self.entries(range).len()
    }

    /// The pairs of a range of squared chords.
    pub fn range(&self, [low, high]: [f64; 2]) -> impl Iterator<Item = Pair> + '_ {
        let entries = self.entries([low, high]);
        let (low, high) = ((low * (1.0 - SINGLE_ROUNDING)) as f32, (high * (1.0 + SINGLE_ROUNDING)) as f32);
        self.chord2[entries.clone()]
            .iter()
            .zip(&self.pairs[entries])
            .filter(move |(chord2, _)| (low..=high).contains(*chord2))
            .map(|(_, pair)| *pair)
    }
}

fn step_of(chord2: f32, step: f64, steps: usize) -> usize {
    ((f64::from(chord2) / step) as usize).min(steps)
}

/// The squared chord of an angle, 4 sin^2(angle / 2).
pub fn chord2_of_angle(angle_rad: f64) -> f64 {
    (2.0 * (0.5 * angle_rad).sin()).powi(2)
}

/// The angle of a squared chord.
pub fn angle_of_chord2(chord2: f64) -> f64 {
    2.0 * (0.5 * chord2.max(0.0).sqrt()).min(1.0).asin()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Against comparing every star with every other.
        #[test]
        fn a_range_holds_the_pairs_that_comparing_all_finds(
            places in prop::collection::vec((-1.0_f64..1.0, 0.0_f64..6.2), 2..60),
            low in 0.0_f64..0.5, width in 0.0_f64..0.3,
        ) {
            let directions: Vec<DVec3> = places.iter()
                .map(|&(z, a)| DVec3::new((1.0 - z * z).sqrt() * a.cos(), (1.0 - z * z).sqrt() * a.sin(), z))
                .collect();
            let table = PairTable::new(&directions, 0.6);
            let range = [low, low + width].map(chord2_of_angle);
            let mut found: Vec<Pair> = table.range(range).map(|[a, b]| [a.min(b), a.max(b)]).collect();
            found.sort_unstable();
            let mut all = Vec::new();
            for i in 0..directions.len() {
                for j in i + 1..directions.len() {
                    let angle = directions[i].cross(directions[j]).length().atan2(directions[i].dot(directions[j]));
                    if angle <= 0.6 && angle >= low && angle <= low + width {
                        all.push([i as u32, j as u32]);
                    }
                }
            }
            // At the very ends single precision may let one in.
            prop_assert!(all.iter().all(|pair| found.contains(pair)));
            prop_assert!(found.len() <= all.len() + 1);
        }
    }

    #[test]
    fn angles_and_chords_are_each_others_inverse() {
        for angle in [1e-9, 1e-3, 0.5, 3.0] {
            assert!((angle_of_chord2(chord2_of_angle(angle)) / angle - 1.0).abs() < 1e-9);
        }
        // 60 deg: an equilateral triangle with the radii.
        assert!((chord2_of_angle(std::f64::consts::FRAC_PI_3) - 1.0).abs() < 1e-15);
    }
}
