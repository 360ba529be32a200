//! Measurement tables: columns from Python, or files.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use retina::files::{InputError, Place, Table};
use retina::formats::{Measurements, PointsTable, PowerTable};
use retina::workbench::Measured;

use crate::errors::Failure;

/// What a table without a file is called in errors: the argument that it is.
const NAME: &str = "<table>";

/// A column: numbers with NaN where nothing was measured, or texts.
#[derive(FromPyObject)]
pub(crate) enum Column<'py> {
    Numbers(PyReadonlyArray1<'py, f64>),
    Texts(Vec<Option<String>>),
}

impl Column<'_> {
    fn len(&self) -> usize {
        use numpy::PyUntypedArrayMethods as _;
        match self {
            Self::Numbers(values) => values.len(),
            Self::Texts(values) => values.len(),
        }
    }
}

/// A table: files of one kind that are read together, or columns by name.
#[derive(FromPyObject)]
pub(crate) enum TableOf<'py> {
    Files(Vec<PathBuf>),
    Columns(Vec<(String, Column<'py>)>),
}

impl TableOf<'_> {
    pub(crate) fn measured(self) -> PyResult<Measured> {
        Ok(match self {
            Self::Files(files) => Measured::Files(files),
            Self::Columns(columns) => Measured::Memory(Box::new(measurements(&columns)?)),
        })
    }

    /// Read or made, any kind but frames.
    pub(crate) fn in_memory(self) -> PyResult<Measurements> {
        match self {
            Self::Files(files) => Ok(Measurements::read(&files).map_err(Failure::from)?),
            Self::Columns(columns) => measurements(&columns),
        }
    }

    /// Displayed points and their centroids.
    pub(crate) fn points(self) -> PyResult<PointsTable> {
        match self {
            Self::Files(files) => Ok(PointsTable::read(&files).map_err(Failure::from)?),
            Self::Columns(columns) => match measurements(&columns)? {
                Measurements::Points(table) => Ok(table),
                other => Err(other_kind("points", other.kind().name())),
            },
        }
    }

    /// Readings of a power meter.
    pub(crate) fn power(self) -> PyResult<PowerTable> {
        match self {
            Self::Files(files) => Ok(PowerTable::read(&files).map_err(Failure::from)?),
            Self::Columns(columns) => match measurements(&columns)? {
                Measurements::Power(table) => Ok(table),
                other => Err(other_kind("power readings", other.kind().name())),
            },
        }
    }
}

fn other_kind(expected: &str, found: &str) -> PyErr {
    let found = format!("columns of a table of {found}");
    Failure::argument("table", "is another kind of table", found, &format!("a table of {expected}")).into()
}

fn measurements(columns: &[(String, Column<'_>)]) -> PyResult<Measurements> {
    let text = csv_text(columns)?;
    Ok(Measurements::parse(Path::new(NAME), &text).map_err(|error| Failure::from(in_rows(error)))?)
}

/// The columns as CSV: the tables' one reader checks them like a file's.
fn csv_text(columns: &[(String, Column<'_>)]) -> PyResult<String> {
    let rows = columns.first().map_or(0, |(_, column)| column.len());
    if let Some((name, column)) = columns.iter().find(|(_, column)| column.len() != rows) {
        let found = format!("column `{name}` with {} values", column.len());
        let expected = format!("{rows}, as in column `{}`", columns[0].0);
        return Err(Failure::argument("table", "has columns of different lengths", found, &expected).into());
    }
    let mut text = String::with_capacity(24 * rows * columns.len());
    for (at, (name, _)) in columns.iter().enumerate() {
        text.push_str(if at > 0 { "," } else { "" });
        quoted(&mut text, name)?;
    }
    for row in 0..rows {
        text.push('\n');
        for (at, (_, column)) in columns.iter().enumerate() {
            text.push_str(if at > 0 { "," } else { "" });
            match column {
                Column::Numbers(values) => match values.as_array()[row] {
                    value if value.is_nan() => {}
                    // The shortest text that reads back as the same number.
                    value => write!(text, "{value}").map_err(|error| Failure::new(error.to_string()))?,
                },
                Column::Texts(values) => {
                    values[row].as_ref().map_or(Ok(()), |cell| quoted(&mut text, cell))?
                }
            }
        }
    }
    text.push('\n');
    Ok(text)
}

fn quoted(text: &mut String, cell: &str) -> PyResult<()> {
    if cell.contains(['\n', '\r']) {
        let found = format!("{cell:?}");
        return Err(
            Failure::argument("table", "has a cell of several lines", found, "texts of one line").into()
        );
    }
    text.push('"');
    text.push_str(&cell.replace('"', "\"\""));
    text.push('"');
    Ok(())
}

/// An error about a table without a file: its rows are counted from 0, as Python does.
fn in_rows(mut error: InputError) -> InputError {
    if error.file == Path::new(NAME) {
        error.place = match error.place {
            Place::Cell(line, column) => {
                Place::Named(format!("row {}, column `{column}`", line.saturating_sub(2)))
            }
            Place::Line(line) if line > 1 => Place::Named(format!("row {}", line - 2)),
            Place::Line(_) => Place::File,
            place => place,
        };
    }
    error
}

/// A table's text as columns: numbers where every cell is one or empty, otherwise texts.
pub(crate) fn columns_of<'py>(py: Python<'py>, text: &str) -> PyResult<Bound<'py, PyDict>> {
    let table = Table::parse(Path::new(NAME), text).map_err(Failure::from)?;
    let out = PyDict::new(py);
    for name in table.columns() {
        let cells: Vec<&str> = (0..table.len()).map(|row| table.text(row, name)).collect();
        let number = |cell: &&str| if cell.is_empty() { Some(f64::NAN) } else { cell.parse().ok() };
        // Names stay texts, also where they are digits.
        let named = ["image", "series", "channel", "night"].contains(&name.as_str());
        match cells.iter().map(number).collect::<Option<Vec<f64>>>().filter(|_| !named) {
            Some(values) => out.set_item(name, PyArray1::from_vec(py, values))?,
            None => out.set_item(name, PyList::new(py, cells)?)?,
        }
    }
    Ok(out)
}

/// A table's file as columns.
#[pyfunction]
pub(crate) fn read_columns(py: Python<'_>, path: PathBuf) -> PyResult<Bound<'_, PyDict>> {
    let text = retina::files::read_text(&path).map_err(Failure::from)?;
    Table::parse(&path, &text).map_err(Failure::from)?;
    columns_of(py, &text)
}
