//! The program `retina`: the command, with the process' arguments and exit code.

use std::process::ExitCode;

fn main() -> ExitCode {
    ExitCode::from(retina_cli::run(std::env::args_os()))
}
