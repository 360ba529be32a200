//! The scene's trajectory: a table from a file, or generated.

use std::path::Path;

use retina_files::{InputError, hash_bytes, read_text};
use retina_geometry::Setup;
use retina_sky::Trajectory;
use retina_sky::deep_space::DeepSpace;
use retina_sky::ephemeris::Ephemeris;
use retina_sky::halo::LumioHalo;
use retina_sky::planets::Planet;
use retina_sky::time::parse_epoch;

use crate::file::{GeneratedTable, GeneratorKind, SceneFile, TrajectoryKey};
use crate::near_body::near_body;
use crate::spacecraft::spacecraft;

/// The trajectory and the hash of its table's text.
pub(crate) fn trajectory(
    scene: &Path,
    file: &SceneFile,
    bodies: &[String],
    setup: &Setup,
    ephemeris: &Ephemeris,
) -> Result<(Trajectory, String), InputError> {
    match &file.trajectory {
        TrajectoryKey::Path(path) => {
            let path = scene.parent().unwrap_or(Path::new("")).join(path);
            let text = read_text(&path).map_err(|error| error.named_by(scene, "trajectory"))?;
            Ok((Trajectory::parse(&path, &text, bodies)?, hash_bytes(text.as_bytes())))
        }
        TrajectoryKey::Generated(table) => {
            check_keys(scene, table)?;
            if !(1..=1_000_000).contains(&table.frames) {
                return Err(InputError::new(scene, "the number of frames does not fit")
                    .at("key `trajectory.frames`")
                    .found(table.frames)
                    .expected("1 to 1000000"));
            }
            let mut trajectory = match table.kind {
                GeneratorKind::LumioHalo => {
                    let halo = lumio_halo(scene, table, bodies, ephemeris)?;
                    if file.stars.is_some() { barycentric(scene, halo, ephemeris)? } else { halo }
                }
                GeneratorKind::DeepSpace => deep_space(scene, file, table, setup, ephemeris)?,
                GeneratorKind::Orbit
                | GeneratorKind::Flyby
                | GeneratorKind::PhaseSweep
                | GeneratorKind::Approach => {
                    near_body(scene, table, bodies, file.stars.as_ref().map(|_| ephemeris))?
                }
                GeneratorKind::Spice => spacecraft(scene, table, bodies, ephemeris)?,
            };
            trajectory.source = scene.to_path_buf();
            let hash = hash_bytes(trajectory.to_csv().as_bytes());
            Ok((trajectory, hash))
        }
    }
}

/// Each kind has its own keys.
fn check_keys(scene: &Path, table: &GeneratedTable) -> Result<(), InputError> {
    let known = table.kind.keys();
    match table.given().iter().find(|(key, given)| *given && !known.contains(key)) {
        None => Ok(()),
        Some((key, _)) => {
            Err(InputError::new(scene, format!("the trajectory `{}` has no such key", table.kind.name()))
                .at(format!("key `trajectory.{key}`"))
                .expected(format!("frames, {}", known.join(", ")))
                .help("remove the key"))
        }
    }
}

/// An epoch of a key.
pub(crate) fn epoch_s(scene: &Path, key: &str, text: &str) -> Result<f64, InputError> {
    parse_epoch(text).map_err(|error| {
        InputError::new(scene, error.to_string())
            .at(format!("key `trajectory.{key}`"))
            .found(format!("`{text}`"))
    })
}

/// A Moon-centred trajectory moved to the Solar System's barycentre, where stars need it.
fn barycentric(
    scene: &Path,
    mut trajectory: Trajectory,
    ephemeris: &Ephemeris,
) -> Result<Trajectory, InputError> {
    for pose in &mut trajectory.frames {
        let moon = ephemeris
            .solar_system(pose.time_s)
            .map_err(|error| InputError::new(scene, error.to_string()).at("key `trajectory.epoch`"))?
            .moon;
        pose.camera_position_m += moon.position_m;
        pose.camera_velocity_m_s =
            pose.camera_velocity_m_s.map(|velocity_m_s| velocity_m_s + moon.velocity_m_s);
        pose.sun_position_m = pose.sun_position_m.map(|sun_m| sun_m + moon.position_m);
        for body in pose.bodies.values_mut() {
            body.position_m += moon.position_m;
        }
    }
    Ok(trajectory)
}

