//! `power.csv`: one reading of a power meter at the camera's pupil a row.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use retina_files::{InputError, Table, write_atomic};
use retina_geometry::Setup;

use crate::columns::{Cells, csv_text, extend_extra, open};
use crate::{Channel, ExtraColumn, SetupStamp, SourceFile};

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

const REQUIRED: [&str; 4] = ["channel", "digital_count", "square_px", "irradiance_w_m2"];
const KNOWN: [&str; 8] = [
    "channel",
    "digital_count",
    "square_px",
    "irradiance_w_m2",
    "sigma_w_m2",
    "time_s",
    "temperature_c",
    "series",
];

impl PowerTable {
    /// Reads several tables of one campaign together.
    ///
    /// # Errors
    /// A column is missing, a cell is no number or outside its range, a file is given twice, or there is no row at all.
    pub fn read(paths: &[PathBuf]) -> Result<Self, InputError> {
        let mut out = Self::default();
        for path in paths {
            let (table, file) = open(path, &out.files)?;
            out.append(&table, file)?;
        }
        match (out.rows.is_empty(), paths.first()) {
            (true, Some(path)) => {
                Err(InputError::new(path, "holds no readings").expected("a row for each reading"))
            }
            _ => Ok(out),
        }
    }

    pub(crate) fn append(&mut self, table: &Table, file: SourceFile) -> Result<(), InputError> {
        table.require(&REQUIRED)?;
        extend_extra(&mut self.extra, self.rows.len(), table, &KNOWN)?;
        let mut series = None;
        let at = self.files.len();
        self.files.push(file);
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
                file: at,
                line: table.line(row),
            });
        }
        Ok(())
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

    /// Writes it as `power.csv` with the setup's name in a comment; optional columns that no row has are left out.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&self, path: &Path, setup: &Setup) -> Result<(), InputError> {
        type Cell = fn(&PowerRow) -> Option<String>;
        let optional: [(&str, Cell); 4] = [
            ("sigma_w_m2", |row| row.sigma_w_m2.map(|v| format!("{v:e}"))),
            ("time_s", |row| row.time_s.map(|v| v.to_string())),
            ("temperature_c", |row| row.temperature_c.map(|v| v.to_string())),
            ("series", |row| row.series.as_deref().map(csv_text)),
        ];
        let used: Vec<&(&str, Cell)> =
            optional.iter().filter(|(_, cell)| self.rows.iter().any(|row| cell(row).is_some())).collect();
        let mut text = SetupStamp::of(setup).line();
        text.push_str(&REQUIRED.join(","));
        for name in used.iter().map(|(name, _)| *name).chain(self.extra.iter().map(|c| c.name.as_str())) {
            text.push(',');
            text.push_str(name);
        }
        text.push('\n');
        for (at, row) in self.rows.iter().enumerate() {
            let (channel, light) = (row.channel.letter(), row.irradiance_w_m2);
            let _ = write!(text, "{channel},{},{},{light:e}", row.digital_count, row.square_px);
            for (_, cell) in &used {
                let _ = write!(text, ",{}", cell(row).unwrap_or_default());
            }
            for column in &self.extra {
                let value = column.values[at];
                let _ = if value.is_nan() { write!(text, ",") } else { write!(text, ",{value}") };
            }
            text.push('\n');
        }
        write_atomic(path, text.as_bytes())
            .map_err(|error| InputError::new(path, format!("cannot be written: {error}")))
    }

    /// An error about a row's cell; names the file where the row came from one.
    pub fn refused(&self, row: &PowerRow, problem: &str, column: &str) -> InputError {
        match self.files.get(row.file).filter(|_| row.line > 0) {
            Some(file) => InputError::new(&file.path, problem).cell(row.line, column),
            None => InputError::new("power readings", problem).at(format!("column `{column}`")),
        }
    }
}
