//! Columns and cells that the tables share.

use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use retina_files::{InputError, Table, hash_bytes, read_text, write_atomic};
use retina_geometry::Setup;

use crate::Channel;
use crate::setup_stamp::SetupStamp;

/// A file that rows came from.
#[derive(Debug, Clone, PartialEq)]
pub struct SourceFile {
    /// Where it lies.
    pub path: PathBuf,
    /// BLAKE3 of its bytes.
    pub blake3: String,
    /// The setup that the file says it was measured with.
    pub setup: Option<SetupStamp>,
    /// What the user ought to know of how it was read: a very long table is read in part.
    pub note: Option<String>,
    /// Rows of the file, read or not.
    pub rows: usize,
}

impl SourceFile {
    /// A file of which nothing else is known.
    pub fn new(path: impl Into<PathBuf>, blake3: String) -> Self {
        Self { path: path.into(), blake3, setup: None, note: None, rows: 0 }
    }
}

/// A numeric column that the table's schema does not name: a covariate.
#[derive(Debug, Clone, PartialEq)]
pub struct ExtraColumn {
    /// Its header.
    pub name: String,
    /// A value for each row; NaN where it was not measured.
    pub values: Vec<f64>,
}

/// A table of measurements: what its reader and its writer share with the others.
pub(crate) trait Rows: Default {
    /// Columns that must be there.
    const REQUIRED: &'static [&'static str];
    /// Columns that the schema names; others are covariates.
    const KNOWN: &'static [&'static str];
    /// What a table without rows lacks, and what was expected.
    const NOTHING: [&'static str; 2];

    /// The files, the extra columns, and the number of rows.
    fn parts(&mut self) -> (&mut Vec<SourceFile>, &mut Vec<ExtraColumn>, usize);

    /// Adds the rows of a file, the `file`-th.
    fn add_rows(&mut self, table: &Table, file: usize) -> Result<(), InputError>;

    /// Adds a file with its extra columns and rows.
    fn append(&mut self, table: &Table, file: SourceFile) -> Result<(), InputError> {
        table.require(Self::REQUIRED)?;
        let (files, extra, rows) = self.parts();
        extend_extra(extra, rows, table, Self::KNOWN)?;
        let at = files.len();
        files.push(file);
        self.add_rows(table, at)
    }

    /// Reads several files together.
    fn read_all(paths: &[PathBuf]) -> Result<Self, InputError> {
        let mut out = Self::default();
        for path in paths {
            let (table, file) = open(path, out.parts().0)?;
            out.append(&table, file)?;
        }
        let [nothing, expected] = Self::NOTHING;
        match (out.parts().2, paths.first()) {
            (0, Some(path)) => Err(InputError::new(path, nothing).expected(expected)),
            _ => Ok(out),
        }
    }
}

/// An optional column of a writer: its name and its cell in a row.
pub(crate) type OptionalColumn<Row> = (&'static str, fn(&Row) -> Option<String>);

/// A table's text with the setup's name in a comment. `required` gives the cells of the required columns; optional
/// columns that no row has are left out.
pub(crate) fn rows_text<T: Rows, Row>(
    setup: &Setup,
    rows: &[Row],
    extra: &[ExtraColumn],
    required: impl Fn(&Row) -> String,
    optional: &[OptionalColumn<Row>],
) -> String {
    let used: Vec<&OptionalColumn<Row>> =
        optional.iter().filter(|(_, cell)| rows.iter().any(|row| cell(row).is_some())).collect();
    let names = T::REQUIRED.iter().copied().chain(used.iter().map(|(name, _)| *name));
    let names: Vec<&str> = names.chain(extra.iter().map(|column| column.name.as_str())).collect();
    let mut text = SetupStamp::of(setup).line() + &names.join(",") + "\n";
    for (at, row) in rows.iter().enumerate() {
        text.push_str(&required(row));
        let cells = used.iter().map(|(_, cell)| cell(row).unwrap_or_default());
        let further = extra.iter().map(|column| column.values[at]);
        for cell in cells.chain(further.map(|v| if v.is_nan() { String::new() } else { v.to_string() })) {
            text.push(',');
            text.push_str(&cell);
        }
        text.push('\n');
    }
    text
}

/// Writes a table's text.
pub(crate) fn write_text(path: &Path, text: &str) -> Result<(), InputError> {
    write_atomic(path, text.as_bytes())
        .map_err(|error| InputError::new(path, format!("cannot be written: {error}")))
}

/// Puts the extra columns of a further file behind those of the files before it. A column of words alone, such as a
/// comment, is none.
fn extend_extra(
    extra: &mut Vec<ExtraColumn>,
    rows_before: usize,
    table: &Table,
    known: &[&str],
) -> Result<(), InputError> {
    let words = |name: &str| {
        let filled = || (0..table.len()).map(|row| table.text(row, name)).filter(|cell| !cell.is_empty());
        filled().next().is_some() && filled().all(|cell| cell.parse::<f64>().is_err())
    };
    for name in table.columns().iter().filter(|name| !known.contains(&name.as_str()) && !words(name)) {
        if !extra.iter().any(|column| column.name == *name) {
            extra.push(ExtraColumn { name: name.clone(), values: vec![f64::NAN; rows_before] });
        }
    }
    for column in extra {
        for row in 0..table.len() {
            column.values.push(table.number_or_empty(row, &column.name)?.unwrap_or(f64::NAN));
        }
    }
    Ok(())
}

/// A table's text with what is known of its file; refuses the same content twice, since errors are taken for
/// independent.
pub(crate) fn open(path: &Path, before: &[SourceFile]) -> Result<(Table, SourceFile), InputError> {
    let part = crate::sample::read(path)?;
    if let Some(other) = before.iter().find(|other| other.blake3 == part.file.blake3) {
        return Err(InputError::new(path, "the table is given twice")
            .found(format!("the same content as {}", other.path.display()))
            .help("the fit takes rows for independent measurements: give each table once"));
    }
    Ok((part.table, part.file))
}

/// A file that is read whole.
pub(crate) fn open_whole(path: &Path) -> Result<(Table, SourceFile), InputError> {
    of_text(path, &read_text(path)?)
}

/// A file's text; `path` names it in errors.
pub(crate) fn of_text(path: &Path, text: &str) -> Result<(Table, SourceFile), InputError> {
    let table = Table::parse(path, text)?;
    let file = SourceFile {
        path: path.to_path_buf(),
        blake3: hash_bytes(text.as_bytes()),
        setup: SetupStamp::of_text(path, text)?,
        note: None,
        rows: table.len(),
    };
    Ok((table, file))
}

/// Cells of one row.
pub(crate) struct Cells<'a> {
    pub(crate) table: &'a Table,
    pub(crate) row: usize,
}

