//! `retina lab calibrate radiometry`.

use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

use retina::lab::{
    BenchScreen, CommandMeter, LabError, PowerLevel, PowerMeter, PowerReadingOptions, ScreenSpec,
    open_screen, read_power,
};
use retina_campaign::PowerOptions;
use retina_files::InputError;
use retina_geometry::Setup;

use super::interrupted;
use crate::command::calibrate::radiometry::{Outputs, fit};
use crate::failure::Failure;
use crate::output::tell;
use crate::progress::{advance, counter};
use crate::setup::read_setup;

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Facility, schema retina.setup/1.
    #[arg(long)]
    setup: PathBuf,
    /// Screen: x11:DISPLAY, x11:DISPLAY@OUTPUT, folder:DIR or exec:COMMAND.
    #[arg(long, value_name = "SCREEN")]
    screen: String,
    /// Power meter at the place of the camera's pupil: exec:COMMAND, which prints a reading (in $RETINA_CHANNEL,
    /// $RETINA_DIGITAL_COUNT, $RETINA_SQUARE_PX and $RETINA_WAVELENGTH_NM it is told what is shown), or person, who
    /// types it.
    #[arg(long, value_name = "METER")]
    meter: String,
    /// Diameter of the meter's sensor, mm, if its readings are in W [default: they are in W m^-2].
    #[arg(long, value_name = "MM")]
    meter_diameter_mm: Option<f64>,
    /// Digital counts of the squares.
    #[arg(long, value_delimiter = ',', value_name = "COUNT,...")]
    counts: Vec<u8>,
    /// Sides of the squares, px.
    #[arg(long, value_delimiter = ',', value_name = "PX,...")]
    squares: Vec<u32>,
    /// Number of readings of each square.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u16).range(1..=1000))]
    readings: u16,
    /// Wait after a frame is shown, s: what the display and the meter take to follow.
    #[arg(long, default_value_t = 1.0)]
    settle_s: f64,
    /// Folder for power.csv, calibration.toml and radiometry.html. An interrupted run there is gone on with.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Print a JSON document on standard output.
    #[arg(long)]
    json: bool,
}

/// A person who reads the meter and types.
struct Person<'a>(&'a dyn Fn() -> bool);

impl PowerMeter for Person<'_> {
    fn read(&mut self, level: &PowerLevel, _: &Setup) -> Result<f64, LabError> {
        let what = format!(
            "channel {}, count {}, a square of {} px",
            level.channel.letter(),
            level.digital_count,
            level.square_px
        );
        loop {
            tell!("{what}: type the meter's reading, and press Enter");
            let mut line = String::new();
            let read = std::io::stdin().read_line(&mut line);
            if (self.0)() {
                return Err(LabError::Interrupted);
            }
            if !matches!(read, Ok(size) if size > 0) {
                return Err(LabError::Unattended { what: format!("the meter's reading at {what}") });
            }
            match line.trim().parse::<f64>() {
                Ok(value) if value.is_finite() => return Ok(value),
                _ => tell!("`{}` is no number; such as 3.2e-6", line.trim()),
            }
        }
    }
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let spec: ScreenSpec = arguments.screen.parse()?;
    let wrong = |flag: &str, found: String, expected: &str| {
        Failure::from(InputError::new(Path::new(flag), "does not fit").found(found).expected(expected))
    };
    if spec == ScreenSpec::Bench {
        let expected = "a screen that a meter can stand before; `retina simulate power` has the virtual bench's readings";
        return Err(wrong("--screen", "bench".into(), expected));
    }
    if !(0.0..=600.0).contains(&arguments.settle_s) {
        return Err(wrong("--settle-s", arguments.settle_s.to_string(), "0 to 600"));
    }
    let w_m2_per_unit = match arguments.meter_diameter_mm {
        None => 1.0,
        Some(mm) if mm > 0.0 && mm <= 1000.0 => 4.0 / (std::f64::consts::PI * (1e-3 * mm).powi(2)),
        Some(mm) => return Err(wrong("--meter-diameter-mm", mm.to_string(), "more than 0, at most 1000")),
    };
    let setup = read_setup(&arguments.setup)?;
    let usual = PowerOptions::default();
    let mut counts = if arguments.counts.is_empty() { usual.counts } else { arguments.counts.clone() };
    let most_count = setup.screen.limits.most_count;
    if arguments.counts.is_empty() {
        counts.retain(|&count| count <= most_count);
    } else if let Some(count) = counts.iter().find(|count| **count > most_count) {
        let expected = format!("up to {most_count}, the setup's `screen.limits.most_count`");
        return Err(wrong("--counts", count.to_string(), &expected));
    }
    let squares = if arguments.squares.is_empty() { usual.squares_px } else { arguments.squares.clone() };
    let squares: Vec<u32> = squares.into_iter().filter(|side| *side > 0).collect();
    let most_px = setup.screen.width_px.min(setup.screen.height_px);
    if let Some(side) = squares.iter().find(|side| **side > most_px) {
        return Err(wrong("--squares", format!("{side} px"), &format!("up to the screen's {most_px} px")));
    }
    let stop = interrupted()?;
    let stop = || stop.load(Ordering::Acquire);
    let mut meter: Box<dyn PowerMeter> = match arguments.meter.split_once(':') {
        None if arguments.meter == "person" => Box::new(Person(&stop)),
        Some(("exec", command)) if !command.trim().is_empty() => Box::new(CommandMeter(command.into())),
        _ => return Err(wrong("--meter", format!("`{}`", arguments.meter), "exec:COMMAND or person")),
    };
    std::fs::create_dir_all(&arguments.out)
        .map_err(|error| InputError::new(&arguments.out, format!("cannot be written: {error}")))?;
    let size_px = [setup.screen.width_px, setup.screen.height_px];
    let mut screen = open_screen(&spec, &setup, None, &BenchScreen::new(size_px))?;
    for remark in screen.remarks() {
        tell!("warning: screen {}: {remark}", arguments.screen);
    }
    let options = PowerReadingOptions {
        levels: PowerLevel::campaign(&counts, &squares),
        readings: arguments.readings.into(),
        settle_s: arguments.settle_s,
        w_m2_per_unit,
    };
    let bar = counter(0, "readings");
    let file = arguments.out.join("power.csv");
    let table = read_power(&setup, screen.as_mut(), meter.as_mut(), &options, &file, &stop, |done, of| {
        advance(&bar, done, of);
    });
    bar.finish_and_clear();
    let table = table?;
    drop(screen);
    let (calibration, report) =
        (arguments.out.join("calibration.toml"), arguments.out.join("radiometry.html"));
    let outputs =
        Outputs { out: Some(&calibration), report: Some(&report), figures: None, json: arguments.json };
    fit(&setup, &table, None, &outputs)
}
