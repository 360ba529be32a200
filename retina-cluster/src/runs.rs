//! Runs of one command over many values, schema `retina.runs/1`: parameter studies, seeds of a Monte Carlo campaign, lens
//! searches with different parts. A run has a folder of its own and is done when its record is there.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

use retina_batch::{BatchError, Shard};
use retina_files::{InputError, Table, read_schema, read_text, write_atomic};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

/// Most runs of a file.
const MOST_RUNS: usize = 10_000_000;
/// Of a run's own folder; the command's name for it.
const OUT: &str = "out";
/// The run's number, as a name for the command.
const NUMBER: &str = "number";
/// The record of a run that is done.
const RECORD: &str = "run.json";

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RunsFile {
    #[serde(rename = "schema")]
    _schema: serde::de::IgnoredAny,
    command: Vec<String>,
    #[serde(default)]
    values: BTreeMap<String, toml::Value>,
    table: Option<PathBuf>,
    #[serde(default)]
    collect: BTreeMap<String, String>,
    #[serde(default)]
    resume: bool,
}

/// What a key's value takes: a list of numbers, texts and truths, or a range of whole numbers.
fn list_of(value: &toml::Value) -> Result<Vec<String>, (&'static str, String)> {
    const EXPECTED: &str = "a list of numbers, texts or truths, or { from = 1, to = 100 } with whole numbers";
    let text = |value: &toml::Value| match value {
        toml::Value::Integer(value) => Ok(value.to_string()),
        toml::Value::Float(value) => Ok(value.to_string()),
        toml::Value::Boolean(value) => Ok(value.to_string()),
        toml::Value::String(value) => Ok(value.clone()),
        other => Err((EXPECTED, other.to_string())),
    };
    match value {
        toml::Value::Array(list) if list.is_empty() => Err(("one value at least", "none".to_owned())),
        toml::Value::Array(list) => list.iter().map(text).collect(),
        toml::Value::Table(range) => {
            let end = |key: &str| range.get(key).and_then(toml::Value::as_integer);
            match (end("from"), end("to"), range.len()) {
                (Some(from), Some(to), 2) if to >= from && to.abs_diff(from) < MOST_RUNS as u64 => {
                    Ok((from..=to).map(|value| value.to_string()).collect())
                }
                (Some(from), Some(to), 2) => {
                    Err(("two whole numbers in order, at most 10 million of them", format!("{from} to {to}")))
                }
                _ => Err((EXPECTED, value.to_string())),
            }
        }
        other => Err((EXPECTED, other.to_string())),
    }
}

/// A file of runs.
#[derive(Debug, Clone, PartialEq)]
pub struct Runs {
    /// The file.
    pub file: PathBuf,
    /// Words of the command, with names in braces.
    command: Vec<String>,
    /// Names of the values, in the order of their columns.
    pub names: Vec<String>,
    /// For each name what it takes: every combination is a run, the last name varies fastest. With a table there is one
    /// list of rows instead.
    values: Choices,
    /// Columns of the joined table, and where their values are in the document that the command prints.
    collect: BTreeMap<String, String>,
    /// What is there of a run that was cut short stays for the next attempt.
    resume: bool,
}

#[derive(Debug, Clone, PartialEq)]
enum Choices {
    Grid(Vec<Vec<String>>),
    Rows(Vec<Vec<String>>),
}

/// What a run left: `run.json` of its folder.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunRecord {
    schema: String,
    /// Its number.
    pub number: usize,
    /// Its values by name.
    pub values: BTreeMap<String, String>,
    /// The command's words, with their names in braces.
    pub command: Vec<String>,
    /// Its wall-clock time, s.
    pub seconds: f64,
}

/// What came of running.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct RunsDone {
    /// Runs made.
    pub done: usize,
    /// Runs that were there already.
    pub skipped: usize,
    /// Runs whose command failed.
    pub failed: Vec<usize>,
}

impl Runs {
    /// Reads a file of runs.
    ///
    /// # Errors
    /// It does not read; a name of the command has no values, or values have no name in it; there are too many runs.
    pub fn read(path: &Path) -> Result<Self, InputError> {
        let file: RunsFile = read_schema(path, "retina.runs/1", "a file of runs")?;
        let refuse =
            |key: &str, problem: &str| InputError::new(path, problem.to_owned()).at(format!("key `{key}`"));
        let (names, values) = match &file.table {
            Some(_) if !file.values.is_empty() => {
                return Err(refuse("table", "the values come from a table or from `values`, not from both"));
            }
            Some(table) => {
                let table = path.parent().unwrap_or(Path::new("")).join(table);
                let own = read_text(&table).map_err(|error| error.named_by(path, "table"))?;
                rows(&table, &own)?
            }
            None => {
                let mut lists = Vec::new();
                for (name, values) in &file.values {
                    lists.push(list_of(values).map_err(|(expected, found)| {
                        refuse(&format!("values.{name}"), "the values do not fit")
                            .found(found)
                            .expected(expected)
                    })?);
                }
                (file.values.keys().cloned().collect(), Choices::Grid(lists))
            }
        };
        let own = Self {
            file: path.to_path_buf(),
            command: file.command,
            names,
            values,
            collect: file.collect,
            resume: file.resume,
        };
        own.check()?;
        Ok(own)
    }

