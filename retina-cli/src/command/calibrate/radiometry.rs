//! `retina calibrate radiometry`.

use std::path::{Path, PathBuf};

use retina_files::{InputError, write_atomic};
use retina_formats::{CalibrationFile, PowerTable};
use retina_geometry::Setup;
use retina_response::{Calibrated, PowerReadings, figures, json_document, report_page, summary};

use crate::failure::Failure;
use crate::output::{print_json, print_lines, tell};
use crate::setup::read_setup;

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Facility that was measured, schema retina.setup/1.
    #[arg(long)]
    setup: PathBuf,
    /// Power-meter readings (power.csv). Repeat the flag for the tables of one campaign.
    #[arg(long, value_name = "TABLE", required = true)]
    data: Vec<PathBuf>,
    /// Calibration to write.
    ///
    /// If the file exists and belongs to the same setup, its other tables are kept.
    #[arg(long, value_name = "FILE.toml")]
    out: Option<PathBuf>,
    /// Scale the response to another magnification of the same display, and write that one.
    #[arg(long, value_name = "OTHER.toml")]
    for_setup: Option<PathBuf>,
    /// Write a report page with the figures.
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// Write the figures into this folder, as response.svg and magnitude.svg.
    #[arg(long, value_name = "DIR")]
    figures: Option<PathBuf>,
    /// Print a JSON document on standard output.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    for (path, extension) in [(&arguments.out, "toml"), (&arguments.report, "html")] {
        path.as_ref().map_or(Ok(()), |path| crate::check_file(path, extension))?;
    }
    if let Some(folder) = arguments.figures.as_ref().filter(|folder| folder.exists() && !folder.is_dir()) {
        return Err(InputError::new(folder, "is not a folder").help("give --figures another one").into());
    }
    let inputs = arguments.data.iter().chain([&arguments.setup]).chain(&arguments.for_setup);
    crate::check_apart(inputs, [arguments.out.as_ref(), arguments.report.as_ref()], None)?;
    let measured = read_setup(&arguments.setup)?;
    let table = PowerTable::read(&arguments.data)?;
    let other = arguments.for_setup.as_deref().map(read_setup).transpose()?;
    let outputs = Outputs {
        out: arguments.out.as_deref(),
        report: arguments.report.as_deref(),
        figures: arguments.figures.as_deref(),
        json: arguments.json,
    };
    fit(&measured, &table, other.as_ref(), &outputs)
}

/// What is written.
pub(crate) struct Outputs<'a> {
    pub(crate) out: Option<&'a Path>,
    pub(crate) report: Option<&'a Path>,
    pub(crate) figures: Option<&'a Path>,
    pub(crate) json: bool,
}

/// The response of readings, for the facility that was measured or for another one.
pub(crate) fn fit(
    measured: &Setup,
    table: &PowerTable,
    other: Option<&Setup>,
    outputs: &Outputs<'_>,
) -> Result<(), Failure> {
    table.check_setup(measured)?;
    let mut calibrated = Calibrated::fit(measured, PowerReadings::of(table)?)?;
    if let Some(other) = other {
        calibrated = calibrated.for_setup(measured, other)?;
    }
    let setup = other.unwrap_or(measured);
    for fit in &calibrated.fits {
        for warning in &fit.warnings {
            tell!("{}: {warning}", fit.channel.name());
        }
    }
    let text = summary(&calibrated, setup);
    if let Some(out) = outputs.out {
        let mut file = CalibrationFile::read_or_new(out, setup)?;
        file.set_response(calibrated.record(measured), out, setup)?;
        file.write(out)?;
    }
    if let Some(report) = outputs.report {
        report_page(&calibrated, &text).write(report)?;
    }
    if let Some(folder) = outputs.figures {
        let [response, magnitude] = figures(&calibrated);
        std::fs::create_dir_all(folder)
            .map_err(|error| InputError::new(folder, format!("cannot be made: {error}")))?;
        write(&folder.join("response.svg"), &response)?;
        write(&folder.join("magnitude.svg"), &magnitude)?;
    }
    if outputs.json { print_json(&json_document(&calibrated, setup)) } else { print_lines(&text) }
}

fn write(path: &Path, text: &str) -> Result<(), Failure> {
    write_atomic(path, text.as_bytes())
        .map_err(|error| Failure::new(format!("{} cannot be written: {error}", path.display())))
}
