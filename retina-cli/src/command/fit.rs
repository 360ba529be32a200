//! `retina fit`.

use std::path::PathBuf;

use retina_diagnosis::{fit, fit_json, fit_page, fit_text, write_model, write_predictions};

use retina_files::InputError;
use retina_formats::{Measurements, TableKind};
use retina_report::Page;

use super::workbench::{Input, Material};
use crate::failure::Failure;
use crate::output::{print_json, print_lines, tell};

#[derive(clap::Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    input: Input,
    /// An effect of the catalogue, or a file with a formula; may be given more than once.
    #[arg(long = "effect", value_name = "ID|FILE", required = true)]
    effects: Vec<String>,
    /// Writes the model as a calibration.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Writes baseline, effect and error of every row.
    #[arg(long, value_name = "FILE")]
    predictions: Option<PathBuf>,
    /// Writes a page with plots and figures, which opens offline.
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// Print a JSON document on standard output.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let outputs = [(&arguments.out, "toml"), (&arguments.predictions, "csv"), (&arguments.report, "html")];
    arguments.input.check_outputs(&arguments.effects, &outputs)?;
    let (material, added) = Material::read(&arguments.input, &arguments.effects)?;
    let data = material.data();
    if data.kind != TableKind::Points && arguments.out.is_some() {
        return Err(InputError::new(
            "--out",
            "writes the calibration of a geometry: it is for tables of points",
        )
        .found(format!("a table of {}", data.kind.name()))
        .help("leave it out; --json and --predictions hold what was fitted")
        .into());
    }
    let result = fit(data, &added)?;
    if let (Some(path), Material::Table(material)) = (&arguments.out, &material)
        && let Measurements::Points(table) = &material.tables
    {
        let held = material.calibration.as_ref();
        let rms_arcsec = write_model(path, data, &result, &added, &material.setup, table, held)?;
        tell!("the model's polynomials are {rms_arcsec:.2e} arcsec rms from its predictions");
    }
    if let Some(path) = &arguments.predictions {
        write_predictions(path, data, &result)?;
    }
    if let Some(path) = &arguments.report {
        let page = fit_page(data, &added, &result);
        material.pictures().into_iter().fold(page, Page::section).write(path)?;
    }
    match arguments.json {
        true => print_json(&fit_json(data, &result)),
        false => print_lines(&fit_text(data, &result)),
    }
}
