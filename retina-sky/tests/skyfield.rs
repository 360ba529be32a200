//! Stars, planets and their magnitudes against Skyfield 1.55 with DE421 and Hipparcos I/311.
//!
//! `skyfield.json` is what `validation/skyfield_sky.py --freeze` wrote: apparent directions from the
//! Earth's centre and from deep space with velocities, 1950 to 2048.

#![allow(clippy::unwrap_used, reason = "a helper that fails fails its test")]

use glam::DVec3;
use retina_sky::catalogue::StarCatalogue;
use retina_sky::ephemeris::{ASTRONOMICAL_UNIT_M, Ephemeris};
use retina_sky::observer::{Observer, separation_rad};
use retina_sky::planets::{Planet, seen_planet};
use serde_json::Value;

const ARCSEC: f64 = std::f64::consts::PI / 648_000.0;

fn vector(value: &Value) -> DVec3 {
    DVec3::from_array(std::array::from_fn(|axis| value[axis].as_f64().unwrap()))
}

/// Each frozen observer with what Skyfield saw from there.
fn observers() -> Vec<(Observer, Value)> {
    let document: Value = serde_json::from_str(include_str!("skyfield.json")).unwrap();
    let frozen = document["observers"].as_array().unwrap().clone();
    assert_eq!(frozen.len(), 12);
    let observer = |entry: &Value| {
        let velocity_m_s = vector(&entry["velocity_m_s"]);
        Observer::new(
            &Ephemeris::analytic(),
            entry["tdb_s"].as_f64().unwrap(),
            vector(&entry["position_m"]),
            Some(velocity_m_s),
        )
        .unwrap()
    };
    frozen.into_iter().map(|entry| (observer(&entry), entry)).collect()
}

#[test]
fn stars_are_within_two_milliarcseconds() {
    let catalogue = StarCatalogue::embedded();
    for (observer, expected) in observers() {
        for (hip, direction) in expected["stars"].as_object().unwrap() {
            let star = catalogue.hipparcos(hip.parse().unwrap()).unwrap();
            let seen = observer.apparent_star(star.direction_from(observer.position_m(), observer.tdb_s()));
            let off = separation_rad(seen, vector(direction)) / ARCSEC;
            assert!(off < 2e-3, "HIP {hip}: {off} arcsec");
        }
    }
}

#[test]
fn a_cone_gives_the_same_directions() {
    for (observer, expected) in observers() {
        let direction = vector(&expected["stars"]["32349"]);
        let found = StarCatalogue::embedded().in_cone(&observer, direction, 1e-5, 0.0);
        assert_eq!(found.len(), 1);
        assert!(found[0].magnitude < -1.4 && found[0].star.id.to_string() == "HIP 32349");
    }
}

#[test]
fn planets_are_as_near_as_their_theory() {
    for (observer, expected) in observers() {
        for (name, entry) in expected["planets"].as_object().unwrap() {
            let planet = Planet::from_name(name).unwrap();
            let seen = seen_planet(&observer, planet).unwrap().unwrap();
            let off_rad = separation_rad(seen.direction, vector(&entry["direction"]));
            // Errors of position against DE421 over 1950-2050, see the module `planets`, and 15 km of the
            // barycentric Earth.
            let error_m = match planet {
                Planet::Mercury | Planet::Venus | Planet::Earth => 35e3,
                Planet::Moon => 60e3,
                Planet::Mars => 70e3,
                Planet::Jupiter => 350e3,
                Planet::Saturn => 2e6,
                Planet::Uranus => 22e6,
                Planet::Neptune => 48e6,
            };
            let off_m = off_rad * seen.distance_m;
            assert!(off_m < error_m, "{name}: {off_m} m");
            let outer = matches!(planet, Planet::Uranus | Planet::Neptune | Planet::Moon);
            assert!(outer || off_rad < ARCSEC, "{name}: {} arcsec", off_rad / ARCSEC);
            // The Earth and the Moon seen closely turn their phase by more.
            if seen.distance_m > 0.05 * ASTRONOMICAL_UNIT_M {
                let phase_off_deg = seen.phase_angle_rad.to_degrees() - entry["phase_deg"].as_f64().unwrap();
                assert!(phase_off_deg.abs() < 2e-3, "{name}: {phase_off_deg} deg");
            }
        }
    }
}

#[test]
fn magnitudes_are_those_of_the_same_paper() {
    let mut compared = 0;
    for (observer, expected) in observers() {
        for (name, entry) in expected["planets"].as_object().unwrap() {
            let seen = seen_planet(&observer, Planet::from_name(name).unwrap()).unwrap().unwrap();
            let Some(magnitude) = entry["magnitude"].as_f64() else { continue };
            if seen.magnitude_extrapolated {
                continue;
            }
            // Skyfield leaves out Mars' rotation (0.06 mag at most) and season (0.09).
            let tolerance = if seen.planet == Planet::Mars { 0.15 } else { 2e-3 };
            assert!((seen.magnitude - magnitude).abs() < tolerance, "{name}: {} {magnitude}", seen.magnitude);
            compared += 1;
        }
    }
    assert!(compared > 60, "{compared}");
}
