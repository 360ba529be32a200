//! A calibration as one page that opens offline.

use std::fmt::Write as _;
use std::path::Path;

use retina_files::{InputError, write_atomic};
use retina_geometry::Setup;

use super::calibrate::{CalibrateOptions, GeometryCalibration, calibrate};
use super::output::text_summary;
use super::plots::figures;
use super::table::PointsTable;

/// Writes the page: the summary, the plots (inline), and the input files' hashes. The plain polynomial that it is
/// compared with is fitted here.
///
/// # Errors
/// The plain polynomial is not determined, or the file cannot be written.
pub fn write_report(
    path: &Path,
    result: &GeometryCalibration,
    table: &PointsTable,
    setup: &Setup,
) -> Result<(), InputError> {
    let plain = calibrate(table, setup, &CalibrateOptions { plain: true, ..CalibrateOptions::default() })?;
    let escaped = |text: &str| text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
    let mut page = String::from(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>Geometric calibration</title>\n\
         <style>body{font:15px/1.45 sans-serif;max-width:1450px;margin:2em auto;padding:0 1em;color:#222}\
         pre{background:#f6f6f6;padding:1em;overflow-x:auto}svg{max-width:100%;height:auto}</style></head><body>\n",
    );
    let _ = writeln!(page, "<h1>Geometric calibration of {}</h1>", escaped(&setup.name));
    let _ = writeln!(page, "<pre>{}</pre>", escaped(&text_summary(result, setup)));
    for (name, svg) in figures(result, &plain, setup) {
        let _ = writeln!(page, "<h2>{name}</h2>\n{svg}");
    }
    page.push_str("<h2>input</h2>\n<pre>");
    for (file, hash) in &table.files {
        let name = file.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let _ = writeln!(page, "{hash}  {}", escaped(&name));
    }
    page.push_str("</pre>\n</body></html>\n");
    write_atomic(path, page.as_bytes())
        .map_err(|error| InputError::new(path, format!("cannot be written: {error}")))
}
