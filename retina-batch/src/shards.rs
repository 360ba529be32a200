//! Folders of shards: made alike before they are rendered, and joined afterwards.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use retina_files::{InputError, hash_bytes, read_bytes, write_atomic};

use crate::folder::{Folder, ManifestLine, Record};
use crate::{Batch, BatchError, Observer, Progress, contact_sheet};

/// Frames that are joined between two reports of progress.
const CHUNK: usize = 256;

/// What a merge did.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Merged {
    /// The folder.
    pub dir: PathBuf,
    /// Frames brought into it.
    pub done: usize,
    /// Frames that were in it already.
    pub skipped: usize,
    /// Frames of the sequence that no shard has.
    pub missing: Vec<usize>,
    /// The contact sheet.
    pub contact_sheet: PathBuf,
}

impl Batch {
    /// Makes folders for shards of this run, each with the record of whose frames it will hold: the radiance scale is
    /// looked for once, and shards on different machines have the same. Gives the scale.
    ///
    /// # Errors
    /// A folder holds another scene's frames or cannot be made; the renderer cannot be opened.
    pub fn prepare(mut self, folders: &[PathBuf], observer: &mut dyn Observer) -> Result<f64, BatchError> {
        let mut found = None;
        for folder in folders {
            if let Some(record) = Folder::at(folder).record()? {
                let wanted = self.record(&record.backend, record.radiance_scale);
                Folder::at(folder).check_same(&record, &wanted)?;
                found = found.or(Some(record));
            }
        }
        let (source, radiance_scale) = self.open_source(found.as_ref(), observer)?;
        let record = self.record(source.name.backend, radiance_scale);
        for folder in folders {
            Folder::open(folder, &record, &self.kinds())?.close()?;
        }
        Ok(radiance_scale)
    }
}

/// Joins the folders of shards into one, as a single run would have left it but for the order of the manifest's lines,
/// which rise here. Every file is held to its hash. Frames that are in `out` already stay. Files are linked where the file
/// system allows it, and copied elsewhere.
///
/// # Errors
/// The folders do not hold frames of one scene, made alike; two hold different files of one frame; a file is not there or
/// not what its manifest says; frames are missing and `partial` is not set; a file cannot be written. Nothing is written
/// unless all is there.
pub fn merge_shards(
    folders: &[PathBuf],
    out: &Path,
    partial: bool,
    observer: &mut dyn Observer,
) -> Result<Merged, BatchError> {
    let (record, mut lines) = gather(folders)?;
    if partial {
        let torn: Vec<usize> = torn_files(&lines).into_iter().map(|(index, _)| index).collect();
        lines.retain(|index, _| !torn.contains(index));
    }
    let mut present: BTreeSet<usize> = lines.keys().copied().collect();
    // What an earlier merge brought in counts.
    let wanted = |line: &ManifestLine| line.outputs.keys().cloned().collect::<Vec<_>>();
    let earlier = Folder::at(out);
    if let Some(found) = earlier.record()? {
        earlier.check_same(&found, &record)?;
        let there = earlier.manifest()?;
        present.extend(
            there.values().filter(|line| earlier.is_whole(line, &wanted(line))).map(|line| line.index),
        );
    }
    let missing: Vec<usize> = (0..record.frames).filter(|index| !present.contains(index)).collect();
    if !missing.is_empty() && !partial {
        return Err(InputError::new(out, "frames are missing")
            .found(format!("{} of {} frames in {} folders", present.len(), record.frames, folders.len()))
            .expected(format!("frame {}, for one", missing[0]))
            .help("run the tasks that `retina status` names again, or add --partial to join what is there")
            .into());
    }
    if !partial {
        check_files(&lines)?;
    }
    let kinds: BTreeSet<String> = lines
        .values()
        .flat_map(|(_, line)| line.outputs.keys())
        .filter_map(|file| file.rsplit_once('/').map(|(folder, _)| folder.to_owned()))
        .collect();
    let target = Folder::open(out, &record, &kinds)?;
    let there = target.manifest()?;
    let to_do: Vec<(&PathBuf, &ManifestLine)> = lines
        .values()
        .filter(|(_, line)| there.get(&line.index) != Some(line) || !target.is_whole(line, &wanted(line)))
        .map(|(folder, line)| (*folder, line))
        .collect();
    let skipped = lines.len() - to_do.len();
    let mut done = 0;
    observer.progress(Progress { done, to_do: to_do.len(), skipped });
    for chunk in to_do.chunks(CHUNK) {
        chunk.par_iter().try_for_each(|(folder, line)| join(folder, line, out))?;
        for (_, line) in chunk {
            target.append(line)?;
        }
        done += chunk.len();
        observer.progress(Progress { done, to_do: to_do.len(), skipped });
    }
    target.sort_manifest()?;
    target.close()?;
    let contact_sheet = contact_sheet(out)?;
    Ok(Merged { dir: out.to_path_buf(), done, skipped, missing, contact_sheet })
}