impl Cells<'_> {
    /// An error about a cell.
    pub(crate) fn wrong(&self, column: &str, expected: &str) -> InputError {
        InputError::new(self.table.file(), "the value is outside its range")
            .cell(self.table.line(self.row), column)
            .found(self.table.text(self.row, column))
            .expected(expected)
    }

    /// A number that must be there.
    pub(crate) fn number(&self, column: &str) -> Result<f64, InputError> {
        self.table.number(self.row, column)
    }

    /// A number within a range that must be there.
    pub(crate) fn number_in(
        &self,
        column: &str,
        range: RangeInclusive<f64>,
        expected: &str,
    ) -> Result<f64, InputError> {
        let value = self.number(column)?;
        if range.contains(&value) { Ok(value) } else { Err(self.wrong(column, expected)) }
    }

    /// A number, or an empty cell.
    pub(crate) fn optional(&self, column: &str) -> Result<Option<f64>, InputError> {
        self.table.number_or_empty(self.row, column)
    }

    /// A number within a range, or an empty cell.
    pub(crate) fn optional_in(
        &self,
        column: &str,
        range: RangeInclusive<f64>,
        expected: &str,
    ) -> Result<Option<f64>, InputError> {
        match self.optional(column)? {
            Some(value) if !range.contains(&value) => Err(self.wrong(column, expected)),
            value => Ok(value),
        }
    }

    /// A number above 0, or an empty cell.
    pub(crate) fn positive(&self, column: &str) -> Result<Option<f64>, InputError> {
        self.optional_in(column, f64::MIN_POSITIVE..=f64::MAX, "a number above 0")
    }

    /// Temperature in degrees Celsius, above absolute zero.
    pub(crate) fn temperature_c(&self) -> Result<Option<f64>, InputError> {
        self.optional_in("temperature_c", -273.15..=1000.0, "degrees Celsius, above -273.15")
    }

    /// Text of a cell, `None` where it is empty. Neighbouring rows mostly share it.
    pub(crate) fn shared_text(&self, column: &str, last: &mut Option<Arc<str>>) -> Option<Arc<str>> {
        let text = self.table.text(self.row, column);
        if text.is_empty() {
            return None;
        }
        if last.as_deref() != Some(text) {
            *last = Some(Arc::from(text));
        }
        last.clone()
    }

    /// The channel; white where the cell is empty.
    pub(crate) fn channel(&self) -> Result<Channel, InputError> {
        match self.table.text(self.row, "channel") {
            "" => Ok(Channel::W),
            _ => self.named_channel(),
        }
    }

    /// The channel, which must be named.
    pub(crate) fn named_channel(&self) -> Result<Channel, InputError> {
        let letter = self.table.text(self.row, "channel");
        Channel::from_letter(letter).ok_or_else(|| {
            InputError::new(self.table.file(), "the channel is not known")
                .cell(self.table.line(self.row), "channel")
                .found(format!("`{letter}`"))
                .expected("`r`, `g`, `b`, or `w` for all three")
        })
    }
}

/// Text for a cell of a CSV table that people open in a spreadsheet. Text that begins as a formula would be carried
/// out there, so that it gets an apostrophe in front; what holds a comma, a quote or a line break is quoted.
pub fn csv_text(text: &str) -> String {
    let formula = text.starts_with(['=', '+', '-', '@', '\t', '\r']) && text.parse::<f64>().is_err();
    let text = if formula { format!("'{text}") } else { text.to_owned() };
    if text.contains([',', '"', '\n', '\r']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a test may fail")]
mod tests {
    use std::path::Path;

    use retina_files::Table;

    use super::*;

    #[test]
    fn a_cell_that_is_written_is_no_formula_and_stays_one_cell() {
        for (text, cell) in [
            ("=HYPERLINK(A1)", "'=HYPERLINK(A1)"),
            ("+1+1", "'+1+1"),
            ("-cmd", "'-cmd"),
            ("@sum", "'@sum"),
            ("-1.5e3", "-1.5e3"),
            ("image 1.png", "image 1.png"),
            ("a,b\"c", "\"a,b\"\"c\""),
            ("=a,b", "\"'=a,b\""),
            ("", ""),
        ] {
            assert_eq!(csv_text(text), cell);
            let table = Table::parse(Path::new("t.csv"), &format!("a,b\n{cell},2\n")).unwrap();
            assert_eq!(table.text(0, "a").trim_start_matches('\''), text);
        }
    }
}
