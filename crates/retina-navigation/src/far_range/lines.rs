//! Results kept as lines of a file: what was finished is not done again.

use std::collections::BTreeMap;
use std::fs::OpenOptions;
use std::io::Write as _;
use std::path::Path;

use retina_files::{InputError, read_text, write_atomic};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};

use super::poses::FarRangeError;

/// A line of a list.
pub(super) trait Line: Serialize + DeserializeOwned {
    /// Schema of the list.
    const SCHEMA: &str;
    /// What the lines are, in the plural.
    const WHAT: &str;
    /// Number of what the line is about.
    fn number(&self) -> usize;
}

fn cannot(path: &Path, error: std::io::Error) -> InputError {
    InputError::new(path, format!("cannot be written: {error}"))
}

/// The lines that are there; the list is begun where there is none, its first line holding the hash of all that
/// decides a result. A last line that was cut short is left out.
///
/// # Errors
/// The list is of another scenario, or cannot be read or written.
pub(super) fn read_done<T: Line>(path: &Path, hash: &str) -> Result<BTreeMap<usize, T>, InputError> {
    let header = json!({"schema": T::SCHEMA, "scenario": hash});
    if !path.exists() {
        write_atomic(path, format!("{header}\n").as_bytes()).map_err(|error| cannot(path, error))?;
        return Ok(BTreeMap::new());
    }
    let text = read_text(path)?;
    let found: Option<Value> = text.lines().next().and_then(|line| serde_json::from_str(line).ok());
    if found.as_ref() != Some(&header) {
        return Err(InputError::new(path, format!("the folder holds {} of another scenario", T::WHAT))
            .line(1)
            .help("give --out another folder, or take this one away"));
    }
    let whole = if text.ends_with('\n') { usize::MAX } else { text.lines().count() - 1 };
    let mut done = BTreeMap::new();
    let mut kept = format!("{header}\n");
    for (number, line) in text.lines().enumerate().skip(1).take_while(|(number, _)| *number < whole) {
        let result: T = serde_json::from_str(line).map_err(|error| {
            InputError::new(path, format!("is not a result among {}: {error}", T::WHAT)).line(number + 1)
        })?;
        kept.push_str(line);
        kept.push('\n');
        done.insert(result.number(), result);
    }
    if whole != usize::MAX {
        write_atomic(path, kept.as_bytes()).map_err(|error| cannot(path, error))?;
    }
    Ok(done)
}

/// Adds lines to the list.
///
/// # Errors
/// It cannot be written.
pub(super) fn append<T: Line>(path: &Path, results: &[T]) -> Result<(), FarRangeError> {
    let mut text = String::new();
    for result in results {
        text.push_str(&serde_json::to_string(result).map_err(|error| FarRangeError::Sky(error.to_string()))?);
        text.push('\n');
    }
    let mut file = OpenOptions::new().append(true).open(path).map_err(|error| cannot(path, error))?;
    file.write_all(text.as_bytes()).map_err(|error| cannot(path, error))?;
    Ok(())
}