type Lines<'a> = BTreeMap<usize, (&'a PathBuf, ManifestLine)>;

/// The frames of all folders, and whose they are.
fn gather(folders: &[PathBuf]) -> Result<(Record, Lines<'_>), InputError> {
    let mut whose: Option<Record> = None;
    let mut lines: Lines<'_> = BTreeMap::new();
    for dir in folders {
        let folder = Folder::at(dir);
        let record = folder.record()?.ok_or_else(|| {
            InputError::new(dir, "holds no frames of a run")
                .expected("a folder that `retina render` or `retina plan` made")
        })?;
        match &whose {
            None => whose = Some(record.clone()),
            Some(first) => folder.check_same(&record, first)?,
        }
        for (index, line) in folder.manifest()? {
            if index >= record.frames {
                return Err(InputError::new(dir, format!("its manifest has a frame {index}"))
                    .expected(format!("frames below {}, as many as the sequence has", record.frames)));
            }
            if let Some((other, known)) = lines.get(&index)
                && known.outputs != line.outputs
            {
                return Err(InputError::new(
                    dir,
                    format!("frame {index} differs from that in {}", other.display()),
                )
                .help("the two were made by different adapters or versions: make one of them again"));
            }
            lines.insert(index, (dir, line));
        }
    }
    let record = whose.ok_or_else(|| InputError::new("retina merge", "no folder is given"))?;
    Ok((record, lines))
}

/// Frames with a file that is not there as its manifest says, rising, and the file.
fn torn_files(lines: &Lines<'_>) -> Vec<(usize, PathBuf)> {
    let mut torn: Vec<(usize, PathBuf)> = lines
        .par_iter()
        .filter_map(|(index, (dir, line))| Some((*index, Folder::at(dir).torn_file(line)?)))
        .collect();
    torn.sort();
    torn
}

/// Every file is there, with the content that its manifest says.
fn check_files(lines: &Lines<'_>) -> Result<(), InputError> {
    let torn = torn_files(lines);
    match torn.first() {
        None => Ok(()),
        Some((index, file)) => Err(InputError::new(
            file,
            format!(
                "is missing, or is not what its manifest says; {} frames have such files, the first is frame {index}",
                torn.len()
            ),
        )
        .help("run the shard's task again: it makes what is torn anew")),
    }
}

/// Brings a frame's files into a folder.
fn join(from: &Path, line: &ManifestLine, out: &Path) -> Result<(), BatchError> {
    for (file, hash) in &line.outputs {
        let (source, target) = (from.join(file), out.join(file));
        if target.exists() {
            fs::remove_file(&target).map_err(BatchError::write(&target))?;
        }
        if fs::hard_link(&source, &target).is_ok() {
            continue;
        }
        let bytes = read_bytes(&source)?;
        if hash_bytes(&bytes) != *hash {
            return Err(InputError::new(&source, "changed while it was read").into());
        }
        write_atomic(&target, &bytes).map_err(BatchError::write(&target))?;
    }
    Ok(())
}
