//! `power.csv`: one reading of a power meter at the camera's pupil a row.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use retina_files::{InputError, Table};
use retina_geometry::Setup;

use crate::columns::{Cells, Rows, csv_text, rows_text, write_text};
use crate::{Channel, ExtraColumn, SourceFile};

/// A reading: an N x N square of pixels at one count, or none lit.
#[derive(Debug, Clone, PartialEq)]
pub struct PowerRow {
    /// Lit sub-pixels.
    pub channel: Channel,
    /// Digital count of the square, 0 to 255.
    pub digital_count: f64,
    /// N; 0 for a dark reading.
    pub square_px: f64,
    /// What the meter says, W m^-2 at the camera's pupil.
    pub irradiance_w_m2: f64,
    /// Its standard deviation, W m^-2.
    pub sigma_w_m2: Option<f64>,
    /// Time of the reading, s.
    pub time_s: Option<f64>,
    /// Temperature, degrees Celsius.
    pub temperature_c: Option<f64>,
    /// Name of the series.
    pub series: Option<Arc<str>>,
    /// Index into [`PowerTable::files`].
    pub file: usize,
    /// Line in its file, from 1; 0 where it was not read from one.
    pub line: usize,
}

/// Rows of one or more `power.csv`, in the files' order, or made in memory.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PowerTable {
    /// The rows.
    pub rows: Vec<PowerRow>,
    /// Columns that the schema does not name.
    pub extra: Vec<ExtraColumn>,
    /// Files read; empty for a table made in memory.
    pub files: Vec<SourceFile>,
}

impl Rows for PowerTable {
    const REQUIRED: &'static [&'static str] = &["channel", "digital_count", "square_px", "irradiance_w_m2"];
    const KNOWN: &'static [&'static str] = &[
        "channel",
        "digital_count",
        "square_px",
        "irradiance_w_m2",
        "sigma_w_m2",
        "time_s",
        "temperature_c",
        "series",
    ];
    const NOTHING: [&'static str; 2] = ["holds no readings", "a row for each reading"];

    fn parts(&mut self) -> (&mut Vec<SourceFile>, &mut Vec<ExtraColumn>, usize) {
        (&mut self.files, &mut self.extra, self.rows.len())
    }

    fn add_rows(&mut self, table: &Table, file: usize) -> Result<(), InputError> {
        let mut series = None;
        for row in 0..table.len() {
            let cells = Cells { table, row };
            self.rows.push(PowerRow {
                channel: cells.named_channel()?,
                digital_count: cells.number_in("digital_count", 0.0..=255.0, "a count from 0 to 255")?,
                square_px: cells.number_in(
                    "square_px",
                    0.0..=1e5,
                    "the square's side in pixels, 0 for a dark reading",
                )?,
                irradiance_w_m2: cells.number("irradiance_w_m2")?,
                sigma_w_m2: cells.positive("sigma_w_m2")?,
                time_s: cells.optional("time_s")?,
                temperature_c: cells.temperature_c()?,
                series: cells.shared_text("series", &mut series),
                file,
                line: table.line(row),
            });
        }
        Ok(())
    }
}

impl PowerTable {
    /// Reads several tables of one campaign together.
    ///
    /// # Errors
    /// A column is missing, a cell is no number or outside its range, a file is given twice, or there is no row at all.
    pub fn read(paths: &[PathBuf]) -> Result<Self, InputError> {
        Self::read_all(paths)
    }

    /// Refuses a table that names another setup than `setup`.
    ///
    /// # Errors
    /// As said.
    pub fn check_setup(&self, setup: &Setup) -> Result<(), InputError> {
        self.files
            .iter()
            .try_for_each(|file| file.setup.as_ref().map_or(Ok(()), |stamp| stamp.check(&file.path, setup)))
    }

    /// Writes [`Self::text`].
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&self, path: &Path, setup: &Setup) -> Result<(), InputError> {
        write_text(path, &self.text(setup))
    }

    /// As `power.csv` with the setup's name in a comment; optional columns that no row has are left out.
    pub fn text(&self, setup: &Setup) -> String {
        rows_text::<Self, _>(
            setup,
            &self.rows,
            &self.extra,
            |row| {
                let (channel, light) = (row.channel.letter(), row.irradiance_w_m2);
                format!("{channel},{},{},{light:e}", row.digital_count, row.square_px)
            },
            &[
                ("sigma_w_m2", |row| row.sigma_w_m2.map(|v| format!("{v:e}"))),
                ("time_s", |row| row.time_s.map(|v| v.to_string())),
                ("temperature_c", |row| row.temperature_c.map(|v| v.to_string())),
                ("series", |row| row.series.as_deref().map(csv_text)),
            ],
        )
    }

    /// An error about a row's cell; names the file where the row came from one.
    pub fn refused(&self, row: &PowerRow, problem: &str, column: &str) -> InputError {
        match self.files.get(row.file).filter(|_| row.line > 0) {
            Some(file) => InputError::new(&file.path, problem).cell(row.line, column),
            None => InputError::new("power readings", problem).at(format!("column `{column}`")),
        }
    }
}