    fn check(&self) -> Result<(), InputError> {
        let error =
            |key: &str, problem: String| InputError::new(&self.file, problem).at(format!("key `{key}`"));
        let used: Vec<String> = self.command.iter().flat_map(|word| names_in(word)).collect();
        if self.command.is_empty() {
            return Err(error("command", "there is no command".to_owned())
                .expected("the words of a command of `retina`, without `retina`"));
        }
        if !used.iter().any(|name| name == OUT) {
            return Err(error("command", "nothing goes into a run's own folder".to_owned())
                .expected("the name {out} in a word of the command, for example after \"--out\""));
        }
        let known = |name: &String| name == OUT || name == NUMBER || self.names.contains(name);
        if let Some(name) = used.iter().find(|name| !known(name)) {
            return Err(error("command", format!("the name {{{name}}} has no values"))
                .expected([&[OUT.to_owned(), NUMBER.to_owned()], &self.names[..]].concat().join(", ")));
        }
        if let Some(name) = self.names.iter().find(|name| !used.contains(name)) {
            return Err(error("values", format!("`{name}` does not occur in the command"))
                .expected(format!("{{{name}}} in one of its words")));
        }
        if let Some(name) = self.names.iter().find(|name| *name == OUT || *name == NUMBER) {
            return Err(
                error("values", format!("`{name}` is given by the run itself")).help("rename the value")
            );
        }
        let taken: Vec<&str> =
            [NUMBER, "seconds"].into_iter().chain(self.names.iter().map(String::as_str)).collect();
        if let Some(name) = self.collect.keys().find(|name| taken.contains(&name.as_str())) {
            return Err(error("collect", format!("the table has a column `{name}` already"))
                .expected(format!("another name than {}", taken.join(", "))));
        }
        if let Some((name, pointer)) = self.collect.iter().find(|(_, pointer)| !pointer.starts_with('/')) {
            return Err(error("collect", format!("`{name}` is no place in a document"))
                .found(format!("`{pointer}`"))
                .expected("a JSON pointer such as \"/errors/rms_arcsec\""));
        }
        if !self.collect.is_empty() && !self.command.iter().any(|word| word == "--json") {
            return Err(error("collect", "the command prints no document to collect from".to_owned())
                .expected("\"--json\" among the command's words"));
        }
        let count = match &self.values {
            Choices::Rows(rows) => Some(rows.len()),
            Choices::Grid(lists) => lists.iter().try_fold(1usize, |all, list| all.checked_mul(list.len())),
        };
        match count {
            Some(0) => Err(error("table", "the table has no row".to_owned()).expected("a row for each run")),
            Some(count) if count <= MOST_RUNS => Ok(()),
            _ => Err(error("values", "there are too many runs".to_owned())
                .expected(format!("{MOST_RUNS} at most"))),
        }
    }

    /// The command's words, with their names in braces.
    pub fn command(&self) -> &[String] {
        &self.command
    }

    /// How many runs there are.
    pub fn count(&self) -> usize {
        match &self.values {
            Choices::Rows(rows) => rows.len(),
            Choices::Grid(lists) => lists.iter().map(Vec::len).product(),
        }
    }

    /// The values of a run, in the order of [`Runs::names`].
    pub fn values_of(&self, number: usize) -> Vec<&str> {
        match &self.values {
            Choices::Rows(rows) => rows[number].iter().map(String::as_str).collect(),
            Choices::Grid(lists) => {
                let mut rest = number;
                let mut found: Vec<&str> = lists
                    .iter()
                    .rev()
                    .map(|list| {
                        let value = list[rest % list.len()].as_str();
                        rest /= list.len();
                        value
                    })
                    .collect();
                found.reverse();
                found
            }
        }
    }

    /// The command's words of a run whose folder is `out`.
    pub fn words(&self, number: usize, out: &Path) -> Vec<String> {
        let values = self.values_of(number);
        let fill = |name: &str| match self.names.iter().position(|own| own == name) {
            Some(at) => values[at].to_owned(),
            None if name == NUMBER => number.to_string(),
            None => out.to_string_lossy().into_owned(),
        };
        self.command.iter().map(|word| filled(word, &mut |name| fill(name))).collect()
    }

