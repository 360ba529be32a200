//! Finished sets as lines of files: a list of its own for each shard, all of them read together.

use std::fs::{File, OpenOptions};
use std::path::{Path, PathBuf};
use std::str::FromStr;

use retina_files::{InputError, read_text, write_atomic};
use serde::de::DeserializeOwned;

use crate::generate::io;

/// One of N parts of the sets: those whose number is `index` modulo `count`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Part {
    /// Which part, from 0.
    pub index: usize,
    /// How many parts.
    pub count: usize,
}

impl FromStr for Part {
    type Err = String;

    /// `I/N` with I from 0 to N - 1.
    fn from_str(text: &str) -> Result<Self, String> {
        let found = text.split_once('/').and_then(|(index, count)| {
            let (index, count) = (index.parse().ok()?, count.parse().ok()?);
            (index < count).then_some(Self { index, count })
        });
        found.ok_or_else(|| {
            format!("`{text}` is not a shard; expected I/N with I from 0 to N - 1, for example 0/4")
        })
    }
}

impl Part {
    /// Whether a set is of this part; without a part all are.
    pub(crate) fn has(part: Option<Self>, set: usize) -> bool {
        part.is_none_or(|part| set % part.count == part.index)
    }
}

/// The list that a part writes.
fn own_list(folder: &Path, stem: &str, part: Option<Part>) -> PathBuf {
    folder.join(match part {
        None => format!("{stem}.jsonl"),
        Some(part) => format!("{stem}-{}-of-{}.jsonl", part.index, part.count),
    })
}

/// What all lists of a stem hold.
///
/// # Errors
/// A line cannot be read.
pub(crate) fn finished<T: DeserializeOwned>(folder: &Path, stem: &str) -> Result<Vec<T>, InputError> {
    let Ok(entries) = std::fs::read_dir(folder) else { return Ok(Vec::new()) };
    let is_list = |path: &Path| {
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        name.strip_prefix(stem).is_some_and(|rest| {
            rest == ".jsonl" || (rest.starts_with('-') && rest.ends_with(".jsonl") && rest.contains("-of-"))
        })
    };
    let mut lists: Vec<PathBuf> =
        entries.filter_map(|entry| Some(entry.ok()?.path())).filter(|path| is_list(path)).collect();
    lists.sort();
    let mut all = Vec::new();
    for list in lists {
        all.extend(whole_lines(&list)?.0);
    }
    Ok(all)
}

/// A list's results, and its text without a last line that was cut short.
fn whole_lines<T: DeserializeOwned>(path: &Path) -> Result<(Vec<T>, String), InputError> {
    let mut text = read_text(path)?;
    text.truncate(text.rfind('\n').map_or(0, |end| end + 1));
    let read = |(k, line): (usize, &str)| {
        serde_json::from_str(line).map_err(|error| {
            InputError::new(path, "holds a line that is no result")
                .line(k + 1)
                .found(error.to_string())
                .help("delete that line; its set is run again")
        })
    };
    let found = text.lines().enumerate().map(read).collect::<Result<_, _>>()?;
    Ok((found, text))
}

/// A part's list, open for further lines.
///
/// # Errors
/// It cannot be read or written.
pub(crate) fn open<T: DeserializeOwned>(
    folder: &Path,
    stem: &str,
    part: Option<Part>,
) -> Result<(File, PathBuf), InputError> {
    let path = own_list(folder, stem, part);
    if path.exists() {
        let (_, text) = whole_lines::<T>(&path)?;
        write_atomic(&path, text.as_bytes()).map_err(|error| io(&path, &error))?;
    }
    let file = OpenOptions::new().create(true).append(true).open(&path).map_err(|error| io(&path, &error))?;
    Ok((file, path))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may fail")]

    use std::io::Write as _;

    use super::*;

    #[test]
    fn lists_of_all_parts_are_read_and_a_torn_line_is_written_anew() {
        let folder = tempfile::tempdir().unwrap();
        let part = |text: &str| Some(text.parse::<Part>().unwrap());
        for (own, text) in [(None, "1\n2\n"), (part("0/2"), "4\n{\"to"), (part("1/2"), "5\n")] {
            std::fs::write(own_list(folder.path(), "results", own), text).unwrap();
        }
        std::fs::write(folder.path().join("results.json"), "no list").unwrap();
        assert_eq!(finished::<usize>(folder.path(), "results").unwrap(), [4, 5, 1, 2]);
        let (mut file, path) = open::<usize>(folder.path(), "results", part("0/2")).unwrap();
        file.write_all(b"6\n").unwrap();
        assert_eq!(std::fs::read_to_string(path).unwrap(), "4\n6\n");
        std::fs::write(own_list(folder.path(), "results", None), "1\ntwo\n").unwrap();
        assert!(finished::<usize>(folder.path(), "results").unwrap_err().to_string().contains("line 2"));
        assert!(Part::has(part("1/3"), 7) && !Part::has(part("1/3"), 6) && Part::has(None, 6));
        for bad in ["", "2/2", "1", "a/2"] {
            assert!(bad.parse::<Part>().is_err());
        }
    }
}
