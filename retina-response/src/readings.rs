//! Readings of a power meter by channel, and what a radiometric calibration refuses among them.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use retina_files::InputError;
use retina_formats::{Channel, PowerRow, PowerTable, SourceFile};

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
    /// Number of its series among those of all channels, where rows name theirs.
    pub series: Option<usize>,
    /// Factor by which its series reads more than the mean of all.
    pub gain: f64,
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
    /// The tables.
    pub files: Vec<SourceFile>,
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
        Self::of(&PowerTable::read(paths)?)
    }

    /// Of a table at hand.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn of(table: &PowerTable) -> Result<Self, InputError> {
        let mut all = Self { files: table.files.clone(), channels: Default::default(), white: Vec::new() };
        let mut series: BTreeMap<(usize, &str), usize> = BTreeMap::new();
        for row in &table.rows {
            let number = row.series.as_deref().map(|name| {
                let next = series.len();
                *series.entry((row.file, name)).or_insert(next)
            });
            let reading = Reading { series: number, ..reading(table, row)? };
            match row.channel {
                Channel::W => all.white.push(reading),
                colour => all.channels[colour as usize].push(reading),
            }
        }
        let file = table.files.first().map_or(Path::new("power readings"), |file| &file.path);
        for channel in Channel::COLOURS {
            all.check_channel(file, channel)?;
        }
        Ok(all)
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

fn reading(table: &PowerTable, row: &PowerRow) -> Result<Reading, InputError> {
    let whole = |value: f64, column: &str, most: f64, expected: &str| {
        if value.fract() == 0.0 && (0.0..=most).contains(&value) {
            return Ok(value);
        }
        Err(table
            .refused(row, "the value is out of range", column)
            .found(value)
            .expected(expected)
            .help("are `digital_count`, `square_px` and `irradiance_w_m2` in each other's places?"))
    };
    let count = whole(row.digital_count, "digital_count", 255.0, "a whole number from 0 to 255")?;
    let square_px =
        whole(row.square_px, "square_px", 16_384.0, "a whole number of pixels, 0 for a dark reading")?;
    if row.irradiance_w_m2.abs() > BRIGHTEST_W_M2 {
        return Err(table
            .refused(row, "the irradiance is beyond any display's", "irradiance_w_m2")
            .found(row.irradiance_w_m2)
            .expected(format!("W m^-2 at the camera's pupil, below {BRIGHTEST_W_M2}"))
            .help("is the column in W m^-2, and not a digital count, milliwatts or microwatts?"));
    }
    Ok(Reading {
        count: count as usize,
        square_px,
        irradiance_w_m2: row.irradiance_w_m2,
        sigma_w_m2: row.sigma_w_m2,
        place: (row.file, row.line),
        series: None,
        gain: 1.0,
    })
}
