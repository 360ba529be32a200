//! The output folder: whose it is, which frames it holds, and the manifest.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::fs::{self, File, OpenOptions};
use std::io::{ErrorKind, Write as _};
use std::path::{Path, PathBuf};

use retina_files::{InputError, hash_file, read_text, write_atomic, write_new};
use serde::{Deserialize, Serialize};

use crate::BatchError;

const RECORD: &str = "batch.json";
const MANIFEST: &str = "manifest.jsonl";
const RECORD_SCHEMA: &str = "retina.batch/1";
const MANIFEST_SCHEMA: &str = "retina.manifest/1";

/// Whose folder it is: `batch.json`. What changes the frames' bytes stands in it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Record {
    schema: String,
    /// One hash over all inputs.
    pub(crate) input_hash: String,
    /// `draft`, `default` or `best`.
    pub(crate) quality: String,
    /// `none`, `resample` or `direct`.
    pub(crate) compensation: String,
    /// `gpu` or `cpu`.
    pub(crate) backend: String,
    /// Displayed over true radiance.
    pub(crate) radiance_scale: f64,
    /// Frames of the whole sequence.
    pub(crate) frames: usize,
}

impl Record {
    pub(crate) fn new(
        input_hash: String,
        quality: &str,
        compensation: &str,
        backend: &str,
        radiance_scale: f64,
        frames: usize,
    ) -> Self {
        Self {
            schema: RECORD_SCHEMA.into(),
            input_hash,
            quality: quality.into(),
            compensation: compensation.into(),
            backend: backend.into(),
            radiance_scale,
            frames,
        }
    }
}

/// A line of the manifest: a finished frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct ManifestLine {
    schema: String,
    /// Number of the frame.
    pub(crate) index: usize,
    /// Hash of each input, by its role.
    inputs: BTreeMap<String, String>,
    /// Hash of each file of the frame, by its path in the folder.
    pub(crate) outputs: BTreeMap<String, String>,
    seed: u64,
    radiance_scale: f64,
    /// Pixels beyond the screen's brightest count.
    pub(crate) saturated_px: u64,
    adapter: String,
    driver: String,
}

impl ManifestLine {
    pub(crate) fn new(
        index: usize,
        inputs: BTreeMap<String, String>,
        outputs: BTreeMap<String, String>,
        seed: u64,
        radiance_scale: f64,
        saturated_px: u64,
        adapter: &crate::AdapterName,
    ) -> Self {
        Self {
            schema: MANIFEST_SCHEMA.into(),
            index,
            inputs,
            outputs,
            seed,
            radiance_scale,
            saturated_px,
            adapter: adapter.adapter.clone(),
            driver: adapter.driver.clone(),
        }
    }
}

/// An output folder.
#[derive(Debug)]
pub(crate) struct Folder {
    dir: PathBuf,
    /// Holds a shared lock on the record while this run writes: leftovers are then a live run's.
    in_use: Option<File>,
}

/// Path of a frame's file in the folder.
pub(crate) fn frame_file(kind: &str, index: usize, extension: &str) -> String {
    format!("{kind}/{index:06}.{extension}")
}

impl Folder {
    /// A folder that need not exist yet; nothing is changed.
    pub(crate) fn at(dir: &Path) -> Self {
        Self { dir: dir.to_path_buf(), in_use: None }
    }

    pub(crate) fn dir(&self) -> &Path {
        &self.dir
    }

    /// Whose folder it is; `None` where it does not exist or holds nothing of a run.
    ///
    /// # Errors
    /// It is no folder, or holds frames of which it does not say whose they are.
    pub(crate) fn record(&self) -> Result<Option<Record>, InputError> {
        if self.dir.exists() && !self.dir.is_dir() {
            return Err(InputError::new(&self.dir, "is not a folder").help("give --out another path"));
        }
        let file = self.dir.join(RECORD);
        if !file.exists() {
            let foreign = ["frames", "truth", MANIFEST].iter().find(|name| self.dir.join(name).exists());
            let Some(name) = foreign else { return Ok(None) };
            // A run that began between the two looks wrote its record first.
            if !file.exists() {
                return Err(InputError::new(
                    &self.dir,
                    format!("holds `{name}` and no `{RECORD}` that says of which scene"),
                )
                .help("give --out another folder"));
            }
        }
        let record: Record = serde_json::from_str(&read_text(&file)?).map_err(|error| {
            InputError::new(&file, format!("is not a batch record: {error}"))
                .help("give --out another folder")
        })?;
        if record.schema != RECORD_SCHEMA {
            return Err(InputError::new(&file, "is not a batch record of this version")
                .found(format!("`{}`", record.schema))
                .expected(format!("`{RECORD_SCHEMA}`")));
        }
        Ok(Some(record))
    }

