//! A facility's geometry from points that were shown and measured: here by the virtual bench, elsewhere from a
//! `points.csv`.
//!
//! `cargo run --release -p retina --example calibrate [points.csv]`

use std::error::Error;
use std::path::PathBuf;

use retina::bench::OpticsDetail;
use retina::campaign::PointsOptions;
use retina::formats::TableKind;
use retina::prelude::*;

pub(crate) fn main() -> Result<(), Box<dyn Error>> {
    let setup = Setup::parse(retina::assets::WIDE_FOV_SETUP, "wide-fov.toml".as_ref())?;
    let given: Vec<PathBuf> = std::env::args()
        .skip(1)
        .map(PathBuf::from)
        .filter(|path| path.extension().is_some_and(|e| e == "csv"))
        .collect();
    let table = if given.is_empty() {
        // A coarse trace of the lenses is quick; the default is exact to 0.01 px.
        let detail = OpticsDetail { nodes: [7, 5], lines: 1, half_px: 24 };
        let options = PointsOptions { exposures: 8, points: 120, detail, ..PointsOptions::default() };
        let facility = Facility::new(&setup, &[], TableKind::Points, options.length_s(), 1)?;
        simulate_points(&facility, &options, None, |_| ())?.table
    } else {
        PointsTable::read(&given)?
    };
    let result = calibrate(&table, &setup, &CalibrateOptions::default())?;
    println!(
        "{} points in {} exposures: {:.2} arcsec rms, {:.2} on exposures that the fit has not seen; {:.1} % within 10 arcsec",
        result.errors.points,
        result.exposures,
        result.errors.rms_arcsec,
        result.heldout.rms_arcsec,
        100.0 * result.heldout.fraction_within_10_arcsec
    );
    for warning in &result.warnings {
        println!("warning: {warning}");
    }
    Ok(())
}
