//! One exception for all that goes wrong: `retina.RetinaError`, with what, where, found, expected and the mend.

use std::path::PathBuf;

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyDict;
use retina::batch::BatchError;
use retina::bench::BenchError;
use retina::files::{InputError, Place};
use retina::navigation::limb::BodyError;
use retina::optics::OpticsError;
use retina::render::RenderError;
use retina::sky::ephemeris::EphemerisError;
use retina::sky::observer::ObserverError;
use retina::sky::time::EpochError;

/// What becomes a `RetinaError`.
#[derive(Debug, Default)]
pub(crate) struct Failure {
    problem: String,
    file: Option<PathBuf>,
    place: Option<String>,
    line: Option<usize>,
    found: Option<String>,
    expected: Option<String>,
    help: Option<String>,
}

impl Failure {
    /// One that is no input's fault.
    pub(crate) fn new(problem: impl Into<String>) -> Self {
        Self { problem: problem.into(), ..Self::default() }
    }

    /// An argument that does not fit.
    pub(crate) fn argument(name: &str, problem: &str, found: impl std::fmt::Display, expected: &str) -> Self {
        Self {
            problem: problem.to_owned(),
            place: Some(format!("argument `{name}`")),
            found: Some(found.to_string()),
            expected: Some(expected.to_owned()),
            ..Self::default()
        }
    }

    pub(crate) fn with_help(mut self, help: &str) -> Self {
        self.help = Some(help.to_owned());
        self
    }
}

impl From<InputError> for Failure {
    fn from(error: InputError) -> Self {
        let line = match error.place {
            Place::Line(line) | Place::LineColumn(line, _) | Place::Cell(line, _) => Some(line),
            Place::File | Place::Named(_) => None,
        };
        let place = match error.place {
            Place::File => None,
            Place::Line(line) => Some(format!("line {line}")),
            Place::LineColumn(line, column) => Some(format!("line {line}, column {column}")),
            Place::Cell(line, column) => Some(format!("line {line}, column `{column}`")),
            Place::Named(name) => Some(name),
        };
        let argument = error.file.to_str().and_then(argument_of);
        let (file, place) = match argument {
            None => (Some(error.file), place),
            Some(name) => {
                let rest = place.map_or_else(String::new, |place| format!(", {place}"));
                (None, Some(format!("argument `{name}`{rest}")))
            }
        };
        let named = |text: Option<String>| text.map(|text| python_names(&text));
        Self {
            problem: python_names(&error.problem),
            file,
            place,
            line,
            found: error.found,
            expected: named(error.expected),
            help: named(error.help),
        }
    }
}

impl From<RenderError> for Failure {
    fn from(error: RenderError) -> Self {
        let help = matches!(error, RenderError::NoAdapter(_) | RenderError::TooLarge { .. });
        let failure = Self::new(python_names(&error.to_string()));
        if help {
            failure.with_help("backend=\"native\" renders without a graphics adapter")
        } else {
            failure
        }
    }
}

impl From<BatchError> for Failure {
    fn from(error: BatchError) -> Self {
        match error {
            BatchError::Input(error) => error.into(),
            BatchError::Render(error) => error.into(),
            error => Self::new(error.to_string()),
        }
    }
}

impl From<BenchError> for Failure {
    fn from(error: BenchError) -> Self {
        match error {
            BenchError::Input(error) => error.into(),
            error => Self::new(error.to_string()),
        }
    }
}

macro_rules! by_its_text {
    ($($error:ty),*) => {
        $(impl From<$error> for Failure {
            fn from(error: $error) -> Self {
                Self::new(python_names(&error.to_string()))
            }
        })*
    };
}
by_its_text!(OpticsError, EphemerisError, ObserverError, EpochError);

impl From<BodyError> for Failure {
    fn from(error: BodyError) -> Self {
        match error {
            BodyError::Mesh(error) => error.into(),
            error => Self { problem: error.to_string(), ..Self::default() },
        }
    }
}

impl From<Failure> for PyErr {
    fn from(failure: Failure) -> Self {
        Python::attach(|py| match exception(py, &failure) {
            Ok(error) => error,
            // The package is damaged: what went wrong is still told.
            Err(_) => PyRuntimeError::new_err(failure.problem),
        })
    }
}

fn exception(py: Python<'_>, failure: &Failure) -> PyResult<PyErr> {
    static CLASS: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    let class = CLASS.import(py, "retina._errors", "RetinaError")?;
    let fields = PyDict::new(py);
    fields.set_item("file", failure.file.as_ref().map(|file| file.display().to_string()))?;
    fields.set_item("place", &failure.place)?;
    fields.set_item("line", failure.line)?;
    fields.set_item("found", &failure.found)?;
    fields.set_item("expected", &failure.expected)?;
    fields.set_item("help", &failure.help)?;
    Ok(PyErr::from_value(class.call((&failure.problem,), Some(&fields))?))
}

/// The argument that is meant where an error is about no file: the libraries have the command's flag there, and what
/// this module gives them in memory stands in angle brackets.
fn argument_of(file: &str) -> Option<String> {
    match file.strip_prefix('<').and_then(|name| name.strip_suffix('>')) {
        Some(name) => Some(name.to_owned()),
        None => file.strip_prefix("--").map(argument_name),
    }
}

/// The keyword that a flag is in Python: `sun-deg` is `sun_deg`.
fn argument_name(flag: &str) -> String {
    flag.replace('-', "_")
}

/// A text of the libraries with the command's flags as Python's keywords. Whole commands stay as they are.
pub(crate) fn python_names(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for (at, part) in text.split('`').enumerate() {
        if at > 0 {
            out.push('`');
        }
        let command = at % 2 == 1 && part.starts_with("retina ");
        if command { out.push_str(part) } else { rename_flags(part, &mut out) }
    }
    out
}

fn rename_flags(text: &str, out: &mut String) {
    let mut rest = text;
    while let Some(at) = rest.find("--") {
        let (before, from) = rest.split_at(at);
        let flag = &from[2..];
        let end = flag.find(|c: char| !(c.is_ascii_lowercase() || c == '-')).unwrap_or(flag.len());
        out.push_str(before);
        // A dash between words is no flag.
        if end == 0 || before.ends_with(|c: char| c.is_alphanumeric()) {
            out.push_str("--");
            rest = flag;
            continue;
        }
        out.push_str(&argument_name(&flag[..end]));
        rest = &flag[end..];
    }
    out.push_str(rest);
}
