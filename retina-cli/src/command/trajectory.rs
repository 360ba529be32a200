//! `retina trajectory`.

use std::path::{Path, PathBuf};

use retina_files::{InputError, write_atomic};
use retina_scene::Scene;
use retina_sky::Trajectory;
use retina_sky::deep_space::DeepSpace;
use retina_sky::ephemeris::Ephemeris;
use retina_sky::halo::LumioHalo;
use retina_sky::planets::Planet;
use retina_sky::site::Site;
use retina_sky::time::{format_epoch_tdb, parse_epoch};
use serde_json::json;

use crate::failure::Failure;
use crate::output::{print_json, tell};

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Kind of trajectory.
    #[arg(long, value_enum, default_value_t)]
    kind: Kind,
    /// Time of the first frame, for example 2027-07-26T00:00 UTC.
    ///
    /// [default for lumio-halo: the sequence is centred on the new Moon of 2027 August 2]
    #[arg(long)]
    epoch: Option<String>,
    /// Take --epoch as the middle of the sequence.
    #[arg(long, requires = "epoch")]
    centred: bool,
    /// Number of frames [default: 4321 for lumio-halo, 5000 for deep-space, 1 for site].
    #[arg(long)]
    frames: Option<usize>,
    /// Time between frames, s (lumio-halo and site).
    #[arg(long, default_value_t = LumioHalo::default().step_s, allow_negative_numbers = true)]
    step_s: f64,
    /// Jacobi constant of the halo orbit, 3.016 to 3.152.
    #[arg(long)]
    jacobi: Option<f64>,
    /// Seed of the deep-space poses [default: 0].
    #[arg(long)]
    seed: Option<u64>,
    /// Latitude of the site, deg, north positive (WGS 84).
    #[arg(long, allow_negative_numbers = true)]
    latitude_deg: Option<f64>,
    /// East longitude of the site, deg.
    #[arg(long, allow_negative_numbers = true)]
    longitude_deg: Option<f64>,
    /// Height of the site above the ellipsoid, m [default: 0].
    #[arg(long, allow_negative_numbers = true)]
    altitude_m: Option<f64>,
    /// What the camera at the site points at: `moon` or a planet [default: moon].
    #[arg(long)]
    target: Option<String>,
    /// SPICE kernel for places, axes and radii of bodies [default: analytical theories].
    ///
    /// SPK, text and binary PCK, frame, leap-second or meta-kernel. Repeat the flag for more kernels. If
    /// several contain the same body, the last one named is used.
    #[arg(long, value_name = "KERNEL")]
    ephemeris: Vec<PathBuf>,
    /// Scene whose trajectory is written as a table, whatever generates it; takes the place of --kind.
    #[arg(
        long,
        value_name = "SCENE.toml",
        conflicts_with_all = [
            "kind", "epoch", "frames", "step_s", "jacobi", "seed", "latitude_deg", "longitude_deg", "altitude_m",
            "target", "ephemeris",
        ]
    )]
    scene: Option<PathBuf>,
    /// Table to write (CSV).
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Print the summary as a JSON document on standard output.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, Default, clap::ValueEnum)]
enum Kind {
    /// Quasi-halo orbit about the Earth-Moon L2 point; the camera points at the Moon.
    #[default]
    LumioHalo,
    /// Random poses between 0.7 and 5.2 au from the Sun, each with a planet in the wide
    /// configuration's field.
    DeepSpace,
    /// Camera on the Earth that points at the Moon or a planet, celestial north up. For scenes with
    /// stars.
    Site,
}

