//! How far a run is, on standard error.

use std::time::{Duration, Instant};

use crate::output::{shows_progress, tell};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use retina_batch::{Observer, Progress};

/// Time between lines where standard error is no terminal.
const LINE_INTERVAL: Duration = Duration::from_secs(10);

/// A bar on a terminal, a line now and then elsewhere.
pub(crate) struct Reporter {
    bar: Option<ProgressBar>,
    start: Instant,
    last_line: Instant,
}

impl Reporter {
    pub(crate) fn new() -> Self {
        let bar = shows_progress().then(|| {
            let style = ProgressStyle::with_template(
                "{wide_bar} {pos}/{len} frames, {per_sec}, {elapsed} elapsed, {eta} left",
            );
            ProgressBar::new(0).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
        });
        let now = Instant::now();
        Self { bar, start: now, last_line: now }
    }

    /// Takes the bar away.
    pub(crate) fn clear(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

impl Observer for Reporter {
    fn note(&mut self, text: &str) {
        match &self.bar {
            Some(bar) => bar.suspend(|| tell!("{text}")),
            None => tell!("{text}"),
        }
    }

    fn progress(&mut self, progress: Progress) {
        if progress.done == 0 {
            // The first frames' rate is not to contain the time before them.
            self.start = Instant::now();
            self.last_line = self.start;
        }
        if let Some(bar) = &self.bar {
            if progress.done == 0 {
                bar.reset();
            }
            bar.set_length(progress.to_do as u64);
            bar.set_position(progress.done as u64);
            return;
        }
        if self.last_line.elapsed() < LINE_INTERVAL || progress.done == 0 {
            return;
        }
        self.last_line = Instant::now();
        let rate = progress.done as f64 / self.start.elapsed().as_secs_f64();
        let left_s = (progress.to_do - progress.done) as f64 / rate;
        tell!("{}/{} frames, {rate:.2} per second, {left_s:.0} s left", progress.done, progress.to_do);
    }
}

/// A sign of life with the time so far, on a terminal, for work whose end cannot be told beforehand.
pub(crate) fn working(text: &'static str) -> ProgressBar {
    if !shows_progress() {
        return ProgressBar::hidden();
    }
    let style = ProgressStyle::with_template("{spinner} {msg}, {elapsed}");
    let spinner = ProgressBar::new_spinner()
        .with_style(style.unwrap_or_else(|_| ProgressStyle::default_spinner()))
        .with_message(text);
    spinner.enable_steady_tick(Duration::from_millis(200));
    spinner
}

/// A bar of counted things on standard error.
pub(crate) fn counter(length: u64, unit: &str) -> ProgressBar {
    let style = ProgressStyle::with_template(&format!(
        "{{wide_bar}} {{pos}}/{{len}} {unit}, {{elapsed}} elapsed, {{eta}} left"
    ));
    let target = if shows_progress() { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
    let bar = ProgressBar::with_draw_target(Some(length), target)
        .with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar.enable_steady_tick(Duration::from_millis(500));
    bar
}

/// Sets a bar of [`counter`] to `done` of `of`, where the whole is known only on the way.
pub(crate) fn advance(bar: &ProgressBar, done: usize, of: usize) {
    bar.set_length(of as u64);
    bar.set_position(done as u64);
}
