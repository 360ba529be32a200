//! What may be read: files in the given folders, told apart by their content.

use std::path::{Path, PathBuf};

use retina_files::{InputError, read_text};
use retina_formats::TableKind;
use serde::Serialize;

/// What a file is to the workbench.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Kind {
    /// `retina.setup/1`.
    Setup,
    /// `retina.calibration/1`.
    Calibration,
    /// A table of points, power readings or a phase curve.
    Table,
}

/// Deepest folder below a given one in which files are looked for.
const DEEPEST: usize = 3;
/// Most files that are listed.
const MOST_FILES: usize = 500;
/// Most entries of folders that are looked at.
const MOST_ENTRIES: usize = 20_000;

/// A file that the workbench takes.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub(crate) struct Found {
    /// As the page names it: the number of the given path, and the path within it.
    pub(crate) path: String,
    /// What it is.
    pub(crate) kind: Kind,
}

/// The kind of a text, by its content alone.
pub(crate) fn kind_of(path: &Path, text: &str) -> Result<Kind, InputError> {
    #[derive(serde::Deserialize)]
    struct Head {
        schema: Option<String>,
    }
    if let Ok(Head { schema: Some(schema) }) = toml::from_str::<Head>(text) {
        return match schema.as_str() {
            "retina.setup/1" => Ok(Kind::Setup),
            "retina.calibration/1" => Ok(Kind::Calibration),
            other => Err(InputError::new(path, "the workbench does not take this file")
                .found(format!("schema `{other}`"))
                .expected("a table, a setup (retina.setup/1) or a calibration (retina.calibration/1)")),
        };
    }
    let comment = |line: &&str| line.trim_start().starts_with('#') || line.trim().is_empty();
    let header = text.trim_start_matches('\u{feff}').lines().find(|line| !comment(line)).unwrap_or_default();
    match TableKind::of(&retina_files::Table::parse(path, header)?)? {
        TableKind::Frames => {
            Err(InputError::new(path, "is a table of frames, which this page does not take")
                .help("`retina compare`, `diagnose` and `fit` take it, and write pages with `--report`"))
        }
        _ => Ok(Kind::Table),
    }
}

/// The given paths. Files are served; of folders what lies in them.
#[derive(Debug, Clone, Default)]
pub(crate) struct Served {
    roots: Vec<PathBuf>,
}

impl Served {
    /// # Errors
    /// A path does not exist.
    pub(crate) fn new(paths: &[PathBuf]) -> Result<Self, InputError> {
        let whole = |path: &PathBuf| {
            path.canonicalize().map_err(|error| {
                InputError::new(path, format!("cannot be read: {error}"))
                    .help("check the path and the permissions")
            })
        };
        Ok(Self { roots: paths.iter().map(whole).collect::<Result<_, _>>()? })
    }

    /// The given files that are no folders.
    pub(crate) fn files(&self) -> impl Iterator<Item = &PathBuf> {
        self.roots.iter().filter(|root| root.is_file())
    }

    /// Whether no folder was given.
    pub(crate) fn is_files_alone(&self) -> bool {
        self.roots.iter().all(|root| root.is_file())
    }

    /// All files that the workbench takes, in the order of their names.
    pub(crate) fn list(&self) -> Vec<Found> {
        let (mut out, mut entries) = (Vec::new(), 0);
        for (number, root) in self.roots.iter().enumerate() {
            let mut files = Vec::new();
            if root.is_file() {
                files.push(root.clone());
            } else {
                walk(root, 0, &mut files, &mut entries);
            }
            files.sort();
            for file in files {
                let Some(kind) = kind_of_file(&file) else { continue };
                let within = file.strip_prefix(root).unwrap_or(&file);
                out.push(Found { path: format!("{number}/{}", within.display()), kind });
                if out.len() == MOST_FILES {
                    return out;
                }
            }
        }
        out
    }

