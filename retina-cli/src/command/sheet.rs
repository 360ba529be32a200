//! `retina sheet`.

use std::path::PathBuf;

use retina_batch::contact_sheet;

use crate::failure::Failure;
use crate::output::tell;

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Folder that `retina render` wrote.
    dir: PathBuf,
}

pub(crate) fn run(arguments: Arguments) -> Result<(), Failure> {
    let path = contact_sheet(&arguments.dir)?;
    tell!("{}", path.display());
    Ok(())
}
