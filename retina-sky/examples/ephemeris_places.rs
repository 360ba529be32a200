//! What `validation/spk_kernels.py` compares: barycentric places at the epochs given on standard input.
//!
//! In and out are JSON. In: {"tdb_s": [epochs], "kernels": [SPK files; none for the theories]}. Out: {"places_m":
//! {"sun": [[x, y, z], ...], "mercury": ...}, "timing": {"all_bodies_us"}}.

use std::error::Error;
use std::io::Read as _;
use std::path::PathBuf;
use std::time::Instant;

use retina_sky::ephemeris::Ephemeris;
use retina_sky::planets::Planet;
use serde_json::{Value, json};

fn main() -> Result<(), Box<dyn Error>> {
    let mut text = String::new();
    std::io::stdin().read_to_string(&mut text)?;
    let asked: Value = serde_json::from_str(&text)?;
    let list = |key: &str| asked[key].as_array().ok_or(format!("`{key}` is no list"));
    let epochs_s: Vec<f64> = list("tdb_s")?.iter().filter_map(Value::as_f64).collect();
    let kernels: Vec<PathBuf> =
        list("kernels")?.iter().filter_map(Value::as_str).map(PathBuf::from).collect();
    let ephemeris = Ephemeris::read(&kernels)?;

    let started = Instant::now();
    let mut sun = Vec::new();
    let mut planets = vec![Vec::new(); Planet::ALL.len()];
    for &tdb_s in &epochs_s {
        sun.push(ephemeris.solar_system(tdb_s)?.sun.position_m);
        for (places, planet) in planets.iter_mut().zip(Planet::ALL) {
            places.push(ephemeris.position_m(planet, tdb_s)?);
        }
    }
    let all_bodies_us = started.elapsed().as_secs_f64() * 1e6 / epochs_s.len() as f64;

    let named = Planet::ALL.iter().map(|planet| planet.name()).zip(&planets);
    let places_m: serde_json::Map<String, Value> = std::iter::once(("sun", &sun))
        .chain(named)
        .map(|(name, places)| {
            let rows: Vec<[f64; 3]> = places.iter().map(|place| place.to_array()).collect();
            (name.to_owned(), json!(rows))
        })
        .collect();
    println!("{}", json!({ "places_m": places_m, "timing": { "all_bodies_us": all_bodies_us } }));
    Ok(())
}
