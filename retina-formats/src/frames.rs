//! `frames.csv`: which image was measured, and what it is compared with.

use std::path::{Path, PathBuf};

use retina_files::{InputError, Table};

/// Columns that are no covariates.
const TEXT: [&str; 6] = ["predicted", "scene", "frame", "measured", "mask", "start"];

/// What an image is compared with.
#[derive(Debug, Clone, PartialEq)]
pub enum Prediction {
    /// A linear EXR.
    File(PathBuf),
    /// A frame of a scene, to be rendered.
    Scene {
        /// The scene.
        file: PathBuf,
        /// Its frame, from 0.
        frame: usize,
        /// Start from a smooth sphere of Lambert's law instead of the scene's own body.
        smooth: bool,
    },
}

/// An acquired image and what it is compared with.
#[derive(Debug, Clone)]
pub struct FrameRow {
    /// Its line, for errors.
    pub line: usize,
    /// What the image ought to show.
    pub prediction: Prediction,
    /// The acquired image.
    pub measured: PathBuf,
    /// Which of its pixels count.
    pub mask: Option<PathBuf>,
    /// All numeric columns that are filled in every row.
    pub numbers: Vec<(String, f64)>,
}

impl FrameRow {
    /// The value of a numeric column.
    pub fn number(&self, name: &str) -> Option<f64> {
        self.numbers.iter().find(|(n, _)| n == name).map(|(_, value)| *value)
    }
}

/// The rows of a `frames.csv`; paths are relative to it.
#[derive(Debug, Clone, Default)]
pub struct FramesTable {
    /// The rows.
    pub rows: Vec<FrameRow>,
    /// Columns that were left out because some cells are empty.
    pub left_out: Vec<String>,
}

impl FramesTable {
    /// Columns that only such a table has.
    pub const COLUMNS: [&'static str; 3] = ["measured", "scene", "predicted"];

    /// Reads a table.
    ///
    /// # Errors
    /// A column is missing, a cell does not fit, an image is named twice, or there is no row.
    pub fn read(path: &Path) -> Result<Self, InputError> {
        let table = Table::read(path)?;
        table.require(&["measured"])?;
        if !table.has("predicted") {
            table.require(&["scene", "frame"])?;
        }
        if table.is_empty() {
            return Err(InputError::new(path, "has no rows").expected("a row for each image"));
        }
        let (mut columns, mut left_out) = (Vec::new(), Vec::new());
        for name in table.columns().iter().filter(|name| !TEXT.contains(&name.as_str())) {
            let mut filled = true;
            for row in 0..table.len() {
                filled &= table.number_or_empty(row, name)?.is_some();
            }
            if filled { &mut columns } else { &mut left_out }.push(name.clone());
        }
        let folder = path.parent().unwrap_or(Path::new(""));
        let rows: Vec<FrameRow> =
            (0..table.len()).map(|row| read_row(&table, row, folder, &columns)).collect::<Result<_, _>>()?;
        for (at, row) in rows.iter().enumerate() {
            if let Some(before) = rows[..at].iter().find(|before| before.measured == row.measured) {
                return Err(InputError::new(path, "the image is there twice")
                    .cell(row.line, "measured")
                    .found(row.measured.display())
                    .expected("each image once")
                    .help(format!("the first is in line {}", before.line)));
            }
        }
        Ok(Self { rows, left_out })
    }
}

fn read_row(table: &Table, row: usize, folder: &Path, columns: &[String]) -> Result<FrameRow, InputError> {
    let line = table.line(row);
    let refuse = |column: &str, problem: &str| InputError::new(table.file(), problem).cell(line, column);
    let file = |column: &str| {
        let text = table.text(row, column);
        (!text.is_empty()).then(|| folder.join(text))
    };
    let measured = file("measured").ok_or_else(|| refuse("measured", "the image is not named"))?;
    let prediction = match (file("predicted"), file("scene")) {
        (Some(_), Some(_)) => {
            return Err(refuse("scene", "the prediction is given twice")
                .expected("`predicted`, or `scene` and `frame`"));
        }
        (Some(path), None) => {
            if let Some(column) =
                ["frame", "start"].into_iter().find(|name| !table.text(row, name).is_empty())
            {
                return Err(refuse(column, "belongs to a scene").expected("an empty cell beside `predicted`"));
            }
            if path.extension().is_some_and(|extension| extension != "exr") {
                return Err(refuse("predicted", "is no linear EXR")
                    .found(path.display())
                    .expected("radiance, as `retina render` writes it beside each screen image")
                    .help("render with `radiance_exr = true` under [output], or name `scene` and `frame`"));
            }
            Prediction::File(path)
        }
        (None, Some(path)) => {
            let frame = table.number(row, "frame")?;
            if frame < 0.0 || frame.fract() != 0.0 || frame > 1e6 {
                return Err(refuse("frame", "is no number of a frame").found(frame).expected("0, 1, 2 ..."));
            }
            let smooth = match table.text(row, "start") {
                "" | "as-given" => false,
                "smooth" => true,
                other => {
                    return Err(refuse("start", "is no start").found(format!("`{other}`")).expected(
                        "`as-given`, or `smooth` for the reference ellipsoid of Lambert's law without a map",
                    ));
                }
            };
            Prediction::Scene { file: path, frame: frame as usize, smooth }
        }
        (None, None) => {
            return Err(
                refuse("predicted", "nothing is predicted").expected("`predicted`, or `scene` and `frame`")
            );
        }
    };
    let numbers = columns
        .iter()
        .map(|name| Ok((name.clone(), table.number(row, name)?)))
        .collect::<Result<Vec<_>, InputError>>()?;
    if let Some((name, value)) = numbers.iter().find(|(n, v)| n == "exposure_s" && *v <= 0.0) {
        return Err(refuse(name, "is no exposure time").found(value).expected("seconds above 0"));
    }
    Ok(FrameRow { line, prediction, measured, mask: file("mask"), numbers })
}
