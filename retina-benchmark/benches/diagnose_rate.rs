//! Time of a diagnosis with the whole catalogue: 2000 and 50 000 rows in exposures of 50, noise alone and a coma.

#![allow(clippy::unwrap_used, reason = "a benchmark")]

use std::path::Path;
use std::time::Instant;

use retina_benchmark::campaign_table;
use retina_diagnosis::{Baseline, Dataset, DiagnoseOptions, Source, diagnose};
use retina_formats::Measurements;
use retina_geometry::Setup;

fn main() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let setup = Setup::read(&root.join("assets/setups/wide-fov.toml")).unwrap();
    let folder = std::env::temp_dir().join(format!("retina-diagnose-rate-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    for rows in [2000, 50_000] {
        for effect in [None, Some("flux_coma")] {
            let path = folder.join("table.csv");
            std::fs::write(&path, campaign_table(rows, rows / 50, effect, 1)).unwrap();
            let start = Instant::now();
            let tables = Measurements::read(std::slice::from_ref(&path)).unwrap();
            let source = Source {
                tables: &tables,
                setup: &setup,
                calibration: None,
                response: None,
                baseline: Baseline::Physical,
            };
            let data = Dataset::new(&source).unwrap();
            let read_s = start.elapsed().as_secs_f64();
            let start = Instant::now();
            let found = diagnose(&data, &[], &DiagnoseOptions::default());
            println!(
                "{rows:6} rows, {:9}: read in {read_s:.3} s, diagnosed in {:.3} s, {} {:?}",
                effect.unwrap_or("noise"),
                start.elapsed().as_secs_f64(),
                found.verdict.name(),
                found.accepted
            );
        }
    }
    std::fs::remove_dir_all(&folder).unwrap();
}
