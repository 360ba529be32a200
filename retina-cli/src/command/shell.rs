//! `retina completions` and `retina man`.

use std::path::PathBuf;

use clap_complete::{Shell, generate};

use crate::failure::Failure;
use crate::output::{print_text, tell};

#[derive(clap::Args)]
pub(crate) struct Completions {
    /// Shell whose completions are printed.
    ///
    /// For bash: retina completions bash > ~/.local/share/bash-completion/completions/retina
    #[arg(value_enum)]
    shell: Shell,
}

pub(crate) fn completions(arguments: &Completions, mut command: clap::Command) -> Result<(), Failure> {
    let mut text = Vec::new();
    generate(arguments.shell, &mut command, "retina", &mut text);
    print_text(&String::from_utf8_lossy(&text))
}

#[derive(clap::Args)]
pub(crate) struct Man {
    /// Folder for the manual pages: retina.1, retina-render.1, ...
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

pub(crate) fn man(arguments: &Man, command: clap::Command) -> Result<(), Failure> {
    let failed = |error: std::io::Error| {
        Failure::new(format!("{} cannot be written: {error}", arguments.out.display()))
    };
    std::fs::create_dir_all(&arguments.out).map_err(failed)?;
    clap_mangen::generate_to(command, &arguments.out).map_err(failed)?;
    tell!("manual pages are in {0}; read one by: man -l {0}/retina-render.1", arguments.out.display());
    Ok(())
}
