//! What may be read: files and folders within the given paths, told apart by their content.

use std::io::{Read as _, Seek as _, SeekFrom};
use std::path::{Path, PathBuf};

use retina_files::{InputError, read_text};
use retina_formats::TableKind;
use serde::Serialize;

use crate::session::file_name;

/// What a file or a folder is to the page.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Kind {
    /// `retina.setup/1`.
    Setup,
    /// `retina.calibration/1`.
    Calibration,
    /// A table of points, power readings or a phase curve.
    Table,
    /// `retina.scene/1`.
    Scene,
    /// A lens system: `retina.optics/1`, or a sequential Zemax file.
    System,
    /// Designs of a lens search, `retina.optics-search/1`.
    Designs,
    /// A folder that `retina render` wrote.
    Sequence,
    /// A folder or a file with results of navigation.
    Results,
}

impl Kind {
    /// Whether the workbench's sessions take it.
    pub(crate) fn is_measured(self) -> bool {
        matches!(self, Self::Setup | Self::Calibration | Self::Table)
    }
}

/// Schemas of results of navigation.
pub(crate) const RESULTS: [&str; 7] = [
    "retina.navigation-full-disk/1",
    "retina.full-disk-result/1",
    "retina.far-range-result/1",
    "retina.far-range-poses/1",
    "retina.far-range-transfer/1",
    "retina.navigation-flashes/1",
    "retina.flashes-result/1",
];

/// Deepest folder below a given one in which files are looked for.
const DEEPEST: usize = 3;
/// Most files that are listed.
const MOST_FILES: usize = 500;
/// Most entries of folders that are looked at.
const MOST_ENTRIES: usize = 20_000;

/// A file that the workbench takes.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub(crate) struct Found {
    /// As the page asks for it: the number of the given path, and the path within it.
    pub(crate) path: String,
    /// As people know it: the path within the given one, or the given one's own name.
    pub(crate) name: String,
    /// What it is.
    pub(crate) kind: Kind,
}

/// The kind of a table or a TOML file, by its content alone.
pub(crate) fn kind_of(path: &Path, text: &str) -> Result<Kind, InputError> {
    #[derive(serde::Deserialize)]
    struct Head {
        schema: Option<String>,
    }
    if let Ok(Head { schema: Some(schema) }) = toml::from_str::<Head>(text) {
        return match schema.as_str() {
            "retina.setup/1" => Ok(Kind::Setup),
            "retina.calibration/1" => Ok(Kind::Calibration),
            "retina.scene/1" => Ok(Kind::Scene),
            "retina.optics/1" => Ok(Kind::System),
            other => Err(InputError::new(path, "the page does not take this file")
                .found(format!("schema `{other}`"))
                .expected(
                    "a table, a setup (retina.setup/1), a calibration (retina.calibration/1), a scene \
                     (retina.scene/1), a lens system (retina.optics/1), or results of navigation",
                )),
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

    /// The given paths, each with its kind; folders that are none of the kinds are left out.
    ///
    /// # Errors
    /// A file is none of the kinds.
    pub(crate) fn given(&self) -> Result<Vec<(usize, PathBuf, Kind)>, InputError> {
        let mut out = Vec::new();
        for (number, root) in self.roots.iter().enumerate() {
            let kind = if root.is_dir() { kind_of_folder(root) } else { Some(kind_of_given(root)?) };
            out.extend(kind.map(|kind| (number, root.clone(), kind)));
        }
        Ok(out)
    }

    /// Whether no folder was given.
    pub(crate) fn is_files_alone(&self) -> bool {
        self.roots.iter().all(|root| root.is_file())
    }

    /// All files and folders that the page takes, in the order of their names.
    pub(crate) fn list(&self) -> Vec<Found> {
        let (mut out, mut entries) = (Vec::new(), 0);
        for (number, root) in self.roots.iter().enumerate() {
            let mut found = Vec::new();
            if root.is_file() {
                found.extend(kind_of_given(root).ok().map(|kind| (root.clone(), kind)));
            } else {
                walk(root, 0, &mut found, &mut entries);
            }
            found.sort();
            for (path, kind) in found {
                let within = path.strip_prefix(root).unwrap_or(&path);
                let name = if within.as_os_str().is_empty() {
                    file_name(root)
                } else {
                    within.display().to_string()
                };
                out.push(Found { path: format!("{number}/{}", within.display()), name, kind });
                if out.len() == MOST_FILES {
                    return out;
                }
            }
        }
        out
    }

    /// The file or folder that the page names; `None` where it is none, or lies outside the given paths.
    pub(crate) fn path(&self, named: &str) -> Option<PathBuf> {
        let (number, within) = named.split_once('/').unwrap_or((named, ""));
        let root = self.roots.get(number.parse::<usize>().ok()?)?;
        let path = if within.is_empty() { root.clone() } else { root.join(within) };
        // Links are followed first: what counts is where the file lies.
        let whole = path.canonicalize().ok()?;
        whole.starts_with(root).then_some(whole)
    }
}

fn walk(folder: &Path, depth: usize, out: &mut Vec<(PathBuf, Kind)>, entries: &mut usize) {
    if kind_of_folder(folder) == Some(Kind::Sequence) {
        // Its files are its own.
        out.push((folder.to_path_buf(), Kind::Sequence));
        return;
    }
    // A folder that cannot be read has nothing to show.
    let Ok(list) = std::fs::read_dir(folder) else { return };
    let mut results = false;
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
            match kind_of_file(&entry.path()) {
                // The page shows what lies in one folder together.
                Some(Kind::Results) => results = true,
                Some(kind) => out.push((entry.path(), kind)),
                None => {}
            }
        }
    }
    if results {
        out.push((folder.to_path_buf(), Kind::Results));
    }
}

