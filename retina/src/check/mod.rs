//! What a file is, whether it reads, and what it would do: every file that RETINA takes or writes, without any work.

mod data;
mod table;
mod toml_file;

use std::path::{Path, PathBuf};

use retina_batch::FolderState;
use retina_cluster::Plan;
use retina_diagnosis::{Baseline, Dataset, Source};
use retina_files::{InputError, read_bytes};
use retina_formats::{Measurements, TableKind};
use retina_geometry::Setup;

/// What was found of one file or folder.
#[derive(Debug, Clone, PartialEq)]
pub struct Checked {
    /// What it is, such as `facility setup`.
    pub kind: String,
    /// Its schema, where it names one.
    pub schema: Option<String>,
    /// What is in it and what it would do, a sentence each.
    pub says: Vec<String>,
    /// What the user ought to know.
    pub notes: Vec<String>,
}

impl Checked {
    fn new(kind: impl Into<String>) -> Self {
        Self { kind: kind.into(), schema: None, says: Vec::new(), notes: Vec::new() }
    }

    fn of_schema(kind: &str, schema: &str) -> Self {
        Self { schema: Some(schema.to_owned()), ..Self::new(kind) }
    }

    fn says(mut self, text: impl Into<String>) -> Self {
        self.says.push(text.into());
        self
    }

    fn note(mut self, text: impl Into<String>) -> Self {
        self.notes.push(text.into());
        self
    }
}

/// What the files that are checked together say of each other: calibrations and tables belong to a setup, formulas to a
/// table.
#[derive(Debug, Default)]
pub struct Company {
    setups: Vec<Setup>,
    tables: Vec<PathBuf>,
}

impl Company {
    /// Setups and tables among the files; those that do not read are left to [`check`].
    pub fn of(files: &[PathBuf]) -> Self {
        let mut out = Self::default();
        for file in files {
            match extension(file).as_str() {
                "toml" => out.setups.extend(Setup::read(file).ok()),
                "csv" if TableKind::of_file(file).is_ok() => out.tables.push(file.clone()),
                _ => {}
            }
        }
        out
    }

    /// The setup of a name: among the files, else one that ships.
    fn setup(&self, name: &str) -> Option<Setup> {
        let own = self.setups.iter().find(|setup| setup.name == name).cloned();
        own.or_else(|| Setup::shipped(Path::new(name)))
    }

    /// Tables as the workbench reads them, with the setup that they name, else with the only one among the files; `None`
    /// where there is none.
    fn dataset(&self, tables: &Measurements) -> Result<Option<Dataset>, InputError> {
        let stamped = match tables {
            Measurements::Points(points) => points.files.first().and_then(|file| file.setup.as_ref()),
            _ => None,
        };
        let only = || if let [only] = self.setups.as_slice() { Some(only.clone()) } else { None };
        let Some(setup) = stamped.and_then(|stamp| self.setup(&stamp.name)).or_else(only) else {
            return Ok(None);
        };
        let source =
            Source { tables, setup: &setup, calibration: None, response: None, baseline: Baseline::Physical };
        Dataset::new(&source).map(Some)
    }
}

fn extension(path: &Path) -> String {
    path.extension().and_then(|extension| extension.to_str()).unwrap_or("").to_ascii_lowercase()
}

/// Checks one file or folder.
///
/// # Errors
/// It is none of RETINA's, or does not read; the error says where and why.
pub fn check(path: &Path, company: &Company) -> Result<Checked, InputError> {
    if path.is_dir() {
        return folder(path);
    }
    if let Some(setup) = Setup::shipped(path).filter(|_| !path.exists()) {
        return Ok(toml_file::setup(&setup)?.says("it ships: commands and scenes take its name"));
    }
    match extension(path).as_str() {
        "toml" => toml_file::check_toml(path, company),
        "csv" => table::check_table(path, company),
        "json" => data::check_json(path),
        "jsonl" => data::check_lines(path),
        "glb" | "gltf" | "obj" | "icq" | "bds" | "dsk" => data::check_body(path),
        "png" | "tif" | "tiff" | "jpg" | "jpeg" | "fits" | "fit" | "fts" => data::check_picture(path),
        "exr" => data::check_exr(path),
        "zmx" => data::check_lenses(path),
        "agf" => data::check_glasses(path),
        "bsp" | "bpc" | "bc" | "tpc" | "tf" | "tsc" | "tls" | "tm" => data::check_kernel(path),
        other => {
            // Says why, where it cannot even be read.
            read_bytes(path)?;
            Err(InputError::new(path, "is no file that RETINA knows")
                .found(if other.is_empty() { "no extension".to_owned() } else { format!("`.{other}`") })
                .expected(
                    "toml, csv, json, jsonl, glb, gltf, obj, icq, bds, dsk, png, tiff, jpg, fits, exr, zmx, agf, bsp, bpc, bc, tpc, tf, tsc, tls, tm, or a folder",
                ))
        }
    }
}

fn folder(path: &Path) -> Result<Checked, InputError> {
    if let Some(plan) = Plan::read(path)? {
        let unit = plan.work.unit();
        return Ok(Checked::of_schema("plan of shards", "retina.plan/1")
            .says(format!("{} {unit} of {} in {} shards", plan.items, plan.source.display(), plan.shards))
            .says("`retina status` counts what is done"));
    }
    if path.join("pattern.toml").exists() {
        return toml_file::check_toml(&path.join("pattern.toml"), &Company::default());
    }
    if path.join("scene").is_dir() {
        let scenario = retina_corto::Scenario::read(path, None)?;
        return Ok(Checked::new("scenario of CORTO")
            .says(format!("{} poses; `retina render --corto` renders them", scenario.poses.len())));
    }
    match FolderState::read(path, false)? {
        Some(state) => {
            let Checked { kind, schema, says, mut notes } =
                Checked::of_schema("folder of frames", "retina.batch/1").says(format!(
                    "{} of the sequence's {} frames are done",
                    state.done.len(),
                    state.frames_of_sequence
                ));
            if !state.torn.is_empty() {
                notes.push(format!("{} frames are torn: `retina render --resume` makes them again", state.torn.len()));
            }
            Ok(Checked { kind, schema, says, notes })
        }
        None => Err(InputError::new(path, "is no folder that RETINA knows").expected(
            "frames (batch.json), a plan (plan.json), a pattern (pattern.toml), or a scenario of CORTO (scene/)",
        )),
    }
}
