//! Forces near the Moon against closed forms and the theories' own accelerations.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

use glam::DVec3;
use retina_sky::ephemeris::{ASTRONOMICAL_UNIT_M, Ephemeris};
use retina_sky::forces::{Field, MoonForces};

const START_S: f64 = 8.7e8;
const GM_MOON_M3_S2: f64 = 4.902_800_118e12;

fn forces(pressure_area_m2_kg: f64) -> MoonForces {
    MoonForces::new(&Ephemeris::analytic(), [START_S, START_S + 20.0 * 86_400.0], pressure_area_m2_kg)
        .unwrap()
}

/// 100 km from a point mass the Earth's tide is 1.5e-9 of its pull: the orbit is Kepler's ellipse. Time, true anomaly
/// and speed of e = 0.5 from Kepler's equation at the eccentric anomaly 2 rad.
#[test]
fn close_to_the_moons_centre_the_orbit_is_keplers() {
    let (a, e, anomaly) = (1e5f64, 0.5f64, 2.0f64);
    let motion = (GM_MOON_M3_S2 / a.powi(3)).sqrt();
    let minor = (1.0 - e * e).sqrt();
    let place = |anomaly: f64| [a * (anomaly.cos() - e), a * minor * anomaly.sin(), 0.0];
    let speed = |anomaly: f64| {
        let rate = motion / (1.0 - e * anomaly.cos());
        [-a * anomaly.sin() * rate, a * minor * anomaly.cos() * rate, 0.0]
    };
    let state = |anomaly: f64| {
        let ([x, y, z], [u, v, w]) = (place(anomaly), speed(anomaly));
        [x, y, z, u, v, w]
    };
    let span_s = (anomaly - e * anomaly.sin()) / motion;
    let end = forces(0.0).propagate(state(0.0), START_S, START_S + span_s).unwrap();
    for (found, expected) in end.iter().zip(state(anomaly)) {
        // The instants are stated to 1e-7 s of the 20 s that this takes.
        assert!((found - expected).abs() < 1e-7 * a, "{end:?} {:?}", state(anomaly));
    }
    let back = forces(0.0).propagate(end, START_S + span_s, START_S).unwrap();
    assert!((back[0] - state(0.0)[0]).abs() < 1e-6 * a, "{back:?}");
}

/// The Earth's own centre, relative to the Moon, is a particle at which the Earth does not pull: the theories'
/// second differences are the oracle of all else.
#[test]
fn the_tide_of_earth_and_sun_is_the_theories() {
    let forces = forces(0.0);
    let earth = |t: f64| {
        let bodies = Ephemeris::analytic().solar_system(t).unwrap();
        bodies.earth.position_m - bodies.moon.position_m
    };
    // At a whole day, where the table is the theories: so near to the Earth, 2 m in between would count.
    let (t, h) = (10_074.0 * 86_400.0, 3600.0);
    let theory = (earth(t + h) - earth(t) * 2.0 + earth(t - h)) / (h * h);
    // At the Earth's own place its pull is singular: the mean of two places to either side cancels it.
    let side = DVec3::new(0.3, -0.8, 0.5).normalize() * 1e7;
    let [a, b] = [side, -side].map(|off| forces.at(t, earth(t) + off).acceleration_m_s2);
    let own = (a + b) * 0.5;
    let off = (own - theory).length() / theory.length();
    assert!(off < 1e-3, "{own} {theory}");
}

#[test]
fn sunlight_pushes_away_from_the_sun_and_falls_with_the_square_of_the_distance() {
    let mut field = Field::ZERO;
    field.add_sunlight(DVec3::Y * ASTRONOMICAL_UNIT_M, 0.02);
    // 4.54e-6 N/m^2 at 1 au (Montenbruck & Gill give 4.56e-6 for 1367 W/m^2).
    let push = field.acceleration_m_s2;
    assert!((push.y / (4.54e-6 * 0.02) - 1.0).abs() < 2e-3 && push.x == 0.0 && push.z == 0.0, "{push}");
    // d(1/r^2)/dr = -2/r^3.
    let slope = field.gradient_s2.y_axis.y * ASTRONOMICAL_UNIT_M / push.y;
    assert!((slope + 2.0).abs() < 1e-12, "{slope}");
    let at = DVec3::new(4e7, -3e7, 2e7);
    let [dark, lit] = [0.0, 0.02].map(|area| forces(area).at(START_S, at).acceleration_m_s2);
    let bodies = Ephemeris::analytic().solar_system(START_S).unwrap();
    let sun = bodies.sun.position_m - bodies.moon.position_m - at;
    let expected = -sun.normalize() * (4.54e-6 * 0.02 * (ASTRONOMICAL_UNIT_M / sun.length()).powi(2));
    assert!((lit - dark - expected).length() < 3e-3 * expected.length(), "{} {expected}", lit - dark);
}

#[test]
fn gradient_and_transition_are_the_differences_of_neighbours() {
    let forces = forces(0.02);
    let state = [3e7, -4e7, 2e7, 50.0, 80.0, -30.0];
    let at = DVec3::from_slice(&state[..3]);
    let gradient = forces.at(START_S, at).gradient_s2;
    for axis in 0..3 {
        let mut step = DVec3::ZERO;
        step[axis] = 1e3;
        let [above, below] = [step, -step].map(|step| forces.at(START_S, at + step).acceleration_m_s2);
        let slope = (above - below) / 2e3;
        assert!((slope - gradient.col(axis)).length() < 1e-6 * gradient.col(axis).length(), "{axis}");
    }
    let to_s = START_S + 2.0 * 86_400.0;
    let (end, transition) = forces.propagate_with_transition(state, START_S, to_s).unwrap();
    let alone = forces.propagate(state, START_S, to_s).unwrap();
    for column in 0..6 {
        let unit = |i: usize| if i < 3 { 1e3 } else { 1e-2 };
        let moved = |sign: f64| {
            let mut moved = state;
            moved[column] += sign * unit(column);
            forces.propagate(moved, START_S, to_s).unwrap()
        };
        let (above, below) = (moved(1.0), moved(-1.0));
        for row in 0..6 {
            let off = (above[row] - below[row]) / 2.0 - transition[row][column] * unit(column);
            assert!(off.abs() < 1e-4 * unit(row), "{row} {column}: {off}");
        }
        assert!((end[column] - alone[column]).abs() < 1e-9 * alone[column].abs() + 1e-9);
    }
}
