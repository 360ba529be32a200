//! Tables of any length: of one that would not fit into memory, every n-th group is read.

use std::collections::HashMap;
use std::fs::File;
use std::io::{BufRead as _, BufReader};
use std::path::Path;

use retina_files::{InputError, Table, hash_file};

use crate::columns::{SourceFile, open_whole};
use crate::setup_stamp::SetupStamp;

/// Rows that are read whole: a row takes some 700 bytes while a table is read.
const MOST_ROWS: usize = 2_000_000;
/// Columns that name a row's group, in the order in which they are looked for.
const GROUPS: [&str; 3] = ["image", "series", "night"];

/// A table, or part of it.
pub(crate) struct Part {
    pub(crate) table: Table,
    pub(crate) file: SourceFile,
}

/// Reads a table, or every n-th group of one that has more than [`MOST_ROWS`] rows.
///
/// # Errors
/// The file cannot be read, or is no table.
pub(crate) fn read(path: &Path) -> Result<Part, InputError> {
    read_most(path, MOST_ROWS)
}

fn read_most(path: &Path, most: usize) -> Result<Part, InputError> {
    // A row has some separators and an end: a shorter file is read without counting.
    let small = std::fs::metadata(path).is_ok_and(|file| file.len() / 8 <= most as u64);
    let whole = || open_whole(path).map(|(table, file)| Part { table, file });
    if small {
        return whole();
    }
    let broken = |error: std::io::Error| InputError::new(path, format!("cannot be read: {error}"));
    let lines = || File::open(path).map(|file| BufReader::new(file).lines()).map_err(broken);
    let counts = |line: &str| !(line.trim().is_empty() || line.trim_start().starts_with('#'));
    let mut rows = 0usize;
    let mut header: Option<String> = None;
    for line in lines()? {
        let line = line.map_err(broken)?;
        if counts(&line) {
            match header {
                None => header = Some(line),
                Some(_) => rows += 1,
            }
        }
    }
    if rows <= most {
        return whole();
    }
    let names: Vec<String> = header
        .iter()
        .flat_map(|header| header.trim_start_matches('\u{feff}').split(','))
        .map(|name| name.trim().to_owned())
        .collect();
    let key = GROUPS.iter().find_map(|name| names.iter().position(|n| n == name));
    let stride = rows.div_ceil(most);
    let mut known: HashMap<String, usize> = HashMap::new();
    let mut text = String::new();
    let (mut row, mut kept) = (0usize, 0usize);
    let mut first = true;
    for line in lines()? {
        let line = line.map_err(broken)?;
        // What is left out leaves its line, so that errors name the file's own lines.
        if counts(&line) {
            let group = match key.and_then(|key| line.split(',').nth(key)) {
                Some(name) if !first => match known.get(name) {
                    Some(&group) => group,
                    None => {
                        known.insert(name.to_owned(), known.len());
                        known.len() - 1
                    }
                },
                _ => row,
            };
            if first || group % stride == 0 {
                text.push_str(&line);
                kept += usize::from(!first);
            }
            row += usize::from(!first);
            first = false;
        } else if line.starts_with('#') {
            text.push_str(&line);
        }
        text.push('\n');
    }
    let note = format!(
        "{}: {kept} of {rows} rows were read, every {stride}-th {}",
        path.display(),
        key.map_or("row", |key| names[key].as_str())
    );
    let file = SourceFile {
        path: path.to_path_buf(),
        blake3: hash_file(path)?,
        setup: SetupStamp::of_text(path, &text)?,
        note: Some(note),
        rows,
    };
    Ok(Part { table: Table::parse(path, &text)?, file })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 12 exposures of 5 rows, at most 30 rows: every second exposure, whole, and lines as in the file.
    #[test]
    fn every_second_exposure_of_a_long_table_is_read_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("long.csv");
        let mut text = String::from("# made by hand\nimage,value\n");
        for row in 0..60 {
            text.push_str(&format!("e{},{row}\n", row % 12));
        }
        std::fs::write(&path, text).unwrap();
        let part = read_most(&path, 30).unwrap();
        assert_eq!(part.table.len(), 30);
        assert!((0..30).all(|row| (part.table.number(row, "value").unwrap() as usize).is_multiple_of(2)));
        // Row 4 of the file stands on line 2 + 4 + 1.
        assert_eq!(part.table.line(2), 7);
        assert!(part.file.note.unwrap().contains("30 of 60 rows were read, every 2-th image"));
        assert!(read_most(&path, 60).unwrap().file.note.is_none());
    }
}
