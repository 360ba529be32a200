//! Hidden formulas of power readings: products of up to two laws of columns, written by hand and composed by the seed. None
//! of the laws is one of the investigation's own.

use std::fmt::Write as _;

use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, StandardNormal};

use crate::algebra::{beside, rms};
use crate::readings::{FULL_W_M2, NOISE, Reading, readings, shown};

/// A law of a column; the two numbers are its shape, 0 to 1.
type LawOf = fn(f64, [f64; 2]) -> f64;
/// A column with how a reading has it, about 0 to 1, and its laws.
type ColumnOf = (&'static str, fn(&Reading) -> f64, &'static [LawOf]);

const LEVEL: [LawOf; 4] = [
    |v, s| v / (v + 0.05 + 0.3 * s[0]),
    |v, s| 1.0 / (1.0 + (-(v - 0.2 - 0.5 * s[0]) / 0.06).exp()),
    |v, s| (-v / (0.1 + 0.3 * s[0])).exp(),
    |v, s| ((v - 0.3 - 0.4 * s[0]).powi(2) + 0.01).sqrt(),
];
const SIDE: [LawOf; 3] = [
    |v, s| v.powf(0.5 + s[0]),
    |v, s| v / (v + 0.2 + 0.3 * s[0]),
    |v, s| (1.0 + v / (0.1 + 0.3 * s[0])).ln(),
];
const TIME: [LawOf; 4] = [
    |t, s| 1.0 / (1.0 + (-(t - 0.3 - 0.4 * s[0]) / 0.04).exp()),
    |t, s| (((t * (1.5 + 3.0 * s[0]) + s[1]).rem_euclid(1.0) - 0.5).abs() - 0.25) * 4.0,
    |t, s| {
        let off = (t - 0.3 - 0.4 * s[0]) / 0.2;
        if off.abs() < 1.0 { 0.5 + 0.5 * (std::f64::consts::PI * off).cos() } else { 0.0 }
    },
    |t, _| t + 0.5 * t * t,
];
const AIR: [LawOf; 4] = [
    |h, _| h,
    |h, _| h + 0.5 * h.powi(3),
    |h, s| 1.0 / (1.0 + (-(h - 0.5 + s[0]) / 0.2).exp()),
    |h, s| (h - 0.4 + 0.8 * s[0]).max(0.0).powf(1.2),
];

const COLUMNS: [ColumnOf; 5] = [
    ("digital_count", |r| r.count / 255.0, &LEVEL),
    ("square_px", |r| r.side / 200.0, &SIDE),
    ("time_s", |r| r.passed, &TIME),
    ("humidity", |r| r.humidity, &AIR),
    ("temperature_c", |r| r.warmth, &AIR),
];

/// Up to two laws.
pub(crate) struct PowerFormula(Vec<(usize, LawOf, [f64; 2])>);

impl PowerFormula {
    /// The formula of a seed.
    pub(crate) fn of(seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(8);
        let mut pick = |of: usize| random.random_range(0..of);
        let count = [1, 1, 1, 2, 2][pick(5)];
        let first = pick(COLUMNS.len());
        let second = (first + 1 + pick(COLUMNS.len() - 1)) % COLUMNS.len();
        let columns: Vec<(usize, LawOf)> = [first, second]
            .into_iter()
            .take(count)
            .map(|column| (column, COLUMNS[column].2[pick(COLUMNS[column].2.len())]))
            .collect();
        let mut number = || random.random_range(0.0..1.0);
        Self(columns.into_iter().map(|(column, law)| (column, law, [number(), number()])).collect())
    }

    /// Columns it depends on.
    pub(crate) fn columns(&self) -> Vec<String> {
        self.0.iter().map(|(column, ..)| COLUMNS[*column].0.to_owned()).collect()
    }

    fn value(&self, reading: &Reading) -> f64 {
        self.0.iter().map(|(column, law, shape)| law(COLUMNS[*column].1(reading), *shape)).product()
    }
}

/// What is behind a table of readings.
pub(crate) enum Behind<'a> {
    /// A formula with its strength, or the amplitude that another day of the facility found.
    Formula(&'a PowerFormula, f64, Option<f64>),
    /// A known effect with its constants and strength.
    Known(&'a str, &'a crate::forms::Nature, f64),
    /// Nothing.
    Nothing,
}

/// A table with what the formula adds to each row, relative, and its amplitude. `scatter` is that of the meter from
/// series to series, `noise` that of a reading, of its usual size.
pub(crate) fn table(behind: &Behind<'_>, seed: u64, scatter: f64, noise: f64) -> (String, Vec<f64>, f64) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut all = readings();
    for series in all.chunk_by_mut(|a, b| a.series == b.series) {
        let (humidity, warmth) = (random.random_range(-1.0..1.0), random.random_range(-1.0..1.0));
        for reading in series {
            (reading.humidity, reading.warmth) = (humidity, warmth);
        }
    }
    let gain = vec![vec![1.0; all.len()]];
    let ones = vec![1.0; all.len()];
    let brightest = all.iter().map(|r| r.light).fold(0.0, f64::max);
    let relative = |a: f64| -> Vec<f64> {
        all.iter()
            .map(|r| match behind {
                Behind::Formula(formula, ..) => a * formula.value(r),
                Behind::Known(id, nature, _) => shown(id, nature, a, r, brightest) / r.light - 1.0,
                Behind::Nothing => 0.0,
            })
            .collect()
    };
    let mut a = 0.01;
    match behind {
        Behind::Formula(_, _, Some(given)) => a = *given,
        Behind::Formula(_, strength, None) | Behind::Known(_, _, strength) => {
            for _ in 0..8 {
                a *= (strength * NOISE / rms(&beside(&gain, &relative(a), &ones)).max(1e-12))
                    .clamp(0.01, 100.0);
            }
        }
        Behind::Nothing => {}
    }
    let field = relative(a);
    let mut text = String::from(
        "channel,digital_count,square_px,irradiance_w_m2,series,time_s,humidity,temperature_c\n",
    );
    let mut factor = 1.0;
    for (k, (r, added)) in all.iter().zip(&field).enumerate() {
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        if k % 20 == 0 {
            factor = 1.0 + scatter * normal();
        }
        let value = r.light * (1.0 + added) * factor * (1.0 + noise * NOISE * normal());
        let _ = writeln!(
            text,
            "{},{},{},{:e},s{:02},{},{:.3},{:.3}",
            ["r", "g", "b", "w"][r.channel],
            r.count,
            r.side,
            value * FULL_W_M2,
            r.series,
            30 * k,
            50.0 + 20.0 * r.humidity,
            22.0 + 2.0 * r.warmth
        );
    }
    (text, field, a)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of many seeds every column comes up, and another day of the facility has the same formula and amplitude.
    #[test]
    fn formulas_are_of_all_columns_and_stay() {
        let all: Vec<PowerFormula> = (0..200).map(PowerFormula::of).collect();
        for (name, ..) in COLUMNS {
            assert!(all.iter().filter(|f| f.columns().iter().any(|c| c == name)).count() > 20, "{name}");
        }
        let (_, field, amplitude) = table(&Behind::Formula(&all[3], 3.0, None), 5, 0.001, 1.0);
        let gain = vec![vec![1.0; field.len()]];
        let size = rms(&beside(&gain, &field, &vec![1.0; field.len()])) / NOISE;
        assert!((size - 3.0).abs() < 0.01, "{size}");
        let (_, again, given) = table(&Behind::Formula(&all[3], 3.0, Some(amplitude)), 6, 0.0, 0.0);
        assert_eq!(given, amplitude);
        assert_eq!(again.len(), field.len());
    }
}
