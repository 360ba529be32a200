//! `retina report`.

use std::path::PathBuf;

use crate::failure::Failure;
use crate::output::tell;

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Folder with the pages that other commands wrote with --report.
    ///
    /// `retina simulate sky` writes one without that flag.
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// Page to write.
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
