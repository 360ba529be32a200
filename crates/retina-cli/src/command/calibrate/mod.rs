//! `retina calibrate`.

mod geometry;

use crate::failure::Failure;

#[derive(clap::Subcommand)]
pub(crate) enum Command {
    /// The mapping between lines of sight and the screen, from displayed points and their centroids.
    Geometry(geometry::Arguments),
}

pub(crate) fn run(command: Command) -> Result<(), Failure> {
    match command {
        Command::Geometry(arguments) => geometry::run(&arguments),
    }
}
