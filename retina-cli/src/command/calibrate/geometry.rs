//! `retina calibrate geometry`.

use std::path::{Path, PathBuf};

use retina_calibration::geometry::{
    self, CalibrateOptions, ImageReport, Pattern, calibrate, points_from_images, text_summary, to_json,
};
use retina_files::InputError;
use retina_formats::{MeasuredResponse, PointsTable};
use retina_geometry::Setup;
use retina_image::{Centroid, DetectOptions};
use serde_json::json;

use crate::failure::Failure;
use crate::output::{print_json, print_lines, tell};
use crate::setup::read_setup;

#[derive(clap::Args)]
#[command(group = clap::ArgGroup::new("input").required(true).args(["data", "images"]))]
pub(crate) struct Arguments {
    /// Facility, schema retina.setup/1.
    #[arg(long)]
    setup: PathBuf,
    /// Table of points (points.csv). Repeat the flag to fit several tables together.
    #[arg(long, value_name = "TABLE")]
    data: Vec<PathBuf>,
    /// Folder of camera images.
    ///
    /// Each image is named after the screen it shows, or the folder's images.csv says which screen
    /// it shows.
    #[arg(long, value_name = "DIR", requires = "pattern")]
    images: Option<PathBuf>,
    /// Folder of the pattern that the images show.
    #[arg(long, value_name = "DIR", requires = "images")]
    pattern: Option<PathBuf>,
    /// Calibration to write.
    #[arg(long, value_name = "FILE.toml")]
    out: PathBuf,
    /// Also write the points found in the images.
    #[arg(long, value_name = "FILE.csv", requires = "images")]
    points_out: Option<PathBuf>,
    /// Also write the residual, weight and error of each point.
    #[arg(long, value_name = "FILE.csv")]
    residuals: Option<PathBuf>,
    /// Also write a report page with plots.
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// Calibration with the display's measured response.
    ///
    /// [default: the file of --out if it exists and has a response, otherwise the setup's power
    /// law]
    #[arg(long, value_name = "FILE.toml")]
    response: Option<PathBuf>,
    /// Fit a plain polynomial, without terms in the irradiance.
    #[arg(long)]
    plain: bool,
    /// Irradiance at which D is given [default: the points' median].
    ///
    /// It is the log10 of the irradiance relative to a white pixel at full count.
    #[arg(long, value_name = "L", allow_negative_numbers = true)]
    reference_log10_irradiance: Option<f64>,
    /// Centroid estimator for points in images.
    #[arg(long, value_enum, default_value = "windowed")]
    centroid: CentroidName,
    /// Gain of the camera, electrons per DN.
    ///
    /// With it, the shot noise of the light enters the standard deviation of each centroid.
    #[arg(long, value_name = "E_PER_DN", requires = "images")]
    gain_e_per_dn: Option<f64>,
    /// Print a JSON document on standard output.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum CentroidName {
    /// Gaussian-weighted mean; the window has the same width for faint and bright points.
    Windowed,
    /// Centre of mass above the threshold.
    Moments,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    crate::check_file(&arguments.out, "toml")?;
    for (path, extension) in
        [(&arguments.points_out, "csv"), (&arguments.residuals, "csv"), (&arguments.report, "html")]
    {
        path.as_ref().map_or(Ok(()), |path| crate::check_file(path, extension))?;
    }
    let inputs = arguments.data.iter().chain([&arguments.setup]).chain(&arguments.response);
    crate::check_apart(
        inputs,
        [
            Some(&arguments.out),
            arguments.points_out.as_ref(),
            arguments.residuals.as_ref(),
            arguments.report.as_ref(),
        ],
        Some(&arguments.out),
    )?;
    let setup = read_setup(&arguments.setup)?;
    let (table, reports) = points(arguments, &setup)?;
    let options = CalibrateOptions {
        plain: arguments.plain,
        form: None,
        reference_log10_irradiance: arguments.reference_log10_irradiance,
        response: response(arguments, &setup)?,
    };
    let result = calibrate(&table, &setup, &options)?;
    if let Some(path) = &arguments.points_out {
        table.write(path, &setup)?;
    }
    geometry::write_calibration(&arguments.out, &result, &table, &setup)?;
    if let Some(path) = &arguments.residuals {
        geometry::write_residuals(path, &result, &table)?;
    }
    if let Some(path) = &arguments.report {
        geometry::write_report(path, &result, &table, &setup, &options)?;
    }
    if result.heldout_by_points {
        tell!("fewer than 3 exposures: single points are held out instead of exposures");
    }
    if arguments.json {
        let mut document = to_json(&result, &setup);
        document["out"] = json!(arguments.out);
        if !reports.is_empty() {
            document["images"] = reports.iter().map(image_json).collect();
        }
        return print_json(&document);
    }
    let lines: Vec<String> = text_summary(&result, &setup).lines().map(str::to_owned).collect();
    print_lines(&lines)
}

