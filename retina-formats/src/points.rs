//! `points.csv`: one displayed point in one exposure a row.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::DVec2;
use retina_files::{InputError, Table};
use retina_geometry::Setup;

use crate::columns::{Cells, Rows, csv_text, rows_text, write_text};
use crate::{Channel, ExtraColumn, SourceFile};

/// A displayed point and where the camera saw it.
#[derive(Debug, Clone, PartialEq)]
pub struct PointRow {
    /// Index into [`PointsTable::images`].
    pub image: usize,
    /// Intended position on the screen, px.
    pub screen_px: DVec2,
    /// Digital count, above 0 up to 255; between whole numbers where several pixels share the light.
    pub digital_count: f64,
    /// Lit sub-pixels.
    pub channel: Channel,
    /// Measured centroid, camera px.
    pub camera_px: DVec2,
    /// Standard deviation of the centroid per axis, px.
    pub sigma_px: Option<f64>,
    /// Time of the exposure, s.
    pub time_s: Option<f64>,
    /// Temperature, degrees Celsius.
    pub temperature_c: Option<f64>,
    /// Lit fraction of the point's rows on the screen, 0 to 1.
    pub row_load: Option<f64>,
    /// Exposure time, s.
    pub exposure_s: Option<f64>,
    /// Measured light, DN.
    pub flux_dn: Option<f64>,
    /// A pixel of its spot is saturated.
    pub saturated: bool,
    /// How far the camera is rolled in its mount, degrees.
    pub camera_roll_deg: Option<f64>,
    /// Number of the time that the camera was mounted; 0: as in the first table of those that are read together. Where it is
    /// absent, each table was measured with the camera mounted anew.
    pub mounting: Option<f64>,
    /// Name of the series.
    pub series: Option<Arc<str>>,
    /// Index into [`PointsTable::files`].
    pub file: usize,
    /// Line in its file, from 1; 0 where it was not read from one.
    pub line: usize,
}

impl PointRow {
    /// A white point without any of the optional columns.
    pub fn new(image: usize, screen_px: DVec2, digital_count: f64, camera_px: DVec2) -> Self {
        Self {
            image,
            screen_px,
            digital_count,
            channel: Channel::W,
            camera_px,
            sigma_px: None,
            time_s: None,
            temperature_c: None,
            row_load: None,
            exposure_s: None,
            flux_dn: None,
            saturated: false,
            camera_roll_deg: None,
            mounting: None,
            series: None,
            file: 0,
            line: 0,
        }
    }
}

/// Rows of one or more `points.csv`, in the files' order, or made in memory.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PointsTable {
    /// Exposure ids; rows of several files with the same id stay apart.
    pub images: Vec<String>,
    /// The rows.
    pub rows: Vec<PointRow>,
    /// Columns that the schema does not name.
    pub extra: Vec<ExtraColumn>,
    /// Files read; empty for a table made in memory.
    pub files: Vec<SourceFile>,
}

/// A centroid may lie beyond the sensor's edge by this share of the side: a spot that the edge cuts, and simulated
/// points whose lens was changed after they were chosen.
const EDGE_SHARE: f64 = 0.02;

impl Rows for PointsTable {
    const REQUIRED: &'static [&'static str] =
        &["image", "screen_x_px", "screen_y_px", "digital_count", "camera_x_px", "camera_y_px"];
    const KNOWN: &'static [&'static str] = &[
        "image",
        "screen_x_px",
        "screen_y_px",
        "digital_count",
        "camera_x_px",
        "camera_y_px",
        "channel",
        "sigma_px",
        "time_s",
        "temperature_c",
        "row_load",
        "exposure_s",
        "flux_dn",
        "saturated",
        "camera_roll_deg",
        "mounting",
        "series",
    ];
    const NOTHING: [&'static str; 2] = ["holds no points", "one row for each point and exposure"];

    fn parts(&mut self) -> (&mut Vec<SourceFile>, &mut Vec<ExtraColumn>, usize) {
        (&mut self.files, &mut self.extra, self.rows.len())
    }

    fn add_rows(&mut self, table: &Table, file: usize) -> Result<(), InputError> {
        let mut images: HashMap<String, usize> = HashMap::new();
        let mut series = None;
        for row in 0..table.len() {
            let cells = Cells { table, row };
            let name = table.text(row, "image");
            if name.is_empty() {
                return Err(cells.wrong("image", "the exposure's name"));
            }
            let image = match images.get(name) {
                Some(&image) => image,
                None => {
                    images.insert(name.to_owned(), self.images.len());
                    self.images.push(name.to_owned());
                    self.images.len() - 1
                }
            };
            self.rows.push(read_row(&cells, image, &mut series, file)?);
        }
        Ok(())
    }
}

impl PointsTable {
    /// Reads several tables of one facility together.
    ///
    /// # Errors
    /// A column is missing, a cell is no number or outside its range, a file is given twice, or there is no row at all.
    pub fn read(paths: &[PathBuf]) -> Result<Self, InputError> {
        Self::read_all(paths)
    }

    /// Refuses points that cannot have been measured with `setup`: a table that names another setup, centroids beside
    /// the sensor.
    ///
    /// # Errors
    /// As said, with the row.
    pub fn check_setup(&self, setup: &Setup) -> Result<(), InputError> {
        for file in &self.files {
            file.setup.as_ref().map_or(Ok(()), |stamp| stamp.check(&file.path, setup))?;
        }
        let sensor_px = DVec2::new(f64::from(setup.camera.width_px), f64::from(setup.camera.height_px));
        let columns = ["camera_x_px", "camera_y_px"];
        self.check_within(
            |row| row.camera_px,
            sensor_px,
            EDGE_SHARE,
            "the centroid lies outside the sensor",
            columns,
            setup,
        )
    }