fn lumio_halo(
    scene: &Path,
    table: &GeneratedTable,
    bodies: &[String],
    ephemeris: &Ephemeris,
) -> Result<Trajectory, InputError> {
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
    let Some(step_s) = table.step_s else {
        return Err(InputError::new(scene, "the time between frames is missing")
            .at("key `trajectory.step_s`")
            .expected("seconds above 0"));
    };
    if !(step_s.is_finite() && step_s > 0.0) {
        return Err(InputError::new(scene, "the time between frames is not positive")
            .at("key `trajectory.step_s`")
            .found(step_s)
            .expected("seconds above 0"));
    }
    let default = LumioHalo::default();
    let middle_s = default.epoch_tdb_s + 0.5 * (default.frames - 1) as f64 * default.step_s;
    let halo = match &table.epoch {
        None if table.centred.is_some() => {
            return Err(InputError::new(scene, "`centred` says what `epoch` means, and there is no epoch")
                .at("key `trajectory.centred`")
                .help("add an epoch, or remove `centred`: the default is centred on a new Moon"));
        }
        None => LumioHalo::centred_on(middle_s, table.frames, step_s),
        Some(text) => {
            let epoch_s = epoch_s(scene, "epoch", text)?;
            let halo = LumioHalo::centred_on(epoch_s, table.frames, step_s);
            if table.centred == Some(true) { halo } else { LumioHalo { epoch_tdb_s: epoch_s, ..halo } }
        }
    };
    let halo = LumioHalo { jacobi: table.jacobi.unwrap_or(halo.jacobi), ..halo };
    let made = halo.generate(ephemeris);
    Ok(made.map_err(|error| InputError::new(scene, error.to_string()).at("key `trajectory`"))?.0)
}

/// The numbers of a deep-space trajectory, by their keys.
fn check_deep_space(scene: &Path, table: &GeneratedTable) -> Result<(), InputError> {
    let refuse = |key: &str, found: String, expected: &str| {
        Err(InputError::new(scene, "the value does not fit")
            .at(format!("key `trajectory.{key}`"))
            .found(found)
            .expected(expected))
    };
    if let Some([low, high]) = table.distance_au
        && !(low > 0.0 && low <= high && high <= 1e3)
    {
        return refuse(
            "distance_au",
            format!("[{low}, {high}]"),
            "two distances in order, above 0 and at most 1000 au",
        );
    }
    for (key, value, most) in [
        ("greatest_latitude_deg", table.greatest_latitude_deg, 90.0),
        ("least_sun_angle_deg", table.least_sun_angle_deg, 170.0),
    ] {
        if let Some(value) = value.filter(|value| !(0.0..=most).contains(value)) {
            return refuse(key, value.to_string(), &format!("0 to {most} deg"));
        }
    }
    if table.planets.as_ref().is_some_and(Vec::is_empty) {
        return refuse("planets", "none".to_owned(), "one planet at least");
    }
    Ok(())
}

fn deep_space(
    scene: &Path,
    file: &SceneFile,
    table: &GeneratedTable,
    setup: &Setup,
    ephemeris: &Ephemeris,
) -> Result<Trajectory, InputError> {
    if file.stars.is_none() {
        return Err(InputError::new(scene, "deep-space poses show stars and planets, and there are none")
            .at("key `trajectory`")
            .expected("a table [stars]")
            .help("add [stars] to the scene"));
    }
    check_deep_space(scene, table)?;
    let mut wanted = DeepSpace { frames: table.frames, ..DeepSpace::default() };
    wanted.seed = table.seed.unwrap_or(file.seed);
    for (limit, key, text) in [(0, "from", &table.from), (1, "until", &table.until)] {
        if let Some(text) = text {
            wanted.epochs_tdb_s[limit] = epoch_s(scene, key, text)?;
            ephemeris.solar_system(wanted.epochs_tdb_s[limit]).map_err(|error| {
                InputError::new(scene, error.to_string())
                    .at(format!("key `trajectory.{key}`"))
                    .found(format!("`{text}`"))
            })?;
        }
    }
    if wanted.epochs_tdb_s[0] > wanted.epochs_tdb_s[1] {
        return Err(InputError::new(scene, "the span of epochs ends before it begins")
            .at("key `trajectory.until`")
            .expected("an epoch after that of `from`"));
    }
    wanted.sun_distance_au = table.distance_au.unwrap_or(wanted.sun_distance_au);
    let radians = |given: Option<f64>, otherwise: f64| given.map_or(otherwise, f64::to_radians);
    wanted.greatest_latitude_rad = radians(table.greatest_latitude_deg, wanted.greatest_latitude_rad);
    wanted.sun_exclusion_rad = radians(table.least_sun_angle_deg, wanted.sun_exclusion_rad);
    if let Some(names) = &table.planets {
        let planet = |name: &String| {
            Planet::from_name(name).ok_or_else(|| {
                InputError::new(scene, "there is no such planet")
                    .at("key `trajectory.planets`")
                    .found(format!("`{name}`"))
                    .expected(Planet::ALL.map(Planet::name).join(", "))
            })
        };
        wanted.planets = names.iter().map(planet).collect::<Result<_, _>>()?;
    }
    // What the camera sees of the screen: the planet is to be in its image.
    let camera = setup.camera_pinhole();
    wanted.field_rad =
        [f64::from(camera.width_px) / camera.fx_px, f64::from(camera.height_px) / camera.fy_px]
            .map(|tan| 2.0 * (0.5 * tan).atan());
    let made = wanted.generate(ephemeris);
    Ok(made.map_err(|error| InputError::new(scene, error.to_string()).at("key `trajectory`"))?.0)
}
