//! Any of the measurement tables, told apart by their columns.

use std::path::{Path, PathBuf};

use retina_files::{InputError, Table, read_text};
use retina_geometry::Setup;

use crate::columns::{Rows as _, of_text, open};
use crate::{FramesTable, PhaseTable, PointsTable, PowerTable, SourceFile};

/// Which table.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum TableKind {
    /// `points.csv`: two components, arcsec.
    Points,
    /// `power.csv`: relative irradiance.
    Power,
    /// `phase.csv`: magnitudes.
    Phase,
    /// `frames.csv`: digital numbers of pixels.
    Frames,
}

impl TableKind {
    /// Its name in JSON.
    pub fn name(self) -> &'static str {
        ["points", "power", "phase", "frames"][self as usize]
    }

    /// Components of a row's residual.
    pub fn components(self) -> usize {
        if self == Self::Points { 2 } else { 1 }
    }

    /// Unit of its residuals.
    pub fn unit(self) -> &'static str {
        ["arcsec", "relative", "mag", "DN"][self as usize]
    }

    /// The kind of a file, by its header line.
    ///
    /// # Errors
    /// The file cannot be read, or its columns are those of no table.
    pub fn of_file(path: &Path) -> Result<Self, InputError> {
        let text = read_text(path)?;
        let comment = |line: &&str| line.trim_start().starts_with('#') || line.trim().is_empty();
        let header = text.trim_start_matches('\u{feff}').lines().find(|line| !comment(line));
        Self::of(&Table::parse(path, header.unwrap_or_default())?)
    }

    /// The kind whose columns a table has.
    ///
    /// # Errors
    /// It has those of none.
    pub fn of(table: &Table) -> Result<Self, InputError> {
        if table.has("screen_x_px") || table.has("camera_x_px") {
            Ok(Self::Points)
        } else if table.has("irradiance_w_m2") {
            Ok(Self::Power)
        } else if table.has("phase_deg") {
            Ok(Self::Phase)
        } else if FramesTable::COLUMNS.iter().any(|column| table.has(column)) {
            Ok(Self::Frames)
        } else {
            Err(InputError::new(table.file(), "the columns belong to none of the known tables")
                .found(format!("columns {}", table.columns().join(", ")))
                .expected(
                    "camera_x_px (points), irradiance_w_m2 (power), phase_deg (phase) or measured (frames)",
                ))
        }
    }
}

/// Tables of one kind, read together.
#[derive(Debug, Clone, PartialEq)]
pub enum Measurements {
    /// Displayed points and their centroids.
    Points(PointsTable),
    /// Readings of a power meter.
    Power(PowerTable),
    /// Magnitudes of a whole body.
    Phase(PhaseTable),
}

impl Measurements {
    /// Reads tables of one kind together. Of a table of more than two million rows every n-th group is read, and
    /// [`SourceFile::note`] says so.
    ///
    /// # Errors
    /// The columns are of no table, of frames, or of different tables; a cell does not fit.
    pub fn read(paths: &[PathBuf]) -> Result<Self, InputError> {
        let Some((first, rest)) = paths.split_first() else {
            return Err(InputError::new("--data", "names no table").expected("at least one file"));
        };
        let (table, file) = open(first, &[])?;
        let mut out = Self::empty(&table)?;
        out.append(&table, file)?;
        for path in rest {
            let (table, file) = open(path, out.files())?;
            if TableKind::of(&table)? != out.kind() {
                return Err(InputError::new(path, "is another kind of table than the first")
                    .found(format!("columns {}", table.columns().join(", ")))
                    .expected(format!("the columns of {}", first.display()))
                    .help("give tables of one kind in one command"));
            }
            out.append(&table, file)?;
        }
        Ok(out)
    }

    /// Of a table's text; `name` names it in errors.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn parse(name: &Path, text: &str) -> Result<Self, InputError> {
        let (table, file) = of_text(name, text)?;
        let mut out = Self::empty(&table)?;
        out.append(&table, file)?;
        Ok(out)
    }

    /// Without rows, of the kind whose columns a table has.
    fn empty(table: &Table) -> Result<Self, InputError> {
        Ok(match TableKind::of(table)? {
            TableKind::Points => Self::Points(PointsTable::default()),
            TableKind::Power => Self::Power(PowerTable::default()),
            TableKind::Phase => Self::Phase(PhaseTable::default()),
            TableKind::Frames => {
                return Err(InputError::new(
                    table.file(),
                    "is a table of frames, whose images have to be predicted first",
                )
                .expected("points, power or phase")
                .help("give tables of frames by themselves"));
            }
        })
    }

    fn append(&mut self, table: &Table, file: SourceFile) -> Result<(), InputError> {
        match self {
            Self::Points(points) => points.append(table, file),
            Self::Power(power) => power.append(table, file),
            Self::Phase(phase) => phase.append(table, file),
        }
    }

    /// Which kind.
    pub fn kind(&self) -> TableKind {
        match self {
            Self::Points(_) => TableKind::Points,
            Self::Power(_) => TableKind::Power,
            Self::Phase(_) => TableKind::Phase,
        }
    }

    /// The files it was read from; empty where it was made in memory.
    pub fn files(&self) -> &[SourceFile] {
        match self {
            Self::Points(points) => &points.files,
            Self::Power(power) => &power.files,
            Self::Phase(phase) => &phase.files,
        }
    }

    /// Refuses tables that cannot have been measured with `setup`.
    ///
    /// # Errors
    /// A table names another setup, or a point lies outside the sensor or the screen.
    pub fn check_setup(&self, setup: &Setup) -> Result<(), InputError> {
        match self {
            Self::Points(points) => points.check_setup(setup),
            Self::Power(power) => power.check_setup(setup),
            // A body is not observed through the facility.
            Self::Phase(_) => Ok(()),
        }
    }
}
