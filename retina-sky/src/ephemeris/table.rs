//! The Sun and the planets over a span of time, from a table: the theories are too slow to be asked at each step.

use glam::DVec3;
use rayon::prelude::*;

use super::{Ephemeris, EphemerisError};
use crate::planets::Planet;

/// The Sun, then the bodies of [`Planet::ALL`].
pub const BODIES: usize = 10;
/// Spacing of the table, s.
const STEP_S: f64 = 86_400.0;
/// Points of the interpolating polynomial. Of the Moon, terms of a third of a month (1000 km) make the largest error:
/// 2 m. Eight points would leave 50 m.
const POINTS: usize = 12;
/// Rows on either side of an instant that its interpolation needs.
const HALF: i64 = POINTS as i64 / 2;

/// One over the product of i - j over all other j.
const DENOMINATORS: [f64; POINTS] = {
    let mut out = [1.0; POINTS];
    let mut i = 0;
    while i < POINTS {
        let mut j = 0;
        while j < POINTS {
            if i != j {
                out[i] /= i as f64 - j as f64;
            }
            j += 1;
        }
        i += 1;
    }
    out
};

/// Geometric barycentric positions, ICRF metres, of the Sun and the planets.
///
/// The rows stand at whole days, so that an instant has the same places in every table that covers it.
#[derive(Debug, Clone)]
pub struct EphemerisTable {
    /// Day of the first row, counted from J2000.
    first_day: i64,
    rows: Vec<[DVec3; BODIES]>,
}

impl EphemerisTable {
    /// Tabulates a span (TDB seconds since J2000), with a margin of five days, which light-time needs.
    ///
    /// # Errors
    /// The span reaches beyond the ephemeris, or kernels lack a planet.
    pub fn new(ephemeris: &Ephemeris, span_s: [f64; 2]) -> Result<Self, EphemerisError> {
        Self::of(ephemeris, span_s, &Planet::ALL)
    }

    /// As [`EphemerisTable::new`], of the Sun and these planets alone; the others must not be asked for.
    ///
    /// # Errors
    /// The span reaches beyond the ephemeris, or kernels lack one of these.
    pub fn of(ephemeris: &Ephemeris, span_s: [f64; 2], planets: &[Planet]) -> Result<Self, EphemerisError> {
        // The ends first: a span of many centuries is refused before anything is laid out for it.
        for end_s in span_s {
            ephemeris.solar_system(end_s)?;
        }
        let [first_day, last_day] =
            [(span_s[0] / STEP_S).floor() as i64 - HALF, (span_s[1] / STEP_S).floor() as i64 + HALF];
        let rows = (first_day..=last_day)
            .into_par_iter()
            .map(|day| {
                let tdb_s = day as f64 * STEP_S;
                let mut bodies = [DVec3::NAN; BODIES];
                let near = ephemeris.solar_system(tdb_s)?;
                bodies[0] = near.sun.position_m;
                for &planet in planets {
                    bodies[column(planet)] = match planet {
                        Planet::Earth => near.earth.position_m,
                        Planet::Moon => near.moon.position_m,
                        other => ephemeris.position_m(other, tdb_s)?,
                    };
                }
                Ok(bodies)
            })
            .collect::<Result<_, EphemerisError>>()?;
        Ok(Self { first_day, rows })
    }

    /// The same table with a planet so far away that it pulls at nothing: for a particle at the planet's own place.
    pub fn without(mut self, planet: Planet) -> Self {
        for row in &mut self.rows {
            row[column(planet)] = DVec3::splat(1e15);
        }
        self
    }

    /// These columns (0 the Sun, 1 + k the k-th of [`Planet::ALL`]) at an instant of the span, by Lagrange's polynomial
    /// through the twelve rows about it.
    pub fn columns<const N: usize>(&self, columns: [usize; N], tdb_s: f64) -> [DVec3; N] {
        let at = tdb_s / STEP_S;
        let first =
            (at.floor() as i64 - (HALF - 1) - self.first_day).clamp(0, (self.rows.len() - POINTS) as i64);
        let u = at - (self.first_day + first) as f64;
        // Products of u - j over all j before i, and over all after it.
        let (mut before, mut after) = ([1.0; POINTS], [1.0; POINTS]);
        for i in 1..POINTS {
            before[i] = before[i - 1] * (u - (i - 1) as f64);
            after[POINTS - 1 - i] = after[POINTS - i] * (u - (POINTS - i) as f64);
        }
        let mut out = [DVec3::ZERO; N];
        for (i, row) in self.rows[first as usize..].iter().take(POINTS).enumerate() {
            let weight = before[i] * after[i] * DENOMINATORS[i];
            for (place, column) in out.iter_mut().zip(columns) {
                *place += row[column] * weight;
            }
        }
        out
    }

    /// All bodies at an instant; it must lie within the span.
    pub fn all(&self, tdb_s: f64) -> [DVec3; BODIES] {
        self.columns(std::array::from_fn(|column| column), tdb_s)
    }

    /// A planet at an instant within the span.
    pub fn planet(&self, planet: Planet, tdb_s: f64) -> DVec3 {
        self.columns([column(planet)], tdb_s)[0]
    }

    /// The Sun at an instant within the span.
    pub fn sun(&self, tdb_s: f64) -> DVec3 {
        self.columns([0], tdb_s)[0]
    }
}

/// A planet's column.
fn column(planet: Planet) -> usize {
    1 + planet as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn between_its_rows_the_table_is_the_theories_within_metres() {
        let start = 8e8;
        let ephemeris = Ephemeris::analytic();
        let table = EphemerisTable::new(&ephemeris, [start, start + 10.0 * 86_400.0]).unwrap();
        for fraction in [0.0, 0.13, 0.5, 0.77, 1.0] {
            let tdb_s = start + fraction * 10.0 * 86_400.0;
            for planet in Planet::ALL {
                let off = table.planet(planet, tdb_s).distance(ephemeris.position_m(planet, tdb_s).unwrap());
                assert!(off < 3.0, "{}: {off} m", planet.name());
            }
            assert!(table.sun(tdb_s).distance(ephemeris.solar_system(tdb_s).unwrap().sun.position_m) < 1.0);
        }
    }

    #[test]
    fn each_planet_has_its_column() {
        for (k, planet) in Planet::ALL.into_iter().enumerate() {
            assert_eq!(column(planet), 1 + k);
        }
    }

    #[test]
    fn an_instant_has_the_same_places_in_every_table() {
        let ephemeris = Ephemeris::analytic();
        let tables =
            [[8e8, 8.02e8], [8.011e8, 8.013e8]].map(|span| EphemerisTable::new(&ephemeris, span).unwrap());
        for tdb_s in [8.011e8, 8.0123e8, 8.013e8] {
            assert_eq!(tables[0].all(tdb_s), tables[1].all(tdb_s));
        }
    }
}
