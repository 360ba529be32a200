//! Power readings: squares of the screen, one after another, in front of a power meter.

use std::ffi::OsStr;
use std::fmt::Write as _;
use std::fs::OpenOptions;
use std::io::Write as _;
use std::path::Path;
use std::time::Duration;

use retina_bench::ScreenImage;
use retina_files::{InputError, write_atomic};
use retina_formats::{Channel, PowerTable};
use retina_geometry::Setup;

use crate::capture::unix_s;
use crate::latency::square;
use crate::run_command::answer_of;
use crate::{LabError, Screen};

/// What is shown for a reading.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PowerLevel {
    /// Lit sub-pixels.
    pub channel: Channel,
    /// Digital count of the square.
    pub digital_count: u8,
    /// Its side, screen px; 0 is a dark reading.
    pub square_px: u32,
}

impl PowerLevel {
    /// All levels of a campaign: each square in each channel at each count, dark readings in between.
    pub fn campaign(counts: &[u8], squares_px: &[u32]) -> Vec<Self> {
        let mut levels = Vec::new();
        for &square_px in squares_px {
            for channel in Channel::ALL {
                levels.push(Self { channel, digital_count: 0, square_px: 0 });
                levels.extend(counts.iter().map(|&digital_count| Self { channel, digital_count, square_px }));
            }
        }
        levels
    }

    /// Its screen image.
    pub fn image(&self, [width_px, height_px]: [u32; 2]) -> ScreenImage {
        let mut image = square([width_px, height_px], self.square_px, self.digital_count);
        if let Some(lit) = Channel::COLOURS.iter().position(|colour| *colour == self.channel) {
            for counts in &mut image.counts {
                *counts = std::array::from_fn(|k| if k == lit { counts[k] } else { 0 });
            }
        }
        image
    }
}

/// A power meter at the place of the camera's pupil.
pub trait PowerMeter {
    /// Reads it while a level is shown, in its own unit.
    ///
    /// # Errors
    /// It does not answer, or not with a number.
    fn read(&mut self, level: &PowerLevel, setup: &Setup) -> Result<f64, LabError>;
}

/// A command that prints a reading. It is told what is shown: `$RETINA_CHANNEL`, `$RETINA_DIGITAL_COUNT`,
/// `$RETINA_SQUARE_PX`, and `$RETINA_WAVELENGTH_NM` for the meter's setting (of green for white).
pub struct CommandMeter(pub String);

impl PowerMeter for CommandMeter {
    fn read(&mut self, level: &PowerLevel, setup: &Setup) -> Result<f64, LabError> {
        let wavelengths = &setup.screen.wavelength_nm;
        let wavelength_nm = match level.channel {
            Channel::R => wavelengths.r,
            Channel::B => wavelengths.b,
            Channel::G | Channel::W => wavelengths.g,
        };
        let [count, side] = [u32::from(level.digital_count), level.square_px].map(|value| value.to_string());
        let wavelength = wavelength_nm.to_string();
        let answer = answer_of(
            &self.0,
            &[
                ("RETINA_CHANNEL", OsStr::new(level.channel.letter())),
                ("RETINA_DIGITAL_COUNT", OsStr::new(&count)),
                ("RETINA_SQUARE_PX", OsStr::new(&side)),
                ("RETINA_WAVELENGTH_NM", OsStr::new(&wavelength)),
            ],
        )?;
        let value = answer.trim().parse::<f64>().ok().filter(|value| value.is_finite());
        value.ok_or_else(|| LabError::Command {
            command: self.0.clone(),
            problem: format!("printed `{}`, not a number", answer.trim()),
        })
    }
}

/// How a campaign is read.
#[derive(Debug, Clone, PartialEq)]
pub struct PowerReadingOptions {
    /// Levels, in their order.
    pub levels: Vec<PowerLevel>,
    /// Readings of each.
    pub readings: usize,
    /// Wait after a frame is shown, s.
    pub settle_s: f64,
    /// W m^-2 in one unit of the meter: 1, or 1 over the area of its sensor where it reads W.
    pub w_m2_per_unit: f64,
}

