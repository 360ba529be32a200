//! How a spacecraft moves between the planets.

use glam::{DMat3, DVec3};
use retina_sky::ephemeris::{EphemerisTable, LIGHT_SPEED_M_S};
use retina_sky::forces::{Field, GM_M3_S2, transition_rate};

use super::matrix::Matrix6;

/// Longest step of the integration, s. A fourth-order Runge-Kutta step of six hours is off by some 0.1 mm at 1 au.
const STEP_S: f64 = 21_600.0;

/// Position and velocity, barycentric ICRF.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PhaseState {
    /// m.
    pub position_m: DVec3,
    /// m/s.
    pub velocity_m_s: DVec3,
}

impl PhaseState {
    /// Position and velocity as one vector.
    pub fn to_array(self) -> [f64; 6] {
        let (r, v) = (self.position_m, self.velocity_m_s);
        [r.x, r.y, r.z, v.x, v.y, v.z]
    }

    /// From one vector.
    pub fn from_array([x, y, z, u, v, w]: [f64; 6]) -> Self {
        Self { position_m: DVec3::new(x, y, z), velocity_m_s: DVec3::new(u, v, w) }
    }

    /// The difference to another state.
    pub fn minus(self, other: Self) -> [f64; 6] {
        let (a, b) = (self.to_array(), other.to_array());
        std::array::from_fn(|i| a[i] - b[i])
    }
}

/// Forces on a spacecraft.
#[derive(Debug, Clone)]
pub struct Dynamics {
    /// Where the Sun and the planets are.
    pub ephemeris: EphemerisTable,
    /// Reflectivity coefficient times area over mass, m^2/kg.
    pub pressure_area_m2_kg: f64,
}

impl Dynamics {
    /// Acceleration, m/s^2: point masses of the Sun, the planets and the Moon, radiation pressure along the line from
    /// the Sun, and the Schwarzschild term of the Sun (Moyer 2000, eq. 4-26 for a test particle:
    /// GM / (c^2 r^3) [(4 GM / r - v^2) r + 4 (r . v) v]).
    pub fn acceleration(&self, tdb_s: f64, state: &PhaseState) -> DVec3 {
        self.acceleration_and_gradient(tdb_s, state).0
    }

    /// The acceleration and its derivative by the position; that of the relativistic term (1e-8 of the Sun's) is left
    /// out of the latter.
    fn acceleration_and_gradient(&self, tdb_s: f64, state: &PhaseState) -> (DVec3, DMat3) {
        let bodies = self.ephemeris.all(tdb_s);
        let mut field = Field::ZERO;
        for (body, gm) in bodies.iter().zip(GM_M3_S2) {
            field.add_point_mass(state.position_m - *body, gm);
        }
        field.add_sunlight(state.position_m - bodies[0], self.pressure_area_m2_kg);
        let r = state.position_m - bodies[0];
        let (distance, v) = (r.length(), state.velocity_m_s);
        let gm = GM_M3_S2[0];
        let scale = gm / (LIGHT_SPEED_M_S * LIGHT_SPEED_M_S * distance.powi(3));
        // The Sun's own velocity (15 m/s) is nothing here.
        let relativity = (r * (4.0 * gm / distance - v.length_squared()) + v * (4.0 * r.dot(v))) * scale;
        (field.acceleration_m_s2 + relativity, field.gradient_s2)
    }

    /// The state at another instant of the table's span.
    pub fn propagate(&self, state: PhaseState, from_s: f64, to_s: f64) -> PhaseState {
        let rate = |t: f64, y: &[f64; 6]| {
            let state = PhaseState::from_array(*y);
            let a = self.acceleration(t, &state);
            [y[3], y[4], y[5], a.x, a.y, a.z]
        };
        PhaseState::from_array(runge_kutta(rate, state.to_array(), from_s, to_s, STEP_S))
    }

    /// As [`Dynamics::propagate`], with the transition matrix d(state) / d(state before).
    pub fn propagate_with_transition(
        &self,
        state: PhaseState,
        from_s: f64,
        to_s: f64,
    ) -> (PhaseState, Matrix6) {
        let mut start = [0.0; 42];
        start[..6].copy_from_slice(&state.to_array());
        for i in 0..6 {
            start[6 + 7 * i] = 1.0;
        }
        let rate = |t: f64, y: &[f64; 42]| {
            let state = PhaseState::from_array(std::array::from_fn(|i| y[i]));
            let (a, gradient) = self.acceleration_and_gradient(t, &state);
            let mut out = [0.0; 42];
            out[..6].copy_from_slice(&[y[3], y[4], y[5], a.x, a.y, a.z]);
            transition_rate(&gradient, &y[6..], &mut out[6..]);
            out
        };
        let end = runge_kutta(rate, start, from_s, to_s, STEP_S);
        let transition = std::array::from_fn(|i| std::array::from_fn(|j| end[6 + 6 * i + j]));
        (PhaseState::from_array(std::array::from_fn(|i| end[i])), transition)
    }
}

