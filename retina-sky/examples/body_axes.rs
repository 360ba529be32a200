//! What `validation/spice_kernels.py` compares: how kernels turn bodies at the epochs given on standard input.
//!
//! In and out are JSON. In: {"tdb_s": [epochs], "kernels": [files], "bodies": [names]}. Out, by body: {"axes": what turns
//! it, or null, "semi_axes_m": [a, b, c] or null, "body_from_inertial": [[w, x, y, z], ...]}.

use std::error::Error;
use std::io::Read as _;
use std::path::PathBuf;

use retina_sky::ephemeris::Ephemeris;
use serde_json::{Map, Value, json};

fn main() -> Result<(), Box<dyn Error>> {
    let mut text = String::new();
    std::io::stdin().read_to_string(&mut text)?;
    let asked: Value = serde_json::from_str(&text)?;
    let list = |key: &str| asked[key].as_array().ok_or(format!("`{key}` is no list"));
    let kernels: Vec<PathBuf> =
        list("kernels")?.iter().filter_map(Value::as_str).map(PathBuf::from).collect();
    let ephemeris = Ephemeris::read(&kernels)?;
    let mut bodies = Map::new();
    for name in list("bodies")?.iter().filter_map(Value::as_str) {
        let mut turns = Vec::new();
        for tdb_s in list("tdb_s")?.iter().filter_map(Value::as_f64) {
            let turn = ephemeris.body_from_inertial(name, tdb_s)?.ok_or(format!("{name} has no axes"))?;
            turns.push([turn.w, turn.x, turn.y, turn.z]);
        }
        let own = json!({
            "axes": ephemeris.axes_source(name),
            "semi_axes_m": ephemeris.semi_axes_m(name).map(|axes_m| axes_m.to_array()),
            "body_from_inertial": turns,
        });
        bodies.insert(name.to_owned(), own);
    }
    println!("{}", Value::Object(bodies));
    Ok(())
}