    /// The file that the page names; `None` where it is none, or lies outside the given paths.
    pub(crate) fn resolve(&self, named: &str) -> Option<PathBuf> {
        let (number, within) = named.split_once('/').unwrap_or((named, ""));
        let root = self.roots.get(number.parse::<usize>().ok()?)?;
        let path = if within.is_empty() { root.clone() } else { root.join(within) };
        // Links are followed first: what counts is where the file lies.
        let whole = path.canonicalize().ok()?;
        (whole.starts_with(root) && whole.is_file()).then_some(whole)
    }
}

fn walk(folder: &Path, depth: usize, out: &mut Vec<PathBuf>, entries: &mut usize) {
    // A folder that cannot be read has nothing to show.
    let Ok(list) = std::fs::read_dir(folder) else { return };
    for entry in list.flatten() {
        *entries += 1;
        if *entries > MOST_ENTRIES {
            return;
        }
        // Links are left out: they may lead in circles, or out.
        let Ok(kind) = entry.file_type() else { continue };
        if kind.is_dir() && depth < DEEPEST {
            walk(&entry.path(), depth + 1, out, entries);
        } else if kind.is_file() {
            out.push(entry.path());
        }
    }
}

/// Of a file with a name that tables and TOML have: others are not opened.
fn kind_of_file(path: &Path) -> Option<Kind> {
    /// A header with its comments is within this.
    const HEAD_BYTES: u64 = 1 << 16;
    let extension = path.extension()?.to_str()?;
    if extension.eq_ignore_ascii_case("toml") {
        return kind_of(path, &read_text(path).ok()?).ok();
    }
    if !extension.eq_ignore_ascii_case("csv") {
        return None;
    }
    let mut head = Vec::new();
    std::io::Read::read_to_end(
        &mut std::io::Read::take(std::fs::File::open(path).ok()?, HEAD_BYTES),
        &mut head,
    )
    .ok()?;
    kind_of(path, &String::from_utf8_lossy(&head)).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_outside_the_given_folders_is_found() {
        let dir = tempfile::tempdir().unwrap();
        let (inside, outside) = (dir.path().join("in"), dir.path().join("out"));
        std::fs::create_dir_all(inside.join("deep")).unwrap();
        std::fs::create_dir_all(&outside).unwrap();
        let table = "screen_x_px,screen_y_px,digital_count,camera_x_px,camera_y_px\n";
        std::fs::write(inside.join("deep/points.csv"), table).unwrap();
        std::fs::write(outside.join("points.csv"), table).unwrap();
        let served = Served::new(std::slice::from_ref(&inside)).unwrap();
        assert_eq!(served.list(), [Found { path: "0/deep/points.csv".to_owned(), kind: Kind::Table }]);
        assert!(served.resolve("0/deep/points.csv").is_some());
        let outer = outside.join("points.csv").display().to_string();
        for path in ["0/../out/points.csv", "1/points.csv", "0/deep", "x", "", &outer, &format!("0/{outer}")]
        {
            assert_eq!(served.resolve(path), None, "{path}");
        }
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(outside.join("points.csv"), inside.join("link.csv")).unwrap();
            assert_eq!(served.resolve("0/link.csv"), None);
            assert_eq!(served.list().len(), 1);
        }
    }

    #[test]
    fn files_are_told_apart_by_their_content() {
        let of = |text: &str| kind_of("a.txt".as_ref(), text);
        assert_eq!(of(retina_assets::WIDE_FOV_SETUP).unwrap(), Kind::Setup);
        assert_eq!(of("# a comment\nphase_deg,magnitude\n1,2\n").unwrap(), Kind::Table);
        let said = of("schema = \"retina.scene/1\"\n").unwrap_err().to_string();
        assert!(said.contains("retina.scene/1") && said.contains("retina.setup/1"), "{said}");
        assert!(of("a,b\n1,2\n").unwrap_err().to_string().contains("none of the known tables"));
    }
}
