//! Long work beside the interpreter: without its lock, with progress, and ended by Ctrl-C.
//!
//! Work runs on a thread of its own, while the caller's thread waits and looks for signals. An exception there (Ctrl-C,
//! or one that the progress callback raises) is raised at once. Work that reports progress then ends at its next
//! report; other work ends in the background, and its result is dropped.

use std::panic::resume_unwind;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use pyo3::prelude::*;

use crate::errors::Failure;

/// Signals are looked for this often. The end of the work and its progress are seen at once.
const SIGNAL_INTERVAL: Duration = Duration::from_millis(50);

/// Deep recursions (hierarchies, fits) have the stack that a program's first thread has.
const STACK_BYTES: usize = 16 << 20;

/// How the work tells how far it is, and learns that nobody waits for it any more.
#[derive(Clone)]
pub(crate) struct Watch {
    abandoned: Arc<AtomicBool>,
    reports: Sender<Told>,
}

/// What the work tells.
enum Told {
    /// Parts done, and parts in all.
    Progress(usize, usize),
    /// The work has ended, whichever way.
    Ended,
}

/// Tells the end of the work when it is dropped, also by a panic. A watch may live longer than the work: an effect that
/// is a function holds one.
struct End(Sender<Told>);

impl Drop for End {
    fn drop(&mut self) {
        // Where nobody waits any more, nobody need be told.
        let _ = self.0.send(Told::Ended);
    }
}

/// What unwinds abandoned work. It passes the panic hook by, so that nothing is printed.
struct Abandoned;

impl Watch {
    /// `done` of `total` parts are finished. Does not return where the work is abandoned.
    pub(crate) fn report(&self, done: usize, total: usize) {
        self.check();
        // Where the receiver is gone, the next check ends the work.
        let _ = self.reports.send(Told::Progress(done, total));
    }

    /// Ends the work where it is abandoned.
    pub(crate) fn check(&self) {
        if self.abandoned.load(Ordering::Relaxed) {
            self.abandon();
        }
    }

    /// Ends the work.
    pub(crate) fn abandon(&self) -> ! {
        resume_unwind(Box::new(Abandoned))
    }
}

/// The process that did the first work. The threads that share the work of a call do not live on in a forked child.
static FIRST_PROCESS: OnceLock<u32> = OnceLock::new();

fn check_process() -> Result<(), Failure> {
    let own = std::process::id();
    if *FIRST_PROCESS.get_or_init(|| own) == own {
        return Ok(());
    }
    Err(Failure::new(
        "this process was forked from one in which retina had worked already, so its threads are missing",
    )
    .with_help(
        "start workers with multiprocessing.get_context(\"spawn\"), or before the first use of retina",
    ))
}

/// Runs work that does not touch Python's objects, or attaches itself where it does.
///
/// # Errors
/// The work's own failure, a forked process, and whatever a signal handler or the progress callback raises.
pub(crate) fn run<T: Send + 'static>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&Watch) -> Result<T, Failure> + Send + 'static,
) -> PyResult<T> {
    check_process()?;
    let (reports, mut told) = channel();
    let abandoned = Arc::new(AtomicBool::new(false));
    let watch = Watch { abandoned: Arc::clone(&abandoned), reports };
    let thread = std::thread::Builder::new().stack_size(STACK_BYTES).spawn(move || {
        let _end = End(watch.reports.clone());
        work(&watch)
    })?;
    if let Err(error) = wait(py, progress, &mut told) {
        abandoned.store(true, Ordering::Relaxed);
        return Err(error);
    }
    match py.detach(|| thread.join()) {
        Ok(result) => Ok(result?),
        Err(panic) if panic.is::<Abandoned>() => Err(Failure::new("the work was given up").into()),
        Err(panic) => resume_unwind(panic),
    }
}

/// Whether a panic is that of abandoned work.
pub(crate) fn is_abandoned(panic: &Box<dyn std::any::Any + Send>) -> bool {
    panic.is::<Abandoned>()
}

/// Until the work has ended: reports go to the callback, and signals to their handlers.
fn wait(py: Python<'_>, progress: Option<&Bound<'_, PyAny>>, told: &mut Receiver<Told>) -> PyResult<()> {
    loop {
        // The exclusive borrow may cross the boundary at which the lock is released.
        let told = &mut *told;
        match py.detach(move || told.recv_timeout(SIGNAL_INTERVAL)) {
            Ok(Told::Progress(done, total)) => {
                if let Some(progress) = progress {
                    progress.call1((done, total))?;
                }
            }
            Err(RecvTimeoutError::Timeout) => {}
            Ok(Told::Ended) | Err(RecvTimeoutError::Disconnected) => return Ok(()),
        }
        py.check_signals()?;
    }
}
