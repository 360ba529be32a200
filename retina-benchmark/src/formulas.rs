//! Hidden formulas: fields over the place times laws of columns, written by hand and composed by the seed. None of the laws
//! is one of the investigation's own.

use glam::DVec2;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use crate::forms::{HALF, Point};

/// A field over the place u, 1 at half the camera's width.
type FieldOf = fn(DVec2, &Shape) -> DVec2;
/// A law of a column; the two numbers are its shape, 0 to 1.
type LawOf = fn(f64, [f64; 2]) -> f64;
/// A column with how a point has it, scaled to about -1 to 1 or 0 to 1, and its laws.
type ColumnOf = (&'static str, fn(&Point) -> f64, &'static [LawOf]);

/// A direction, a place and two numbers.
struct Shape {
    along: DVec2,
    at: DVec2,
    numbers: [f64; 2],
}

/// Fields that a baseline of shift, linear terms and k1 has: they need a law.
const LINEAR: [FieldOf; 5] = [
    |_, s| s.along,
    |u, _| u,
    |u, _| u.perp(),
    |u, s| s.along * s.along.dot(u),
    |u, s| DVec2::from_angle(0.4 + 2.0 * s.numbers[0]).rotate(u),
];

/// Fields that it does not have.
const CURVED: [FieldOf; 8] = [
    |u, s| u * s.along.dot(u) / (1.0 + 0.2 * s.along.dot(u)),
    |u, s| s.along * u.length_squared() * (1.0 + 0.12 * u.length_squared()),
    |u, _| u * u.length().powf(0.6),
    |u, _| u.perp() * u.length_squared().sqrt(),
    |u, s| (u - s.at) / (1.0 + (u - s.at).length_squared() / (0.05 + 0.1 * s.numbers[0])),
    |u, s| s.along * (8.0 * s.at.normalize_or(DVec2::X).dot(u) * (0.8 + s.numbers[0])).sin(),
    |u, s| s.along / (1.0 + (-(s.at.normalize_or(DVec2::Y).dot(u)) / 0.12).exp()),
    |u, _| DVec2::new(u.x * u.x - u.y * u.y, -2.0 * u.x * u.y),
];

const LIGHT: [LawOf; 5] = [
    |f, s| f / (f + 0.02 + 0.3 * s[0]),
    |f, s| (1.0 + f / (0.005 + 0.05 * s[0])).ln(),
    |f, s| f.powf(0.3 + 0.5 * s[0]),
    |f, s| 1.0 / (1.0 + f / (0.01 + 0.1 * s[0])),
    |f, s| (-f / (0.05 + 0.3 * s[0])).exp(),
];
const TIME: [LawOf; 6] = [
    |t, s| 1.0 - (-(t / (0.2 + 0.5 * s[0])).powf(1.3)).exp(),
    |t, s| 1.0 / (1.0 + (-(t - 0.3 - 0.4 * s[0]) / 0.05).exp()),
    |t, s| (((t * (1.5 + 3.0 * s[0]) + s[1]).rem_euclid(1.0) - 0.5).abs() - 0.25) * 4.0,
    |t, _| t + 0.5 * t * t,
    |t, s| if t < 0.25 + 0.5 * s[0] { 0.0 } else { 1.0 + 0.4 * (-(t - 0.25 - 0.5 * s[0]) / 0.05).exp() },
    |t, s| {
        let off = (t - 0.3 - 0.4 * s[0]) / 0.2;
        if off.abs() < 1.0 { 0.5 + 0.5 * (std::f64::consts::PI * off).cos() } else { 0.0 }
    },
];
const TEMPERATURE: [LawOf; 4] = [
    |g, _| g,
    |g, s| g + (0.2 + 0.5 * s[0]) * g * g,
    |g, _| (1.5 * g).sinh(),
    |g, s| ((g - 0.5 + s[0]).powi(2) + 0.02).sqrt(),
];
const LOAD: [LawOf; 4] = [
    |v, _| v,
    |v, s| v * v * (1.0 + s[0] * v),
    |v, s| (v - 0.3 - 0.3 * s[0]).max(0.0).powf(1.2),
    |v, s| v / (v + 0.1 + 0.4 * s[0]),
];
const HUMIDITY: [LawOf; 3] =
    [|h, _| h, |h, _| h + 0.5 * h.powi(3), |h, s| 1.0 / (1.0 + (-(h - 0.5 + s[0]) / 0.2).exp())];

const COLUMNS: [ColumnOf; 5] = [
    ("log10_irradiance", |p| p.f, &LIGHT),
    ("time_s", |p| p.passed, &TIME),
    ("temperature_c", |p| (p.temperature_c - 20.0) / 2.0, &TEMPERATURE),
    ("row_load", |p| p.row_load, &LOAD),
    ("humidity", |p| (p.humidity - 50.0) / 20.0, &HUMIDITY),
];

/// A field times up to two laws.
pub(crate) struct Formula {
    field: FieldOf,
    shape: Shape,
    laws: Vec<(usize, LawOf, [f64; 2])>,
    over_field: bool,
}

impl Formula {
    /// The formula of a seed.
    pub(crate) fn of(seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(7);
        let mut number = || random.random_range(0.0..1.0);
        let shape = Shape {
            along: DVec2::from_angle(std::f64::consts::TAU * number()),
            at: DVec2::new(1.2 * number() - 0.6, 0.9 * number() - 0.45),
            numbers: [number(), number()],
        };
        let mut pick = |of: usize| ((number() * of as f64) as usize).min(of - 1);
        let count = [0, 0, 1, 1, 1, 1, 1, 2, 2, 2][pick(10)];
        let curved = count == 0 || pick(3) == 0;
        let which = if curved { pick(CURVED.len()) } else { pick(LINEAR.len()) };
        let first = pick(COLUMNS.len());
        let second = (first + 1 + pick(COLUMNS.len() - 1)) % COLUMNS.len();
        let laws = [first, second]
            .into_iter()
            .take(count)
            .map(|column| (column, COLUMNS[column].2[pick(COLUMNS[column].2.len())]))
            .collect::<Vec<_>>();
        let laws = laws.into_iter().map(|(column, law)| (column, law, [number(), number()])).collect();
        let field = if curved { CURVED[which] } else { LINEAR[which] };
        Self { field, shape, laws, over_field: curved || which > 0 }
    }

    /// Columns it depends on; `place` for x and y.
    pub(crate) fn columns(&self) -> Vec<String> {
        let laws = self.laws.iter().map(|(column, ..)| COLUMNS[*column].0.to_owned());
        laws.chain(self.over_field.then(|| "place".to_owned())).collect()
    }

    /// What it adds to a line of sight, in units of its amplitude.
    pub(crate) fn value(&self, p: &Point) -> DVec2 {
        let scale: f64 =
            self.laws.iter().map(|(column, law, shape)| law(COLUMNS[*column].1(p), *shape)).product();
        (self.field)(p.r / HALF, &self.shape) * scale
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of many seeds every field and column comes up, and a formula without a law is none of the baseline's.
    #[test]
    fn formulas_are_of_all_kinds() {
        let all: Vec<Formula> = (0..400).map(Formula::of).collect();
        for name in ["place", "log10_irradiance", "time_s", "temperature_c", "row_load", "humidity"] {
            assert!(all.iter().filter(|f| f.columns().iter().any(|c| c == name)).count() > 40, "{name}");
        }
        assert!(all.iter().all(|f| f.over_field || !f.laws.is_empty()));
    }
}
