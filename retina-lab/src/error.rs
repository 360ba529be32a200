//! Why the laboratory cannot go on.

use retina_bench::BenchError;
use retina_files::InputError;

/// A device that does not do what is asked of it, or a file that does not fit.
#[derive(Debug, thiserror::Error)]
pub enum LabError {
    /// A file or an argument does not fit.
    #[error(transparent)]
    Input(#[from] InputError),
    /// The virtual bench cannot be built or used.
    #[error(transparent)]
    Bench(#[from] BenchError),
    /// A display cannot be used.
    #[error("the display {display} {problem}")]
    Display {
        /// Its name.
        display: String,
        /// What is wrong, with what is to be done.
        problem: String,
    },
    /// A camera cannot be used.
    #[error("the camera {camera} {problem}")]
    Camera {
        /// Its name.
        camera: String,
        /// What is wrong, with what is to be done.
        problem: String,
    },
    /// A user's own command fails.
    #[error("the command `{command}` {problem}")]
    Command {
        /// The command.
        command: String,
        /// What is wrong.
        problem: String,
    },
    /// Nobody answers.
    #[error("nobody says that this is done: {what}. Standard input has ended")]
    Unattended {
        /// What was to be done.
        what: String,
    },
    /// The user interrupted.
    #[error("interrupted; what was taken is kept")]
    Interrupted,
}
