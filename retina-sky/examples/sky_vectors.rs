//! What `validation/skyfield_sky.py` compares: the sky of observers given on standard input.
//!
//! In and out are JSON. In: {"observers": [{"tdb_s", "position_m", "velocity_m_s" or null}], "hipparcos":
//! [numbers]}. Out, for each observer: the stars' apparent directions, and the planets; and once the
//! catalogue's places, counts and the time of a query.

use std::error::Error;
use std::io::Read as _;
use std::time::Instant;

use glam::DVec3;
use retina_sky::catalogue::StarCatalogue;
use retina_sky::ephemeris::Ephemeris;
use retina_sky::observer::Observer;
use retina_sky::planets::seen_planets;
use serde_json::{Value, json};

fn vector(value: &Value) -> Option<DVec3> {
    let numbers: Vec<f64> = value.as_array()?.iter().filter_map(Value::as_f64).collect();
    Some(DVec3::from_array(numbers.try_into().ok()?))
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut text = String::new();
    std::io::stdin().read_to_string(&mut text)?;
    let asked: Value = serde_json::from_str(&text)?;
    let (ephemeris, catalogue) = (Ephemeris::analytic(), StarCatalogue::embedded());
    let numbers = asked["hipparcos"].as_array().ok_or("`hipparcos` is no list")?;
    let stars: Vec<_> = numbers
        .iter()
        .filter_map(|number| catalogue.hipparcos(u32::try_from(number.as_u64()?).ok()?))
        .collect();

    let mut observers = Vec::new();
    for place in asked["observers"].as_array().ok_or("`observers` is no list")? {
        let tdb_s = place["tdb_s"].as_f64().ok_or("an observer without `tdb_s`")?;
        let position = vector(&place["position_m"]).ok_or("an observer without `position_m`")?;
        let observer = Observer::new(&ephemeris, tdb_s, position, vector(&place["velocity_m_s"]))?;
        let directions: Vec<_> = stars
            .iter()
            .map(|star| observer.apparent_star(star.direction_from(position, tdb_s)).to_array())
            .collect();
        let mut planets = serde_json::Map::new();
        for seen in seen_planets(&observer)? {
            let entry = json!({
                "direction": seen.direction.to_array(),
                "position_m": ephemeris.position_m(seen.planet, tdb_s)?.to_array(),
                "distance_m": seen.distance_m,
                "sun_distance_m": seen.sun_distance_m,
                "phase_deg": seen.phase_angle_rad.to_degrees(),
                "magnitude": seen.magnitude,
                "extrapolated": seen.magnitude_extrapolated,
            });
            planets.insert(seen.planet.name().to_owned(), entry);
        }
        observers.push(json!({ "stars": directions, "planets": planets }));
    }

    let counts: Vec<_> = [4.0, 6.0, 6.5, 8.25]
        .map(|limit| catalogue.stars().iter().filter(|star| star.v_magnitude <= limit).count())
        .into();
    // The wide field's half diagonal, 10 deg; the mean over many axes.
    let observer = Observer::new(&ephemeris, 0.0, DVec3::X * 1.5e11, Some(DVec3::Y * 3e4))?;
    let axes: Vec<_> = catalogue.stars().iter().step_by(57).map(|star| star.direction).collect();
    let started = Instant::now();
    let found: usize = axes.iter().map(|axis| catalogue.in_cone(&observer, *axis, 0.1745, 8.25).len()).sum();
    let wide_us = started.elapsed().as_secs_f64() * 1e6 / axes.len() as f64;
    let started = Instant::now();
    let few: usize = axes.iter().map(|axis| catalogue.in_cone(&observer, *axis, 0.01, 8.25).len()).sum();
    let narrow_us = started.elapsed().as_secs_f64() * 1e6 / axes.len() as f64;
    let started = Instant::now();
    for _ in 0..20 {
        seen_planets(&observer)?;
    }
    let planets_us = started.elapsed().as_secs_f64() * 1e6 / 20.0;
    let answer = json!({
        "observers": observers,
        "catalogue": stars.iter().map(|star| json!({
            "id": star.id.to_string(), "direction": star.direction.to_array(),
            "motion_rad_yr": star.proper_motion_rad_yr.to_array(), "parallax_rad": star.parallax_rad,
            "v": star.v_magnitude,
        })).collect::<Vec<_>>(),
        "counts": { "4.0": counts[0], "6.0": counts[1], "6.5": counts[2], "8.25": counts[3] },
        "timing": {
            "cone_10_deg_us": wide_us, "stars_a_10_deg_cone": found as f64 / axes.len() as f64,
            "cone_0.57_deg_us": narrow_us, "stars_a_0.57_deg_cone": few as f64 / axes.len() as f64,
            "all_planets_us": planets_us,
        },
    });
    println!("{answer}");
    Ok(())
}