pub(crate) fn run(arguments: Arguments) -> Result<(), Failure> {
    crate::check_file(&arguments.out, "csv")?;
    if let Some(scene) = &arguments.scene {
        return of_scene(scene, &arguments);
    }
    if !arguments.step_s.is_finite() || arguments.step_s <= 0.0 {
        return Err(InputError::new("--step-s", "is out of range")
            .found(arguments.step_s)
            .expected("a time above 0")
            .into());
    }
    let (wanted, foreign) = match arguments.kind {
        Kind::LumioHalo => (LumioHalo::default().frames, arguments.seed.map(|_| "--seed")),
        Kind::DeepSpace => {
            let epoch = arguments.epoch.as_ref().map(|_| "--epoch");
            (DeepSpace::default().frames, epoch.or(arguments.jacobi.map(|_| "--jacobi")))
        }
        Kind::Site => {
            let seed = arguments.seed.map(|_| "--seed");
            (1, seed.or(arguments.jacobi.map(|_| "--jacobi")).or(arguments.centred.then_some("--centred")))
        }
    };
    let of_site = [
        ("--latitude-deg", arguments.latitude_deg.is_some()),
        ("--longitude-deg", arguments.longitude_deg.is_some()),
        ("--altitude-m", arguments.altitude_m.is_some()),
        ("--target", arguments.target.is_some()),
    ];
    let elsewhere = of_site.iter().find(|(_, given)| *given && !matches!(arguments.kind, Kind::Site));
    if let Some(option) = foreign.or(elsewhere.map(|(option, _)| *option)) {
        return Err(InputError::new(option, "does not apply to this kind of trajectory")
            .help("leave the option out, or give another --kind")
            .into());
    }
    let frames = arguments.frames.unwrap_or(wanted);
    if !(1..=1_000_000).contains(&frames) {
        return Err(InputError::new("--frames", "the number of frames is out of range")
            .found(frames)
            .expected("1 to 1000000")
            .into());
    }
    let ephemeris = Ephemeris::read(&arguments.ephemeris)?;
    match arguments.kind {
        Kind::LumioHalo => lumio_halo(&arguments, &ephemeris, frames),
        Kind::DeepSpace => deep_space(&arguments, &ephemeris, frames),
        Kind::Site => site(&arguments, &ephemeris, frames),
    }
}

fn write(out: &Path, text: &str) -> Result<(), Failure> {
    write_atomic(out, text.as_bytes())
        .map_err(|error| Failure::new(format!("{} cannot be written: {error}", out.display())))
}

/// A scene's own trajectory.
fn of_scene(scene: &Path, arguments: &Arguments) -> Result<(), Failure> {
    let trajectory = Scene::read(scene)?.trajectory;
    let name = scene.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    let text =
        format!("# retina.trajectory/1: of {}\n{}", name.replace(['\n', '\r'], " "), trajectory.to_csv());
    write_atomic(&arguments.out, text.as_bytes())
        .map_err(|error| InputError::new(&arguments.out, format!("cannot be written: {error}")))?;
    tell!("{} frames written to {}", trajectory.frames.len(), arguments.out.display());
    if arguments.json {
        print_json(&json!({
            "schema": "retina.trajectory-summary/1",
            "out": arguments.out,
            "frames": trajectory.frames.len(),
        }))?;
    }
    Ok(())
}

fn deep_space(arguments: &Arguments, ephemeris: &Ephemeris, frames: usize) -> Result<(), Failure> {
    let wanted = DeepSpace { frames, seed: arguments.seed.unwrap_or(0), ..DeepSpace::default() };
    let (trajectory, planets) =
        wanted.generate(ephemeris).map_err(|error| InputError::new("deep-space", error.to_string()))?;
    let head = format!("# retina.trajectory/1: deep-space, seed {}", wanted.seed);
    write(&arguments.out, &format!("{head}\n{}", trajectory.to_csv()))?;
    let counts: Vec<(&str, usize)> = wanted
        .planets
        .iter()
        .map(|planet| (planet.name(), planets.iter().filter(|seen| *seen == planet).count()))
        .collect();
    let shares: Vec<String> = counts.iter().map(|(name, count)| format!("{count} {name}")).collect();
    tell!("{frames} poses, seed {}: {}", wanted.seed, shares.join(", "));
    if arguments.json {
        print_json(&json!({
            "schema": "retina.trajectory-summary/1",
            "out": arguments.out,
            "ephemeris": ephemeris.name(),
            "frames": frames,
            "seed": wanted.seed,
            "planets": counts.into_iter().map(|(name, count)| (name.to_string(), json!(count)))
                .collect::<serde_json::Map<_, _>>(),
        }))?;
    }
    Ok(())
}

