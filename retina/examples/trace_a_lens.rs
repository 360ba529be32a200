//! Rays through the reference design of stock doublets, from the camera's pupil to the screen.
//!
//! `cargo run --release -p retina --example trace_a_lens`

use std::error::Error;

use retina::glam::DVec3;
use retina::optics::Clipping;
use retina::optics::paraxial::Paraxial;
use retina::prelude::*;

pub(crate) fn main() -> Result<(), Box<dyn Error>> {
    let system = shipped_design("reference-1.3fc-wide").ok_or("no such design")??;
    let first = Paraxial::primary(&system)?.first_order();
    if let Some(efl_mm) = first.efl_mm {
        println!("{}: focal length {efl_mm:.2} mm", system.name);
    }
    let tracer = Tracer::new(&system, system.wavelengths[system.primary].nm, Clipping::On)?;
    let launcher = Launcher::new(&system)?;
    for field in &system.fields {
        let mut landed = Vec::new();
        for pupil in [[0.0, 0.0], [0.7, 0.0], [-0.7, 0.0], [0.0, 0.7], [0.0, -0.7]] {
            // A ray that a lens' edge stops is no error of the program.
            if let Ok(crossing) = tracer.trace_to_image(&launcher.ray(field.at, pupil)?) {
                landed.push(crossing.position_mm);
            }
        }
        let mean = landed.iter().sum::<DVec3>() / landed.len().max(1) as f64;
        let widest_um = landed.iter().map(|at| 1e3 * at.distance(mean)).fold(0.0, f64::max);
        println!(
            "field {:?}: {} of 5 rays land about ({:.3}, {:.3}) mm, within {widest_um:.1} um",
            field.at,
            landed.len(),
            mean.x,
            mean.y
        );
    }
    Ok(())
}
