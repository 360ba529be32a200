//! `retina navigate far-range`.

use std::path::{Path, PathBuf};

use retina_batch::Shard;
use retina_experiments::far_range::{
    Choice, FarRangeError, ImagedResult, Images, Scenario, Transfer, TransferImages, report, run_imaged,
    run_poses, run_transfer, summarise,
};
use retina_files::InputError;
use serde_json::Value;

use super::steps::{results_name, write};
use crate::failure::Failure;
use crate::output::{print_json, tell};

#[derive(Clone, Copy, clap::ValueEnum)]
enum ImagesName {
    /// No images: measured positions with noise.
    Points,
    /// Images of an ideal camera, without the facility.
    Ideal,
    /// Images of the virtual bench.
    Bench,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum TransferImagesName {
    /// No images: only the Monte Carlo runs.
    None,
    /// Images of an ideal camera, without the facility.
    Ideal,
    /// Images of the virtual bench.
    Bench,
}

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Scenario, schema retina.far-range/1.
    #[arg(value_name = "SCENARIO")]
    scenario: PathBuf,
    /// Folder for the results. Poses that are already in it are not run again.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Source of the measurements [default: the scenario's].
    #[arg(long, value_enum)]
    images: Option<ImagesName>,
    /// Source of the images for one more run of the transfer filter [default: the scenario's].
    #[arg(long, value_enum, conflicts_with = "shard")]
    transfer_images: Option<TransferImagesName>,
    /// Number of random poses [default: the scenario's].
    #[arg(long)]
    poses: Option<usize>,
    /// Calibration of the bench [default: the scenario's or the setup's].
    #[arg(long, value_name = "FILE")]
    calibration: Option<PathBuf>,
    /// Run only the poses whose number is I modulo N, without the transfer.
    ///
    /// Run all shards into one folder. Then run the command without --shard into that folder: it
    /// gives the whole result.
    #[arg(long, value_name = "I/N", allow_hyphen_values = true)]
    shard: Option<Shard>,
    /// Print a JSON document on standard output.
    #[arg(long)]
    json: bool,
}