fn site(arguments: &Arguments, ephemeris: &Ephemeris, frames: usize) -> Result<(), Failure> {
    let missing = |option: &str, expected: &str| {
        InputError::new(option, "is needed for a camera on the Earth").expected(expected)
    };
    let within = |option: &str, value: Option<f64>, most: f64, expected: &str| match value {
        Some(value) if value.abs() <= most => Ok(value),
        Some(value) => Err(InputError::new(option, "is out of range").found(value).expected(expected)),
        None => Err(missing(option, expected)),
    };
    let site = Site {
        latitude_rad: within("--latitude-deg", arguments.latitude_deg, 90.0, "-90 to 90 deg")?.to_radians(),
        longitude_rad: within("--longitude-deg", arguments.longitude_deg, 360.0, "-360 to 360 deg")?
            .to_radians(),
        altitude_m: within("--altitude-m", arguments.altitude_m.or(Some(0.0)), 1e5, "metres, up to 100 km")?,
    };
    let name = arguments.target.as_deref().unwrap_or("moon");
    let Some(target) = Planet::from_name(name) else {
        let names: Vec<&str> = Planet::ALL.iter().map(|planet| planet.name()).collect();
        return Err(InputError::new("--target", "is not a body with a known ephemeris")
            .found(format!("`{name}`"))
            .expected(names.join(", "))
            .into());
    };
    let Some(epoch) = &arguments.epoch else {
        return Err(missing("--epoch", "a time such as 2023-12-22T19:21:25 UTC").into());
    };
    let epoch_s = parse_epoch(epoch)
        .map_err(|error| InputError::new("--epoch", error.to_string()).found(format!("`{epoch}`")))?;
    let poses = (0..frames)
        .map(|frame| site.looking_at(ephemeris, target, epoch_s + frame as f64 * arguments.step_s))
        .collect::<Result<Vec<_>, _>>()
        .map_err(|error| InputError::new("--target", error.to_string()))?;
    let trajectory = Trajectory::new(Path::new("site"), poses);
    let head = format!("# retina.trajectory/1: {name} from a site, barycentric");
    write(&arguments.out, &format!("{head}\n{}", trajectory.to_csv()))?;
    tell!("{frames} frames from {}", format_epoch_tdb(epoch_s));
    if arguments.json {
        print_json(&json!({
            "schema": "retina.trajectory-summary/1",
            "out": arguments.out,
            "ephemeris": ephemeris.name(),
            "axes": ephemeris.axes_source("earth"),
            "frames": frames,
            "epoch_tdb_s": epoch_s,
            "step_s": arguments.step_s,
            "target": name,
        }))?;
    }
    Ok(())
}

fn lumio_halo(arguments: &Arguments, ephemeris: &Ephemeris, frames: usize) -> Result<(), Failure> {
    let default = LumioHalo::default();
    let middle_s = default.epoch_tdb_s + 0.5 * (default.frames - 1) as f64 * default.step_s;
    let halo = match &arguments.epoch {
        None => LumioHalo::centred_on(middle_s, frames, arguments.step_s),
        Some(text) => {
            let epoch_s = parse_epoch(text)
                .map_err(|error| InputError::new("--epoch", error.to_string()).found(format!("`{text}`")))?;
            let halo = LumioHalo::centred_on(epoch_s, frames, arguments.step_s);
            if arguments.centred { halo } else { LumioHalo { epoch_tdb_s: epoch_s, ..halo } }
        }
    };
    let halo = LumioHalo { jacobi: arguments.jacobi.unwrap_or(halo.jacobi), ..halo };
    let (trajectory, summary) =
        halo.generate(ephemeris).map_err(|error| InputError::new("lumio-halo", error.to_string()))?;
    let text = format!("# retina.trajectory/1: lumio-halo, {summary}\n{}", trajectory.to_csv());
    write(&arguments.out, &text)?;
    tell!("{} frames from {}: {summary}", halo.frames, format_epoch_tdb(halo.epoch_tdb_s));
    if arguments.json {
        print_json(&json!({
            "schema": "retina.trajectory-summary/1",
            "out": arguments.out,
            "ephemeris": ephemeris.name(),
            "axes": ephemeris.axes_source("moon"),
            "frames": halo.frames,
            "epoch_tdb_s": halo.epoch_tdb_s,
            "step_s": halo.step_s,
            "jacobi": summary.jacobi,
            "jacobi_drift": summary.jacobi_drift,
            "period_days": summary.period_days,
            "half_period_residual": summary.half_period_residual,
            "moved_m": summary.moved_m,
            "defect_m": summary.defects[0],
            "defect_m_s": summary.defects[1],
            "distance_m": [summary.distance_min_m, summary.distance_max_m],
            "phase_deg": [summary.phase_min_rad.to_degrees(), summary.phase_max_rad.to_degrees()],
            "lit_fraction": summary.lit_fraction,
        }))?;
    }
    Ok(())
}
