//! What `validation/spice_craft.py` compares: where kernels have spacecraft and how they turn their instruments at the
//! epochs given on standard input.
//!
//! In and out are JSON. In: {"tdb_s": [epochs], "kernels": [files], "frames": [names], "bodies": [names], "seen":
//! [spacecraft, its camera's frame, a body] or []}. Out: {"frame_from_inertial": {name: [[w, x, y, z], ...]}, "states_m":
//! {name: [[x, y, z, vx, vy, vz], ...]}, "seen_camera_m": [[x, y, z], ...]}.

use std::error::Error;
use std::io::Read as _;
use std::path::PathBuf;

use glam::DQuat;
use retina_sky::ephemeris::{Ephemeris, EphemerisError};
use retina_sky::spacecraft::{Pointing, SpacecraftFrames};
use serde_json::{Map, Value, json};

fn main() -> Result<(), Box<dyn Error>> {
    let mut text = String::new();
    std::io::stdin().read_to_string(&mut text)?;
    let asked: Value = serde_json::from_str(&text)?;
    let list = |key: &str| asked[key].as_array().ok_or(format!("`{key}` is no list"));
    let names = |key: &str| Ok::<_, String>(list(key)?.iter().filter_map(Value::as_str));
    let ephemeris = Ephemeris::read(&names("kernels")?.map(PathBuf::from).collect::<Vec<_>>())?;
    let epochs: Vec<f64> = list("tdb_s")?.iter().filter_map(Value::as_f64).collect();
    let mut turns = Map::new();
    for name in names("frames")? {
        let own = epochs.iter().map(|&tdb_s| {
            let turn = ephemeris.frame_from_inertial(name, tdb_s)?;
            Ok([turn.w, turn.x, turn.y, turn.z])
        });
        turns.insert(name.to_owned(), json!(own.collect::<Result<Vec<_>, EphemerisError>>()?));
    }
    let mut states = Map::new();
    for name in names("bodies")? {
        let own = epochs.iter().map(|&tdb_s| {
            let state = ephemeris.state(name, tdb_s)?;
            Ok([state.position_m.to_array(), state.velocity_m_s.to_array()].concat())
        });
        states.insert(name.to_owned(), json!(own.collect::<Result<Vec<_>, EphemerisError>>()?));
    }
    let mut seen = Vec::new();
    if let [craft, camera, body] = names("seen")?.collect::<Vec<_>>()[..] {
        for &epoch_tdb_s in &epochs {
            let pointing = Pointing::Frame { name: camera.to_owned(), camera_from_frame: DQuat::IDENTITY };
            let (observer, bodies) = (craft.to_owned(), vec![body.to_owned()]);
            let wanted = SpacecraftFrames { observer, pointing, bodies, frames: 1, step_s: 1.0, epoch_tdb_s };
            let pose = &wanted.generate(&ephemeris)?.frames[0];
            let from_m = pose.bodies[body].position_m - pose.camera_position_m;
            seen.push((pose.camera_from_inertial * from_m).to_array());
        }
    }
    println!("{}", json!({ "frame_from_inertial": turns, "states_m": states, "seen_camera_m": seen }));
    Ok(())
}