impl From<FarRangeError> for Failure {
    fn from(error: FarRangeError) -> Self {
        match error {
            FarRangeError::Input(error) => error.into(),
            FarRangeError::Bench(error) => error.into(),
            error => Self::new(error.to_string()),
        }
    }
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let images = arguments.images.map(|name| match name {
        ImagesName::Points => Images::Points,
        ImagesName::Ideal => Images::Ideal,
        ImagesName::Bench => Images::Bench,
    });
    let transfer_images = arguments.transfer_images.map(|name| match name {
        TransferImagesName::None => TransferImages::None,
        TransferImagesName::Ideal => TransferImages::Ideal,
        TransferImagesName::Bench => TransferImages::Bench,
    });
    let choice = Choice {
        images,
        transfer_images,
        poses: arguments.poses,
        calibration: arguments.calibration.clone(),
    };
    let scenario = Scenario::read(&arguments.scenario, &choice)?;
    std::fs::create_dir_all(&arguments.out)
        .map_err(|error| InputError::new(&arguments.out, format!("the folder cannot be made: {error}")))?;
    let count = match arguments.shard {
        None => scenario.poses.count,
        Some(shard) => (scenario.poses.count + shard.count - 1 - shard.index) / shard.count,
    };
    if count == 0 {
        return Err(InputError::new(Path::new("--shard"), "contains no pose")
            .found(format!("more shards than the {} poses", scenario.poses.count))
            .into());
    }
    let bar = crate::progress::counter(count as u64, "poses");
    let advance = &mut |done| bar.set_position(done as u64);
    let results = run_poses(&scenario, arguments.shard, &arguments.out, advance)?;
    bar.finish_and_clear();
    let summary = summarise(&results);
    let name = |stem: &str| results_name(stem, None, arguments.shard);
    write(&arguments.out, &format!("{}.svg", name("figure-12")), &report::figure_12(&results))?;
    let errors = match summary.cross_percentiles_arcsec[0].is_finite() {
        true => format!(
            "50 and 95 % within {:.1} and {:.1} arcsec across the boresight, {:.0} and {:.0} about it",
            summary.cross_percentiles_arcsec[0],
            summary.cross_percentiles_arcsec[2],
            summary.about_percentiles_arcsec[0],
            summary.about_percentiles_arcsec[2],
        ),
        false => "none was found, so there are no errors".to_owned(),
    };
    tell!(
        "attitude found in {:.2} % of {} poses (the paper: {} %), wrong in {}; planet identified in {:.2} % (the paper: {} %), \
         wrong in {}; {errors}",
        summary.attitude_found_percent,
        summary.poses,
        report::PAPER_ATTITUDE_PERCENT,
        summary.attitude_wrong,
        summary.planet_found_percent,
        report::PAPER_PLANET_PERCENT,
        summary.planet_wrong,
    );
    // The transfer's measurements are as good as all poses have them.
    let whole = arguments.shard.is_none();
    let (transfer, imaged) = match scenario.transfer.as_ref().filter(|_| whole) {
        None => (None, None),
        Some(transfer) => {
            let measured = (summary.planet_sigma_arcsec / 3600.0).to_radians();
            let sigma_rad = transfer.line_of_sight_sigma_rad.unwrap_or(measured);
            if !sigma_rad.is_finite() || sigma_rad <= 0.0 {
                return Err(Failure::new(
                    "no planet was identified, so the noise of the lines of sight is unknown; give \
                     transfer.line_of_sight_sigma_arcsec",
                ));
            }
            let used = summary.attitude_found_percent * summary.planet_found_percent * 1e-4;
            let result = run_transfer(transfer, &scenario.ephemeris, sigma_rad, used, scenario.seed)?;
            let imaged = imaged(&scenario, transfer, &arguments.out)?;
            write(&arguments.out, "figure-13.svg", &report::figure_13(&result, imaged.as_ref()))?;
            if let Some(last) = result.sessions.last() {
                tell!(
                    "transfer of {:.0} days: {:.0} km and {:.3} m/s at the end, 3 sigma (the paper: {:.0} km, {} m/s); lines of \
                     sight of {:.2} arcsec; NEES within its bounds in {:.0} % of sessions, NIS {:.3} (bounds {:.3} to {:.3})",
                    last.day,
                    last.three_sigma[0],
                    last.three_sigma[1],
                    report::PAPER_THREE_SIGMA[0],
                    report::PAPER_THREE_SIGMA[1],
                    result.line_of_sight_sigma_arcsec,
                    100.0 * result.nees_within,
                    result.nis,
                    result.nis_bounds[0],
                    result.nis_bounds[1]
                );
            }
            (Some(result), imaged)
        }
    };
    let warnings = report::warnings(&scenario, &summary, imaged.as_ref());
    warnings.iter().for_each(|warning| tell!("{warning}"));
    let document: Value =
        report::document(&scenario, &summary, transfer.as_ref(), imaged.as_ref(), &warnings);
    write(&arguments.out, &format!("{}.json", name("far-range")), &format!("{document:#}\n"))?;
    if arguments.json { print_json(&document) } else { Ok(()) }
}

/// The transfer's run on images, where the scenario wants one.
fn imaged(scenario: &Scenario, transfer: &Transfer, out: &Path) -> Result<Option<ImagedResult>, Failure> {
    let Some(images) = transfer.images.taken() else { return Ok(None) };
    let sessions = (transfer.length_s / transfer.session_s) as u64 + 1;
    let bar = crate::progress::counter(sessions * transfer.imaged_per_session as u64, "images");
    let run = run_imaged(scenario, transfer, images, out, &mut |done| bar.set_position(done as u64))?;
    bar.finish_and_clear();
    tell!(
        "on {} images: {} attitudes found, {} planets identified ({} saturated), {} wrong; {:.0} km and {:.3} m/s off at the \
         end, 3 sigma {:.0} km and {:.3} m/s; NIS {:.3} (bounds {:.3} to {:.3})",
        run.images,
        run.attitudes_found,
        run.planets_identified,
        run.planets_saturated,
        run.wrong,
        run.final_error[0],
        run.final_error[1],
        run.final_three_sigma[0],
        run.final_three_sigma[1],
        run.nis.unwrap_or(f64::NAN),
        run.nis_bounds[0],
        run.nis_bounds[1]
    );
    Ok(Some(run))
}
