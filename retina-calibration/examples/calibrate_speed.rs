//! Time of a calibration with 100 000 points: `cargo run --release -p retina-calibration --example calibrate_speed`.

#![allow(clippy::unwrap_used, reason = "the tests' facility may fail")]

#[path = "../tests/common/mod.rs"]
mod common;

use std::time::Instant;

use retina_calibration::geometry::{CalibrateOptions, calibrate};

fn main() {
    let setup = common::wide();
    for (exposures, points) in [(40, 50), (100, 1000), (250, 400)] {
        let table = common::LIKELY.table(&setup, exposures, points, 1);
        let mut times_s: Vec<f64> = (0..7)
            .map(|_| {
                let start = Instant::now();
                let result = calibrate(&table, &setup, &CalibrateOptions::default());
                std::hint::black_box(result.is_ok());
                start.elapsed().as_secs_f64()
            })
            .collect();
        times_s.sort_by(f64::total_cmp);
        println!(
            "{} points, {exposures} exposures: median {:.3} s, best {:.3} s",
            table.rows.len(),
            times_s[3],
            times_s[0]
        );
    }
}
