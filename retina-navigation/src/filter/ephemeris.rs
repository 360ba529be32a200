//! The Sun and the planets over a span of time, from a table: the theories are too slow to be asked at each step.

use glam::DVec3;
use rayon::prelude::*;
use retina_sky::ephemeris::{Ephemeris, EphemerisError};
use retina_sky::planets::Planet;

/// The Sun, then the bodies of [`Planet::ALL`].
pub const BODIES: usize = 10;
/// Spacing of the table, s.
const STEP_S: f64 = 86_400.0;
/// Points of the interpolating polynomial: of the Moon, (2 pi / 27.3)^8 times its distance times some thousandths is
/// metres.
const POINTS: usize = 8;

/// Geometric barycentric positions, ICRF metres, of the Sun and the planets.
#[derive(Debug, Clone)]
pub struct EphemerisTable {
    start_s: f64,
    rows: Vec<[DVec3; BODIES]>,
}

impl EphemerisTable {
    /// Tabulates a span (TDB seconds since J2000), with a margin for light-time.
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
        let start_s = span_s[0] - 4.0 * STEP_S;
        let count = ((span_s[1] - start_s) / STEP_S).ceil().max(0.0) as usize + POINTS;
        let rows = (0..count)
            .into_par_iter()
            .map(|row| {
                let tdb_s = start_s + row as f64 * STEP_S;
                let mut bodies = [DVec3::NAN; BODIES];
                bodies[0] = ephemeris.solar_system(tdb_s)?.sun.position_m;
                for (body, planet) in bodies[1..].iter_mut().zip(Planet::ALL) {
                    if planets.contains(&planet) {
                        *body = ephemeris.position_m(planet, tdb_s)?;
                    }
                }
                Ok(bodies)
            })
            .collect::<Result<_, EphemerisError>>()?;
        Ok(Self { start_s, rows })
    }

    /// The table's rows, for tests that take a body away.
    #[cfg(test)]
    pub(crate) fn rows_mut(&mut self) -> &mut [[DVec3; BODIES]] {
        &mut self.rows
    }

    /// Weights of the interpolation at an instant: the first row, and the Lagrange coefficients.
    fn weights(&self, tdb_s: f64) -> (usize, [f64; POINTS]) {
        let at = (tdb_s - self.start_s) / STEP_S;
        let first = ((at.floor() as isize) - (POINTS as isize / 2 - 1))
            .clamp(0, (self.rows.len() - POINTS) as isize) as usize;
        let u = at - first as f64;
        let weight = |i: usize| {
            (0..POINTS).filter(|j| *j != i).map(|j| (u - j as f64) / (i as f64 - j as f64)).product()
        };
        (first, std::array::from_fn(weight))
    }

    /// All bodies at an instant; it must lie within the span.
    pub fn all(&self, tdb_s: f64) -> [DVec3; BODIES] {
        let (first, weights) = self.weights(tdb_s);
        let mut out = [DVec3::ZERO; BODIES];
        for (row, weight) in self.rows[first..first + POINTS].iter().zip(weights) {
            for (body, value) in out.iter_mut().zip(row) {
                *body += *value * weight;
            }
        }
        out
    }

    /// A planet at an instant within the span.
    pub fn planet(&self, planet: Planet, tdb_s: f64) -> DVec3 {
        let (first, weights) = self.weights(tdb_s);
        let column = 1 + Planet::ALL.iter().position(|other| *other == planet).unwrap_or(0);
        self.rows[first..first + POINTS].iter().zip(weights).map(|(row, weight)| row[column] * weight).sum()
    }

    /// The Sun at an instant within the span.
    pub fn sun(&self, tdb_s: f64) -> DVec3 {
        let (first, weights) = self.weights(tdb_s);
        self.rows[first..first + POINTS].iter().zip(weights).map(|(row, weight)| row[0] * weight).sum()
    }
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
                assert!(off < 50.0, "{}: {off} m", planet.name());
            }
            assert!(table.sun(tdb_s).distance(ephemeris.solar_system(tdb_s).unwrap().sun.position_m) < 1.0);
        }
    }
}
