//! Rays times surfaces per second on one core, for each instruction set that the processor has.
//!
//! `cargo bench -p retina-optics --bench trace_rate`

#![allow(clippy::unwrap_used, reason = "a benchmark may fail")]

use std::time::Instant;

use retina_optics::{Clipping, Launcher, Tracer, pupil, shipped_design};
use retina_simd::{InstructionSet, Level};

fn main() {
    for name in ["reference-1.3fc-wide", "cooke-triplet"] {
        let system = shipped_design(name).unwrap().unwrap();
        let launcher = Launcher::new(&system).unwrap();
        let tracer = Tracer::new(&system, system.primary_nm(), Clipping::On).unwrap();
        let points = pupil::gaussian(32, 64, 0.0);
        let launched: retina_optics::RayBatch =
            points.iter().map(|point| launcher.ray(system.fields[1].at, point.at).unwrap()).collect();
        let work = (launched.len() * tracer.surface_count()) as f64;
        for set in InstructionSet::ALL {
            let Some(level) = Level::of(set) else {
                println!("{name}: {}: not on this processor", set.name());
                continue;
            };
            // The best of many short runs: a shared machine only ever adds time.
            let mut rays = launched.clone();
            let best = (0..400)
                .map(|_| {
                    rays.clone_from(&launched);
                    let start = Instant::now();
                    tracer.trace_batch_with(&mut rays, level);
                    start.elapsed().as_secs_f64()
                })
                .fold(f64::INFINITY, f64::min);
            println!("{name}: {}: {:.3e} rays x surfaces / s", set.name(), work / best);
        }
        let ray = launcher.ray(system.fields[1].at, [0.3, 0.4]).unwrap();
        let start = Instant::now();
        let mut sum = 0.0;
        for _ in 0..20_000 {
            sum += tracer.trace_to_image(std::hint::black_box(&ray)).unwrap().path_mm;
        }
        let rate = 20_000.0 * tracer.surface_count() as f64 / start.elapsed().as_secs_f64();
        println!("{name}: scalar, with all crossings: {rate:.3e} rays x surfaces / s ({sum:.1})");
    }
}
