//! Standard output and standard error.
//!
//! A result that cannot be written is a failure, except where its reader has gone away. What is told on
//! standard error is told to nobody where that cannot be written: the run goes on.

use std::fmt;
use std::io::{self, ErrorKind, Write};
use std::sync::atomic::{AtomicBool, Ordering};

use crate::failure::Failure;

/// Tells the user something on standard error, with the command's name before it.
macro_rules! tell {
    ($($text:tt)*) => {
        $crate::output::tell_line(format_args!($($text)*))
    };
}
pub(crate) use tell;

/// Whether only errors are told (`--quiet`).
static QUIET: AtomicBool = AtomicBool::new(false);

/// Has only errors told from here on.
pub(crate) fn be_quiet(quiet: bool) {
    QUIET.store(quiet, Ordering::Relaxed);
}

/// Whether standard error is a terminal on which progress is to be drawn.
pub(crate) fn shows_progress() -> bool {
    use io::IsTerminal as _;
    !QUIET.load(Ordering::Relaxed) && io::stderr().is_terminal()
}

/// A line on standard error, as [`tell!`] writes it; none if the user wants errors only.
pub(crate) fn tell_line(text: fmt::Arguments<'_>) {
    if !QUIET.load(Ordering::Relaxed) {
        tell_result(text);
    }
}

/// A line on standard error without which the command is of no use.
pub(crate) fn tell_result(text: fmt::Arguments<'_>) {
    // Where this fails there is nobody left to be told.
    let _ = writeln!(io::stderr(), "retina: {text}");
}

/// A document on standard output.
pub(crate) fn print_json(document: &serde_json::Value) -> Result<(), Failure> {
    print(format_args!("{document:#}\n"))
}

/// A document on one line of standard output, at once.
pub(crate) fn print_json_line(document: &serde_json::Value) -> Result<(), Failure> {
    print(format_args!("{document}\n"))
}

/// Lines of text on standard output.
pub(crate) fn print_lines(lines: &[String]) -> Result<(), Failure> {
    lines.iter().try_for_each(|line| print(format_args!("{line}\n")))
}

/// Text on standard output, as it is.
pub(crate) fn print_text(text: &str) -> Result<(), Failure> {
    print(format_args!("{text}"))
}

/// Whether anything was written to standard output.
static WRITTEN: AtomicBool = AtomicBool::new(false);

/// Whether standard output is still empty.
pub(crate) fn is_silent() -> bool {
    !WRITTEN.load(Ordering::Relaxed)
}

fn print(text: fmt::Arguments<'_>) -> Result<(), Failure> {
    WRITTEN.store(true, Ordering::Relaxed);
    let mut out = io::stdout().lock();
    of_writing(out.write_fmt(text).and_then(|()| out.flush()))
}

fn of_writing(result: io::Result<()>) -> Result<(), Failure> {
    match result {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            Err(Failure::new(format!("standard output cannot be written: {error}")))
        }
        _ => Ok(()),
    }
}
