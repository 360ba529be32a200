//! `phase.csv`: one magnitude of a whole body at one phase angle a row.

use std::path::PathBuf;
use std::sync::Arc;

use retina_files::{InputError, Table};

use crate::columns::{Cells, Rows};
use crate::{ExtraColumn, SourceFile};

/// A magnitude at a phase angle.
#[derive(Debug, Clone, PartialEq)]
pub struct PhaseRow {
    /// Signed phase angle, degrees: negative before full.
    pub phase_deg: f64,
    /// Magnitude at unit distances.
    pub magnitude: f64,
    /// Its standard deviation, mag.
    pub sigma_mag: Option<f64>,
    /// Airmass of the observation.
    pub airmass: Option<f64>,
    /// Name of the night.
    pub night: Option<Arc<str>>,
    /// Name of the series.
    pub series: Option<Arc<str>>,
    /// Index into [`PhaseTable::files`].
    pub file: usize,
    /// Line in its file, from 1; 0 where it was not read from one.
    pub line: usize,
}

/// Rows of one or more `phase.csv`, in the files' order, or made in memory.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PhaseTable {
    /// The rows.
    pub rows: Vec<PhaseRow>,
    /// Columns that the schema does not name.
    pub extra: Vec<ExtraColumn>,
    /// Files read; empty for a table made in memory.
    pub files: Vec<SourceFile>,
}

impl Rows for PhaseTable {
    const REQUIRED: &'static [&'static str] = &["phase_deg", "magnitude"];
    const KNOWN: &'static [&'static str] =
        &["phase_deg", "magnitude", "sigma_mag", "airmass", "night", "series"];
    const NOTHING: [&'static str; 2] = ["holds no magnitudes", "a row for each observation"];

    fn parts(&mut self) -> (&mut Vec<SourceFile>, &mut Vec<ExtraColumn>, usize) {
        (&mut self.files, &mut self.extra, self.rows.len())
    }

    fn add_rows(&mut self, table: &Table, file: usize) -> Result<(), InputError> {
        let (mut night, mut series) = (None, None);
        for row in 0..table.len() {
            let cells = Cells { table, row };
            self.rows.push(PhaseRow {
                phase_deg: cells.number_in(
                    "phase_deg",
                    -178.0..=178.0,
                    "a signed phase angle within 178 deg",
                )?,
                magnitude: cells.number_in("magnitude", -60.0..=60.0, "a magnitude")?,
                sigma_mag: cells.optional_in("sigma_mag", 1e-9..=100.0, "a number above 0")?,
                airmass: cells.optional("airmass")?,
                night: cells.shared_text("night", &mut night),
                series: cells.shared_text("series", &mut series),
                file,
                line: table.line(row),
            });
        }
        Ok(())
    }
}

impl PhaseTable {
    /// Reads several tables of one body together.
    ///
    /// # Errors
    /// A column is missing, a cell is no number or outside its range, a file is given twice, or there is no row at all.
    pub fn read(paths: &[PathBuf]) -> Result<Self, InputError> {
        Self::read_all(paths)
    }
}
