//! Results of a rendered sequence, frame by frame, kept as lines of a file.

use std::collections::BTreeMap;
use std::path::Path;

use rayon::prelude::*;
use retina_files::InputError;

use crate::full_disk::Source;
use crate::lines::{Line, append, read_done};

/// Frames between two writes of the list.
const CHUNK: usize = 8;

/// What one frame gave; its number is the frame's.
pub(crate) trait FrameLine: Line + Send {
    /// Hash of its image and truth.
    fn inputs(&self) -> &str;
}

/// Measures the frames of a source that are not yet in `list`, and returns all of them in order; without a list nothing
/// is kept. `sequence` is the hash of all that decides a result besides the frame's own files. `progress` hears how many
/// are done.
///
/// # Errors
/// A frame does not fit; the list is another sequence's or cannot be written.
pub(crate) fn measure_frames<T: FrameLine>(
    source: &Source,
    sequence: &str,
    list: Option<&Path>,
    measure: impl Fn(usize) -> Result<T, InputError> + Sync,
    progress: &mut dyn FnMut(usize),
) -> Result<Vec<T>, InputError> {
    let mut done = list.map_or(Ok(BTreeMap::new()), |list| read_done::<T>(list, sequence))?;
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
    let mut finished = source.frames.len() - missing.len();
    progress(finished);
    for chunk in missing.chunks(CHUNK) {
        let results: Vec<T> = chunk.par_iter().map(|&frame| measure(frame)).collect::<Result<_, _>>()?;
        if let Some(list) = list {
            append(list, &results)?;
        }
        finished += results.len();
        done.extend(results.into_iter().map(|result| (result.number(), result)));
        progress(finished);
    }
    Ok(source.frames.iter().filter_map(|frame| done.remove(frame)).collect())
}