    /// Refuses the folder where its frames would differ from those of `wanted`.
    pub(crate) fn check_same(&self, found: &Record, wanted: &Record) -> Result<(), InputError> {
        if found.input_hash != wanted.input_hash || found.frames != wanted.frames {
            return Err(InputError::new(
                &self.dir,
                "holds the frames of another scene, or of this one before its files changed",
            )
            .found(format!("input hash {}", short(&found.input_hash)))
            .expected(short(&wanted.input_hash))
            .help("give --out another folder"));
        }
        let options = [
            ("quality", &found.quality, &wanted.quality),
            ("compensation", &found.compensation, &wanted.compensation),
            ("backend", &found.backend, &wanted.backend),
        ];
        for (option, found, wanted) in options {
            if found != wanted {
                return Err(InputError::new(
                    &self.dir,
                    format!("holds frames of this scene made with another {option}"),
                )
                .found(format!("`{found}`"))
                .expected(format!("`{wanted}`"))
                .help(format!("ask for the {option} `{found}`, or give --out another folder")));
            }
        }
        if found.radiance_scale != wanted.radiance_scale {
            return Err(InputError::new(&self.dir, "holds frames of this scene at another radiance scale")
                .found(found.radiance_scale)
                .expected(wanted.radiance_scale)
                .help("give --out another folder"));
        }
        Ok(())
    }

    /// Refuses a folder that already has one of the frames.
    pub(crate) fn refuse_present(&self, frames: &[usize]) -> Result<(), InputError> {
        let there =
            frames.iter().filter(|&&index| self.dir.join(frame_file("frames", index, "png")).exists());
        let (mut first, mut count) = (None, 0);
        for index in there {
            first = first.or(Some(*index));
            count += 1;
        }
        match first {
            None => Ok(()),
            Some(first) => Err(InputError::new(&self.dir, "holds frames that are asked for")
                .found(format!("{count} of {}, the first is {first}", frames.len()))
                .help("add --resume to keep them and make the others, or give --out another folder")),
        }
    }

    /// Makes the folder and its record, or joins a run of the same scene; removes what killed
    /// runs left, unless another run is at work in it.
    ///
    /// `kinds` are the folders of the frames' files.
    pub(crate) fn open(dir: &Path, record: &Record, kinds: &BTreeSet<String>) -> Result<Self, BatchError> {
        let mut folder = Self::at(dir);
        fs::create_dir_all(dir).map_err(BatchError::write(dir))?;
        let file = dir.join(RECORD);
        // The record comes before the folders of the files, and is never replaced: runs that begin at the same moment
        // find nothing without an owner, and lock one file.
        if !file.exists() {
            let mut text = serde_json::to_vec_pretty(record).map_err(|e| BatchError::encode(RECORD, &e))?;
            text.push(b'\n');
            match write_new(&file, &text) {
                // Another run was first, and took our unfinished one for a leftover.
                Err(error) if error.kind() == ErrorKind::NotFound && file.exists() => {}
                written => written.map(|_| ()).map_err(BatchError::write(&file))?,
            }
        }
        for name in kinds {
            let path = dir.join(name);
            fs::create_dir_all(&path).map_err(BatchError::write(&path))?;
        }
        // Another run may have been first.
        if let Some(found) = folder.record()? {
            folder.check_same(&found, record)?;
        }
        let lock = File::open(&file).map_err(BatchError::write(&file))?;
        if lock.try_lock().is_ok() {
            folder.remove_leftovers(kinds)?;
            folder.mend_manifest()?;
            lock.unlock().map_err(BatchError::write(&file))?;
        }
        lock.lock_shared().map_err(BatchError::write(&file))?;
        folder.in_use = Some(lock);
        Ok(folder)
    }

