//! One module a subcommand.

pub(crate) mod adapter;
pub(crate) mod body;
pub(crate) mod optics;
pub(crate) mod render;
pub(crate) mod sheet;
pub(crate) mod trajectory;
pub(crate) mod warp;

use retina_batch::BackendChoice;

/// `--backend`.
#[derive(Clone, Copy, Default, clap::ValueEnum)]
pub(crate) enum Backend {
    /// The GPU, or the CPU where there is no adapter.
    #[default]
    Auto,
    /// The GPU.
    Gpu,
    /// The CPU.
    Cpu,
}

impl From<Backend> for BackendChoice {
    fn from(backend: Backend) -> Self {
        match backend {
            Backend::Auto => Self::Auto,
            Backend::Gpu => Self::Gpu,
            Backend::Cpu => Self::Cpu,
        }
    }
}
