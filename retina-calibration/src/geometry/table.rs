//! `points.csv`: one displayed point in one exposure a row.

use std::collections::HashMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use glam::DVec2;
use retina_files::{InputError, Table, hash_bytes, read_text, write_atomic};

/// Which sub-pixels are lit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Channel {
    /// Red alone.
    R,
    /// Green alone.
    G,
    /// Blue alone.
    B,
    /// All three, equal counts.
    #[default]
    W,
}

impl Channel {
    /// `r`, `g`, `b` or `w`.
    pub fn name(self) -> &'static str {
        ["r", "g", "b", "w"][self as usize]
    }

    /// From its name.
    pub fn from_name(name: &str) -> Option<Self> {
        [Self::R, Self::G, Self::B, Self::W].into_iter().find(|channel| channel.name() == name)
    }
}

/// A displayed point and where the camera saw it.
#[derive(Debug, Clone, PartialEq)]
pub struct PointRow {
    /// Index into [`PointsTable::images`].
    pub image: usize,
    /// Intended position on the screen, px.
    pub screen_px: DVec2,
    /// Digital count, above 0 up to 255.
    pub digital_count: f64,
    /// Lit sub-pixels.
    pub channel: Channel,
    /// Measured centroid, camera px.
    pub camera_px: DVec2,
    /// Standard deviation of the centroid per axis, px.
    pub sigma_px: Option<f64>,
    /// Exposure time, s.
    pub exposure_s: Option<f64>,
    /// Measured light, DN.
    pub flux_dn: Option<f64>,
    /// A pixel of its spot is saturated.
    pub saturated: bool,
    /// Lit fraction of the point's rows on the screen, 0 to 1.
    pub row_load: Option<f64>,
    /// Cells of [`PointsTable::extra_columns`].
    pub extra: Vec<String>,
    /// Line in its file, from 1; 0 where it was not read from one.
    pub line: usize,
}

/// Rows of one or more `points.csv`, in the files' order.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PointsTable {
    /// Exposure ids; rows of several files with the same id stay apart.
    pub images: Vec<String>,
    /// Names of further columns of the rows.
    pub extra_columns: Vec<String>,
    /// The rows.
    pub rows: Vec<PointRow>,
    /// Files read, with their BLAKE3.
    pub files: Vec<(PathBuf, String)>,
}

const KNOWN: [&str; 12] = [
    "image",
    "screen_x_px",
    "screen_y_px",
    "digital_count",
    "camera_x_px",
    "camera_y_px",
    "sigma_px",
    "exposure_s",
    "flux_dn",
    "saturated",
    "channel",
    "row_load",
];

impl PointsTable {
    /// Reads several tables of one facility together.
    ///
    /// # Errors
    /// A column is missing, a cell is no number or outside its range, or there is no row at all.
    pub fn read(paths: &[PathBuf]) -> Result<Self, InputError> {
        let mut out = Self::default();
        for path in paths {
            out.append(path)?;
        }
        match (out.rows.is_empty(), paths.first()) {
            (true, Some(path)) => {
                Err(InputError::new(path, "holds no points").expected("one row for each point and exposure"))
            }
            _ => Ok(out),
        }
    }

