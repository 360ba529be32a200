//! The scene's trajectory: a table from a file, or generated.

use std::path::Path;

use retina_files::{InputError, hash_bytes, read_text};
use retina_sky::Trajectory;
use retina_sky::halo::LumioHalo;
use retina_sky::time::parse_epoch;

use crate::file::{GeneratedTable, TrajectoryKey};

/// The trajectory and the hash of its table's text.
pub(crate) fn trajectory(
    scene: &Path,
    key: &TrajectoryKey,
    bodies: &[String],
) -> Result<(Trajectory, String), InputError> {
    match key {
        TrajectoryKey::Path(path) => {
            let path = scene.parent().unwrap_or(Path::new("")).join(path);
            let text = read_text(&path)?;
            Ok((Trajectory::parse(&path, &text, bodies)?, hash_bytes(text.as_bytes())))
        }
        TrajectoryKey::Generated(table) => {
            let trajectory = generated(scene, table, bodies)?;
            let hash = hash_bytes(trajectory.to_csv().as_bytes());
            Ok((trajectory, hash))
        }
    }
}

fn generated(scene: &Path, table: &GeneratedTable, bodies: &[String]) -> Result<Trajectory, InputError> {
    if let Some(body) = bodies.iter().find(|name| *name != "moon") {
        return Err(InputError::new(
            scene,
            "the built-in trajectory says where the Moon is and nothing else",
        )
        .at("key `trajectory`")
        .found(format!("a body `{body}`"))
        .expected("`moon`")
        .help("write the table with `retina trajectory`, add the body's columns, and name the table here"));
    }
    if !(table.step_s.is_finite() && table.step_s > 0.0) {
        return Err(InputError::new(scene, "the time between frames is not positive")
            .at("key `trajectory.step_s`")
            .found(table.step_s)
            .expected("seconds above 0"));
    }
    if !(1..=1_000_000).contains(&table.frames) {
        return Err(InputError::new(scene, "the number of frames does not fit")
            .at("key `trajectory.frames`")
            .found(table.frames)
            .expected("1 to 1000000"));
    }
    let default = LumioHalo::default();
    let middle_s = default.epoch_tdb_s + 0.5 * (default.frames - 1) as f64 * default.step_s;
    let halo = match &table.epoch {
        None if table.centred.is_some() => {
            return Err(InputError::new(scene, "`centred` says what `epoch` means, and there is no epoch")
                .at("key `trajectory.centred`")
                .help("add an epoch, or remove `centred`: the default is centred on a new Moon"));
        }
        None => LumioHalo::centred_on(middle_s, table.frames, table.step_s),
        Some(text) => {
            let epoch_s = parse_epoch(text).map_err(|error| {
                InputError::new(scene, error.to_string())
                    .at("key `trajectory.epoch`")
                    .found(format!("`{text}`"))
            })?;
            let halo = LumioHalo::centred_on(epoch_s, table.frames, table.step_s);
            if table.centred == Some(true) { halo } else { LumioHalo { epoch_tdb_s: epoch_s, ..halo } }
        }
    };
    let halo = LumioHalo { jacobi: table.jacobi.unwrap_or(halo.jacobi), ..halo };
    let (mut trajectory, _) =
        halo.generate().map_err(|error| InputError::new(scene, error.to_string()).at("key `trajectory`"))?;
    trajectory.source = scene.to_path_buf();
    Ok(trajectory)
}
