//! Errors as the user sees them.

use std::fmt;
use std::io::{IsTerminal as _, Write as _};

use miette::{Diagnostic, LabeledSpan, MietteHandlerOpts, NamedSource, ReportHandler, SourceCode};
use retina::gige::GigeError;
use retina::lab::LabError;
use retina_batch::BatchError;
use retina_bench::BenchError;
use retina_files::{InputError, Place};
use retina_render::RenderError;
use serde_json::{Value, json};

/// What ends the command with exit code 2, or 1 where all was done and a tolerance is exceeded.
pub(crate) struct Failure {
    exit_code: u8,
    message: String,
    help: Option<String>,
    source: Option<NamedSource<String>>,
    span: Option<(usize, usize)>,
    /// Where the input does not fit, for programs.
    input: Option<Value>,
}

impl Failure {
    /// A failure that is no input's fault.
    pub(crate) fn new(message: impl Into<String>) -> Self {
        Self { exit_code: 2, message: message.into(), help: None, source: None, span: None, input: None }
    }

    /// All is done and written, but a tolerance that the caller asked for is exceeded.
    pub(crate) fn exceeded(message: impl Into<String>) -> Self {
        Self { exit_code: 1, ..Self::new(message) }
    }

    /// The command's exit code.
    pub(crate) fn exit_code(&self) -> u8 {
        self.exit_code
    }

    /// The failure for programs, schema `retina.error/1`.
    pub(crate) fn document(&self) -> Value {
        json!({
            "schema": "retina.error/1",
            "exit_code": self.exit_code,
            "message": self.message,
            "help": self.help,
            "input": self.input,
        })
    }

    /// Prints the error to standard error, with the place in the file underlined where it has one.
    pub(crate) fn show(&self) {
        let terminal = std::io::stderr().is_terminal();
        // Lines are not wrapped: paths stay whole, so that they can be copied and searched for.
        let handler = MietteHandlerOpts::new()
            .color(terminal)
            .unicode(terminal)
            .terminal_links(false)
            .wrap_lines(false)
            .build();
        // Where standard error is closed the exit code alone speaks.
        let _ = write!(std::io::stderr(), "{:?}", Shown { failure: self, handler: &handler });
    }
}

impl From<InputError> for Failure {
    fn from(error: InputError) -> Self {
        let message = error.to_string();
        let input = Some(input_json(&error));
        let (source, span) = match error.snippet {
            Some(snippet) => {
                // A span at the very end of the text is moved onto it, where it can be shown.
                let offset = snippet.offset.min(snippet.text.len());
                let length = snippet.length.min(snippet.text.len() - offset);
                let name = error.file.display().to_string();
                (Some(NamedSource::new(name, snippet.text)), Some((offset, length)))
            }
            None => (None, None),
        };
        Self { exit_code: 2, message, help: error.help, source, span, input }
    }
}

/// Input that does not fit: which, where, what is wrong, what was found and expected.
pub(crate) fn input_json(error: &InputError) -> Value {
    let (mut line, mut column, mut name) = (None, None, None);
    match &error.place {
        Place::File => {}
        Place::Line(at) => line = Some(*at),
        Place::LineColumn(at, character) => (line, column) = (Some(*at), Some(json!(character))),
        Place::Cell(at, title) => (line, column) = (Some(*at), Some(json!(title))),
        Place::Named(text) => name = Some(text),
    }
    json!({
        "file": error.file,
        "line": line,
        "column": column,
        "place": name,
        "problem": error.problem,
        "found": error.found,
        "expected": error.expected,
        "help": error.help,
    })
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

impl From<LabError> for Failure {
    fn from(error: LabError) -> Self {
        match error {
            LabError::Input(error) => error.into(),
            LabError::Bench(error) => error.into(),
            error => Self::new(error.to_string()),
        }
    }
}

impl From<GigeError> for Failure {
    fn from(error: GigeError) -> Self {
        let help = match &error {
            GigeError::InUse { .. } => {
                "end the other one, or give --interface another address of this machine"
            }
            GigeError::Socket { .. } => "give --interface an address of this machine",
        };
        Self { help: Some(help.into()), ..Self::new(error.to_string()) }
    }
}

impl From<RenderError> for Failure {
    fn from(error: RenderError) -> Self {
        let help = matches!(error, RenderError::NoAdapter(_) | RenderError::TooLarge { .. })
            .then(|| "--backend native renders without a graphics adapter".to_owned());
        Self { help, ..Self::new(error.to_string()) }
    }
}

struct Shown<'a, H> {
    failure: &'a Failure,
    handler: &'a H,
}

impl<H: ReportHandler> fmt::Debug for Shown<'_, H> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.handler.debug(self.failure, f)
    }
}

impl fmt::Debug for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for Failure {}

impl Diagnostic for Failure {
    fn help<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        self.help.as_ref().map(|help| Box::new(help) as Box<dyn fmt::Display>)
    }

    fn source_code(&self) -> Option<&dyn SourceCode> {
        self.source.as_ref().map(|source| source as &dyn SourceCode)
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        let span = self.span?;
        Some(Box::new(std::iter::once(LabeledSpan::new_with_span(Some("here".into()), span))))
    }
}
