//! Long work of a session: one at a time, with progress, given up when nobody waits for it any more.
//!
//! Work that reports progress ends at its next report. Other work ends in the background, and its result is dropped; the
//! next work of the session waits for it, so that never two share the cores.

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Deep recursions (hierarchies, fits) have the stack that a program's first thread has.
pub(crate) const STACK_BYTES: usize = 16 << 20;

/// What a job does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// The bench measures.
    Bench,
    /// Tables are read, and the model fitted.
    Read,
    /// Candidates are looked for.
    Diagnose,
    /// Formulas are looked for.
    Investigate,
}

impl Kind {
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Bench => "bench",
            Self::Read => "read",
            Self::Diagnose => "diagnose",
            Self::Investigate => "investigate",
        }
    }
}

/// A job as the page sees it.
#[derive(Debug, Clone)]
pub(crate) struct Job {
    pub(crate) kind: Kind,
    pub(crate) done: usize,
    /// Parts in all; 0 where they are not counted.
    pub(crate) total: usize,
    abandoned: Arc<AtomicBool>,
}

impl Job {
    pub(crate) fn new(kind: Kind) -> Self {
        Self { kind, done: 0, total: 0, abandoned: Arc::default() }
    }

    pub(crate) fn abandon(&self) {
        self.abandoned.store(true, Ordering::Relaxed);
    }

    pub(crate) fn watch(&self) -> Watch {
        Watch(Arc::clone(&self.abandoned))
    }
}

/// What unwinds abandoned work. It passes the panic hook by, so that nothing is printed.
struct Abandoned;

/// How the work learns that nobody waits for it.
#[derive(Clone)]
pub(crate) struct Watch(Arc<AtomicBool>);

impl Watch {
    pub(crate) fn is_abandoned(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// Ends the work where it is abandoned.
    pub(crate) fn check(&self) {
        if self.is_abandoned() {
            resume_unwind(Box::new(Abandoned));
        }
    }

    /// Whether this is the watch of a job.
    pub(crate) fn is_of(&self, job: &Job) -> bool {
        Arc::ptr_eq(&self.0, &job.abandoned)
    }
}

/// How work ended.
pub(crate) enum Ended<T> {
    Done(T),
    Abandoned,
    /// By a fault of the program, which the panic hook has printed.
    Broken,
}

/// Runs work, and tells an abandonment from a fault.
pub(crate) fn run<T>(work: impl FnOnce() -> T) -> Ended<T> {
    // What the work leaves behind a fault is not looked at again.
    match catch_unwind(AssertUnwindSafe(work)) {
        Ok(value) => Ended::Done(value),
        Err(panic) if panic.is::<Abandoned>() => Ended::Abandoned,
        Err(_) => Ended::Broken,
    }
}
