//! `retina trajectory`.

use std::path::PathBuf;

use retina_files::{InputError, write_atomic};
use retina_sky::halo::LumioHalo;
use retina_sky::time::{format_epoch_tdb, parse_epoch};
use serde_json::json;

use crate::failure::Failure;

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
    /// Number of frames.
    #[arg(long, default_value_t = LumioHalo::default().frames)]
    frames: usize,
    /// Time between frames, s.
    #[arg(long, default_value_t = LumioHalo::default().step_s)]
    step_s: f64,
    /// Jacobi constant of the halo orbit, 3.016 to 3.152.
    #[arg(long)]
    jacobi: Option<f64>,
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
}

pub(crate) fn run(arguments: Arguments) -> Result<(), Failure> {
    crate::check_target(&arguments.out, "csv")?;
    let Kind::LumioHalo = arguments.kind;
    if !(1..=1_000_000).contains(&arguments.frames) {
        return Err(InputError::new("--frames", "the number of frames does not fit")
            .found(arguments.frames)
            .expected("1 to 1000000")
            .into());
    }
    let default = LumioHalo::default();
    let middle_s = default.epoch_tdb_s + 0.5 * (default.frames - 1) as f64 * default.step_s;
    let halo = match &arguments.epoch {
        None => LumioHalo::centred_on(middle_s, arguments.frames, arguments.step_s),
        Some(text) => {
            let epoch_s = parse_epoch(text)
                .map_err(|error| InputError::new("--epoch", error.to_string()).found(format!("`{text}`")))?;
            let halo = LumioHalo::centred_on(epoch_s, arguments.frames, arguments.step_s);
            if arguments.centred { halo } else { LumioHalo { epoch_tdb_s: epoch_s, ..halo } }
        }
    };
    let halo = LumioHalo { jacobi: arguments.jacobi.unwrap_or(halo.jacobi), ..halo };
    let (trajectory, summary) =
        halo.generate().map_err(|error| InputError::new("lumio-halo", error.to_string()))?;
    let text = format!("# retina.trajectory/1: lumio-halo, {summary}\n{}", trajectory.to_csv());
    write_atomic(&arguments.out, text.as_bytes())
        .map_err(|error| Failure::new(format!("{} cannot be written: {error}", arguments.out.display())))?;
    eprintln!("retina: {} frames from {}: {summary}", halo.frames, format_epoch_tdb(halo.epoch_tdb_s));
    if arguments.json {
        crate::print_json(&json!({
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
        }));
    }
    Ok(())
}
