//! `retina lab monitor`.

use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use retina::lab::{Monitor, MonitorOptions, MonitorReading};
use retina_files::InputError;
use retina_formats::Calibration;
use serde_json::{Value, json};

use super::{DeviceArguments, Devices};
use crate::failure::Failure;
use crate::output::{print_json_line, tell};

#[derive(clap::Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    devices: DeviceArguments,
    #[command(flatten)]
    limits: Limits,
    /// Time from round to round, s.
    #[arg(long, default_value_t = 60.0, value_name = "S")]
    every_s: f64,
    /// Number of rounds [default: until Ctrl-C].
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..))]
    rounds: Option<u32>,
    /// Folder for monitor.csv, monitor.svg and reference.csv. An earlier run there is gone on with.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Print a JSON document for each round, one a line, on standard output.
    #[arg(long)]
    json: bool,
}

/// What is held to, and how much may change.
#[derive(clap::Args)]
pub(super) struct Limits {
    /// Calibration whose validity is watched [default: changes since the first round are].
    #[arg(long, value_name = "FILE.toml")]
    calibration: Option<PathBuf>,
    /// Alarm where the RMS error of the reference points is larger.
    #[arg(long, default_value_t = 10.0, value_name = "ARCSEC")]
    within_arcsec: f64,
    /// Alarm where their light has changed by a larger part.
    #[arg(long, default_value_t = 0.05, value_name = "PART")]
    within_light: f64,
    /// Alarm where their width has changed by a larger part.
    #[arg(long, default_value_t = 0.2, value_name = "PART")]
    within_width: f64,
}

impl Limits {
    pub(super) fn open(&self, devices: &Devices, folder: &Path) -> Result<Monitor, Failure> {
        for (flag, value) in [
            ("--within-arcsec", self.within_arcsec),
            ("--within-light", self.within_light),
            ("--within-width", self.within_width),
        ] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(InputError::new(Path::new(flag), "is not a positive number").found(value).into());
            }
        }
        let setup = &devices.setup;
        let calibration = self.calibration.as_ref().map(|path| Calibration::read(path, setup)).transpose()?;
        let options = MonitorOptions {
            within_arcsec: self.within_arcsec,
            within_light: self.within_light,
            within_width: self.within_width,
            ..MonitorOptions::default()
        };
        Ok(Monitor::open(setup, calibration, options, folder)?)
    }
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    if !(arguments.every_s >= 0.0 && arguments.every_s <= 86_400.0) {
        return Err(InputError::new(Path::new("--every-s"), "is out of range")
            .found(arguments.every_s)
            .expected("0 to 86400")
            .into());
    }
    let mut devices = arguments.devices.open()?;
    let mut monitor = arguments.limits.open(&devices, &arguments.out)?;
    let mut alarmed = 0u32;
    let mut round = 0;
    while arguments.rounds.is_none_or(|rounds| round < rounds) {
        let due = Instant::now() + Duration::from_secs_f64(arguments.every_s);
        let reading = match devices.with(|_, rig| monitor.round(rig)) {
            Err(retina::lab::LabError::Interrupted) => break,
            reading => reading?,
        };
        round += 1;
        alarmed += u32::from(!reading.alarms.is_empty());
        show(monitor.readings().len(), &reading);
        if arguments.json {
            print_json_line(&to_json(&reading))?;
        }
        while arguments.rounds.is_none_or(|rounds| round < rounds)
            && Instant::now() < due
            && !devices.stop.load(Ordering::Acquire)
        {
            std::thread::sleep(Duration::from_millis(50).min(due.saturating_duration_since(Instant::now())));
        }
        if devices.stop.load(Ordering::Acquire) {
            break;
        }
    }
    if alarmed > 0 {
        return Err(Failure::exceeded(format!("an alarm in {alarmed} of {round} rounds")));
    }
    Ok(())
}

pub(super) fn show(round: usize, reading: &MonitorReading) {
    let [x, y] = reading.boresight_arcsec;
    tell!(
        "round {round}: {} points, {:.2} arcsec RMS, shift {x:+.2}, {y:+.2} arcsec, roll {:+.1} arcsec, light {:+.2} %, \
         spots of {:.2} px",
        reading.points,
        reading.rms_arcsec,
        reading.roll_arcsec,
        100.0 * (reading.light - 1.0),
        reading.width_px
    );
    for alarm in &reading.alarms {
        tell!("alarm: {alarm}");
    }
}

fn to_json(reading: &MonitorReading) -> Value {
    json!({
        "schema": "retina.lab-monitor/1",
        "unix_s": reading.unix_s,
        "temperature_c": reading.temperature_c,
        "points": reading.points,
        "boresight_arcsec": reading.boresight_arcsec,
        "roll_arcsec": reading.roll_arcsec,
        "scale_ppm": reading.scale_ppm,
        "rms_arcsec": reading.rms_arcsec,
        "left_arcsec": reading.left_arcsec,
        "width_px": reading.width_px,
        "light": reading.light,
        "alarms": reading.alarms,
    })
}
