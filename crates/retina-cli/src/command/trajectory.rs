//! `retina trajectory`.

use std::path::{Path, PathBuf};

use retina_files::{InputError, write_atomic};
use retina_sky::deep_space::DeepSpace;
use retina_sky::halo::LumioHalo;
use retina_sky::time::{format_epoch_tdb, parse_epoch};
use serde_json::json;

use crate::failure::Failure;
use crate::output::{print_json, tell};

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Which trajectory.
    #[arg(long, value_enum, default_value_t)]
    kind: Kind,
    /// Time of the first frame, for example 2027-07-26T00:00 UTC; by default the sequence is
    /// centred on the new Moon of 2027 August 2.
    #[arg(long)]
    epoch: Option<String>,
    /// The epoch is that of the middle of the sequence.
    #[arg(long, requires = "epoch")]
    centred: bool,
    /// Number of frames; by default 4321 of the halo, 5000 deep-space poses.
    #[arg(long)]
    frames: Option<usize>,
    /// Time between frames of the halo, s.
    #[arg(long, default_value_t = LumioHalo::default().step_s, allow_negative_numbers = true)]
    step_s: f64,
    /// Jacobi constant of the halo orbit, 3.016 to 3.152.
    #[arg(long)]
    jacobi: Option<f64>,
    /// Seed of the deep-space poses.
    #[arg(long)]
    seed: Option<u64>,
    /// The table to write.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Print the summary as a JSON document on standard output.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, Default, clap::ValueEnum)]
enum Kind {
    /// A quasi-halo about the Earth-Moon L2 point, camera pointed at the Moon.
    #[default]
    LumioHalo,
    /// Random poses between 0.7 and 5.2 au, a planet in the wide configuration's field.
    DeepSpace,
}

pub(crate) fn run(arguments: Arguments) -> Result<(), Failure> {
    crate::check_file(&arguments.out, "csv")?;
    let (wanted, foreign) = match arguments.kind {
        Kind::LumioHalo => (LumioHalo::default().frames, arguments.seed.map(|_| "--seed")),
        Kind::DeepSpace => {
            let epoch = arguments.epoch.as_ref().map(|_| "--epoch");
            (DeepSpace::default().frames, epoch.or(arguments.jacobi.map(|_| "--jacobi")))
        }
    };
    if let Some(option) = foreign {
        return Err(InputError::new(option, "has no meaning for this kind of trajectory")
            .help("leave the option out, or give another --kind")
            .into());
    }
    let frames = arguments.frames.unwrap_or(wanted);
    if !(1..=1_000_000).contains(&frames) {
        return Err(InputError::new("--frames", "the number of frames does not fit")
            .found(frames)
            .expected("1 to 1000000")
            .into());
    }
    match arguments.kind {
        Kind::LumioHalo => lumio_halo(&arguments, frames),
        Kind::DeepSpace => deep_space(&arguments, frames),
    }
}

fn write(out: &Path, text: &str) -> Result<(), Failure> {
    write_atomic(out, text.as_bytes())
        .map_err(|error| Failure::new(format!("{} cannot be written: {error}", out.display())))
}

fn deep_space(arguments: &Arguments, frames: usize) -> Result<(), Failure> {
    let wanted = DeepSpace { frames, seed: arguments.seed.unwrap_or(0), ..DeepSpace::default() };
    let (trajectory, planets) =
        wanted.generate().map_err(|error| InputError::new("deep-space", error.to_string()))?;
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
            "frames": frames,
            "seed": wanted.seed,
            "planets": counts.into_iter().map(|(name, count)| (name.to_string(), json!(count)))
                .collect::<serde_json::Map<_, _>>(),
        }))?;
    }
    Ok(())
}

fn lumio_halo(arguments: &Arguments, frames: usize) -> Result<(), Failure> {
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
        halo.generate().map_err(|error| InputError::new("lumio-halo", error.to_string()))?;
    let text = format!("# retina.trajectory/1: lumio-halo, {summary}\n{}", trajectory.to_csv());
    write(&arguments.out, &text)?;
    tell!("{} frames from {}: {summary}", halo.frames, format_epoch_tdb(halo.epoch_tdb_s));
    if arguments.json {
        print_json(&json!({
            "schema": "retina.trajectory-summary/1",
            "out": arguments.out,
            "frames": halo.frames,
            "epoch_tdb_s": halo.epoch_tdb_s,
            "step_s": halo.step_s,
            "jacobi": summary.jacobi,
            "jacobi_drift": summary.jacobi_drift,
            "period_days": summary.period_days,
            "half_period_residual": summary.half_period_residual,
            "distance_m": [summary.distance_min_m, summary.distance_max_m],
            "phase_deg": [summary.phase_min_rad.to_degrees(), summary.phase_max_rad.to_degrees()],
            "lit_fraction": summary.lit_fraction,
        }))?;
    }
    Ok(())
}
