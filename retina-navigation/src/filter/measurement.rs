//! The direction in which a spacecraft sees a planet.

use glam::DVec3;
use retina_sky::ephemeris::{ASTRONOMICAL_UNIT_M, EphemerisTable, LIGHT_SPEED_M_S};
use retina_sky::observer::{aberrated, deflected_by_sun};
use retina_sky::planets::Planet;

use super::dynamics::PhaseState;

/// The apparent direction of a planet (unit vector, ICRF axes; light-time, deflection by the Sun and aberration in
/// it) and its distance (m), as `state` sees it at an instant.
pub fn apparent_direction(
    ephemeris: &EphemerisTable,
    planet: Planet,
    tdb_s: f64,
    state: &PhaseState,
) -> (DVec3, f64) {
    let mut source_m = ephemeris.planet(planet, tdb_s) - state.position_m;
    // Each pass gains a factor of c over the planet's speed, 6000 at least.
    for _ in 0..3 {
        let then_s = tdb_s - source_m.length() / LIGHT_SPEED_M_S;
        source_m = ephemeris.planet(planet, then_s) - state.position_m;
    }
    let from_sun_m = state.position_m - ephemeris.sun(tdb_s);
    let direction = source_m.normalize();
    let bent =
        deflected_by_sun(direction, (from_sun_m + source_m).normalize(), from_sun_m / ASTRONOMICAL_UNIT_M);
    (aberrated(bent, state.velocity_m_s / LIGHT_SPEED_M_S), source_m.length())
}

/// Two unit vectors across a direction, at right angles to each other.
pub fn tangent_axes(direction: DVec3) -> [DVec3; 2] {
    let (a, b) = direction.any_orthonormal_pair();
    [a, b]
}

#[cfg(test)]
mod tests {
    use super::*;
    use retina_sky::ephemeris::Ephemeris;
    use retina_sky::observer::Observer;
    use retina_sky::planets::seen_planet;

    #[test]
    fn the_table_shows_planets_where_the_theories_show_them() {
        let tdb_s = 8.2e8;
        let ephemeris = Ephemeris::analytic();
        let table = EphemerisTable::new(&ephemeris, [tdb_s, tdb_s + 86_400.0]).unwrap();
        let state = PhaseState {
            position_m: DVec3::new(1.5e11, -1.2e11, -6e10),
            velocity_m_s: DVec3::new(15e3, 18e3, 7e3),
        };
        let observer = Observer::new(&ephemeris, tdb_s, state.position_m, Some(state.velocity_m_s)).unwrap();
        for planet in
            [Planet::Mercury, Planet::Venus, Planet::Earth, Planet::Mars, Planet::Jupiter, Planet::Saturn]
        {
            let seen = seen_planet(&observer, planet).unwrap().unwrap();
            let (direction, distance_m) = apparent_direction(&table, planet, tdb_s, &state);
            let off_mas = direction.distance(seen.direction).to_degrees() * 3.6e6;
            assert!(off_mas < 1.0, "{}: {off_mas} mas", planet.name());
            assert!((distance_m / seen.distance_m - 1.0).abs() < 1e-9);
        }
    }
}
