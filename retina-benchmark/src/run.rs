//! Runs the workbench on each set: one JSON line a finished set, so that a run that was stopped goes on.

use std::collections::HashSet;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::Instant;

use rayon::prelude::*;
use retina_diagnosis::{
    AddedEffect, Baseline, Dataset, DiagnoseOptions, Diagnosis, Fit, Source, diagnose, fit, write_predictions,
};
use retina_files::InputError;
use retina_formats::{Measurements, TableKind};
use retina_geometry::Setup;
use serde::{Deserialize, Serialize};

use crate::generate::{io, to_bytes};
use crate::lists::{self, Part, finished};

/// What the workbench said of a table.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Said {
    pub(crate) verdict: String,
    pub(crate) accepted: Vec<String>,
    pub(crate) indistinguishable: Vec<String>,
    pub(crate) unexplained: Vec<String>,
    pub(crate) unexplained_p: f64,
    /// Least p-value of all candidates.
    pub(crate) p: f64,
    /// Of the best candidate: name, value, standard deviation.
    pub(crate) parameters: Vec<(String, f64, Option<f64>)>,
    pub(crate) next: Option<String>,
}

/// A finished set.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Finished {
    pub(crate) set: usize,
    pub(crate) said: Said,
    /// After the follow-up that was proposed, both campaigns read together.
    pub(crate) follow_up: Option<Said>,
    pub(crate) seconds: f64,
}

/// Stem of the lists of finished sets.
pub(crate) const LIST: &str = "results";

/// Runs all sets that are not finished, of a part or of all; `progress` is told finished, total and seconds left.
///
/// # Errors
/// A table cannot be read or a result not be written.
pub fn run(
    folder: &Path,
    setup: &Path,
    part: Option<Part>,
    progress: impl Fn(usize, usize, f64) + Sync,
) -> Result<(), InputError> {
    let setup = Setup::named(setup, Path::new(""))?;
    let done: HashSet<usize> = finished::<Finished>(folder, LIST)?.iter().map(|f| f.set).collect();
    let sets = folder.join("sets");
    let entries = std::fs::read_dir(&sets).map_err(|error| {
        InputError::new(&sets, format!("cannot be read: {error}")).help("`generate` writes the sets")
    })?;
    let mut all: Vec<usize> = entries
        .filter_map(|entry| entry.ok()?.file_name().to_string_lossy().parse().ok())
        .filter(|&set| Part::has(part, set))
        .collect();
    all.sort_unstable();
    let open: Vec<usize> = all.iter().copied().filter(|set| !done.contains(set)).collect();
    let before = all.len() - open.len();
    let (file, path) = lists::open::<Finished>(folder, LIST, part)?;
    let out = Mutex::new((file, 0usize));
    let start = Instant::now();
    open.par_iter().with_max_len(1).try_for_each(|&set| {
        let result = line(&one(folder, &setup, set)?)?;
        let mut out = out.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        out.0.write_all(result.as_bytes()).map_err(|error| io(&path, &error))?;
        out.1 += 1;
        let left = start.elapsed().as_secs_f64() / out.1 as f64 * (open.len() - out.1) as f64;
        progress(before + out.1, all.len(), left);
        Ok(())
    })
}

fn line(set: &Finished) -> Result<String, InputError> {
    serde_json::to_string(set)
        .map(|text| text + "\n")
        .map_err(|error| InputError::new("results", error.to_string()))
}

pub(crate) fn read(setup: &Setup, files: &[PathBuf]) -> Result<Dataset, InputError> {
    let tables = Measurements::read(files)?;
    let baseline = Baseline::Physical;
    Dataset::new(&Source { tables: &tables, setup, calibration: None, response: None, baseline })
}

fn one(folder: &Path, setup: &Setup, set: usize) -> Result<Finished, InputError> {
    let start = Instant::now();
    let own = folder.join("sets").join(format!("{set:05}"));
    let table = own.join("table.csv");
    let data = read(setup, std::slice::from_ref(&table))?;
    let found = diagnose(&data, &[], &DiagnoseOptions::default());
    let seconds = start.elapsed().as_secs_f64();
    if data.kind == TableKind::Points && !found.accepted.is_empty() {
        let added =
            found.accepted.iter().map(|id| AddedEffect::read(id, &data)).collect::<Result<Vec<_>, _>>()?;
        predict(folder, set, &data, &fit(&data, &added)?)?;
    }
    let mut follow_up = None;
    if let Some(next) = &found.next {
        let again = own.join(format!("{}.csv", next.action));
        if again.exists() {
            let both = read(setup, &[table, again])?;
            follow_up = Some(said(&diagnose(&both, &[], &DiagnoseOptions::default())));
        }
    }
    Ok(Finished { set, said: said(&found), follow_up, seconds })
}

/// The fitted effects' field, camera px, beside the sealed one.
pub(crate) fn predict(folder: &Path, set: usize, data: &Dataset, fitted: &Fit) -> Result<(), InputError> {
    let predicted = folder.join("predicted");
    std::fs::create_dir_all(&predicted).map_err(|error| io(&predicted, &error))?;
    let path = predicted.join(format!("{set:05}.csv"));
    write_predictions(&path, data, fitted)?;
    let text = std::fs::read_to_string(&path).map_err(|error| io(&path, &error))?;
    let values: Vec<f64> = text
        .lines()
        .skip(1)
        .flat_map(|line| line.split(',').skip(2).take(2).map(|cell| cell.parse().unwrap_or(f64::NAN)))
        .collect();
    let short = predicted.join(format!("{set:05}.f32"));
    std::fs::write(&short, to_bytes(&values)).map_err(|error| io(&short, &error))?;
    std::fs::remove_file(&path).map_err(|error| io(&path, &error))
}

fn said(found: &Diagnosis) -> Said {
    let text = |ids: &[&'static str]| ids.iter().map(|id| (*id).to_owned()).collect();
    let best = found.candidates.iter().map(|c| c.p_value).fold(1.0, f64::min);
    Said {
        verdict: found.verdict.name().to_owned(),
        accepted: text(&found.accepted),
        indistinguishable: text(&found.indistinguishable),
        unexplained: found.unexplained.covariates.clone(),
        unexplained_p: found.unexplained.p_value,
        p: best,
        parameters: found.candidates.first().map_or_else(Vec::new, |c| {
            c.parameters.iter().map(|p| (p.name.clone(), p.value, p.sigma)).collect()
        }),
        next: found.next.as_ref().map(|next| next.action.to_owned()),
    }
}
