//! A folder of plans and their measurements, a folder for each round: what is there says how far one is.

use std::path::{Path, PathBuf};

use retina_calibration::geometry::{MeasurementPlan, PLAN_FILE, PlannedExposure, points_from_images};
use retina_files::InputError;
use retina_formats::{PointRow, PointsTable};
use retina_geometry::Setup;
use retina_image::DetectOptions;

/// Rounds of one question.
#[derive(Debug, Clone)]
pub struct Rounds {
    folder: PathBuf,
}

/// A round that was planned.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Round {
    /// Its number, from 1.
    pub number: usize,
    /// Its folder.
    pub folder: PathBuf,
}

impl Round {
    /// Where its measurements go: a table of points.
    pub fn points(&self) -> PathBuf {
        self.folder.join("points.csv")
    }

    /// Where its photographs go, with `images.csv`, where no table was made of them.
    pub fn images(&self) -> PathBuf {
        self.folder.join("images")
    }
}

/// What a measured exposure may be off from its plan before it is told, and in which unit.
const TOLERANCES: [(&str, f64, Condition, Measured); 4] = [
    ("camera_roll_deg", 0.5, |planned| planned.camera_roll_deg, |row| row.camera_roll_deg),
    ("temperature_c", 0.5, |planned| planned.temperature_c, |row| row.temperature_c),
    ("exposure_s", 0.0, |planned| planned.exposure_s, |row| row.exposure_s),
    ("mounting", 0.0, |planned| planned.mounting, |row| row.mounting),
];

type Condition = fn(&PlannedExposure) -> Option<f64>;
type Measured = fn(&PointRow) -> Option<f64>;

impl Round {
    /// What was measured otherwise than planned, in words. The measurements count as they are.
    ///
    /// # Errors
    /// Nothing was measured, or exposures that the plan does not have.
    pub fn deviations(&self, plan: &MeasurementPlan, table: &PointsTable) -> Result<Vec<String>, InputError> {
        let path = self.points();
        let own: Vec<&PointRow> = table
            .rows
            .iter()
            .filter(|row| table.files.get(row.file).is_some_and(|file| file.path == path))
            .collect();
        let help = "remove the file, and measure the round again";
        if own.is_empty() {
            return Err(InputError::new(&path, "holds no point")
                .expected("the points of the plan's screens")
                .help(help));
        }
        let image = |row: &&&PointRow| table.images[row.image].as_str();
        if let Some(other) =
            own.iter().find(|row| plan.exposures.iter().all(|planned| planned.image != image(row)))
        {
            return Err(InputError::new(&path, "has an exposure that the plan does not have")
                .found(format!("`{}`", image(&other)))
                .expected(format!("the images of {PLAN_FILE}, such as `{}`", plan.exposures[0].image))
                .help(help));
        }
        let mut out = Vec::new();
        let rows = |planned: &PlannedExposure| own.iter().find(|row| image(row) == planned.image);
        let missing = plan.exposures.iter().filter(|planned| rows(planned).is_none()).count();
        if missing > 0 {
            out.push(format!(
                "{}: {missing} of {} planned exposures were not measured",
                path.display(),
                plan.exposures.len()
            ));
        }
        for (column, most, planned_value, measured_value) in TOLERANCES {
            let off = plan.exposures.iter().find_map(|planned| {
                let (wanted, found) = (planned_value(planned)?, measured_value(rows(planned)?));
                let within = found.is_some_and(|found| (found - wanted).abs() <= most + 1e-6 * wanted.abs());
                (!within).then(|| (planned.image.clone(), wanted, found))
            });
            if let Some((image, wanted, found)) = off {
                let found =
                    found.map_or_else(|| "is not in the table".to_owned(), |found| format!("was {found}"));
                out.push(format!("{}: {column} of {image} {found}, planned was {wanted}", path.display()));
            }
        }
        Ok(out)
    }
}

impl Rounds {
    /// Those of a folder, which need not be there yet.
    ///
    /// # Errors
    /// It is a file.
    pub fn new(folder: &Path) -> Result<Self, InputError> {
        if folder.exists() && !folder.is_dir() {
            return Err(InputError::new("--out", "is no folder")
                .found(folder.display().to_string())
                .expected("a folder, which is made where it is not there"));
        }
        Ok(Self { folder: folder.to_owned() })
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The round of a number.
    pub fn round(&self, number: usize) -> Round {
        Round { number, folder: self.folder.join(format!("round_{number:02}")) }
    }

    /// Tables of the rounds that were measured, and the round that was planned and not measured yet. Photographs become
    /// tables here.
    ///
    /// # Errors
    /// The photographs of a round do not show its screens, or have no list.
    pub fn measured(&self, setup: &Setup) -> Result<(Vec<PathBuf>, Option<Round>), InputError> {
        let mut tables = Vec::new();
        for number in 1.. {
            let round = self.round(number);
            if !round.folder.join(PLAN_FILE).is_file() {
                return Ok((tables, None));
            }
            if !round.points().is_file() {
                if !round.images().is_dir() {
                    return Ok((tables, Some(round)));
                }
                detected(&round, setup)?;
            }
            tables.push(round.points());
        }
        Ok((tables, None))
    }

    /// Writes a round's screens and exposures.
    ///
    /// # Errors
    /// A file cannot be written.
    pub fn write(
        &self,
        number: usize,
        plan: &MeasurementPlan,
        setup: &Setup,
        seed: u64,
    ) -> Result<Round, InputError> {
        let round = self.round(number);
        plan.write(&round.folder, setup, seed)?;
        Ok(round)
    }
}

/// Makes a table of a round's photographs.
fn detected(round: &Round, setup: &Setup) -> Result<(), InputError> {
    let images = round.images();
    if !images.join("images.csv").is_file() {
        return Err(InputError::new(&images, "has no images.csv")
            .expected("which image shows which screen, with time, temperature, roll and mounting")
            .help("copy plan.csv of the round there, and correct what was not as planned"));
    }
    let (table, _) = points_from_images(&images, &round.folder, setup, &DetectOptions::default())?;
    table.write(&round.points(), setup)
}
