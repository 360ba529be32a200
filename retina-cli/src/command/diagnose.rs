//! `retina diagnose`.

use std::path::PathBuf;

use retina_diagnosis::{
    DiagnoseOptions, Diagnosis, diagnose, diagnose_json, diagnose_page, diagnose_text, diagnose_with_kept,
    kept_effects, unexplained_shapes,
};

use retina_files::InputError;
use retina_frames::diagnose_frames;

use super::workbench::{Input, Material, pictures};
use crate::failure::Failure;
use crate::output::{print_json, print_lines};
use crate::progress::working;

#[derive(clap::Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    input: Input,
    /// Effect that the model already has: an id, or a file with a formula. Repeat the flag for
    /// more.
    #[arg(long = "effect", value_name = "ID|FILE")]
    effects: Vec<String>,
    /// Folder with formulas that you keep, as `investigate --out` writes them. They are tried where no
    /// effect of the catalogue explains what is left.
    #[arg(long, value_name = "DIR")]
    catalogue: Option<PathBuf>,
    /// Number of sign flips of whole groups. The smallest p-value is 1 / (flips + 1).
    #[arg(long, default_value_t = 1999, value_parser = clap::value_parser!(u32).range(199..=99_999))]
    flips: u32,
    /// Seed of the sign flips.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Write a report page with plots and figures. It opens offline.
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// Print a JSON document on standard output.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    arguments.input.check_outputs(&arguments.effects, &[(&arguments.report, "html")])?;
    let options = DiagnoseOptions { flips: arguments.flips as usize, seed: arguments.seed };
    if let Some(mut set) = arguments.input.read()?.frames()? {
        if arguments.catalogue.is_some() {
            return Err(InputError::new("--catalogue", "formulas are not tried on images")
                .help("give the formula with --effect to `retina investigate`")
                .into());
        }
        let (data, added, result) = diagnose_frames(&mut set, &arguments.effects, &options)?;
        if let Some(path) = &arguments.report {
            let left = Diagnosis { accepted: Vec::new(), ..result.clone() };
            let shapes = unexplained_shapes(&data, &added, &left)?;
            diagnose_page(&data, &added, &result, &shapes).after_card(pictures(&set)).write(path)?;
        }
        return match arguments.json {
            true => print_json(&diagnose_json(&data, &result)),
            false => print_lines(&diagnose_text(&data, &result)),
        };
    }
    let (material, added) = Material::read(&arguments.input, &arguments.effects)?;
    let data = material.data();
    let kept = arguments.catalogue.as_ref().map(|folder| kept_effects(folder, data)).transpose()?;
    let spinner = working("looking for effects");
    let found = match kept {
        None => (diagnose(data, &added, &options), added),
        Some((kept, notes)) => {
            let (mut result, model) = diagnose_with_kept(data, &added, &kept, &options);
            result.notes.extend(notes);
            (result, model)
        }
    };
    spinner.finish_and_clear();
    let (result, added) = found;
    if let Some(path) = &arguments.report {
        let shapes = unexplained_shapes(data, &added, &result)?;
        diagnose_page(data, &added, &result, &shapes).write(path)?;
    }
    match arguments.json {
        true => print_json(&diagnose_json(data, &result)),
        false => print_lines(&diagnose_text(data, &result)),
    }
}