fn kind_of_folder(folder: &Path) -> Option<Kind> {
    if folder.join("batch.json").is_file() && folder.join("frames").is_dir() {
        return Some(Kind::Sequence);
    }
    let files = std::fs::read_dir(folder).ok()?.flatten().take(MOST_FILES);
    let mut files = files.map(|entry| entry.path()).filter(|path| path.is_file());
    files.any(|path| kind_of_file(&path) == Some(Kind::Results)).then_some(Kind::Results)
}

/// The kind of a file of the command line.
fn kind_of_given(path: &Path) -> Result<Kind, InputError> {
    match extension(path).as_str() {
        "json" | "jsonl" | "zmx" => kind_of_file(path).ok_or_else(|| {
            InputError::new(path, "the page does not take this file").expected(
                "a sequential Zemax file, the document of `retina optics search`, or what `retina navigate` wrote",
            )
        }),
        _ => kind_of(path, &read_text(path)?),
    }
}

fn extension(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase()
}

/// Of a file with a name that the page's files have: others are not opened.
fn kind_of_file(path: &Path) -> Option<Kind> {
    match extension(path).as_str() {
        "toml" => kind_of(path, &read_text(path).ok()?).ok(),
        "csv" => kind_of(path, &ends(path).ok()?).ok(),
        "zmx" => Some(Kind::System),
        "json" | "jsonl" => {
            let text = ends(path).ok()?;
            let names = |schema: &str| text.contains(&format!("\"{schema}\""));
            if names("retina.optics-search/1") {
                return Some(Kind::Designs);
            }
            RESULTS.iter().any(|schema| names(schema)).then_some(Kind::Results)
        }
        _ => None,
    }
}

/// The beginning and the end of a file: a header with its comments, a document's schema.
fn ends(path: &Path) -> std::io::Result<String> {
    const BYTES: u64 = 1 << 16;
    let mut file = std::fs::File::open(path)?;
    let length = file.metadata()?.len();
    let mut bytes = Vec::new();
    (&mut file).take(BYTES).read_to_end(&mut bytes)?;
    if length > 2 * BYTES {
        file.seek(SeekFrom::End(-4096))?;
    }
    file.take(BYTES).read_to_end(&mut bytes)?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(within: &str, kind: Kind) -> Found {
        Found { path: format!("0/{within}"), name: within.to_owned(), kind }
    }

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
        assert_eq!(served.list(), [found("deep/points.csv", Kind::Table)]);
        assert!(served.path("0/deep/points.csv").is_some());
        let outer = outside.join("points.csv").display().to_string();
        for path in ["0/../out/points.csv", "0/..", "1/points.csv", "x", "", &outer, &format!("0/{outer}")] {
            assert_eq!(served.path(path), None, "{path}");
        }
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(outside.join("points.csv"), inside.join("link.csv")).unwrap();
            assert_eq!(served.path("0/link.csv"), None);
            assert_eq!(served.list().len(), 1);
        }
    }

    #[test]
    fn folders_of_frames_and_of_results_are_found_whole() {
        let dir = tempfile::tempdir().unwrap();
        let [frames, results] = ["run", "fd"].map(|name| dir.path().join(name));
        std::fs::create_dir_all(frames.join("frames")).unwrap();
        std::fs::create_dir_all(&results).unwrap();
        std::fs::write(frames.join("batch.json"), "{}").unwrap();
        std::fs::write(results.join("other.json"), "{\"schema\": \"retina.other/1\"}").unwrap();
        let served = Served::new(&[dir.path().to_path_buf()]).unwrap();
        assert_eq!(served.list(), [found("run", Kind::Sequence)]);
        // A document's schema may stand behind all of its frames.
        let long = format!("{{\"frames\": \"{}\", \"schema\": \"{}\"}}", "x".repeat(1 << 18), RESULTS[0]);
        std::fs::write(results.join("full-disk.json"), long).unwrap();
        assert_eq!(served.list(), [found("fd", Kind::Results), found("run", Kind::Sequence)]);
        assert!(served.path("0/run").is_some());
        let alone = Served::new(&[frames]).unwrap().list();
        assert_eq!((alone[0].path.as_str(), alone[0].name.as_str()), ("0/", "run"));
    }

    #[test]
    fn files_are_told_apart_by_their_content() {
        let of = |text: &str| kind_of("a.txt".as_ref(), text);
        assert_eq!(of(retina_assets::WIDE_FOV_SETUP).unwrap(), Kind::Setup);
        assert_eq!(of("# a comment\nphase_deg,magnitude\n1,2\n").unwrap(), Kind::Table);
        assert_eq!(of("schema = \"retina.scene/1\"\n").unwrap(), Kind::Scene);
        let said = of("schema = \"retina.model/1\"\n").unwrap_err().to_string();
        assert!(said.contains("retina.model/1") && said.contains("retina.setup/1"), "{said}");
        assert!(of("a,b\n1,2\n").unwrap_err().to_string().contains("none of the known tables"));
    }
}