    /// Makes the runs of a shard, or all, that are not done, one after the other, by the command `program`. A run whose
    /// command fails is named in the end; the others go on. The command's own outputs lie in the run's folder, as
    /// `stdout.txt` and `stderr.txt`. `progress` is told how many are done or failed, and of how many.
    ///
    /// # Errors
    /// The folder is another file's, the program cannot be started, a file cannot be written.
    pub fn run(
        &self,
        out: &Path,
        shard: Option<Shard>,
        program: &Path,
        progress: &mut dyn FnMut(usize, usize),
    ) -> Result<RunsDone, BatchError> {
        let out = &self.made(out)?;
        // The runs' folder is not this one.
        let program = &match program.components().count() {
            1 => program.to_path_buf(),
            _ => std::path::absolute(program).unwrap_or_else(|_| program.to_path_buf()),
        };
        let own = |number: &usize| shard.is_none_or(|shard| number % shard.count == shard.index);
        let numbers: Vec<usize> = (0..self.count()).filter(own).collect();
        let mut result = RunsDone::default();
        for (at, &number) in numbers.iter().enumerate() {
            let folder = out.join(run_folder(number));
            if self.record(number, &folder)?.is_some() {
                result.skipped += 1;
            } else if self.one(number, &folder, program)? {
                result.done += 1;
            } else {
                result.failed.push(number);
            }
            progress(at + 1, numbers.len());
        }
        Ok(result)
    }

    /// Makes one run; whether its command succeeded.
    fn one(&self, number: usize, folder: &Path, program: &Path) -> Result<bool, BatchError> {
        let failed = |path: &Path| {
            let path = path.to_path_buf();
            move |source| BatchError::Write { path, source }
        };
        // Held until the record is written, here and by the command: another task, or this one started again beside a
        // command that outlived it, waits for it.
        let lock_path = folder.with_extension("lock");
        let lock = File::create(&lock_path).map_err(failed(&lock_path))?;
        match lock.lock() {
            // Some shared file systems have no locks.
            Err(error) if error.kind() != ErrorKind::Unsupported => return Err(failed(&lock_path)(error)),
            _ => {}
        }
        if self.record(number, folder)?.is_some() {
            return Ok(true);
        }
        if !self.resume && folder.exists() {
            fs::remove_dir_all(folder).map_err(failed(folder))?;
        }
        fs::create_dir_all(folder).map_err(failed(folder))?;
        let words = self.words(number, folder);
        let output = |name: &str| {
            let path = folder.join(name);
            File::create(&path).map_err(failed(&path))
        };
        let started = Instant::now();
        let status = Command::new(program)
            .args(&words)
            .current_dir(self.file.parent().filter(|path| *path != Path::new("")).unwrap_or(Path::new(".")))
            // The command reads nothing.
            .stdin(Stdio::from(lock.try_clone().map_err(failed(&lock_path))?))
            .stdout(output("stdout.txt")?)
            .stderr(output("stderr.txt")?)
            .status()
            .map_err(|error| {
                InputError::new(program, format!("cannot be started: {error}"))
                    .help("put the command `retina` into the PATH")
            })?;
        if status.success() {
            let record = RunRecord {
                schema: "retina.run/1".into(),
                number,
                values: self.named(number),
                command: self.command.clone(),
                seconds: started.elapsed().as_secs_f64(),
            };
            let mut text = serde_json::to_string_pretty(&record)
                .map_err(|error| BatchError::Encode { what: RECORD.into(), reason: error.to_string() })?;
            text.push('\n');
            let path = folder.join(RECORD);
            write_atomic(&path, text.as_bytes()).map_err(failed(&path))?;
            // Whoever waits for it finds the record.
            let _ = fs::remove_file(&lock_path);
        }
        Ok(status.success())
    }

    /// Makes the folder of all runs; gives its absolute path.
    fn made(&self, out: &Path) -> Result<PathBuf, InputError> {
        let runs = out.join("runs");
        fs::create_dir_all(&runs)
            .map_err(|error| InputError::new(&runs, format!("cannot be written: {error}")))?;
        fs::canonicalize(out).map_err(|error| InputError::new(out, format!("cannot be read: {error}")))
    }