    /// Keeps other runs from taking this one's unfinished files for leftovers, until what it gives is dropped; `None`
    /// where the folder is not a run's.
    pub(crate) fn hold(dir: &Path) -> Option<File> {
        File::open(dir.join(RECORD)).ok().filter(|file| file.lock_shared().is_ok())
    }

    fn remove_leftovers(&self, kinds: &BTreeSet<String>) -> Result<(), BatchError> {
        for path in kinds.iter().map(|kind| self.dir.join(kind)).chain([self.dir.clone()]) {
            for entry in fs::read_dir(&path).map_err(BatchError::write(&path))? {
                let entry = entry.map_err(BatchError::write(&path))?;
                if !entry.file_name().to_string_lossy().starts_with(".part-") {
                    continue;
                }
                match fs::remove_file(entry.path()) {
                    // A run that begins beside this one writes its record before it holds the lock.
                    Err(error) if error.kind() == ErrorKind::NotFound => {}
                    removed => removed.map_err(BatchError::write(&entry.path()))?,
                }
            }
        }
        Ok(())
    }

    /// Leaves one line a frame, the last; a line that a killed run did not finish goes too.
    fn mend_manifest(&self) -> Result<(), BatchError> {
        let path = self.dir.join(MANIFEST);
        if !path.exists() {
            return Ok(());
        }
        let text = read_text(&path)?;
        let mut seen = BTreeSet::new();
        let mut kept: Vec<&str> = Vec::new();
        for line in text.split_inclusive('\n').rev().filter(|line| line.ends_with('\n')) {
            let parsed = serde_json::from_str::<ManifestLine>(line);
            if parsed.map_or(true, |line| seen.insert(line.index)) {
                kept.push(line);
            }
        }
        let mended: String = kept.into_iter().rev().collect();
        if mended == text {
            return Ok(());
        }
        write_atomic(&path, mended.as_bytes()).map_err(BatchError::write(&path))
    }

    /// Brings the manifest's lines into the order of their frames.
    pub(crate) fn sort_manifest(&self) -> Result<(), BatchError> {
        let mut lines: Vec<ManifestLine> = self.manifest()?.into_values().collect();
        lines.sort_by_key(|line| line.index);
        let mut text = String::new();
        for line in &lines {
            text += &serde_json::to_string(line).map_err(|error| BatchError::encode(MANIFEST, &error))?;
            text.push('\n');
        }
        let path = self.dir.join(MANIFEST);
        write_atomic(&path, text.as_bytes()).map_err(BatchError::write(&path))
    }

    /// Ends the use of the folder: the last run to leave it mends the manifest, where frames that
    /// were made again stand twice.
    pub(crate) fn close(self) -> Result<(), BatchError> {
        let Some(lock) = &self.in_use else { return Ok(()) };
        lock.unlock().map_err(BatchError::write(&self.dir))?;
        if lock.try_lock().is_ok() {
            self.mend_manifest()?;
        }
        Ok(())
    }

    /// Adds a finished frame to the manifest, in one write, and brings it to the disk.
    pub(crate) fn append(&self, line: &ManifestLine) -> Result<(), BatchError> {
        let path = self.dir.join(MANIFEST);
        let mut text = serde_json::to_vec(line).map_err(|error| BatchError::encode(MANIFEST, &error))?;
        text.push(b'\n');
        let mut file =
            OpenOptions::new().create(true).append(true).open(&path).map_err(BatchError::write(&path))?;
        file.write_all(&text).and_then(|()| file.sync_data()).map_err(BatchError::write(&path))
    }

    /// The manifest's whole lines, the last of each frame.
    pub(crate) fn manifest(&self) -> Result<HashMap<usize, ManifestLine>, InputError> {
        let path = self.dir.join(MANIFEST);
        if !path.exists() {
            return Ok(HashMap::new());
        }
        // A torn line does not parse; its frame is made again.
        let lines = read_text(&path)?;
        Ok(lines
            .lines()
            .filter_map(|line| serde_json::from_str::<ManifestLine>(line).ok())
            .map(|line| (line.index, line))
            .collect())
    }

