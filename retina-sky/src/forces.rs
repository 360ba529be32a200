//! Forces on a spacecraft: point masses and the pressure of sunlight; and how one moves near the Moon.

use glam::{DMat3, DVec3};

use crate::ephemeris::{
    ASTRONOMICAL_UNIT_M, BODIES, Ephemeris, EphemerisError, EphemerisTable, LIGHT_SPEED_M_S,
};
use crate::ode::integrate;
use crate::planets::Planet;

/// GM of the Sun and of the bodies of `Planet::ALL` (Mercury, Venus, Earth, Moon, Mars, Jupiter, Saturn, Uranus,
/// Neptune; systems with their moons), m^3/s^2 (JPL DE440, Park et al. 2021).
pub const GM_M3_S2: [f64; BODIES] = [
    1.327_124_400_412_794e20,
    2.203_186_855_1e13,
    3.248_585_92e14,
    3.986_004_355_07e14,
    4.902_800_118e12,
    4.282_837_581_6e13,
    1.267_127_641e17,
    3.794_058_484_18e16,
    5.794_556_4e15,
    6.836_527_100_58e15,
];
/// The Sun's radiation pressure on an absorber at 1 au: 1361 W/m^2 (Kopp & Lean 2011) over c, N/m^2.
const PRESSURE_1AU_N_M2: f64 = 1361.0 / LIGHT_SPEED_M_S;
/// Relative error a step of the integrations.
const TOLERANCE: f64 = 1e-13;
/// Sun, Earth and Moon in [`GM_M3_S2`] and in the table's columns.
const NEAR: [usize; 3] = [0, 3, 4];

/// Reflectivity coefficient times area over mass that the built-in halo goes by, m^2/kg: 1.3 times 0.4 m^2 over 24 kg.
///
/// An assumption, not LUMIO's figures: a 12U CubeSat of 20 to 28 kg whose arrays of some 0.4 m^2 face the Sun. At 1 au
/// it is pushed by 1e-7 m/s^2.
pub const LUMIO_PRESSURE_AREA_M2_KG: f64 = 1.3 * 0.4 / 24.0;

/// An acceleration, and how it changes with the place.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Field {
    /// m/s^2.
    pub acceleration_m_s2: DVec3,
    /// Its derivative by the position, 1/s^2.
    pub gradient_s2: DMat3,
}

impl Field {
    /// Nothing pulls.
    pub const ZERO: Self = Self { acceleration_m_s2: DVec3::ZERO, gradient_s2: DMat3::ZERO };

    /// Adds the pull of a point mass from which the spacecraft stands `offset_m`.
    pub fn add_point_mass(&mut self, offset_m: DVec3, gm_m3_s2: f64) {
        let outer = DMat3::from_cols(offset_m * offset_m.x, offset_m * offset_m.y, offset_m * offset_m.z);
        let r2 = offset_m.length_squared();
        let per_r3 = gm_m3_s2 / (r2 * r2.sqrt());
        self.acceleration_m_s2 -= offset_m * per_r3;
        self.gradient_s2 += (outer * (3.0 / r2) - DMat3::IDENTITY) * per_r3;
    }

    /// Adds the push of sunlight, along the line from the Sun, from which the spacecraft stands `offset_m`;
    /// `area_m2_kg` is the reflectivity coefficient times area over mass.
    pub fn add_sunlight(&mut self, offset_m: DVec3, area_m2_kg: f64) {
        // It falls with the square of the distance as gravity does: a weaker Sun.
        let gm_m3_s2 = PRESSURE_1AU_N_M2 * ASTRONOMICAL_UNIT_M * ASTRONOMICAL_UNIT_M * area_m2_kg;
        self.add_point_mass(offset_m, -gm_m3_s2);
    }
}

