//! `retina lab measure`.

use std::path::{Path, PathBuf};

use retina::decision::Rounds;
use retina::lab::{Condition, LabError, Rig, Screw, Turns, measure_round};
use retina_files::InputError;
use retina_geometry::Setup;
use serde_json::json;

use super::{DeviceArguments, Turner, wait_for_enter};
use crate::failure::Failure;
use crate::output::{print_json, tell};
use crate::progress::{advance, counter};

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// A round of `retina decide`, or the folder of its rounds: the first that is not measured.
    #[arg(value_name = "ROUND_DIR")]
    round: PathBuf,
    #[command(flatten)]
    devices: DeviceArguments,
    /// Who rolls and mounts the camera and sets the temperature: `person` (the command waits for Enter) or `camera` (a
    /// virtual bench rolls its own camera; its temperature stays as it is).
    #[arg(long, value_enum, default_value_t)]
    turn: Turner,
    /// Roll at which the camera stands now, deg.
    #[arg(long, default_value_t = 0.0, allow_hyphen_values = true, value_name = "DEG")]
    roll_deg: f64,
    /// Take the exposures one after another, instead of when the plan says.
    #[arg(long)]
    no_wait: bool,
    /// Print a JSON document on standard output.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let mut devices = arguments.devices.open()?;
    let round = round(&arguments.round, &devices.setup)?;
    let bar = counter(0, "exposures");
    let mut roll_deg = arguments.roll_deg;
    let mut arrange = |rig: &mut Rig<'_>, condition: Condition| {
        bar.suspend(|| arrange(arguments.turn, rig, condition, &mut roll_deg))
    };
    let table = devices.with(|setup, rig| {
        let progress = |done, of| advance(&bar, done, of);
        measure_round(setup, rig, &round, !arguments.no_wait, &mut arrange, progress)
    });
    bar.finish_and_clear();
    let table = table?;
    let points = round.join("points.csv");
    tell!("{}: {} points of {} images", points.display(), table.rows.len(), table.images.len());
    if arguments.json {
        print_json(&json!({
            "schema": "retina.lab-measure/1",
            "points": points,
            "rows": table.rows.len(),
            "images": table.images.len(),
        }))?;
    }
    Ok(())
}

/// The round that is meant.
fn round(folder: &Path, setup: &Setup) -> Result<PathBuf, Failure> {
    if folder.join("plan.csv").is_file() || !folder.join("round_01").is_dir() {
        return Ok(folder.to_path_buf());
    }
    match Rounds::new(folder)?.measured(setup)? {
        (_, Some(round)) => Ok(round.folder),
        (measured, None) => Err(InputError::new(folder, "no round is left to be measured")
            .found(format!("{} measured rounds", measured.len()))
            .help("`retina decide` with the same --out plans the next")
            .into()),
    }
}

/// Sets a condition, or has it set.
fn arrange(
    turn: Turner,
    rig: &mut Rig<'_>,
    condition: Condition,
    roll_deg: &mut f64,
) -> Result<(), LabError> {
    let words = match condition {
        Condition::Wait(left_s) => {
            tell!("the next exposure is due in {left_s:.0} s");
            return Ok(());
        }
        Condition::Roll { to_deg, .. } => {
            let by_deg = to_deg - *roll_deg;
            *roll_deg = to_deg;
            if by_deg == 0.0 {
                return Ok(());
            }
            if turn == Turner::Camera {
                let mut turns = Turns::default();
                turns.set(Screw::CameraRoll, by_deg);
                return rig.camera.turn(&turns);
            }
            format!("roll the camera to {to_deg:+} deg (by {by_deg:+} deg, {})", Screw::CameraRoll.meaning())
        }
        Condition::Mounting(number) => {
            format!("take the camera out and mount it anew, for the {number}. time")
        }
        Condition::Temperature(wanted_c) => format!("bring the bench to {wanted_c} degC, and let it settle"),
    };
    if turn == Turner::Camera {
        tell!("a virtual bench cannot do this: {words}. It is recorded as it is");
        return Ok(());
    }
    wait_for_enter(&words, rig.stop)
}
