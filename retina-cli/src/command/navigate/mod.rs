//! `retina navigate`.

mod far_range;
mod flashes;
mod frames_folder;
mod full_disk;
mod limb;
mod limb_text;
mod star_text;
mod stars;
mod steps;

use crate::failure::Failure;

/// Finds attitude and position from images.
#[derive(clap::Subcommand)]
pub(crate) enum Command {
    /// Finds the attitude from star images, lost in space, and the planets in them.
    Stars(stars::Arguments),
    /// Finds a body, its range and its line of sight in one photograph, by its limb.
    Limb(limb::Arguments),
    /// Runs the paper's far-range experiment: random poses, and a transfer to Mars.
    FarRange(far_range::Arguments),
    /// Finds the camera's position from the limb of a resolved body.
    ///
    /// The input is a rendered sequence, or a scenario for the paper's whole LUMIO experiment.
    FullDisk(full_disk::Arguments),
    /// Finds impact flashes on the night side of a body.
    ///
    /// The input is a rendered sequence, or a scenario for the whole experiment.
    Flashes(flashes::Arguments),
}

pub(crate) fn run(command: &Command) -> Result<(), Failure> {
    match command {
        Command::Stars(arguments) => stars::run(arguments),
        Command::Limb(arguments) => limb::run(arguments),
        Command::FarRange(arguments) => far_range::run(arguments),
        Command::FullDisk(arguments) => full_disk::run(arguments),
        Command::Flashes(arguments) => flashes::run(arguments),
    }
}
