//! How far a folder of frames is.

use std::fs;
use std::path::Path;
use std::time::SystemTime;

use rayon::prelude::*;
use retina_files::InputError;

use crate::folder::{Folder, ManifestLine, frame_file};

/// What a folder of frames holds.
#[derive(Debug, Clone, PartialEq)]
pub struct FolderState {
    /// Frames of the whole sequence, whatever part of it the folder is to hold.
    pub frames_of_sequence: usize,
    /// Frames whose files are all there, rising.
    pub done: Vec<usize>,
    /// Frames that the manifest names and whose files are not all there, or not what it says, rising.
    pub torn: Vec<usize>,
    /// A run on this machine is at work in it.
    pub in_use: bool,
    /// When the last frame was finished.
    pub last_finished: Option<SystemTime>,
    /// Median time between frames' ends, s: waiting between two runs does not count.
    pub seconds_per_frame: Option<f64>,
}

impl FolderState {
    /// Reads a folder that `retina render` or `retina merge` wrote; `None` where nothing was begun. With `verify` every file
    /// is held to its hash, else it only has to be there and not empty.
    ///
    /// # Errors
    /// It is no folder of frames, or its manifest cannot be read.
    pub fn read(dir: &Path, verify: bool) -> Result<Option<Self>, InputError> {
        let folder = Folder::at(dir);
        let Some(record) = folder.record()? else { return Ok(None) };
        let lines: Vec<ManifestLine> =
            folder.manifest()?.into_values().filter(|line| line.index < record.frames).collect();
        let whole = |line: &ManifestLine| match verify {
            true => folder.torn_file(line).is_none(),
            false => line.outputs.keys().all(|file| {
                fs::metadata(dir.join(file)).is_ok_and(|found| found.is_file() && found.len() > 0)
            }),
        };
        let mut found: Vec<(usize, bool)> = lines.par_iter().map(|line| (line.index, whole(line))).collect();
        found.sort_unstable();
        let of = |wanted: bool| {
            found.iter().filter(|(_, whole)| *whole == wanted).map(|(index, _)| *index).collect()
        };
        let (done, torn): (Vec<usize>, Vec<usize>) = (of(true), of(false));
        let mut ends: Vec<SystemTime> = done
            .iter()
            .filter_map(|index| {
                fs::metadata(dir.join(frame_file("frames", *index, "png"))).ok()?.modified().ok()
            })
            .collect();
        ends.sort_unstable();
        let mut between: Vec<f64> = ends
            .windows(2)
            .filter_map(|pair| Some(pair[1].duration_since(pair[0]).ok()?.as_secs_f64()))
            .collect();
        between.sort_by(f64::total_cmp);
        Ok(Some(Self {
            frames_of_sequence: record.frames,
            done,
            torn,
            in_use: folder.is_in_use(),
            last_finished: ends.last().copied(),
            seconds_per_frame: between.get(between.len() / 2).copied(),
        }))
    }
}
