//! The error for input that does not fit.

use std::fmt;
use std::path::{Path, PathBuf};

use crate::shorten::shortened;

/// Where in a file the trouble lies.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Place {
    /// The file as a whole.
    File,
    /// A line, counted from 1.
    Line(usize),
    /// A line and a column of text, both counted from 1.
    LineColumn(usize, usize),
    /// A cell of a table: line counted from 1, and the column's name.
    Cell(usize, String),
    /// A key, an accessor, a mesh: whatever name the file's own format gives the place.
    Named(String),
}

/// The file's text with the span to underline, for errors shown to a person; long lines are cut.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Snippet {
    /// The text.
    pub text: String,
    /// Byte offset of the span.
    pub offset: usize,
    /// Length of the span, bytes.
    pub length: usize,
}

/// Input that does not fit: what, where, found, expected, and the mend. Long values are cut, their length said.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct InputError {
    /// The file (or argument) it was found in.
    pub file: PathBuf,
    /// The place within the file.
    pub place: Place,
    /// What is wrong, one sentence without a full stop.
    pub problem: String,
    /// The value found.
    pub found: Option<String>,
    /// What was expected in its stead.
    pub expected: Option<String>,
    /// How to mend it.
    pub help: Option<String>,
    /// The text to show, where the file is text.
    pub snippet: Option<Snippet>,
}

impl InputError {
    /// An error about a whole file; the methods below narrow it down.
    pub fn new(file: impl AsRef<Path>, problem: impl Into<String>) -> Self {
        Self {
            file: file.as_ref().to_path_buf(),
            place: Place::File,
            problem: shortened(problem.into()),
            found: None,
            expected: None,
            help: None,
            snippet: None,
        }
    }

    /// At this line (from 1).
    pub fn line(mut self, line: usize) -> Self {
        self.place = Place::Line(line);
        self
    }

    /// In this cell of a table (line from 1, column name).
    pub fn cell(mut self, line: usize, column: impl Into<String>) -> Self {
        self.place = Place::Cell(line, shortened(column.into()));
        self
    }

    /// At this key or named part.
    pub fn at(mut self, name: impl Into<String>) -> Self {
        self.place = Place::Named(shortened(name.into()));
        self
    }

    /// The value found.
    pub fn found(mut self, found: impl fmt::Display) -> Self {
        self.found = Some(shortened(found.to_string()));
        self
    }

    /// What was expected.
    pub fn expected(mut self, expected: impl fmt::Display) -> Self {
        self.expected = Some(shortened(expected.to_string()));
        self
    }

    /// Says which key of which file named the file that this is about.
    pub fn named_by(mut self, file: &Path, key: &str) -> Self {
        let named = format!("it is named by the key `{key}` of {}", file.display());
        self.help = Some(self.help.map_or_else(|| named.clone(), |help| format!("{help}; {named}")));
        self
    }

    /// How to mend it.
    pub fn help(mut self, help: impl fmt::Display) -> Self {
        self.help = Some(shortened(help.to_string()));
        self
    }
}

impl fmt::Display for InputError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.file.display())?;
        match &self.place {
            Place::File => {}
            Place::Line(line) => write!(f, ", line {line}")?,
            Place::LineColumn(line, column) => write!(f, ", line {line}, column {column}")?,
            Place::Cell(line, column) => write!(f, ", line {line}, column `{column}`")?,
            Place::Named(name) => write!(f, ", {name}")?,
        }
        write!(f, ": {}", self.problem)?;
        match (&self.found, &self.expected) {
            (Some(found), Some(expected)) => write!(f, " (found {found}, expected {expected})"),
            (Some(found), None) => write!(f, " (found {found})"),
            (None, Some(expected)) => write!(f, " (expected {expected})"),
            (None, None) => Ok(()),
        }
    }
}

impl std::error::Error for InputError {}
