//! `power.csv`: readings of a power meter at the camera's pupil, and what is refused among them.

use std::path::{Path, PathBuf};

use retina_files::{InputError, Table, hash_file};

/// A colour channel of the display.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Channel {
    /// Red.
    Red,
    /// Green.
    Green,
    /// Blue.
    Blue,
}

impl Channel {
    /// Red, green, blue.
    pub const ALL: [Self; 3] = [Self::Red, Self::Green, Self::Blue];

    /// As files name it.
    pub fn letter(self) -> &'static str {
        ["r", "g", "b"][self as usize]
    }

    /// As people name it.
    pub fn name(self) -> &'static str {
        ["red", "green", "blue"][self as usize]
    }
}

/// A reading: an N x N square of pixels at one count, or none lit.
#[derive(Debug, Clone, PartialEq)]
pub struct Reading {
    /// Digital count B of the square.
    pub count: usize,
    /// N; 0 for a dark reading.
    pub square_px: f64,
    /// What the meter says, W m^-2 at the camera's pupil.
    pub irradiance_w_m2: f64,
    /// Its standard deviation, where the table states one.
    pub sigma_w_m2: Option<f64>,
    /// Which of the files, and the line there.
    pub place: (usize, usize),
}

impl Reading {
    /// Lit pixels, N^2.
    pub fn pixels(&self) -> f64 {
        self.square_px * self.square_px
    }

    /// Whether a square was shown.
    pub fn is_lit(&self) -> bool {
        self.square_px > 0.0
    }
}

/// The readings of one or more tables, by channel.
#[derive(Debug, Clone)]
pub struct PowerReadings {
    /// The tables, with the BLAKE3 of each.
    pub files: Vec<(PathBuf, String)>,
    /// Red, green, blue.
    pub channels: [Vec<Reading>; 3],
    /// All three channels at one count.
    pub white: Vec<Reading>,
}

/// Lit counts that a channel needs at least: four unknowns, and one to see a misfit by.
const FEWEST_COUNTS: usize = 5;
/// No display at a lens reaches this at the pupil (all pixels of the paper's at full: 0.1), W m^-2.
const BRIGHTEST_W_M2: f64 = 10.0;

impl PowerReadings {
    /// Reads tables of one campaign.
    ///
    /// # Errors
    /// A cell that does not fit, a channel that is missing, too few counts.
    pub fn read(paths: &[PathBuf]) -> Result<Self, InputError> {
        let mut all = Self { files: Vec::new(), channels: Default::default(), white: Vec::new() };
        for (index, path) in paths.iter().enumerate() {
            let hash = hash_file(path)?;
            if let Some((other, _)) = all.files.iter().find(|(_, other)| *other == hash) {
                return Err(InputError::new(path, "the table is given twice")
                    .found(format!("the same content as {}", other.display()))
                    .help("readings are taken for independent: give each once"));
            }
            all.files.push((path.clone(), hash));
            all.add(index, &Table::read(path)?)?;
        }
        let file = paths.first().map_or(Path::new("--data"), |path| path.as_path());
        for channel in Channel::ALL {
            all.check_channel(file, channel)?;
        }
        Ok(all)
    }

    fn add(&mut self, file: usize, table: &Table) -> Result<(), InputError> {
        table.require(&["channel", "digital_count", "square_px", "irradiance_w_m2"])?;
        for row in 0..table.len() {
            let reading = read_row(file, table, row)?;
            match table.text(row, "channel") {
                "r" => self.channels[0].push(reading),
                "g" => self.channels[1].push(reading),
                "b" => self.channels[2].push(reading),
                "w" => self.white.push(reading),
                other => {
                    return Err(InputError::new(table.file(), "the channel is not known")
                        .cell(table.line(row), "channel")
                        .found(format!("`{other}`"))
                        .expected("`r`, `g`, `b`, or `w` for all three"));
                }
            }
        }
        Ok(())
    }

    fn check_channel(&self, file: &Path, channel: Channel) -> Result<(), InputError> {
        let name = channel.name();
        let readings = &self.channels[channel as usize];
        if readings.is_empty() {
            return Err(InputError::new(file, format!("there is no reading of the {name} channel"))
                .at("column `channel`")
                .expected(format!("rows with `{}`", channel.letter()))
                .help("the meter is calibrated for one wavelength: measure r, g and b one by one"));
        }
        let counts = lit_counts(readings);
        if counts.len() < FEWEST_COUNTS {
            return Err(InputError::new(file, format!("the {name} channel was measured at too few counts"))
                .at("column `digital_count`")
                .found(format!("{} different counts above 0", counts.len()))
                .expected(format!("at least {FEWEST_COUNTS}, spread from the lowest to 255")));
        }
        Ok(())
    }
}

/// The counts above 0 at which squares were measured, rising.
pub(crate) fn lit_counts(readings: &[Reading]) -> Vec<usize> {
    let mut counts: Vec<usize> =
        readings.iter().filter(|r| r.is_lit() && r.count > 0).map(|r| r.count).collect();
    counts.sort_unstable();
    counts.dedup();
    counts
}

fn read_row(file: usize, table: &Table, row: usize) -> Result<Reading, InputError> {
    let whole = |column: &str, most: f64, expected: &str| {
        let value = table.number(row, column)?;
        if value.fract() == 0.0 && (0.0..=most).contains(&value) {
            return Ok(value);
        }
        Err(InputError::new(table.file(), "the value is out of range")
            .cell(table.line(row), column)
            .found(value)
            .expected(expected)
            .help("are `digital_count`, `square_px` and `irradiance_w_m2` in each other's places?"))
    };
    let count = whole("digital_count", 255.0, "a whole number from 0 to 255")?;
    let square_px = whole("square_px", 16_384.0, "a whole number of pixels, 0 for a dark reading")?;
    let irradiance_w_m2 = table.number(row, "irradiance_w_m2")?;
    if irradiance_w_m2.abs() > BRIGHTEST_W_M2 {
        return Err(InputError::new(table.file(), "the irradiance is beyond any display's")
            .cell(table.line(row), "irradiance_w_m2")
            .found(irradiance_w_m2)
            .expected(format!("W m^-2 at the camera's pupil, below {BRIGHTEST_W_M2}"))
            .help("is the column in W m^-2, and not a digital count, milliwatts or microwatts?"));
    }
    let sigma_w_m2 = table.number_or_empty(row, "sigma_w_m2")?;
    if let Some(sigma) = sigma_w_m2.filter(|&sigma| sigma <= 0.0) {
        return Err(InputError::new(table.file(), "the uncertainty is not positive")
            .cell(table.line(row), "sigma_w_m2")
            .found(sigma)
            .expected("a standard deviation above 0, or an empty cell"));
    }
    Ok(Reading {
        count: count as usize,
        square_px,
        irradiance_w_m2,
        sigma_w_m2,
        place: (file, table.line(row)),
    })
}
