//! Which physical effect a model misses: a table made in memory, whose centroids move with the temperature.
//!
//! `cargo run --release -p retina --example diagnose`

use std::error::Error;

use retina::formats::PointRow;
use retina::glam::DVec2;
use retina::prelude::*;

pub(crate) fn main() -> Result<(), Box<dyn Error>> {
    let setup = Setup::parse(retina::assets::WIDE_FOV_SETUP, "wide-fov.toml".as_ref())?;
    let (facility, camera) = (setup.facility_pinhole(), setup.camera_pinhole());
    let mut table = PointsTable::default();
    // A fixed sequence of numbers stands in for noise.
    let mut state = 1u64;
    let mut uniform = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    for image in 0..40usize {
        table.images.push(format!("{image:03}"));
        let time_s = 60.0 * image as f64;
        let temperature_c = 20.0 + 2.0 * (time_s / 600.0).sin();
        for _ in 0..40 {
            let seen = DVec2::new(2048.0 * uniform(), 1536.0 * uniform());
            let shown = facility.pixel(camera.line_of_sight(seen));
            let noise = DVec2::new(uniform() + uniform() - 1.0, uniform() + uniform() - 1.0) * 0.1;
            // The mount turns by 0.15 px, some 4 arcsec, for each kelvin.
            let moved = seen + noise + DVec2::new(0.15 * (temperature_c - 20.0), 0.0);
            let camera_px = moved.clamp(DVec2::ZERO, DVec2::new(2048.0, 1536.0));
            table.rows.push(PointRow {
                time_s: Some(time_s),
                temperature_c: Some(temperature_c),
                ..PointRow::new(image, shown, 200.0, camera_px)
            });
        }
    }
    let tables = Measurements::Points(table);
    let source = Source {
        tables: &tables,
        setup: &setup,
        calibration: None,
        response: None,
        baseline: Baseline::Physical,
    };
    let data = Dataset::new(&source)?;
    let found = diagnose(&data, &[], &DiagnoseOptions::default());
    println!("{}: {}", found.verdict.name(), found.accepted.join(" and "));
    for step in &found.steps {
        println!("  {:.3} arcsec left with [{}]", step.heldout_rms, step.effects.join(", "));
    }
    if found.accepted != ["thermal_boresight"] {
        return Err("another effect was named".into());
    }
    Ok(())
}