const HEAD: &str = "channel,digital_count,square_px,irradiance_w_m2,time_s,unix_s";

/// Shows each level and reads the meter: a line a reading in the table `out`. Readings that an interrupted run left are
/// kept. The screen is dark at the end.
///
/// # Errors
/// A device fails, `stop` says so, or the table is of other levels.
pub fn read_power(
    setup: &Setup,
    screen: &mut dyn Screen,
    meter: &mut dyn PowerMeter,
    options: &PowerReadingOptions,
    out: &Path,
    stop: &dyn Fn() -> bool,
    mut progress: impl FnMut(usize, usize),
) -> Result<PowerTable, LabError> {
    let failed = |error: std::io::Error| -> LabError {
        InputError::new(out, format!("cannot be written: {error}")).into()
    };
    let total = options.levels.len() * options.readings;
    let level_of = |reading: usize| options.levels[reading / options.readings];
    let (mut done, mut first_s) = there(out, total, level_of)?;
    let size_px = [setup.screen.width_px, setup.screen.height_px];
    let mut shown = None;
    while done < total {
        progress(done, total);
        if stop() {
            return Err(LabError::Interrupted);
        }
        let level = level_of(done);
        if shown != Some(level) {
            screen.show(&level.image(size_px))?;
            std::thread::sleep(Duration::from_secs_f64(options.settle_s));
            shown = Some(level);
        }
        let at_s = unix_s();
        if screen.hold(0.0)? {
            std::thread::sleep(Duration::from_secs_f64(options.settle_s));
        }
        let value = meter.read(&level, setup)? * options.w_m2_per_unit;
        if !screen.is_shown() {
            return Err(LabError::Display {
                display: "under the meter".into(),
                problem: "went dark before the reading was there (`screen.limits.longest_s`). The reading is not used. \
                          Start the same command again to go on, or raise the limit"
                    .into(),
            });
        }
        let first_s = *first_s.get_or_insert(at_s);
        let mut line = if done == 0 { format!("{HEAD}\n") } else { String::new() };
        let _ = writeln!(
            line,
            "{},{},{},{value:e},{:.3},{at_s:.3}",
            level.channel.letter(),
            level.digital_count,
            level.square_px,
            at_s - first_s
        );
        let mut file = OpenOptions::new().create(true).append(true).open(out).map_err(failed)?;
        file.write_all(line.as_bytes()).and_then(|()| file.sync_data()).map_err(failed)?;
        done += 1;
    }
    screen.show(&ScreenImage::dark(size_px[0], size_px[1]))?;
    Ok(PowerTable::read(&[out.to_path_buf()])?)
}

/// How many readings an earlier run left, and when its first was.
fn there(
    out: &Path,
    total: usize,
    level_of: impl Fn(usize) -> PowerLevel,
) -> Result<(usize, Option<f64>), LabError> {
    if !out.exists() {
        return Ok((0, None));
    }
    let text = retina_files::read_text(out)?;
    // A line that a killed run did not finish.
    let whole = &text[..text.rfind('\n').map_or(0, |end| end + 1)];
    if whole.len() < text.len() {
        write_atomic(out, whole.as_bytes())
            .map_err(|error| InputError::new(out, format!("cannot be written: {error}")))?;
    }
    if whole.lines().count() < 2 {
        std::fs::remove_file(out)
            .map_err(|error| InputError::new(out, format!("cannot be written: {error}")))?;
        return Ok((0, None));
    }
    let table = retina_files::Table::parse(out, whole)?;
    for row in 0..table.len() {
        let fits = row < total && {
            let level = level_of(row);
            table.text(row, "channel") == level.channel.letter()
                && table.number(row, "digital_count")? == f64::from(level.digital_count)
                && table.number(row, "square_px")? == f64::from(level.square_px)
        };
        if !fits {
            return Err(InputError::new(out, "holds readings of another campaign")
                .help("give --out another folder, or the counts and squares that it began with")
                .into());
        }
    }
    Ok((table.len(), Some(table.number(0, "unix_s")?)))
}