    /// Whether a run on this machine is at work in it.
    pub(crate) fn is_in_use(&self) -> bool {
        File::open(self.dir.join(RECORD)).is_ok_and(|file| file.try_lock().is_err())
    }

    /// The first file of a manifest's line that is not there with the content that it says.
    pub(crate) fn torn_file(&self, line: &ManifestLine) -> Option<PathBuf> {
        let whole = |(file, hash): (&String, &String)| {
            hash_file(&self.dir.join(file)).is_ok_and(|found| found == *hash)
        };
        line.outputs.iter().find(|pair| !whole(*pair)).map(|(file, _)| self.dir.join(file))
    }

    /// Whether all files of a manifest's line are there with the content that it says.
    pub(crate) fn is_whole(&self, line: &ManifestLine, wanted: &[String]) -> bool {
        wanted.iter().all(|file| {
            line.outputs
                .get(file)
                .is_some_and(|hash| hash_file(&self.dir.join(file)).is_ok_and(|found| found == *hash))
        })
    }
}

fn short(hash: &str) -> &str {
    hash.get(..12).unwrap_or(hash)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kinds() -> BTreeSet<String> {
        ["frames".to_string(), "truth".to_string()].into()
    }

    fn record() -> Record {
        Record::new("0123456789abcdef".into(), "default", "none", "cpu", 0.1 + 0.2, 7)
    }

    #[test]
    fn a_record_is_read_back_bit_for_bit_and_another_scene_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let folder = Folder::open(dir.path(), &record(), &kinds()).unwrap();
        let found = folder.record().unwrap().unwrap();
        assert_eq!(found, record());
        let other = Record { input_hash: "fff".into(), ..record() };
        assert!(folder.check_same(&found, &other).unwrap_err().to_string().contains("another scene"));
        let best = Record { quality: "best".into(), ..record() };
        assert!(folder.check_same(&found, &best).unwrap_err().to_string().contains("quality"));
        assert!(Folder::open(dir.path(), &other, &kinds()).is_err());
    }

    #[test]
    fn a_torn_line_and_leftovers_are_cleared_but_not_under_a_live_run() {
        let dir = tempfile::tempdir().unwrap();
        let live = Folder::open(dir.path(), &record(), &kinds()).unwrap();
        let left = dir.path().join("frames/.part-abc");
        fs::write(&left, "x").unwrap();
        fs::write(dir.path().join(MANIFEST), "{\"schema\":1}\n{\"ind").unwrap();
        drop(Folder::open(dir.path(), &record(), &kinds()).unwrap());
        assert!(left.exists(), "another run's file was removed");
        assert!(live.manifest().unwrap().is_empty());
        drop(live);
        drop(Folder::open(dir.path(), &record(), &kinds()).unwrap());
        assert!(!left.exists());
        assert_eq!(fs::read_to_string(dir.path().join(MANIFEST)).unwrap(), "{\"schema\":1}\n");
    }

    #[test]
    fn runs_that_begin_at_the_same_moment_do_not_disturb_each_other() {
        for _ in 0..40 {
            let dir = tempfile::tempdir().unwrap();
            let dir = &dir.path().join("new");
            std::thread::scope(|scope| {
                for run in 0..6 {
                    scope.spawn(move || {
                        Folder::at(dir).record().unwrap();
                        let folder = Folder::open(dir, &record(), &kinds()).unwrap();
                        for frame in 0..3 {
                            write_atomic(&dir.join(frame_file("frames", 3 * run + frame, "png")), b"x")
                                .unwrap();
                        }
                        folder.close().unwrap();
                        let _held = Folder::hold(dir).unwrap();
                        write_atomic(&dir.join("contact-sheet.png"), b"x").unwrap();
                    });
                }
            });
            assert_eq!(fs::read_dir(dir.join("frames")).unwrap().count(), 18);
        }
    }

    #[test]
    fn frames_of_unknown_origin_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        fs::create_dir(dir.path().join("frames")).unwrap();
        assert!(Folder::at(dir.path()).record().unwrap_err().to_string().contains("frames"));
    }
}
