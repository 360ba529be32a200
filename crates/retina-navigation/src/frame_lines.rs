//! Results frame by frame, kept as lines of a file: what was finished is not done again.

use std::collections::BTreeMap;
use std::fs::OpenOptions;
use std::io::Write as _;
use std::path::Path;

use rayon::prelude::*;
use retina_files::{InputError, read_text, write_atomic};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};

use crate::full_disk::Source;

/// Frames between two writes of the list.
const CHUNK: usize = 8;

/// What one frame gave: a line of the list.
pub(crate) trait FrameLine: Serialize + DeserializeOwned + Send {
    /// The frame's number.
    fn frame(&self) -> usize;
    /// Hash of its image and truth.
    fn inputs(&self) -> &str;
}

/// Measures the frames of a source that are not yet in `list`, and returns all of them in order; without a list nothing
/// is kept. The list's first line holds `schema` and `sequence`, the hash of all that decides a result besides the
/// frame's own files. `progress` hears how many are done.
///
/// # Errors
/// A frame does not fit; the list is another sequence's or cannot be written.
pub(crate) fn measure_frames<T: FrameLine>(
    source: &Source,
    (schema, sequence): (&str, &str),
    list: Option<&Path>,
    measure: impl Fn(usize) -> Result<T, InputError> + Sync,
    progress: &mut dyn FnMut(usize),
) -> Result<Vec<T>, InputError> {
    let header = json!({"schema": schema, "sequence": sequence});
    let mut done = list.map_or(Ok(BTreeMap::new()), |list| read_done::<T>(list, &header))?;
    let mut missing = Vec::new();
    for &frame in &source.frames {
        let same = match done.get(&frame) {
            Some(result) => result.inputs() == source.frame_hash(frame)?,
            None => false,
        };
        if !same {
            missing.push(frame);
        }
    }
    progress(source.frames.len() - missing.len());
    let mut finished = source.frames.len() - missing.len();
    for chunk in missing.chunks(CHUNK) {
        let results: Vec<T> = chunk.par_iter().map(|&frame| measure(frame)).collect::<Result<_, _>>()?;
        let mut text = String::new();
        for result in results {
            text.push_str(&line(&result));
            done.insert(result.frame(), result);
        }
        if let Some(list) = list {
            let cannot = |error: std::io::Error| InputError::new(list, format!("cannot be written: {error}"));
            let mut file = OpenOptions::new().append(true).open(list).map_err(cannot)?;
            file.write_all(text.as_bytes()).map_err(cannot)?;
        }
        finished += chunk.len();
        progress(finished);
    }
    Ok(source.frames.iter().filter_map(|frame| done.remove(frame)).collect())
}

fn line<T: FrameLine>(result: &T) -> String {
    // A number that is not finite becomes `null`; none of them is one where there is a result.
    serde_json::to_string(result).map(|text| text + "\n").unwrap_or_default()
}

/// The frames that are done; the list is begun where there is none. A last line that was cut short is left out, and so
/// are frames that were measured twice but for the last.
fn read_done<T: FrameLine>(path: &Path, header: &Value) -> Result<BTreeMap<usize, T>, InputError> {
    let cannot = |error: std::io::Error| InputError::new(path, format!("cannot be written: {error}"));
    if !path.exists() {
        write_atomic(path, format!("{header}\n").as_bytes()).map_err(cannot)?;
        return Ok(BTreeMap::new());
    }
    let text = read_text(path)?;
    let found: Option<Value> = text.lines().next().and_then(|line| serde_json::from_str(line).ok());
    if found.as_ref() != Some(header) {
        return Err(InputError::new(
            path,
            "the folder holds frames of another sequence, or measured otherwise",
        )
        .line(1)
        .help("give --out another folder, or take this one away"));
    }
    let whole = if text.ends_with('\n') { usize::MAX } else { text.lines().count() - 1 };
    let mut done = BTreeMap::new();
    for (number, line) in text.lines().enumerate().skip(1).take_while(|(number, _)| *number < whole) {
        let result: T = serde_json::from_str(line).map_err(|error| {
            InputError::new(path, format!("is not a frame's result: {error}")).line(number + 1)
        })?;
        done.insert(result.frame(), result);
    }
    if whole != usize::MAX {
        let kept: String = done.values().map(line).collect();
        write_atomic(path, format!("{header}\n{kept}").as_bytes()).map_err(cannot)?;
    }
    Ok(done)
}
