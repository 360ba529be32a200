//! Results kept as lines of a file: what was finished is not done again.

use std::collections::BTreeMap;
use std::fs::OpenOptions;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use retina_batch::Shard;
use retina_files::{InputError, read_text, write_atomic};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};

/// A line of a list.
pub(crate) trait Line: Serialize + DeserializeOwned {
    /// Schema of the list.
    const SCHEMA: &str;
    /// What the lines are, in the plural.
    const WHAT: &str;
    /// What they belong to.
    const OF: &str;
    /// Number of what the line is about.
    fn number(&self) -> usize;
}

fn cannot(path: &Path, error: &dyn std::fmt::Display) -> InputError {
    InputError::new(path, format!("cannot be written: {error}"))
}

/// The name of a list, of all or of a shard alone: shards that run at the same time write each its own.
pub fn list_name(stem: &str, shard: Option<Shard>) -> String {
    match shard {
        None => format!("{stem}.jsonl"),
        Some(shard) => format!("{stem}-{}-of-{}.jsonl", shard.index, shard.count),
    }
}

/// The stem of a list's name, whether of all or of a shard.
fn stem(path: &Path) -> Option<&str> {
    let name = path.file_name()?.to_str()?.strip_suffix(".jsonl")?;
    let digits = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    let shard = name.rsplit_once("-of-").filter(|(_, count)| digits(count));
    let whole = shard.and_then(|(head, _)| head.rsplit_once('-')).filter(|(_, index)| digits(index));
    Some(whole.map_or(name, |(whole, _)| whole))
}

/// The other lists of the same results in a list's folder: what other shards, or all together, have finished.
fn siblings(path: &Path) -> Vec<PathBuf> {
    let Some(entries) = path.parent().and_then(|folder| std::fs::read_dir(folder).ok()) else {
        return Vec::new();
    };
    let mut out: Vec<PathBuf> = entries
        .filter_map(|entry| entry.ok().map(|entry| entry.path()))
        .filter(|other| other.file_name() != path.file_name() && stem(other) == stem(path))
        .filter(|other| stem(other).is_some())
        .collect();
    out.sort();
    out
}

/// The lines that are there, in the list or in those of other shards beside it; the list is begun where there is none,
/// its first line holding `hash`, of all that decides a result besides what each line names itself. A last line that was
/// cut short is left out, and of lines with one number all but the last.
///
/// # Errors
/// A list is of something else, or cannot be read or written.
pub(crate) fn read_done<T: Line>(path: &Path, hash: &str) -> Result<BTreeMap<usize, T>, InputError> {
    let mut done = BTreeMap::new();
    for other in siblings(path) {
        // Another process may be writing its last line just now.
        done.extend(parse(&other, &read_text(&other)?, hash)?.0);
    }
    if !path.exists() {
        let text = format!("{}\n", header::<T>(hash));
        write_atomic(path, text.as_bytes()).map_err(|error| cannot(path, &error))?;
        return Ok(done);
    }
    let text = read_text(path)?;
    let (own, whole) = parse(path, &text, hash)?;
    if whole < text.len() {
        write_atomic(path, &text.as_bytes()[..whole]).map_err(|error| cannot(path, &error))?;
    }
    done.extend(own);
    Ok(done)
}

fn header<T: Line>(hash: &str) -> Value {
    json!({"schema": T::SCHEMA, T::OF: hash})
}

/// The results of a list's text, and the length of what is whole of it.
fn parse<T: Line>(path: &Path, text: &str, hash: &str) -> Result<(BTreeMap<usize, T>, usize), InputError> {
    let found: Option<Value> = text.lines().next().and_then(|line| serde_json::from_str(line).ok());
    if found != Some(header::<T>(hash)) {
        return Err(InputError::new(
            path,
            format!("the folder holds {} of another {}, or made otherwise", T::WHAT, T::OF),
        )
        .line(1)
        .help("give --out another folder, or take this one away"));
    }
    let whole = text.rfind('\n').map_or(0, |end| end + 1);
    let mut done = BTreeMap::new();
    for (number, line) in text[..whole].lines().enumerate().skip(1) {
        let result: T = serde_json::from_str(line).map_err(|error| {
            InputError::new(path, format!("is not a result among {}: {error}", T::WHAT))
                .line(number + 1)
                .help("delete that line; its result is made again")
        })?;
        done.insert(result.number(), result);
    }
    Ok((done, whole))
}

/// Adds lines to the list.
///
/// # Errors
/// It cannot be written.
pub(crate) fn append<T: Line>(path: &Path, results: &[T]) -> Result<(), InputError> {
    let mut text = String::new();
    for result in results {
        text.push_str(&serde_json::to_string(result).map_err(|error| cannot(path, &error))?);
        text.push('\n');
    }
    let file = OpenOptions::new().append(true).open(path);
    file.and_then(|mut file| file.write_all(text.as_bytes()).and_then(|()| file.sync_data()))
        .map_err(|error| cannot(path, &error))
}

#[cfg(test)]
mod tests {
    use serde::Deserialize;

    use super::*;

    #[derive(Debug, PartialEq, Serialize, Deserialize)]
    struct Result1 {
        at: usize,
    }

    impl Line for Result1 {
        const SCHEMA: &str = "test/1";
        const WHAT: &str = "results";
        const OF: &str = "test";

        fn number(&self) -> usize {
            self.at
        }
    }

    #[test]
    fn shards_write_their_own_lists_and_read_each_others() {
        let folder = tempfile::tempdir().unwrap();
        let path = |shard| folder.path().join(list_name("poses", shard));
        let shard = |text: &str| Some(text.parse::<Shard>().unwrap());
        let (first, second) = (path(shard("0/2")), path(shard("1/2")));
        assert!(first.ends_with("poses-0-of-2.jsonl"));
        assert!(read_done::<Result1>(&first, "h").unwrap().is_empty());
        append(&first, &[Result1 { at: 0 }, Result1 { at: 2 }]).unwrap();
        read_done::<Result1>(&second, "h").unwrap();
        append(&second, &[Result1 { at: 1 }]).unwrap();
        // A line that another shard is writing just now is its own affair; one's own is cut off.
        let half = std::fs::read_to_string(&second).unwrap() + "{\"a";
        std::fs::write(&second, &half).unwrap();
        let numbers = |path: &Path| read_done::<Result1>(path, "h").unwrap().into_keys().collect::<Vec<_>>();
        assert_eq!(numbers(&path(None)), [0, 1, 2]);
        assert_eq!(std::fs::read_to_string(&second).unwrap(), half);
        assert_eq!(numbers(&second), [0, 1, 2]);
        assert!(std::fs::read_to_string(&second).unwrap().ends_with("}\n"));
        // Lists of something else in the folder do not count, another scenario's of the same do.
        std::fs::write(folder.path().join("transfer.jsonl"), "other\n").unwrap();
        assert_eq!(numbers(&first), [0, 1, 2]);
        assert!(read_done::<Result1>(&first, "other").unwrap_err().to_string().contains("another test"));
    }
}
