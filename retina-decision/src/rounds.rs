//! A folder of plans and their measurements, a folder for each round: what is there says how far one is.

use std::path::{Path, PathBuf};

use retina_calibration::geometry::{MeasurementPlan, PLAN_FILE, points_from_images};
use retina_files::InputError;
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
