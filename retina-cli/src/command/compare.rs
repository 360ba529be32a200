//! `retina compare`.

use std::path::PathBuf;

use retina_diagnosis::{compare, compare_json, compare_page, compare_text};
use retina_files::InputError;
use retina_report::Page;

use super::workbench::{Input, Material};
use crate::failure::Failure;
use crate::output::{print_json, print_lines};

#[derive(clap::Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    input: Input,
    /// Effect to fit: an id of the catalogue, or a file with a formula. Repeat the flag for more.
    #[arg(long = "effect", value_name = "ID|FILE")]
    effects: Vec<String>,
    /// Draw the errors over the field and against the columns, as SVG.
    #[arg(long, value_name = "FILE")]
    svg: Option<PathBuf>,
    /// Write a report page with plots and figures. It opens offline.
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// Print a JSON document on standard output.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let outputs = [(&arguments.svg, "svg"), (&arguments.report, "html")];
    arguments.input.check_outputs(&arguments.effects, &outputs)?;
    let (material, added) = Material::read(&arguments.input, &arguments.effects)?;
    let data = material.data();
    let result = compare(data, &added);
    if !(result.rms.is_finite() && result.rms_unweighted.is_finite()) {
        return Err(InputError::new(arguments.input.table(), "the errors have no finite size")
            .found(format!("{} rms, {} unweighted", result.rms, result.rms_unweighted))
            .help("look for measurements, or their uncertainties, that are larger than any can be")
            .into());
    }
    if let Some(path) = &arguments.svg {
        retina_diagnosis::write_figure(path, data, &added)?;
    }
    if let Some(path) = &arguments.report {
        let page = compare_page(data, &added, &result);
        material.pictures().into_iter().fold(page, Page::after_card).write(path)?;
    }
    match arguments.json {
        true => print_json(&compare_json(data, &result)),
        false => print_lines(&compare_text(data, &result)),
    }
}
