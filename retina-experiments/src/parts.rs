//! Parts of an experiment's frames, made by tasks on any machines, and joined.
//!
//! Part `I/N` has the frames at the places I, I + N, I + 2N, ... of the scenario's own. Its screens and photographs lie in
//! `parts/I-of-N/` of the results' folder; its lists lie beside those of the whole, which reads them.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use retina_batch::{FolderState, FrameRange, Selection, Shard};
use retina_campaign::torn_frames;
use retina_files::InputError;

/// The folder of all parts.
const PARTS: &str = "parts";

/// Where a part's screens and photographs lie.
pub(crate) fn part_folder(out: &Path, part: Shard) -> PathBuf {
    out.join(PARTS).join(format!("{}-of-{}", part.index, part.count))
}

/// The folders in which a part's files change while it is at work; those of them that are there tell when it last was.
pub fn busy_folders(out: &Path, part: Shard) -> Vec<PathBuf> {
    let folder = part_folder(out, part);
    let below = |kind: &str| std::fs::read_dir(folder.join(kind)).into_iter().flatten().flatten();
    let screens = below("screen").map(|entry| entry.path().join("manifest.jsonl"));
    screens.chain(below("bench").map(|entry| entry.path().join("images"))).collect()
}

/// Frames of a part whose screens or photographs are not what they were when they were made, by name.
///
/// # Errors
/// A folder of the part cannot be read.
pub fn torn_in_part(out: &Path, part: Shard) -> Result<BTreeSet<String>, InputError> {
    let folder = part_folder(out, part);
    let below = |kind: &str| {
        std::fs::read_dir(folder.join(kind)).into_iter().flatten().flatten().map(|entry| entry.path())
    };
    let mut torn = BTreeSet::new();
    for screens in below("screen") {
        if let Some(state) = FolderState::read(&screens, true)? {
            torn.extend(state.torn.iter().map(|frame| format!("{frame:06}.png")));
        }
    }
    for photographs in below("bench") {
        torn.extend(torn_frames(&photographs)?);
    }
    Ok(torn)
}

/// The parts that have begun, in the order of their numbers.
pub(crate) fn parts(out: &Path) -> Vec<(Shard, PathBuf)> {
    let Ok(entries) = std::fs::read_dir(out.join(PARTS)) else { return Vec::new() };
    let part = |name: &str| {
        let (index, count) = name.split_once("-of-")?;
        format!("{index}/{count}").parse::<Shard>().ok()
    };
    let mut found: Vec<(Shard, PathBuf)> = entries
        .filter_map(|entry| entry.ok().map(|entry| entry.path()))
        .filter_map(|path| Some((part(path.file_name()?.to_str()?)?, path)))
        .collect();
    found.sort_by_key(|(part, _)| (part.count, part.index));
    found
}

/// The folders among these that hold a finished frame.
///
/// # Errors
/// One of them cannot be read.
pub(crate) fn begun(folders: Vec<PathBuf>) -> Result<Vec<PathBuf>, InputError> {
    let mut found = Vec::new();
    for folder in folders {
        if FolderState::read(&folder, false)?.is_some_and(|state| !state.done.is_empty()) {
            found.push(folder);
        }
    }
    Ok(found)
}

/// The frames of a part as a selection of their own, and their places among the scenario's.
///
/// # Errors
/// The selection does not fit the scene, or the part has no frame.
pub(crate) fn part_of(
    selection: Selection,
    part: Shard,
    frame_count: usize,
) -> Result<(Selection, Vec<usize>), InputError> {
    let all = selection.frames(frame_count)?;
    let places: Vec<usize> = (part.index..all.len()).step_by(part.count).collect();
    let Some(&first) = places.first() else {
        return Err(InputError::new(Path::new("--shard"), "contains no frame")
            .found(format!("part {} of {}", part.index, part.count))
            .expected(format!("at most as many parts as the scenario's {} frames", all.len())));
    };
    let range = FrameRange { first: all[first], end: all.last().map(|last| last + 1) };
    let every = selection.every.unwrap_or(1).saturating_mul(part.count);
    Ok((Selection { range: Some(range), every: Some(every), shard: None }, places))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_have_each_frame_once_and_know_its_place() {
        let all = Selection { range: "3..40".parse().ok(), every: Some(4), shard: None };
        let frames = all.frames(50).unwrap();
        // A step and a number of parts with a factor in common.
        for count in [1, 2, 4, 7, 10] {
            let mut found = Vec::new();
            for index in 0..count {
                let (own, places) = part_of(all, Shard { index, count }, 50).unwrap();
                let own = own.frames(50).unwrap();
                assert_eq!(own, places.iter().map(|&place| frames[place]).collect::<Vec<_>>());
                found.extend(own);
            }
            found.sort_unstable();
            assert_eq!(found, frames, "{count}");
        }
        let error = part_of(all, Shard { index: 10, count: 11 }, 50).unwrap_err().to_string();
        assert!(error.contains("the scenario's 10 frames"), "{error}");
    }
}
