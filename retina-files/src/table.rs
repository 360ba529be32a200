//! CSV tables: header row, `#` comment lines, cells read by column name.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use crate::{InputError, nearest, read_text};

/// A table read from a CSV file: every cell as text, with the line it stands on.
#[derive(Debug, Clone)]
pub struct Table {
    file: PathBuf,
    columns: Vec<String>,
    index: HashMap<String, usize>,
    rows: Vec<(usize, csv::StringRecord)>,
}

impl Table {
    /// Reads a table from a file.
    ///
    /// # Errors
    /// No header, a header named twice, a row with too many or too few cells, text that is not
    /// UTF-8: each with its line.
    pub fn read(path: &Path) -> Result<Self, InputError> {
        Self::parse(path, &read_text(path)?)
    }

    /// As [`Table::read`], from text already in memory; `path` only names it in errors.
    pub fn parse(path: &Path, text: &str) -> Result<Self, InputError> {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        // Comments and blank lines are taken out first: the csv crate would count a record's line
        // from the comment above it.
        let (lines, kept): (Vec<usize>, Vec<&str>) = text
            .lines()
            .enumerate()
            .filter(|(_, line)| !line.trim_start().starts_with('#') && !line.trim().is_empty())
            .map(|(i, line)| (i + 1, line))
            .unzip();
        let kept = kept.join("\n");
        let line_of = |position: Option<&csv::Position>| {
            position.and_then(|p| lines.get((p.line() as usize).saturating_sub(1))).copied().unwrap_or(1)
        };
        let mut reader =
            csv::ReaderBuilder::new().trim(csv::Trim::All).flexible(true).from_reader(kept.as_bytes());
        let broken = |error: csv::Error| {
            let line = line_of(error.position());
            InputError::new(path, format!("is not a readable CSV table: {error}")).line(line)
        };
        let header = reader.headers().map_err(broken)?.clone();
        if header.is_empty() || header.iter().all(str::is_empty) {
            return Err(InputError::new(path, "holds no table").expected("a header row with column names"));
        }
        let header_line = line_of(header.position());
        for (delimiter, name) in [(';', "semicolons"), ('\t', "tabs")] {
            if header.len() == 1 && header[0].contains(delimiter) {
                return Err(InputError::new(path, format!("the columns are parted by {name}"))
                    .line(header_line)
                    .expected("commas")
                    .help("save the table as CSV with commas, and points in numbers"));
            }
        }
        let mut index = HashMap::new();
        for (i, name) in header.iter().enumerate() {
            if name.is_empty() {
                return Err(InputError::new(path, format!("column {} has no name", i + 1)).line(header_line));
            }
            if index.insert(name.to_owned(), i).is_some() {
                return Err(InputError::new(path, format!("column `{name}` is named twice"))
                    .line(header_line)
                    .help("rename or remove one of the two"));
            }
        }
        let mut rows = Vec::new();
        for record in reader.records() {
            let record = record.map_err(broken)?;
            let line = line_of(record.position());
            if record.len() != header.len() {
                return Err(InputError::new(path, "the row does not have one cell for each column")
                    .line(line)
                    .found(format!("{} cells", record.len()))
                    .expected(format!("{} cells", header.len())));
            }
            rows.push((line, record));
        }
        Ok(Self {
            file: path.to_path_buf(),
            columns: header.iter().map(str::to_owned).collect(),
            index,
            rows,
        })
    }

    /// The file the table came from.
    pub fn file(&self) -> &Path {
        &self.file
    }

    /// Column names, in the file's order.
    pub fn columns(&self) -> &[String] {
        &self.columns
    }

    /// Whether a column is there.
    pub fn has(&self, column: &str) -> bool {
        self.index.contains_key(column)
    }

    /// Number of data rows.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Whether there are no data rows.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// The line in the file on which data row `row` stands.
    pub fn line(&self, row: usize) -> usize {
        self.rows[row].0
    }

    /// An error unless all of `columns` are present; suggests the nearest column there is.
    pub fn require(&self, columns: &[&str]) -> Result<(), InputError> {
        let missing: Vec<&str> = columns.iter().copied().filter(|column| !self.has(column)).collect();
        let Some(first) = missing.first() else { return Ok(()) };
        let named: Vec<String> = missing.iter().map(|column| format!("`{column}`")).collect();
        let problem = match missing.len() {
            1 => format!("column {} is missing", named[0]),
            _ => format!("columns {} are missing", named.join(", ")),
        };
        // A column that is wanted as it stands is no slip of the pen for another.
        let strangers = self.columns.iter().map(String::as_str).filter(|column| !columns.contains(column));
        let help = match nearest(first, strangers) {
            Some(near) => format!("is `{near}` meant to be `{first}`?"),
            None => format!("add {}", named.join(", ")),
        };
        Err(InputError::new(&self.file, problem)
            .found(format!("columns {}", self.columns.join(", ")))
            .help(help))
    }

    /// The text of a cell; empty where the column is absent.
    pub fn text(&self, row: usize, column: &str) -> &str {
        self.index.get(column).and_then(|&i| self.rows[row].1.get(i)).unwrap_or("")
    }

    /// A finite number, `None` for an empty cell (not measured) or an absent column.
    ///
    /// # Errors
    /// The cell holds something that is not a finite number.
    pub fn number_or_empty(&self, row: usize, column: &str) -> Result<Option<f64>, InputError> {
        let text = self.text(row, column);
        if text.is_empty() {
            return Ok(None);
        }
        match text.parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(Some(value)),
            _ => Err(InputError::new(&self.file, "the cell is not a finite number")
                .cell(self.line(row), column)
                .found(format!("`{text}`"))
                .expected("a number such as 1.25 or -3e5")),
        }
    }

    /// A finite number that must be there.
    ///
    /// # Errors
    /// As [`Table::number_or_empty`], and an empty cell.
    pub fn number(&self, row: usize, column: &str) -> Result<f64, InputError> {
        self.number_or_empty(row, column)?.ok_or_else(|| {
            InputError::new(&self.file, "the cell is empty").cell(self.line(row), column).expected("a number")
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Table, InputError> {
        Table::parse(Path::new("t.csv"), text)
    }

    #[test]
    fn cells_are_read_by_name_and_lines_are_the_files_own() {
        let table = parse("# note\na, b\n1, 2\n# note\n3,\n").unwrap();
        assert_eq!((table.len(), table.line(0), table.line(1)), (2, 3, 5));
        assert_eq!(table.number(0, "b").unwrap(), 2.0);
        assert_eq!(table.number_or_empty(1, "b").unwrap(), None);
        assert!(table.number(1, "b").unwrap_err().to_string().contains("line 5, column `b`"));
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        assert!(parse("").unwrap_err().to_string().contains("no table"));
        assert!(parse("a,a\n1,2\n").unwrap_err().to_string().contains("named twice"));
        assert!(parse("a,b\n1\n").unwrap_err().to_string().contains("line 2"));
        for bad in ["nan", "inf", "-inf", "x", "1e999"] {
            let table = parse(&format!("a,b\n{bad},2\n")).unwrap();
            assert!(table.number(0, "a").unwrap_err().to_string().contains(bad));
        }
        let error = parse("camera_x,b\n1,2\n").unwrap().require(&["camera_x_m"]).unwrap_err();
        assert!(error.help.unwrap().contains("`camera_x`"));
    }
}