/// The measured response, if there is one.
fn response(arguments: &Arguments, setup: &Setup) -> Result<Option<MeasuredResponse>, Failure> {
    if let Some(path) = &arguments.response {
        return measured_response(path, setup).map(Some);
    }
    if !arguments.out.is_file() {
        return Ok(None);
    }
    let response = MeasuredResponse::read(&arguments.out, setup)?;
    if response.is_some() {
        tell!("{}: using its measured response", arguments.out.display());
    }
    Ok(response)
}

/// The measured response of a calibration that must have one.
pub(crate) fn measured_response(path: &Path, setup: &Setup) -> Result<MeasuredResponse, Failure> {
    MeasuredResponse::read(path, setup)?.ok_or_else(|| {
        InputError::new(path, "has no measured response")
            .expected("a table [response]")
            .help("make one with `retina calibrate radiometry --out`")
            .into()
    })
}

fn points(arguments: &Arguments, setup: &Setup) -> Result<(PointsTable, Vec<ImageReport>), Failure> {
    let (Some(images), Some(pattern)) = (&arguments.images, &arguments.pattern) else {
        return Ok((PointsTable::read(&arguments.data)?, Vec::new()));
    };
    let centroid = match arguments.centroid {
        CentroidName::Windowed => Centroid::Windowed,
        CentroidName::Moments => Centroid::Moments,
    };
    if let Some(gain) = arguments.gain_e_per_dn.filter(|gain| !(gain.is_finite() && *gain > 0.0)) {
        return Err(InputError::new(Path::new("--gain-e-per-dn"), "is not a positive number")
            .found(gain)
            .into());
    }
    let detect =
        DetectOptions { centroid, gain_e_per_dn: arguments.gain_e_per_dn, ..DetectOptions::default() };
    let (table, reports) = points_from_images(images, pattern, setup, &detect)?;
    let shown = Pattern::read(pattern, setup)?;
    let missing = shown.screens.iter().filter(|s| !reports.iter().any(|r| r.screen == s.file)).count();
    if missing > 0 {
        tell!("warning: {missing} of the pattern's {} screens have no image", shown.screens.len());
    }
    for report in &reports {
        match report.recognised {
            Some((matched, _)) => tell!(
                "{}: {matched} of {} points of light belong to screen {}",
                report.file.display(),
                report.detected,
                report.screen
            ),
            None => tell!(
                "warning: {}: screen {} is not recognised among its {} points of light; left out",
                report.file.display(),
                report.screen,
                report.detected
            ),
        }
    }
    Ok((table, reports))
}

fn image_json(report: &ImageReport) -> serde_json::Value {
    json!({
        "file": report.file,
        "screen": report.screen,
        "detected": report.detected,
        "matched": report.recognised.map(|r| r.0),
        "log10_chance": report.recognised.map(|r| r.1),
    })
}
