//! Sessions whose data the virtual bench makes.

use std::path::{Path, PathBuf};

use retina_bench::BenchError;
use retina_calibration::geometry::{CalibrateOptions, calibrate, write_calibration};
use retina_campaign::{PointsRecord, simulate_points};
use retina_files::{InputError, read_text, write_atomic};
use retina_geometry::Setup;
use serde::{Deserialize, Serialize};

/// What the bench makes for a session: a calibration at one campaign's light, and the table of another.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Recipe {
    /// The campaign that the facility is calibrated with.
    pub(crate) calibration: PointsRecord,
    /// The campaign that is looked at.
    pub(crate) data: PointsRecord,
}

/// An example of the start page.
pub(crate) struct Example {
    pub(crate) id: &'static str,
    pub(crate) title: &'static str,
    pub(crate) text: &'static str,
    pub(crate) recipe: fn() -> Recipe,
}

fn campaign(seed: u64, exposures: usize, points: usize) -> PointsRecord {
    PointsRecord {
        seed,
        effects: Vec::new(),
        exposures,
        points,
        interval_s: 60.0,
        temperature: "warm-up".to_owned(),
        exposure_s: Some(0.08),
        channel: "w".to_owned(),
        counts: vec![34],
        centroid: "moments".to_owned(),
        camera_roll_deg: 0.0,
    }
}

/// Counts of the paper's Fig. 10, every 0.2 of a magnitude or so.
const MANY_COUNTS: [u8; 11] = [60, 52, 45, 39, 34, 29, 25, 22, 19, 16, 14];

pub(crate) const EXAMPLES: [Example; 2] = [
    Example {
        id: "fig-10",
        title: "Points move as they get brighter (Fig. 10)",
        text: "A facility was calibrated at one brightness and is used at eleven. About 2000 points. Which effect is missing?",
        recipe: || Recipe {
            calibration: campaign(1, 24, 400),
            data: PointsRecord { counts: MANY_COUNTS.to_vec(), ..campaign(7, 40, 50) },
        },
    },
    Example {
        id: "wandering-mount",
        title: "A mount that wanders",
        text: "The camera's boresight moves while the bench warms up. Is it time or temperature? One more measurement tells.",
        recipe: || Recipe {
            calibration: campaign(1, 24, 400),
            data: PointsRecord { effects: vec!["drift=60arcsec/h".to_owned()], ..campaign(3, 40, 50) },
        },
    },
];

/// Files that the bench makes in a session's folder.
pub(crate) struct Made {
    pub(crate) setup: PathBuf,
    pub(crate) table: PathBuf,
    pub(crate) calibration: PathBuf,
}

impl Made {
    pub(crate) fn of(folder: &Path) -> Self {
        let at = |name: &str| folder.join(name);
        Self { setup: at("setup.toml"), table: at("points.csv"), calibration: at("calibration.toml") }
    }

    fn is_whole(&self) -> bool {
        [&self.setup, &self.table, &self.calibration].into_iter().all(|path| path.is_file())
    }
}

impl Recipe {
    /// Makes the files, if they are not there yet. `progress` is told exposures done and in all.
    pub(crate) fn make(&self, folder: &Path, progress: impl Fn(usize, usize)) -> Result<(), BenchError> {
        let made = Made::of(folder);
        if made.is_whole() {
            return Ok(());
        }
        write(&made.setup, retina_assets::WIDE_FOV_SETUP)?;
        let setup = Setup::read(&made.setup)?;
        let all = self.calibration.exposures + self.data.exposures;
        let table = simulate_points(
            &self.calibration.facility(&setup)?,
            &self.calibration.options()?,
            None,
            |done| {
                progress(done, all);
            },
        )?
        .table;
        let options = CalibrateOptions { plain: true, ..CalibrateOptions::default() };
        let result = calibrate(&table, &setup, &options)?;
        write_calibration(&made.calibration, &result, &table, &setup)?;
        let before = self.calibration.exposures;
        measure(&self.data, &setup, &made.table, |done| progress(before + done, all))
    }
}

/// Runs a campaign on the bench and writes its table, with the record beside it.
pub(crate) fn measure(
    record: &PointsRecord,
    setup: &Setup,
    table: &Path,
    progress: impl Fn(usize),
) -> Result<(), BenchError> {
    let result = simulate_points(&record.facility(setup)?, &record.options()?, None, progress)?;
    result.table.write(table, setup)?;
    Ok(())
}

fn write(path: &Path, text: &str) -> Result<(), InputError> {
    write_atomic(path, text.as_bytes())
        .map_err(|error| InputError::new(path, format!("cannot be written: {error}")))
}

/// The campaign of a table that `retina simulate points` wrote: `campaign.json` lies beside it and tells of as many points.
pub(crate) fn campaign_beside(table: &Path, setup: &Setup) -> Option<PointsRecord> {
    #[derive(Deserialize)]
    struct Campaign {
        kind: String,
        setup: String,
        points: usize,
        options: PointsRecord,
    }
    let text = read_text(&table.parent()?.join("campaign.json")).ok()?;
    let campaign: Campaign = serde_json::from_str(&text).ok()?;
    let rows = read_text(table)
        .ok()?
        .lines()
        .filter(|line| !line.starts_with('#') && !line.trim().is_empty())
        .count();
    (campaign.kind == "points" && campaign.setup == setup.name && campaign.points + 1 == rows)
        .then_some(campaign.options)
}