/// Forces on a spacecraft near the Moon, relative to the Moon's centre: point masses of Moon, Earth and Sun, less what
/// Earth and Sun pull at the Moon itself, and the pressure of sunlight.
///
/// What is left out is a hundredth of sunlight's push. At 60 000 km from the Moon: the Moon's oblateness 4e-10 m/s^2,
/// the Earth's 7e-10, Venus's tide 5e-10 at most, Jupiter's 6e-11.
#[derive(Debug, Clone)]
pub struct MoonForces {
    table: EphemerisTable,
    pressure_area_m2_kg: f64,
}

impl MoonForces {
    /// Forces over a span of time (TDB seconds since J2000); `pressure_area_m2_kg` is the reflectivity coefficient times
    /// area over mass.
    ///
    /// # Errors
    /// The span, with six days before and after it, reaches beyond the ephemeris.
    pub fn new(
        ephemeris: &Ephemeris,
        span_s: [f64; 2],
        pressure_area_m2_kg: f64,
    ) -> Result<Self, EphemerisError> {
        let table = EphemerisTable::of(ephemeris, span_s, &[Planet::Earth, Planet::Moon])?;
        Ok(Self { table, pressure_area_m2_kg })
    }

    /// At a place relative to the Moon (m, ICRF axes), at an instant of the span.
    pub fn at(&self, tdb_s: f64, position_m: DVec3) -> Field {
        let [sun, earth, moon] = self.table.columns(NEAR, tdb_s);
        let mut field = Field::ZERO;
        field.add_point_mass(position_m, GM_M3_S2[NEAR[2]]);
        for (body, gm) in [(earth - moon, GM_M3_S2[NEAR[1]]), (sun - moon, GM_M3_S2[NEAR[0]])] {
            field.add_point_mass(position_m - body, gm);
            field.acceleration_m_s2 -= body * (gm / body.length().powi(3));
        }
        field.add_sunlight(position_m - (sun - moon), self.pressure_area_m2_kg);
        field
    }

    /// Position (m) and velocity (m/s) relative to the Moon, ICRF axes, at another instant of the span. `None` where the
    /// path runs into the Moon's centre.
    pub fn propagate(&self, state: [f64; 6], from_s: f64, to_s: f64) -> Option<[f64; 6]> {
        let rate = |t: f64, y: &[f64; 6]| {
            let pull = self.at(t, DVec3::new(y[0], y[1], y[2])).acceleration_m_s2;
            [y[3], y[4], y[5], pull.x, pull.y, pull.z]
        };
        integrate(rate, state, [from_s, to_s], TOLERANCE)
    }

    /// As [`MoonForces::propagate`], with the transition d(state) / d(state before), rows first.
    pub fn propagate_with_transition(
        &self,
        state: [f64; 6],
        from_s: f64,
        to_s: f64,
    ) -> Option<([f64; 6], [[f64; 6]; 6])> {
        let mut start = [0.0; 42];
        start[..6].copy_from_slice(&state);
        for i in 0..6 {
            start[6 + 7 * i] = 1.0;
        }
        let rate = |t: f64, y: &[f64; 42]| {
            let field = self.at(t, DVec3::new(y[0], y[1], y[2]));
            let mut out = [0.0; 42];
            out[..3].copy_from_slice(&y[3..6]);
            out[3..6].copy_from_slice(&field.acceleration_m_s2.to_array());
            transition_rate(&field.gradient_s2, &y[6..], &mut out[6..]);
            out
        };
        let end = integrate(rate, start, [from_s, to_s], TOLERANCE)?;
        let transition = std::array::from_fn(|i| std::array::from_fn(|j| end[6 + 6 * i + j]));
        Some((std::array::from_fn(|i| end[i]), transition))
    }
}

/// The rate of a transition matrix of position and velocity, 36 numbers row by row: the position's rows change by the
/// velocity's, those by the gradient times the position's.
pub fn transition_rate(gradient_s2: &DMat3, phi: &[f64], rate: &mut [f64]) {
    for column in 0..6 {
        let pull = *gradient_s2 * DVec3::new(phi[column], phi[6 + column], phi[12 + column]);
        for row in 0..3 {
            rate[6 * row + column] = phi[6 * (row + 3) + column];
            rate[6 * (row + 3) + column] = pull[row];
        }
    }
}