    fn append(&mut self, path: &Path) -> Result<(), InputError> {
        let text = read_text(path)?;
        let hash = hash_bytes(text.as_bytes());
        if let Some((other, _)) = self.files.iter().find(|(_, other)| *other == hash) {
            return Err(InputError::new(path, "the table is given twice")
                .found(format!("the same content as {}", other.display()))
                .help("errors are taken for independent: give each once"));
        }
        self.files.push((path.to_path_buf(), hash));
        let table = Table::parse(path, &text)?;
        table.require(&KNOWN[..6])?;
        let mut index: HashMap<String, usize> = HashMap::new();
        let mut roll_deg = None;
        for row in 0..table.len() {
            let wrong = |column: &str, expected: &str| {
                InputError::new(path, "the value is outside its range")
                    .cell(table.line(row), column)
                    .found(format!("`{}`", table.text(row, column)))
                    .expected(expected)
            };
            let name = table.text(row, "image");
            if name.is_empty() {
                return Err(wrong("image", "the exposure's name"));
            }
            let image = match index.get(name) {
                Some(&image) => image,
                None => {
                    index.insert(name.to_owned(), self.images.len());
                    self.images.push(name.to_owned());
                    self.images.len() - 1
                }
            };
            let digital_count = table.number(row, "digital_count")?;
            if !(digital_count > 0.0 && digital_count <= 255.0) {
                return Err(wrong("digital_count", "a count above 0, at most 255"));
            }
            let channel = match table.text(row, "channel") {
                "" => Channel::W,
                name => Channel::from_name(name).ok_or_else(|| wrong("channel", "r, g, b or w"))?,
            };
            let saturated = match table.number_or_empty(row, "saturated")? {
                None => false,
                Some(value) if value == 0.0 || value == 1.0 => value == 1.0,
                Some(_) => return Err(wrong("saturated", "0 or 1")),
            };
            let roll = table.number_or_empty(row, "camera_roll_deg")?;
            if *roll_deg.get_or_insert(roll) != roll {
                return Err(wrong("camera_roll_deg", "one roll of the camera in a table")
                    .help("calibrate each roll of the camera by itself: parts of the mapping turn with it"));
            }
            let positive = |column: &str| match table.number_or_empty(row, column)? {
                Some(value) if value <= 0.0 => Err(wrong(column, "a number above 0")),
                value => Ok(value),
            };
            self.rows.push(PointRow {
                image,
                screen_px: DVec2::new(table.number(row, "screen_x_px")?, table.number(row, "screen_y_px")?),
                digital_count,
                channel,
                camera_px: DVec2::new(table.number(row, "camera_x_px")?, table.number(row, "camera_y_px")?),
                sigma_px: positive("sigma_px")?,
                exposure_s: positive("exposure_s")?,
                flux_dn: table.number_or_empty(row, "flux_dn")?,
                saturated,
                row_load: table.number_or_empty(row, "row_load")?,
                extra: Vec::new(),
                line: table.line(row),
            });
        }
        Ok(())
    }

    /// Writes it as `points.csv`; optional columns that no row has are left out.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), InputError> {
        let optional = |any: fn(&PointRow) -> bool| self.rows.iter().any(any);
        let (exposure, load) = (optional(|r| r.exposure_s.is_some()), optional(|r| r.row_load.is_some()));
        let mut text = String::from(
            "image,screen_x_px,screen_y_px,digital_count,camera_x_px,camera_y_px,sigma_px,flux_dn,saturated,channel",
        );
        text.push_str(if exposure { ",exposure_s" } else { "" });
        text.push_str(if load { ",row_load" } else { "" });
        for column in &self.extra_columns {
            text.push(',');
            text.push_str(column);
        }
        text.push('\n');
        let cell = |value: Option<f64>| value.map(|v| format!("{v}")).unwrap_or_default();
        for row in &self.rows {
            let [screen, camera] = [row.screen_px, row.camera_px];
            let line = format!(
                "{},{},{},{},{:.5},{:.5},{},{},{},{}",
                self.images[row.image],
                screen.x,
                screen.y,
                row.digital_count,
                camera.x,
                camera.y,
                row.sigma_px.map(|v| format!("{v:.5}")).unwrap_or_default(),
                row.flux_dn.map(|v| format!("{v:.2}")).unwrap_or_default(),
                u8::from(row.saturated),
                row.channel.name()
            );
            text.push_str(&line);
            if exposure {
                let _ = write!(text, ",{}", cell(row.exposure_s));
            }
            if load {
                let _ = write!(text, ",{}", row.row_load.map(|v| format!("{v:.5}")).unwrap_or_default());
            }
            for value in &row.extra {
                text.push(',');
                text.push_str(value);
            }
            text.push('\n');
        }
        write_atomic(path, text.as_bytes())
            .map_err(|error| InputError::new(path, format!("cannot be written: {error}")))
    }
}
