//! `retina navigate`.

mod far_range;
mod flashes;
mod frames_folder;
mod full_disk;
mod stars;
mod steps;

use crate::failure::Failure;

/// Attitude and position from images.
#[derive(clap::Subcommand)]
pub(crate) enum Command {
    /// Finds the attitude of star images, lost in space, and planets in them.
    Stars(stars::Arguments),
    /// Runs the paper's far-range experiment: random poses, and a transfer to Mars.
    FarRange(far_range::Arguments),
    /// Measures a resolved body by its limb over a rendered sequence, or runs the paper's LUMIO experiment.
    FullDisk(full_disk::Arguments),
    /// Finds flashes of impacts on a body's night side over a rendered sequence, or runs the whole experiment.
    Flashes(flashes::Arguments),
}

pub(crate) fn run(command: &Command) -> Result<(), Failure> {
    match command {
        Command::Stars(arguments) => stars::run(arguments),
        Command::FarRange(arguments) => far_range::run(arguments),
        Command::FullDisk(arguments) => full_disk::run(arguments),
        Command::Flashes(arguments) => flashes::run(arguments),
    }
}