/// The classical fourth-order Runge-Kutta method in equal steps of at most `longest_s`.
pub fn runge_kutta<const N: usize>(
    rate: impl Fn(f64, &[f64; N]) -> [f64; N],
    start: [f64; N],
    from_s: f64,
    to_s: f64,
    longest_s: f64,
) -> [f64; N] {
    let steps = ((to_s - from_s).abs() / longest_s).ceil().max(1.0);
    let h = (to_s - from_s) / steps;
    let mut y = start;
    let along = |y: &[f64; N], k: &[f64; N], h: f64| -> [f64; N] { std::array::from_fn(|i| y[i] + h * k[i]) };
    for step in 0..steps as usize {
        let t = from_s + step as f64 * h;
        let k1 = rate(t, &y);
        let k2 = rate(t + h / 2.0, &along(&y, &k1, h / 2.0));
        let k3 = rate(t + h / 2.0, &along(&y, &k2, h / 2.0));
        let k4 = rate(t + h, &along(&y, &k3, h));
        y = std::array::from_fn(|i| y[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]));
    }
    y
}

#[cfg(test)]
mod tests {
    use super::*;
    use retina_sky::ephemeris::{ASTRONOMICAL_UNIT_M, Ephemeris};
    use retina_sky::planets::Planet;

    fn dynamics(days: f64) -> (f64, Dynamics) {
        let start = 8.5e8;
        let ephemeris =
            EphemerisTable::new(&Ephemeris::analytic(), [start, start + days * 86_400.0]).unwrap();
        (start, Dynamics { ephemeris, pressure_area_m2_kg: 0.0 })
    }

    /// Far from all planets the orbit is Kepler's: on a circle the angle grows by n = sqrt(GM / r^3).
    #[test]
    fn the_sun_alone_keeps_keplers_constants() {
        let (start, dynamics) = dynamics(100.0);
        let sun = dynamics.ephemeris.sun(start);
        // 1.3 au, far from all planets, 3 deg out of the ecliptic's plane.
        let r = DVec3::new(-0.9, 0.9, 0.45) * 1.496e11;
        let speed = (GM_M3_S2[0] / r.length()).sqrt();
        let sun_m_s =
            (dynamics.ephemeris.sun(start + 600.0) - dynamics.ephemeris.sun(start - 600.0)) / 1200.0;
        let velocity_m_s = sun_m_s + r.cross(DVec3::Z).normalize() * speed;
        let state = PhaseState { position_m: sun + r, velocity_m_s };
        let end_s = start + 100.0 * 86_400.0;
        let end = dynamics.propagate(state, start, end_s);
        // A circular orbit: after 100 days the angle is n t; planets move it by 1e-5 of the distance at most.
        let turned = (end.position_m - dynamics.ephemeris.sun(end_s)).angle_between(r);
        let expected = speed / r.length() * 100.0 * 86_400.0;
        assert!((turned / expected - 1.0).abs() < 1e-4, "{turned} {expected}");
        let back = dynamics.propagate(end, end_s, start);
        assert!(back.position_m.distance(state.position_m) < 1.0, "there and back");
    }

    /// VSOP87's Mars is the oracle: a test particle at its place, Mars' own pull taken away, must follow it.
    #[test]
    fn mars_itself_moves_as_the_theory_says() {
        let days = 40.0;
        let (start, mut dynamics) = dynamics(days);
        // Mars must not pull at itself: its own place is put far away.
        dynamics.ephemeris = dynamics.ephemeris.without(Planet::Mars);
        let place = |t: f64| Ephemeris::analytic().position_m(Planet::Mars, t).unwrap();
        let velocity = (place(start + 600.0) - place(start - 600.0)) / 1200.0;
        let state = PhaseState { position_m: place(start), velocity_m_s: velocity };
        let end_s = start + days * 86_400.0;
        let off_m = dynamics.propagate(state, start, end_s).position_m.distance(place(end_s));
        // VSOP87's velocity is good to some mm/s: 40 days are 3.5e6 s.
        assert!(off_m < 4e4, "{off_m} m after a way of 8e10");
        assert!(dynamics.propagate(state, start, end_s).position_m.distance(state.position_m) > 7e10);
    }

    #[test]
    fn the_transition_is_the_difference_of_neighbours() {
        let (start, mut dynamics) = dynamics(20.0);
        dynamics.pressure_area_m2_kg = 0.02;
        let state = PhaseState {
            position_m: DVec3::new(-1.2e11, 1.5e11, 7e10),
            velocity_m_s: DVec3::new(-18e3, -12e3, -5e3),
        };
        let end_s = start + 10.0 * 86_400.0;
        let (end, transition) = dynamics.propagate_with_transition(state, start, end_s);
        for column in 0..6 {
            let step = if column < 3 { 1e6 } else { 1.0 };
            let mut moved = state.to_array();
            moved[column] += step;
            let other = dynamics.propagate(PhaseState::from_array(moved), start, end_s).minus(end);
            for row in 0..6 {
                let unit = if row < 3 { 1.0 } else { 1e-6 } * if column < 3 { 1.0 } else { 1e6 };
                let off = (other[row] / step - transition[row][column]).abs() / unit;
                assert!(off < 1e-4, "{row} {column}: {off}");
            }
        }
    }

    #[test]
    fn radiation_pressure_at_one_au() {
        let (start, mut dynamics) = dynamics(1.0);
        let at = dynamics.ephemeris.sun(start) + DVec3::Z * ASTRONOMICAL_UNIT_M;
        let state = PhaseState { position_m: at, velocity_m_s: DVec3::ZERO };
        let without = dynamics.acceleration(start, &state);
        dynamics.pressure_area_m2_kg = 0.02;
        let push = dynamics.acceleration(start, &state) - without;
        // 4.54e-6 N/m^2 at 1 au (Montenbruck & Gill give 4.56e-6 for 1367 W/m^2).
        assert!((push.z / (4.54e-6 * 0.02) - 1.0).abs() < 2e-3 && push.truncate().length() < 1e-14, "{push}");
    }
}
