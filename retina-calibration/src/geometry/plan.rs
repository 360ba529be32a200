//! Planned exposures: a pattern's screens, each with the conditions under which it is to be photographed.

use std::path::Path;

use retina_files::{InputError, Table, write_atomic};
use retina_geometry::Setup;

use super::pattern::Pattern;

/// An exposure that is to be made.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedExposure {
    /// Name that the image is to have.
    pub image: String,
    /// Index of the screen that is shown.
    pub screen: usize,
    /// Exposure time, s; the operator's choice where absent.
    pub exposure_s: Option<f64>,
    /// Time on the clock of the measurements before, s.
    pub time_s: Option<f64>,
    /// Temperature, degrees Celsius.
    pub temperature_c: Option<f64>,
    /// How far the camera is rolled in its mount, degrees.
    pub camera_roll_deg: Option<f64>,
    /// Number of the time that the camera was mounted, as in `points.csv`.
    pub mounting: Option<f64>,
}

/// Screens and exposures, in a folder: a pattern's files, and `plan.csv` with the columns of `images.csv`.
#[derive(Debug, Clone, PartialEq)]
pub struct MeasurementPlan {
    /// The screens.
    pub pattern: Pattern,
    /// The exposures in the order in which they are made.
    pub exposures: Vec<PlannedExposure>,
}

/// File of the exposures.
pub const PLAN_FILE: &str = "plan.csv";

type Fits = fn(f64) -> bool;

/// What a column's values may be.
const BOUNDS: [(&str, Fits, &str); 4] = [
    ("exposure_s", |value| value > 0.0 && value <= 86_400.0, "more than 0, at most a day"),
    ("temperature_c", |value| (-150.0..=150.0).contains(&value), "-150 to 150"),
    ("camera_roll_deg", |value| value.abs() <= 360.0, "-360 to 360"),
    ("mounting", |value| value >= 0.0 && value.fract() == 0.0, "a whole number from 0"),
];

impl MeasurementPlan {
    /// Writes the pattern and `plan.csv`.
    ///
    /// # Errors
    /// A file cannot be written.
    pub fn write(&self, folder: &Path, setup: &Setup, seed: u64) -> Result<(), InputError> {
        self.pattern.write(folder, setup, seed)?;
        let mut text =
            String::from("image,screen,exposure_s,time_s,temperature_c,camera_roll_deg,mounting\n");
        let cell = |value: Option<f64>| value.map_or_else(String::new, |value| value.to_string());
        for exposure in &self.exposures {
            text.push_str(&format!(
                "{},{},{},{},{},{},{}\n",
                exposure.image,
                self.pattern.screens[exposure.screen].file,
                cell(exposure.exposure_s),
                cell(exposure.time_s),
                cell(exposure.temperature_c),
                cell(exposure.camera_roll_deg),
                cell(exposure.mounting),
            ));
        }
        let path = folder.join(PLAN_FILE);
        write_atomic(&path, text.as_bytes())
            .map_err(|error| InputError::new(&path, format!("cannot be written: {error}")))
    }

    /// Reads a plan's folder.
    ///
    /// # Errors
    /// As [`Pattern::read`]; an exposure shows a screen that the pattern does not have.
    pub fn read(folder: &Path, setup: &Setup) -> Result<Self, InputError> {
        let pattern = Pattern::read(folder, setup)?;
        let table = Table::read(&folder.join(PLAN_FILE))?;
        table.require(&["image", "screen"])?;
        let mut exposures = Vec::with_capacity(table.len());
        for row in 0..table.len() {
            let name = table.text(row, "screen");
            let screen = pattern.screens.iter().position(|screen| screen.file == name).ok_or_else(|| {
                InputError::new(table.file(), "the pattern has no such screen")
                    .cell(table.line(row), "screen")
                    .found(format!("`{name}`"))
            })?;
            let number = |column: &str| table.number_or_empty(row, column);
            let image = table.text(row, "image").to_owned();
            if exposures.iter().any(|other: &PlannedExposure| other.image == image) {
                return Err(InputError::new(table.file(), "an image stands there twice")
                    .cell(table.line(row), "image")
                    .found(format!("`{image}`")));
            }
            for (column, fits, expected) in BOUNDS {
                if let Some(value) = number(column)?.filter(|value| !fits(*value)) {
                    return Err(InputError::new(table.file(), "cannot be carried out")
                        .cell(table.line(row), column)
                        .found(value)
                        .expected(expected));
                }
            }
            exposures.push(PlannedExposure {
                image,
                screen,
                exposure_s: number("exposure_s")?,
                time_s: number("time_s")?,
                temperature_c: number("temperature_c")?,
                camera_roll_deg: number("camera_roll_deg")?,
                mounting: number("mounting")?,
            });
        }
        if exposures.is_empty() {
            return Err(InputError::new(table.file(), "holds no exposure"));
        }
        Ok(Self { pattern, exposures })
    }
}
