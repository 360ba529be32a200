//! `retina lab check`.

use std::path::PathBuf;

use retina::lab::{Finding, Grade, check};
use serde_json::{Value, json};

use super::DeviceArguments;
use crate::failure::Failure;
use crate::output::{print_json, print_lines};
use crate::progress::{advance, counter};

#[derive(clap::Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    devices: DeviceArguments,
    /// Folder for the images: dark.png, flat.png and pattern.png.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Print a JSON document on standard output.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let mut devices = arguments.devices.open()?;
    let bar = counter(0, "steps");
    let findings =
        devices.with(|setup, rig| check(setup, rig, &arguments.out, |done, of| advance(&bar, done, of)));
    bar.finish_and_clear();
    let findings = findings?;
    let bad = findings.iter().filter(|finding| finding.grade == Grade::Bad).count();
    if arguments.json {
        print_json(&json!({
            "schema": "retina.lab-check/1",
            "good": findings.iter().all(|finding| finding.grade == Grade::Good),
            "findings": findings.iter().map(to_json).collect::<Vec<_>>(),
        }))?;
    } else {
        let mut lines = Vec::new();
        for finding in &findings {
            lines.push(format!("{:<5} {:<24} {}", finding.grade.word(), finding.what, finding.found));
            if !finding.mend.is_empty() {
                lines.push(format!("{:30} -> {}", "", finding.mend));
            }
        }
        print_lines(&lines)?;
    }
    if bad > 0 {
        return Err(Failure::exceeded(format!("{bad} of {} findings are bad", findings.len())));
    }
    Ok(())
}

fn to_json(finding: &Finding) -> Value {
    let values: serde_json::Map<String, Value> =
        finding.values.iter().map(|(key, value)| ((*key).to_owned(), json!(value))).collect();
    json!({
        "what": finding.what,
        "grade": finding.grade.word(),
        "found": finding.found,
        "mend": finding.mend,
        "values": values,
    })
}
