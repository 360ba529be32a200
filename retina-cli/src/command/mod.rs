//! One module a subcommand.

pub(crate) mod adapter;
pub(crate) mod body;
pub(crate) mod calibrate;
pub(crate) mod check;
pub(crate) mod cluster;
pub(crate) mod compare;
pub(crate) mod corto;
pub(crate) mod decide;
pub(crate) mod diagnose;
pub(crate) mod doctor;
pub(crate) mod effects;
pub(crate) mod export;
pub(crate) mod fit;
pub(crate) mod import;
pub(crate) mod investigate;
pub(crate) mod lab;
mod live;
pub(crate) mod navigate;
pub(crate) mod new;
pub(crate) mod optics;
pub(crate) mod pattern;
pub(crate) mod render;
pub(crate) mod report;
pub(crate) mod schema;
pub(crate) mod serve;
mod serve_basilisk;
pub(crate) mod sheet;
pub(crate) mod shell;
pub(crate) mod simulate;
pub(crate) mod trajectory;
pub(crate) mod view;
pub(crate) mod warp;
pub(crate) mod workbench;

use retina_batch::BackendChoice;
use retina_render::Quality;

/// `--backend`.
#[derive(Clone, Copy, Default, clap::ValueEnum)]
pub(crate) enum Backend {
    /// A real GPU if there is one, otherwise the native renderer.
    #[default]
    Auto,
    /// The GPU, or a driver that acts as one.
    Gpu,
    /// The processor's cores, with its vector instructions.
    Native,
    /// The f64 reference that the others are held against; slow.
    Cpu,
}

/// What renders, and how finely.
#[derive(clap::Args)]
pub(crate) struct Rendering {
    /// Renderer to use.
    #[arg(long, value_enum, default_value_t)]
    pub(crate) backend: Backend,
    /// Sampling quality of a frame [default: the scene's].
    #[arg(long, value_enum)]
    quality: Option<QualityName>,
}

impl Rendering {
    /// The quality that was asked for.
    pub(crate) fn quality(&self) -> Option<Quality> {
        self.quality.map(Quality::from)
    }
}

impl From<Backend> for BackendChoice {
    fn from(backend: Backend) -> Self {
        match backend {
            Backend::Auto => Self::Auto,
            Backend::Gpu => Self::Gpu,
            Backend::Native => Self::Native,
            Backend::Cpu => Self::Cpu,
        }
    }
}

/// `--quality`.
#[derive(Clone, Copy, clap::ValueEnum)]
pub(crate) enum QualityName {
    /// Coarse, for a first look.
    Draft,
    /// Limb within 0.01 px rms.
    Default,
    /// Limb within 0.003 px rms; slower.
    Best,
}

impl From<QualityName> for Quality {
    fn from(name: QualityName) -> Self {
        match name {
            QualityName::Draft => Self::Draft,
            QualityName::Default => Self::Default,
            QualityName::Best => Self::Best,
        }
    }
}
