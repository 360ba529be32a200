//! `retina check`.

use std::path::PathBuf;

use retina::check::{Checked, Company, check};
use retina_files::InputError;
use serde_json::{Value, json};

use crate::failure::{Failure, input_json};
use crate::output::{print_json, print_lines};

/// Files that are given together are held to each other: a calibration and a table to their setup, an effect's formula to
/// a table.
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Files, or folders of frames, patterns, plans or CORTO scenarios.
    #[arg(value_name = "FILE", required = true)]
    files: Vec<PathBuf>,
    /// Print a JSON document on standard output.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let company = Company::of(&arguments.files);
    let found: Vec<(&PathBuf, Result<Checked, InputError>)> =
        arguments.files.iter().map(|file| (file, check(file, &company))).collect();
    let bad = found.iter().filter(|(_, checked)| checked.is_err()).count();
    if arguments.json {
        let files: Vec<Value> = found.iter().map(|(file, checked)| document(file, checked)).collect();
        print_json(&json!({ "schema": "retina.check/1", "ok": bad == 0, "files": files }))?;
    }
    for (file, checked) in found {
        match checked {
            Ok(checked) if !arguments.json => print_lines(&lines(file, &checked))?,
            Ok(_) => {}
            Err(error) => Failure::from(error).show(),
        }
    }
    match bad {
        0 => Ok(()),
        _ => {
            Err(Failure::new(format!("{bad} of {} files cannot be used as they are", arguments.files.len())))
        }
    }
}

fn lines(file: &std::path::Path, checked: &Checked) -> Vec<String> {
    let schema = checked.schema.as_ref().map_or_else(String::new, |schema| format!(" ({schema})"));
    let mut out = vec![format!("{}: {}{schema}", file.display(), checked.kind)];
    out.extend(checked.says.iter().map(|text| format!("    {text}")));
    out.extend(checked.notes.iter().map(|text| format!("    note: {text}")));
    out
}

fn document(file: &std::path::Path, checked: &Result<Checked, InputError>) -> Value {
    match checked {
        Ok(checked) => json!({
            "file": file,
            "ok": true,
            "kind": checked.kind,
            "schema": checked.schema,
            "says": checked.says,
            "notes": checked.notes,
        }),
        Err(error) => json!({
            "file": file,
            "ok": false,
            "message": error.to_string(),
            "input": input_json(error),
        }),
    }
}
