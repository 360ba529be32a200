//! `retina investigate`.

use std::path::PathBuf;

use retina::workbench::{investigate_frames, pictures_of};
use retina_diagnosis::Dataset;
use retina_files::InputError;
use retina_frames::PICTURES_CAPTION;
use retina_investigation::{
    Investigation, Options, investigate, investigation_json, investigation_page, investigation_text,
    write_formulas,
};
use retina_report::Section;

use super::workbench::{Input, Material};
use crate::failure::Failure;
use crate::output::{print_json, print_lines};
use crate::progress::counter;

#[derive(clap::Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    input: Input,
    /// Effect that the model already has: an id, or a file with a formula. Repeat the flag for
    /// more.
    #[arg(long = "effect", value_name = "ID|FILE")]
    effects: Vec<String>,
    /// Largest number of formulas to look for, one beside the other: 1 to 8.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=8))]
    terms: u32,
    /// Seed of the sign flips.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Write each formula, and those that the data cannot tell from it, into this folder.
    ///
    /// The files are for --effect of compare, diagnose, fit and investigate.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Write a report page with the formulas drawn on the data. It opens offline.
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// Print a JSON document on standard output.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    arguments.input.check_outputs(&arguments.effects, &[(&arguments.report, "html")])?;
    if let Some(folder) = arguments.out.as_ref().filter(|folder| folder.exists() && !folder.is_dir()) {
        return Err(InputError::new("--out", "is no folder")
            .found(folder.display().to_string())
            .expected("a folder, which is made where it is not there")
            .into());
    }
    let options = Options { seed: arguments.seed, most_terms: arguments.terms as usize };
    let bar = counter(100, "%");
    let progress = |_: &str, share: f64| bar.set_position((100.0 * share) as u64);
    if let Some(mut set) = arguments.input.read()?.frames()? {
        let found = investigate_frames(&mut set, &arguments.effects, &options, &progress);
        bar.finish_and_clear();
        let (data, mut result) = found?;
        let images = Section::new("Images").figure(&pictures_of(&set, &result), PICTURES_CAPTION);
        return write(arguments, &data, &mut result, Some(images));
    }
    let (material, added) = Material::read(&arguments.input, &arguments.effects)?;
    let data = material.data();
    let found = investigate(data, &added, &options, &progress);
    bar.finish_and_clear();
    write(arguments, data, &mut found?, None)
}

fn write(
    arguments: &Arguments,
    data: &Dataset,
    result: &mut Investigation,
    images: Option<Section>,
) -> Result<(), Failure> {
    if let Some(folder) = &arguments.out {
        write_formulas(folder, result)?;
    }
    if let Some(path) = &arguments.report {
        let mut page = investigation_page(data, result);
        if let Some(images) = images {
            page = page.after_card(images);
        }
        page.write(path)?;
    }
    match arguments.json {
        true => print_json(&investigation_json(data, result, arguments.out.as_deref())),
        false => print_lines(&investigation_text(data, result)),
    }
}
