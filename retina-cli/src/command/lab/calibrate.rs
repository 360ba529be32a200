//! `retina lab calibrate`.

use std::path::PathBuf;

use retina::lab::{LabCalibration, Step, calibrate_geometry};
use retina_calibration::geometry::{PatternOptions, text_summary, to_json};
use serde_json::json;

use super::DeviceArguments;
use crate::failure::Failure;
use crate::output::{print_json, print_lines, tell};
use crate::progress::{advance, counter};

/// Calibrates the facility in one piece.
#[derive(clap::Subcommand)]
pub(crate) enum Command {
    /// Calibrates the mapping between lines of sight and the screen, and checks it on fresh points.
    Geometry(Arguments),
    /// Calibrates the response: shows squares, reads a power meter at the camera's place, and fits.
    Radiometry(super::radiometry::Arguments),
}

#[derive(clap::Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    devices: DeviceArguments,
    /// Number of points on each screen.
    #[arg(long, default_value_t = 400)]
    points: usize,
    /// Number of screens [default: six for each group of counts that one exposure can hold].
    #[arg(long)]
    screens: Option<usize>,
    /// Number of screens of fresh points.
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u16).range(1..=999))]
    check_screens: u16,
    /// Folder for calibration.toml and everything it was made from.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Exit with code 1 if the RMS error of the fresh points is larger.
    #[arg(long, value_name = "ARCSEC")]
    within_arcsec: Option<f64>,
    /// Print a JSON document on standard output.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(command: &Command) -> Result<(), Failure> {
    match command {
        Command::Geometry(arguments) => geometry(arguments),
        Command::Radiometry(arguments) => super::radiometry::run(arguments),
    }
}

fn geometry(arguments: &Arguments) -> Result<(), Failure> {
    let mut devices = arguments.devices.open()?;
    let options = LabCalibration {
        pattern: PatternOptions {
            points: arguments.points,
            screens: arguments.screens,
            ..PatternOptions::default()
        },
        capture: devices.capture.clone(),
        check_screens: arguments.check_screens.into(),
    };
    let bar = counter(0, "images");
    let done = devices.with(|setup, rig| {
        calibrate_geometry(setup, rig, &options, &arguments.out, |step| match step {
            Step::Pattern(done, of) | Step::Check(done, of) => advance(&bar, done, of),
            Step::Fit => bar.suspend(|| tell!("fitting")),
        })
    });
    bar.finish_and_clear();
    let done = done?;
    let (rms, most) = (done.fresh_rms_arcsec(), done.fresh_quantile_arcsec(0.96));
    if arguments.json {
        let mut document = to_json(&done.fit, &devices.setup);
        document["out"] = json!(done.file);
        document["fresh"] =
            json!({"points": done.fresh_arcsec.len(), "rms_arcsec": rms, "within_96_percent_arcsec": most});
        print_json(&document)?;
    } else {
        let mut lines: Vec<String> =
            text_summary(&done.fit, &devices.setup).lines().map(str::to_owned).collect();
        lines.push(format!(
            "fresh points: {} with an RMS error of {rms:.2} arcsec, 96 % within {most:.2} arcsec",
            done.fresh_arcsec.len()
        ));
        lines.push(format!("written: {}", done.file.display()));
        print_lines(&lines)?;
    }
    match arguments.within_arcsec {
        Some(limit) if rms.is_nan() || rms > limit => Err(Failure::exceeded(format!(
            "the fresh points' RMS error is {rms:.2} arcsec, not within {limit}"
        ))),
        _ => Ok(()),
    }
}