    /// Refuses points that were not on the screen.
    ///
    /// # Errors
    /// As said, with the row.
    pub fn check_on_screen(&self, setup: &Setup) -> Result<(), InputError> {
        let screen_px = DVec2::new(f64::from(setup.screen.width_px), f64::from(setup.screen.height_px));
        let columns = ["screen_x_px", "screen_y_px"];
        self.check_within(
            |row| row.screen_px,
            screen_px,
            0.0,
            "the point lies outside the screen",
            columns,
            setup,
        )
    }

    /// `edge` is the share of a side by which a place may lie beyond it.
    fn check_within(
        &self,
        place: impl Fn(&PointRow) -> DVec2,
        size_px: DVec2,
        edge: f64,
        problem: &str,
        columns: [&str; 2],
        setup: &Setup,
    ) -> Result<(), InputError> {
        for row in &self.rows {
            let at = place(row);
            let beyond = |k: &usize| at[*k] < -edge * size_px[*k] || at[*k] > (1.0 + edge) * size_px[*k];
            if let Some(axis) = (0..2).find(beyond) {
                return Err(self
                    .refused(row, problem, columns[axis])
                    .found(at[axis])
                    .expected(format!(
                        "0 to {}, for setup `{}` ({} x {} px)",
                        size_px[axis], setup.name, size_px.x, size_px.y
                    ))
                    .help("is it the setup that was measured? Columns may also be in each other's places"));
            }
        }
        Ok(())
    }

    /// An error about a row's cell; names the file where the row came from one.
    pub fn refused(&self, row: &PointRow, problem: &str, column: &str) -> InputError {
        match self.files.get(row.file).filter(|_| row.line > 0) {
            Some(file) => InputError::new(&file.path, problem).cell(row.line, column),
            None => InputError::new(Path::new("points"), problem).at(format!(
                "column `{column}`, image `{}`",
                self.images.get(row.image).map_or("", String::as_str)
            )),
        }
    }

    /// Writes [`Self::text`].
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&self, path: &Path, setup: &Setup) -> Result<(), InputError> {
        write_text(path, &self.text(setup))
    }

    /// As `points.csv` with the setup's name in a comment; optional columns that no row has are left out.
    pub fn text(&self, setup: &Setup) -> String {
        rows_text::<Self, _>(
            setup,
            &self.rows,
            &self.extra,
            |row| {
                let ([screen, camera], count) = ([row.screen_px, row.camera_px], row.digital_count);
                let image = csv_text(&self.images[row.image]);
                format!("{image},{},{},{count},{:.5},{:.5}", screen.x, screen.y, camera.x, camera.y)
            },
            &[
                ("sigma_px", |row| row.sigma_px.map(|v| format!("{v:.5}"))),
                ("flux_dn", |row| row.flux_dn.map(|v| format!("{v:.2}"))),
                ("saturated", |row| Some(u8::from(row.saturated).to_string())),
                ("channel", |row| Some(row.channel.letter().to_owned())),
                ("exposure_s", |row| row.exposure_s.map(|v| v.to_string())),
                ("row_load", |row| row.row_load.map(|v| format!("{v:.5}"))),
                ("time_s", |row| row.time_s.map(|v| v.to_string())),
                ("temperature_c", |row| row.temperature_c.map(|v| v.to_string())),
                ("camera_roll_deg", |row| row.camera_roll_deg.map(|v| v.to_string())),
                ("mounting", |row| row.mounting.map(|v| v.to_string())),
                ("series", |row| row.series.as_deref().map(csv_text)),
            ],
        )
    }
}

fn mounting(cells: &Cells<'_>) -> Result<Option<f64>, InputError> {
    match cells.optional("mounting")? {
        Some(value) if value < 0.0 || value.fract() != 0.0 => {
            Err(cells.wrong("mounting", "a whole number from 0 on, or an empty cell"))
        }
        value => Ok(value),
    }
}

fn read_row(
    cells: &Cells<'_>,
    image: usize,
    series: &mut Option<Arc<str>>,
    file: usize,
) -> Result<PointRow, InputError> {
    let place = |x: &str, y: &str| Ok::<_, InputError>(DVec2::new(cells.number(x)?, cells.number(y)?));
    let saturated = match cells.optional("saturated")? {
        None => false,
        Some(value) if value == 0.0 || value == 1.0 => value == 1.0,
        Some(_) => return Err(cells.wrong("saturated", "0 or 1")),
    };
    Ok(PointRow {
        image,
        screen_px: place("screen_x_px", "screen_y_px")?,
        digital_count: cells.number_in("digital_count", 1e-9..=255.0, "a count above 0, at most 255")?,
        channel: cells.channel()?,
        camera_px: place("camera_x_px", "camera_y_px")?,
        sigma_px: cells.positive("sigma_px")?,
        time_s: cells.optional("time_s")?,
        temperature_c: cells.temperature_c()?,
        row_load: cells.optional("row_load")?,
        exposure_s: cells.positive("exposure_s")?,
        flux_dn: cells.optional("flux_dn")?,
        saturated,
        camera_roll_deg: cells.optional("camera_roll_deg")?,
        mounting: mounting(cells)?,
        series: cells.shared_text("series", series),
        file,
        line: cells.table.line(cells.row),
    })
}
