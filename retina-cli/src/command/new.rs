//! `retina new`.

use std::path::PathBuf;

use retina::starting::StartingFile;

use crate::failure::Failure;
use crate::output::tell;

#[derive(Clone, Copy, clap::ValueEnum)]
enum Kind {
    /// A facility, schema retina.setup/1.
    Setup,
    /// A scene, schema retina.scene/1, and a setup beside it where there is none.
    Scene,
    /// A far-range campaign, schema retina.far-range/1, and a setup beside it where there is none.
    Campaign,
}

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// What to start.
    #[arg(value_enum)]
    kind: Kind,
    /// File to write; it must not be there yet. Its folder is made.
    #[arg(long, value_name = "FILE.toml")]
    out: PathBuf,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let kind = match arguments.kind {
        Kind::Setup => StartingFile::Setup,
        Kind::Scene => StartingFile::Scene,
        Kind::Campaign => StartingFile::Campaign,
    };
    crate::check_extension(&arguments.out, "toml")?;
    for path in kind.write(&arguments.out)? {
        tell!("{}: every key has a comment; `retina check {0}` says what it would do", path.display());
    }
    Ok(())
}