    /// A run's record, where it is done.
    ///
    /// # Errors
    /// It does not read, or is of another command or other values.
    fn record(&self, number: usize, folder: &Path) -> Result<Option<RunRecord>, InputError> {
        let path = folder.join(RECORD);
        if !path.exists() {
            return Ok(None);
        }
        let record: RunRecord = serde_json::from_str(&read_text(&path)?).map_err(|error| {
            InputError::new(&path, format!("is no record of a run: {error}"))
                .help("delete it; the run is made again")
        })?;
        let own: BTreeMap<String, String> = self.named(number);
        if record.values != own || record.command != self.command {
            let told = |command: &[String], values: &BTreeMap<String, String>| {
                let values: Vec<String> =
                    values.iter().map(|(name, value)| format!("{name} = {value}")).collect();
                format!("`{}` with {}", command.join(" "), values.join(", "))
            };
            return Err(InputError::new(&path, "this run was made by another command, or with other values")
                .found(told(&record.command, &record.values))
                .expected(told(&self.command, &own))
                .help("give --out another folder, or take this one away"));
        }
        Ok(Some(record))
    }

    /// The values of a run by name.
    fn named(&self, number: usize) -> BTreeMap<String, String> {
        self.names.iter().cloned().zip(self.values_of(number).into_iter().map(String::from)).collect()
    }

    /// The table of all runs that are done: number, values, seconds, and what `collect` names in the documents that the
    /// commands printed; and how many runs are missing.
    ///
    /// # Errors
    /// A record does not read; a document has no such value.
    pub fn table(&self, out: &Path) -> Result<(String, usize), InputError> {
        let heads = [NUMBER].into_iter().chain(self.names.iter().map(String::as_str));
        let heads: Vec<String> =
            heads.chain(["seconds"]).chain(self.collect.keys().map(String::as_str)).map(cell).collect();
        let (mut text, mut missing) = (heads.join(",") + "\n", 0);
        for number in 0..self.count() {
            let folder = out.join(run_folder(number));
            let Some(record) = self.record(number, &folder)? else {
                missing += 1;
                continue;
            };
            let mut cells = vec![number.to_string()];
            cells.extend(self.values_of(number).into_iter().map(cell));
            cells.push(format!("{:.3}", record.seconds));
            cells.extend(self.collected(&folder)?);
            text += &(cells.join(",") + "\n");
        }
        Ok((text, missing))
    }

    fn collected(&self, folder: &Path) -> Result<Vec<String>, InputError> {
        if self.collect.is_empty() {
            return Ok(Vec::new());
        }
        let path = folder.join("stdout.txt");
        let document: Value = serde_json::from_str(&read_text(&path)?).map_err(|error| {
            InputError::new(&path, format!("`collect` needs a JSON document: {error}"))
                .help("end the command with \"--json\"")
        })?;
        self.collect
            .iter()
            .map(|(name, pointer)| match document.pointer(pointer) {
                Some(Value::String(text)) => Ok(cell(text)),
                Some(Value::Null) => Ok(String::new()),
                Some(value) => Ok(cell(value.to_string())),
                None => Err(InputError::new(&path, "the document has no such value")
                    .found(json!(pointer).to_string())
                    .expected("a JSON pointer such as \"/errors/rms_arcsec\"")
                    .named_by(&self.file, &format!("collect.{name}"))),
            })
            .collect()
    }

    /// How many runs of a shard are done in a folder.
    pub(crate) fn done_in(out: &Path, numbers: impl Iterator<Item = usize>) -> usize {
        numbers.filter(|&number| out.join(run_folder(number)).join(RECORD).exists()).count()
    }
}

/// A run's folder in that of the results.
pub(crate) fn run_folder(number: usize) -> PathBuf {
    Path::new("runs").join(format!("{number:06}"))
}

/// A cell of a CSV table.
fn cell(text: impl AsRef<str>) -> String {
    let text = text.as_ref();
    match text.contains([',', '"', '\n', '\r']) {
        true => format!("\"{}\"", text.replace('"', "\"\"")),
        false => text.to_owned(),
    }
}

/// A word whose names in braces are replaced.
fn filled(word: &str, value: &mut dyn FnMut(&str) -> String) -> String {
    let (mut text, mut rest) = (String::new(), word);
    while let Some((before, after)) = rest.split_once('{') {
        let Some((name, behind)) = after.split_once('}') else { break };
        text += before;
        text += &value(name);
        rest = behind;
    }
    text + rest
}

/// The names in braces of a word.
fn names_in(word: &str) -> Vec<String> {
    let mut found = Vec::new();
    filled(word, &mut |name| {
        found.push(name.to_owned());
        String::new()
    });
    found
}

/// The columns and rows of a table of values.
fn rows(path: &Path, text: &str) -> Result<(Vec<String>, Choices), InputError> {
    let table = Table::parse(path, text)?;
    let names = table.columns().to_vec();
    let row = |row: usize| names.iter().map(|name| table.text(row, name).to_owned()).collect();
    let rows = (0..table.len()).map(row).collect();
    Ok((names, Choices::Rows(rows)))
}
