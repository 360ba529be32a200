//! Times of the virtual bench: how long it takes to build, and frames a second of points and of a disc.
//! `cargo run --release -p retina-bench --example speed [SETUP]`

use std::path::PathBuf;
use std::time::Instant;

use retina_bench::{Bench, BenchOptions, Exposure, ScreenImage};
use retina_geometry::Setup;

/// What an exposure is made of.
const PARTS: [&str; 3] = ["where each sub-pixel's light lands", "light on the sensor", "sensor"];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let default = concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/setups/wide-fov.toml");
    let path = std::env::args().nth(1).map_or_else(|| PathBuf::from(default), PathBuf::from);
    let setup = Setup::read(&path)?;
    let start = Instant::now();
    let bench = Bench::new(&setup, &BenchOptions::default())?;
    println!("build: {:.2} s, {} threads", start.elapsed().as_secs_f64(), rayon::current_num_threads());

    // 300 points, three pixels each, over the field and over brightness.
    let mut points = ScreenImage::dark(1920, 1200);
    for i in 0..300u32 {
        let (x, y) = (170 + i * 73 % 1580, 20 + i * 191 % 1160);
        let count = [20, 60, 120, 255][i as usize % 4];
        for (dx, dy) in [(0, 0), (1, 0), (0, 1)] {
            points.set(x + dx, y + dy, [count; 3]);
        }
    }
    let mut disc = ScreenImage::dark(1920, 1200);
    for y in 0..1200 {
        for x in 0..1920 {
            if (f64::from(x) - 960.0).hypot(f64::from(y) - 600.0) < 560.0 {
                disc.set(x, y, [180; 3]);
            }
        }
    }
    for (name, screen, frames) in [("300 points", &points, 60u64), ("disc of 1120 px", &disc, 10)] {
        let mut exposure = Exposure::new(0.01, 0);
        bench.expose(screen, &exposure)?;
        let start = Instant::now();
        for frame in 0..frames {
            exposure.frame = frame;
            bench.expose(screen, &exposure)?;
        }
        let each = start.elapsed().as_secs_f64() / frames as f64;
        println!("{name}: {:.1} frames/s, {:.1} ms", 1.0 / each, 1e3 * each);
        // Its parts, with an image between them.
        let mut parts = [0.0; PARTS.len()];
        for _ in 0..frames {
            let mut begun = Instant::now();
            let mut done = |part: usize| {
                parts[part] += begun.elapsed().as_secs_f64();
                begun = Instant::now();
            };
            let landed = bench.landed(screen, &exposure)?;
            done(0);
            let light = bench.landed_e(landed, &exposure);
            done(1);
            bench.read(&light, &exposure);
            done(2);
        }
        for (part, seconds) in PARTS.iter().zip(parts) {
            println!("   {part}: {:.1} ms", 1e3 * seconds / frames as f64);
        }
    }
    Ok(())
}
