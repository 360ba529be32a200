//! A calibration as one page.

use std::path::Path;

use retina_files::InputError;
use retina_formats::PointsTable;
use retina_geometry::Setup;
use retina_report::{Page, Section};

use super::calibrate::{CalibrateOptions, GeometryCalibration, calibrate};
use super::output::text_summary;
use super::plots::figures;

/// Writes the page: the summary, the plots, and the input files' hashes. The plain polynomial that it is compared with
/// is fitted here.
///
/// # Errors
/// The plain polynomial is not determined, or the file cannot be written.
pub fn write_report(
    path: &Path,
    result: &GeometryCalibration,
    table: &PointsTable,
    setup: &Setup,
    options: &CalibrateOptions,
) -> Result<(), InputError> {
    let plain = calibrate(table, setup, &CalibrateOptions { plain: true, form: None, ..options.clone() })?;
    let summary = text_summary(result, setup);
    let mut page = Page::new("calibrate geometry", &format!("Geometric calibration of {}", setup.name))
        .section(Section::new("").lines(&summary.lines().collect::<Vec<_>>()));
    for (name, figure) in figures(result, &plain) {
        page = page.section(Section::new(name).figures(&figure.panel_svgs(), figure.title()));
    }
    let files = table.files.iter().map(|file| (file.path.as_path(), file.blake3.as_str()));
    page.section(Section::new("Input").files(files)).write(path)
}
