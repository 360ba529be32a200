//! `retina fit`.

use std::path::PathBuf;

use retina_diagnosis::{fit, fit_json, fit_page, fit_text, lens_of_fit, write_model, write_predictions};

use retina_files::InputError;
use retina_formats::{Measurements, TableKind};
use retina_import::write_camera_model;
use retina_report::Page;

use super::workbench::{Input, Material};
use crate::failure::Failure;
use crate::output::{print_json, print_lines, tell};

#[derive(clap::Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    input: Input,
    /// Effect to fit: an id of the catalogue, or a file with a formula. Repeat the flag for more.
    #[arg(long = "effect", value_name = "ID|FILE", required_unless_present = "camera_model")]
    effects: Vec<String>,
    /// Write the model as a calibration (tables of points only).
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Write the lens that was fitted as another program's file.
    ///
    /// `.cameramodel` is for mrcal, `.yaml` and `.json` are for OpenCV. It takes a --baseline that
    /// is a lens model.
    #[arg(long, value_name = "FILE")]
    camera_model: Option<PathBuf>,
    /// Write the baseline, effect and error of every row.
    #[arg(long, value_name = "FILE")]
    predictions: Option<PathBuf>,
    /// Write a report page with plots and figures. It opens offline.
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// Print a JSON document on standard output.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let outputs = [(&arguments.out, "toml"), (&arguments.predictions, "csv"), (&arguments.report, "html")];
    arguments.input.check_outputs(&arguments.effects, &outputs)?;
    if let Some(path) = &arguments.camera_model {
        crate::check_target(path)?;
        let others = [&arguments.out, &arguments.predictions, &arguments.report, &arguments.camera_model];
        arguments.input.check_written(others)?;
        if !arguments.input.has_lens() {
            return Err(InputError::new(
                "--camera-model",
                "writes the lens of a baseline that is a lens model",
            )
            .found("a baseline without a lens")
            .expected("--baseline pinhole, fisheye:... or rational")
            .help("choose such a baseline; --out writes any baseline as a calibration")
            .into());
        }
    }
    let (material, added) = Material::read(&arguments.input, &arguments.effects)?;
    let data = material.data();
    if data.kind != TableKind::Points && arguments.out.is_some() {
        return Err(InputError::new(
            "--out",
            "writes a geometric calibration, which only tables of points give",
        )
        .found(format!("a table of {}", data.kind.name()))
        .help("leave it out; --json and --predictions hold the result of the fit")
        .into());
    }
    let result = fit(data, &added)?;
    if let (Some(path), Material::Table(material)) = (&arguments.out, &material)
        && let Measurements::Points(table) = &material.tables
    {
        let held = material.calibration.as_ref();
        let rms_arcsec = write_model(path, data, &result, &added, &material.setup, table, held)?;
        tell!("the written polynomials differ from the model by {rms_arcsec:.2e} arcsec rms");
    }
    if let (Some(path), Material::Table(material)) = (&arguments.camera_model, &material)
        && let Some(lens) = lens_of_fit(data, &result)
    {
        let camera = &material.setup.camera;
        write_camera_model(path, &lens, [camera.width_px, camera.height_px])?;
    }
    if let Some(path) = &arguments.predictions {
        write_predictions(path, data, &result)?;
    }
    if let Some(path) = &arguments.report {
        let page = fit_page(data, &added, &result);
        material.pictures().into_iter().fold(page, Page::after_card).write(path)?;
    }
    match arguments.json {
        true => print_json(&fit_json(data, &result)),
        false => print_lines(&fit_text(data, &result)),
    }
}
