//! `retina simulate plan`.

use std::path::PathBuf;

use retina_calibration::geometry::MeasurementPlan;
use retina_campaign::{PointsOptions, simulate_plan};
use retina_files::InputError;
use retina_formats::TableKind;
use serde_json::json;

use super::{CentroidName, Common};
use crate::failure::Failure;
use crate::output::tell;
use crate::progress::counter;
use crate::setup::read_setup;

#[derive(clap::Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    common: Common,
    /// Folder of the plan: screens/, pattern.csv, pattern.toml and plan.csv.
    #[arg(long, value_name = "DIR")]
    plan: PathBuf,
    /// Centroid estimator.
    #[arg(long, value_enum, default_value = "windowed")]
    centroid: CentroidName,
    /// Keep the camera images, in DIR/images.
    #[arg(long)]
    images: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let common = &arguments.common;
    let plan = MeasurementPlan::read(&arguments.plan, &read_setup(&common.setup)?)?;
    // A knock happened half way through the campaign that came before.
    let start_s = plan.exposures.iter().filter_map(|exposure| exposure.time_s).reduce(f64::min);
    let facility = common.facility(TableKind::Points, start_s.unwrap_or(0.0))?;
    let options = PointsOptions { centroid: arguments.centroid.into(), ..PointsOptions::default() };
    let table = common.out.join("points.csv");
    if table.exists() {
        return Err(InputError::new(&table, "is there already")
            .help("give --out another folder, or remove the file to measure the plan again")
            .into());
    }
    common.make_folder()?;
    let bar = counter(plan.exposures.len() as u64, "exposures");
    let keep = arguments.images.then_some(common.out.as_path());
    let result = simulate_plan(&facility, &plan, &options, keep, |done| bar.set_position(done as u64))?;
    bar.finish_and_clear();
    result.table.write(&table, &facility.setup)?;
    tell!(
        "{}: {} of {} points measured in {} exposures",
        table.display(),
        result.table.rows.len(),
        result.shown,
        result.exposures_s.len()
    );
    common.finish(
        "plan",
        &facility,
        json!({
            "points": result.table.rows.len(),
            "shown": result.shown,
            "exposure_s": result.exposures_s,
            "centroid": format!("{:?}", options.centroid),
        }),
    )
}
