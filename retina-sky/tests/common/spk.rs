//! Writes small SPK kernels of motions in closed form: DAF and SPK Required Reading (NAIF), segments of type 2.

use std::f64::consts::{PI, TAU};

/// Coefficients a coordinate.
const COEFFICIENTS: usize = 16;
/// Length of a record, s.
const RECORD_S: f64 = 4.0 * 86_400.0;
/// Words of eight bytes in a DAF's record.
const DAF_WORDS: usize = 128;

/// A body on a circle about another.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Circle {
    /// NAIF's number of the body.
    pub(crate) target: i32,
    /// NAIF's number of what it goes round.
    pub(crate) centre: i32,
    /// km.
    pub(crate) radius_km: f64,
    /// days.
    pub(crate) period_d: f64,
}

impl Circle {
    /// Position, km, and velocity, km/s, at TDB seconds since J2000: tilted, and each body at its own angle.
    pub(crate) fn state_km(&self, tdb_s: f64) -> [[f64; 3]; 2] {
        let rate = TAU / (self.period_d * 86_400.0);
        let (sin, cos) = (rate * tdb_s + f64::from(self.target)).sin_cos();
        let r = self.radius_km;
        [
            [r * cos, r * sin * 0.8, r * sin * 0.6],
            [-r * rate * sin, r * rate * cos * 0.8, r * rate * cos * 0.6],
        ]
    }
}

/// The Solar System on circles: the Sun, the barycentres 1 to 8, the Earth and the Moon, as DE440 has them.
pub(crate) fn solar_system() -> Vec<Circle> {
    let circle = |(target, centre, radius_km, period_d)| Circle { target, centre, radius_km, period_d };
    [
        (10, 0, 7.4e5, 4332.0),
        (1, 0, 5.8e7, 88.0),
        (2, 0, 1.08e8, 225.0),
        (3, 0, 1.496e8, 365.0),
        (4, 0, 2.28e8, 687.0),
        (5, 0, 7.78e8, 4333.0),
        (6, 0, 1.43e9, 10_759.0),
        (7, 0, 2.87e9, 30_687.0),
        (8, 0, 4.5e9, 60_190.0),
        (399, 3, 4670.0, 27.3),
        (301, 3, 3.8e5, 27.3),
    ]
    .map(circle)
    .to_vec()
}

/// A kernel of these bodies from an epoch over some records of four days.
pub(crate) fn kernel(bodies: &[Circle], from_s: f64, records: usize) -> Vec<u8> {
    assert!(bodies.len() <= 25, "one record of summaries holds 25");
    let (mut summaries, mut data): (Vec<u8>, Vec<f64>) = (Vec::new(), Vec::new());
    for body in bodies {
        let first = 3 * DAF_WORDS + data.len() + 1;
        for record in 0..records {
            let middle_s = from_s + (record as f64 + 0.5) * RECORD_S;
            data.extend([middle_s, RECORD_S / 2.0]);
            for axis in 0..3 {
                data.extend(chebyshev(|x| body.state_km(middle_s + x * RECORD_S / 2.0)[0][axis]));
            }
        }
        data.extend([from_s, RECORD_S, (2 + 3 * COEFFICIENTS) as f64, records as f64]);
        for epoch_s in [from_s, from_s + records as f64 * RECORD_S] {
            summaries.extend(epoch_s.to_le_bytes());
        }
        let last = 3 * DAF_WORDS + data.len();
        // Axes of J2000, type 2.
        for number in [body.target, body.centre, 1, 2, first as i32, last as i32] {
            summaries.extend(number.to_le_bytes());
        }
    }
    let mut file = vec![0u8; 3 * DAF_WORDS * 8];
    let mut put = |at: usize, bytes: &[u8]| file[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, b"DAF/SPK ");
    let free = (3 * DAF_WORDS + data.len() + 1) as i32;
    // Doubles and integers of a summary; then the first and last record of summaries, the first free word.
    for (at, number) in [(8, 2), (12, 6), (76, 2), (80, 2), (84, free)] {
        put(at, &i32::to_le_bytes(number));
    }
    put(16, &[b' '; 60]);
    put(88, b"LTL-IEEE");
    // What a transfer as text would garble.
    put(699, b"FTPSTR:\r:\n:\r\n:\r\0:\x81:\x10\xce:ENDFTP");
    put(1024 + 16, &(bodies.len() as f64).to_le_bytes());
    put(1024 + 24, &summaries);
    put(2048, &[b' '; 1024]);
    file.extend(data.iter().flat_map(|word| word.to_le_bytes()));
    file
}

/// Coefficients of a function on -1..1 by its values at the Chebyshev nodes (Press et al., Numerical Recipes, 5.8).
fn chebyshev(function: impl Fn(f64) -> f64) -> [f64; COEFFICIENTS] {
    let angle = |node: usize| PI * (node as f64 + 0.5) / COEFFICIENTS as f64;
    std::array::from_fn(|order| {
        let term = |node| function(angle(node).cos()) * (order as f64 * angle(node)).cos();
        let sum: f64 = (0..COEFFICIENTS).map(term).sum();
        sum * if order == 0 { 1.0 } else { 2.0 } / COEFFICIENTS as f64
    })
}
