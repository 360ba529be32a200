//! What a folder of rounds was asked, so that another question does not go on with its measurements.

use std::path::Path;

use retina_files::{InputError, hash_file, read_text, write_atomic};
use serde_json::{Value, json};

use super::{Outcome, Question, decision_json};
use crate::workbench::{Input, Measured};

/// File that says what was asked and decided.
const RECORD: &str = "decision.json";

/// A question's identity: names of files do not belong to it, what they hold does.
pub(super) struct Asked(Value);

impl Asked {
    pub(super) fn of(input: &Input, question: &Question, specified: &[String]) -> Result<Self, InputError> {
        let Measured::Files(files) = &input.measured else { return Ok(Self(Value::Null)) };
        let data = files
            .iter()
            .map(|file| hash_file(file))
            .collect::<Result<Vec<_>, _>>()
            .map_err(|error| InputError::new("--data", format!("cannot be read: {error}")))?;
        let sorted = |mut names: Vec<String>| {
            names.sort();
            names
        };
        let common = question.common.iter().map(|given| given.name().to_owned());
        Ok(Self(json!({
            "setup": input.setup.name,
            "data_blake3": data,
            "rivals": sorted(specified.to_vec()),
            "effects": sorted(common.collect()),
            "baseline": input.baseline,
        })))
    }

    /// Refuses a folder that was asked something else.
    pub(super) fn check(&self, folder: &Path) -> Result<(), InputError> {
        let path = folder.join(RECORD);
        if !path.exists() {
            return Ok(());
        }
        let help = "name another folder with --out, or remove this file if its rounds belong to the question that you ask";
        let known: Value = serde_json::from_str(&read_text(&path)?)
            .map_err(|error| InputError::new(&path, format!("is no decision: {error}")).help(help))?;
        let words = [
            ("setup", "setup"),
            ("data_blake3", "content of --data"),
            ("rivals", "set of rivals"),
            ("effects", "set of --effect"),
            ("baseline", "baseline"),
        ];
        match words.iter().find(|(key, _)| known["asked"][key] != self.0[key]) {
            None => Ok(()),
            Some((key, what)) => Err(InputError::new(
                folder,
                format!("the folder has rounds of another question: another {what}"),
            )
            .found(&known["asked"][key])
            .expected(&self.0[key])
            .help("name another folder with --out")),
        }
    }
}

pub(super) fn write_record(folder: &Path, asked: &Asked, outcome: &Outcome) -> Result<(), InputError> {
    let path = folder.join(RECORD);
    let failed = |error: std::io::Error| InputError::new(&path, format!("cannot be written: {error}"));
    std::fs::create_dir_all(folder).map_err(failed)?;
    let mut document = decision_json(outcome);
    document["asked"] = asked.0.clone();
    write_atomic(&path, format!("{document:#}\n").as_bytes()).map_err(failed)
}
