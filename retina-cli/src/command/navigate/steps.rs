//! What the experiments' commands share: progress step by step, and their files.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use indicatif::ProgressBar;
use retina_batch::{FrameRange, Shard};
use retina_experiments::experiment::{ExperimentError, Watcher};
use retina_files::{InputError, write_atomic};

use crate::failure::Failure;
use crate::output::tell;
use crate::progress::advance;

impl From<ExperimentError> for Failure {
    fn from(error: ExperimentError) -> Self {
        match error {
            ExperimentError::Input(error) => error.into(),
            ExperimentError::Bench(error) => error.into(),
            ExperimentError::Batch(error) => error.into(),
        }
    }
}

/// A bar a step on a terminal, a line now and then elsewhere.
pub(crate) struct Steps {
    name: String,
    bar: Option<ProgressBar>,
    start: Instant,
    first: usize,
    last_line: Instant,
}

/// Time between lines where standard error is no terminal.
const LINE_INTERVAL: Duration = Duration::from_secs(10);

impl Steps {
    pub(crate) fn new() -> Self {
        let now = Instant::now();
        Self { name: String::new(), bar: None, start: now, first: 0, last_line: now }
    }

    pub(crate) fn finish(&mut self) {
        if let Some(bar) = self.bar.take() {
            bar.finish_and_clear();
        }
    }
}

impl Watcher for Steps {
    fn note(&mut self, text: &str) {
        match &self.bar {
            Some(bar) => bar.suspend(|| tell!("{text}")),
            None => tell!("{text}"),
        }
    }

    fn step(&mut self, name: &str) {
        self.finish();
        name.clone_into(&mut self.name);
        tell!("{name}");
        let now = Instant::now();
        (self.start, self.first, self.last_line) = (now, usize::MAX, now);
        self.bar = crate::output::shows_progress().then(|| crate::progress::counter(0, "done"));
    }

    fn done(&mut self, done: usize, all: usize) {
        if let Some(bar) = &self.bar {
            advance(bar, done, all);
            return;
        }
        if self.first == usize::MAX {
            // What was there already took no time.
            (self.first, self.start) = (done, Instant::now());
        }
        if self.last_line.elapsed() < LINE_INTERVAL || done <= self.first {
            return;
        }
        self.last_line = Instant::now();
        let rate = (done - self.first) as f64 / self.start.elapsed().as_secs_f64();
        tell!("{}: {done}/{all}, {:.0} s left", self.name, (all - done) as f64 / rate);
    }
}

/// Makes the folder for results, which is neither the folder that they are made from nor its frames' or truth's.
pub(crate) fn results_folder(out: &Path, input: &Path) -> Result<(), InputError> {
    let rendered = input.canonicalize().ok();
    // A folder that does not exist yet has no canonical name; some folder above it does.
    let above = std::path::absolute(out).unwrap_or_else(|_| out.to_owned());
    let whole = above.ancestors().find_map(|folder| {
        Some(
            folder
                .canonicalize()
                .ok()?
                .join(above.strip_prefix(folder).ok()?)
                .components()
                .collect::<PathBuf>(),
        )
    });
    if let (Some(rendered), Some(whole)) = (rendered, whole)
        && (whole == rendered
            || ["frames", "truth"].iter().any(|part| whole.starts_with(rendered.join(part))))
    {
        return Err(InputError::new(out, "is the rendered folder itself, or its frames or truth folder")
            .at("--out")
            .expected("a folder of its own for the results"));
    }
    std::fs::create_dir_all(out)
        .map_err(|error| InputError::new(out, format!("the folder cannot be made: {error}")))
}

/// The name of a selection of frames' results: a part does not take the whole's place.
pub(crate) fn results_name(stem: &str, frames: Option<FrameRange>, shard: Option<Shard>) -> String {
    let end = |range: FrameRange| range.end.map_or_else(String::new, |end| end.to_string());
    let range = frames.map_or_else(String::new, |range| format!("-{}..{}", range.first, end(range)));
    let shard = shard.map_or_else(String::new, |shard| format!("-{}-of-{}", shard.index, shard.count));
    format!("{stem}{range}{shard}")
}

/// Writes a file of a folder of results.
pub(crate) fn write(folder: &Path, name: &str, text: &str) -> Result<(), Failure> {
    let path = folder.join(name);
    write_atomic(&path, text.as_bytes())
        .map_err(|error| InputError::new(&path, format!("cannot be written: {error}")).into())
}
