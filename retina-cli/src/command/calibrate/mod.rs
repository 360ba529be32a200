//! `retina calibrate`.

mod geometry;
pub(crate) mod radiometry;

pub(crate) use geometry::measured_response;

use crate::failure::Failure;

#[derive(clap::Subcommand)]
pub(crate) enum Command {
    /// Calibrates the mapping between lines of sight and the screen, from displayed points and
    /// their centroids.
    Geometry(geometry::Arguments),
    /// Calibrates the display's response, from power-meter readings.
    Radiometry(radiometry::Arguments),
}

pub(crate) fn run(command: Command) -> Result<(), Failure> {
    match command {
        Command::Geometry(arguments) => geometry::run(&arguments),
        Command::Radiometry(arguments) => radiometry::run(&arguments),
    }
}
