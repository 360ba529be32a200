//! `retina report`.

use std::path::PathBuf;

use crate::failure::Failure;
use crate::output::tell;

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Folder with the pages that other commands wrote with --report (simulate sky writes one by itself).
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// The page to write.
    #[arg(long, value_name = "FILE.html")]
    out: PathBuf,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    crate::check_file(&arguments.out, "html")?;
    let joined = retina_report::join(&arguments.folder, &arguments.out)?;
    let names: Vec<String> = joined.iter().map(|path| path.display().to_string()).collect();
    tell!("{}: {}", arguments.out.display(), names.join(", "));
    Ok(())
}
