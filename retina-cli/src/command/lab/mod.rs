//! `retina lab ...`: real screens and cameras, and the virtual bench in their place.

mod camera;

use crate::failure::Failure;

/// Drives a laboratory's screen and camera, or the virtual bench in their place.
#[derive(clap::Subcommand)]
pub(crate) enum Command {
    /// Makes the virtual bench a GigE Vision camera that photographs a screen.
    ///
    /// Any program that speaks GigE Vision finds it, sets its features and receives its images. It runs until it is
    /// interrupted.
    Camera(camera::Arguments),
}

pub(crate) fn run(command: &Command) -> Result<(), Failure> {
    match command {
        Command::Camera(arguments) => camera::run(arguments),
    }
}
