//! `retina lab align`.

use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

use retina::lab::{AlignOptions, Aligner, Alignment, Estimate, Screw, Turns};
use retina_files::InputError;
use serde_json::{Value, json};

use super::{DeviceArguments, Devices, Turner, wait_for_enter};
use crate::failure::Failure;
use crate::output::{print_json, tell};
use crate::progress::{advance, counter};

#[derive(clap::Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    devices: DeviceArguments,
    /// Who turns the screws: `person` (the command waits for Enter after each round) or `camera` (a virtual bench turns
    /// its own).
    #[arg(long, value_enum, default_value_t)]
    turn: Turner,
    /// Most rounds.
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u16).range(1..=100))]
    rounds: u16,
    /// The bench is aligned when no angle is larger, deg.
    #[arg(long, default_value_t = 0.02)]
    within_deg: f64,
    /// ... and no length, mm.
    #[arg(long, default_value_t = 0.02)]
    within_mm: f64,
    /// Number of exposures of a round.
    #[arg(long, default_value_t = 12, value_parser = clap::value_parser!(u16).range(1..=1000))]
    exposures: u16,
    /// Find out where the relay's lenses stand, too. Their mounts are taken to hold them within 0.05 mm and 0.05 deg.
    #[arg(long)]
    relay: bool,
    /// Folder for the pattern and the spots of each round.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Print a JSON document on standard output.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    for (flag, value) in [("--within-deg", arguments.within_deg), ("--within-mm", arguments.within_mm)] {
        if !(value > 0.0 && value.is_finite()) {
            return Err(InputError::new(Path::new(flag), "is not a positive number").found(value).into());
        }
    }
    let mut devices = arguments.devices.open()?;
    let options = AlignOptions {
        exposures: arguments.exposures.into(),
        first_exposure_s: devices.capture.exposures_s.first().copied().unwrap_or(0.01),
        relay: arguments.relay,
        ..AlignOptions::default()
    };
    let mut aligner = Aligner::new(&devices.setup, options, &arguments.out)?;
    let mut turned = Turns::default();
    let mut rounds = Vec::new();
    let mut aligned = false;
    let mut last_unknown = Vec::new();
    for round in 1..=arguments.rounds {
        let found = measure(&mut aligner, &mut devices, &turned, arguments)?;
        aligned =
            turned_ones(&found).all(|(screw, estimate)| estimate.value.abs() <= limit(*screw, arguments));
        show(round, &found, arguments);
        rounds.push(to_json(&found));
        last_unknown = unknown(&found, arguments);
        if aligned || round == arguments.rounds {
            break;
        }
        turned = found.turn;
        if arguments.turn == Turner::Camera {
            devices.camera.turn(&turned)?;
        } else {
            wait_for_enter("turn the screws as said", &|| devices.stop.load(Ordering::Acquire))?;
        }
    }
    if arguments.json {
        print_json(&json!({
            "schema": "retina.lab-align/1", "aligned": aligned, "uncertain": last_unknown, "rounds": rounds,
        }))?;
    }
    if !last_unknown.is_empty() {
        tell!("the spots do not tell whether these are within the limits: {}", last_unknown.join(", "));
    }
    if aligned {
        tell!("aligned within {} deg and {} mm", arguments.within_deg, arguments.within_mm);
        return Ok(());
    }
    Err(Failure::exceeded(format!("not aligned after {} rounds", rounds.len())))
}

fn measure(
    aligner: &mut Aligner,
    devices: &mut Devices,
    turned: &Turns,
    arguments: &Arguments,
) -> Result<Alignment, Failure> {
    let bar = counter(0, "exposures");
    let found =
        devices.with(|_, rig| aligner.round(rig, turned, &arguments.out, |done, of| advance(&bar, done, of)));
    bar.finish_and_clear();
    Ok(found?)
}

/// The screws that are turned: the others stand where the lenses were built in.
fn turned_ones(found: &Alignment) -> impl Iterator<Item = (&Screw, &Estimate)> {
    found.screws.iter().filter(|(screw, _)| !screw.is_built_in())
}

/// Screws of which the images do not tell whether they are within the limits.
fn unknown(found: &Alignment, arguments: &Arguments) -> Vec<String> {
    turned_ones(found)
        .filter(|(screw, estimate)| estimate.sigma > limit(**screw, arguments))
        .map(|(screw, estimate)| format!("{} to {:.2} {}", screw.name(), estimate.sigma, screw.unit()))
        .collect()
}

fn limit(screw: Screw, arguments: &Arguments) -> f64 {
    if screw.unit() == "mm" { arguments.within_mm } else { arguments.within_deg }
}

fn show(round: u16, found: &Alignment, arguments: &Arguments) {
    tell!(
        "round {round}: {} points, spots of {:.2} px, {:.3} px from the model",
        found.points,
        found.width_px,
        found.rms_px
    );
    for (screw, estimate) in &found.screws {
        let (unit, name) = (screw.unit(), screw.name());
        let turn = if screw.is_built_in() {
            "built in".to_owned()
        } else if estimate.value.abs() <= limit(*screw, arguments) {
            "good".to_owned()
        } else {
            format!("turn by {:+.3} {unit} ({} where positive)", found.turn.get(*screw), screw.meaning())
        };
        tell!("  {name:<16} {:+.3} +- {:.3} {unit:<3}  {turn}", estimate.value, estimate.sigma);
    }
}

fn to_json(found: &Alignment) -> Value {
    let screws: serde_json::Map<String, Value> = found
        .screws
        .iter()
        .map(|(screw, estimate)| {
            let value = json!({
                "value": estimate.value,
                "sigma": estimate.sigma,
                "turn": found.turn.get(*screw),
                "unit": screw.unit(),
            });
            (screw.name(), value)
        })
        .collect();
    json!({
        "screws": screws,
        "points": found.points,
        "width_px": found.width_px,
        "rms_px": found.rms_px,
    })
}
