//! Camera images of a pattern to a table of points.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::DVec2;
use rayon::prelude::*;
use retina_files::{InputError, Table, hash_file};
use retina_formats::{ExtraColumn, PointRow, PointsTable, SourceFile};
use retina_geometry::Setup;
use retina_image::{CameraImage, DetectOptions, LightPoint, ReadOptions, detect_points};

use super::pattern::Pattern;
use super::recognise::{LOG10_CHANCE_LIMIT, Recognition, recognise};

/// What became of an image.
#[derive(Debug, Clone, PartialEq)]
pub struct ImageReport {
    /// Its file.
    pub file: PathBuf,
    /// The screen that it shows.
    pub screen: String,
    /// Points of light in it.
    pub detected: usize,
    /// Points of the pattern found among them, with the log10 of the chance of that; `None`: not recognised.
    pub recognised: Option<(usize, f64)>,
}

/// An image and what `images.csv` says of it.
struct ImageEntry {
    file: PathBuf,
    screen: usize,
    exposure_s: Option<f64>,
    time_s: Option<f64>,
    temperature_c: Option<f64>,
    camera_roll_deg: Option<f64>,
    mounting: Option<f64>,
    series: Option<Arc<str>>,
    /// Values of the columns that the schema does not name; NaN where not measured.
    extra: Vec<f64>,
}

/// Finds the pattern's points in every image of a folder: images with the same stem as the screens, or those that
/// `images.csv` in the folder lists. Points whose spots overlap another's are left out.
///
/// # Errors
/// A file that does not fit, no images, or images that do not show the pattern.
pub fn points_from_images(
    images: &Path,
    pattern_folder: &Path,
    setup: &Setup,
    detect: &DetectOptions,
) -> Result<(PointsTable, Vec<ImageReport>), InputError> {
    let pattern = Pattern::read(pattern_folder, setup)?;
    let (entries, extra_columns) = entries(images, &pattern)?;
    let done: Vec<Result<(Vec<PointRow>, ImageReport), InputError>> = entries
        .par_iter()
        .enumerate()
        .map(|(image, entry)| rows_of(image, entry, &pattern, setup, detect))
        .collect();
    let list = pattern_folder.join("pattern.csv");
    let extra = extra_columns.into_iter().map(|name| ExtraColumn { name, values: Vec::new() });
    let mut table = PointsTable { extra: extra.collect(), ..PointsTable::default() };
    table.files.push(source(&list)?);
    let mut reports = Vec::new();
    for (entry, done) in entries.iter().zip(done) {
        let (rows, report) = done?;
        table.files.push(source(&entry.file)?);
        table
            .images
            .push(entry.file.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default());
        for (column, value) in table.extra.iter_mut().zip(&entry.extra) {
            column.values.extend(std::iter::repeat_n(*value, rows.len()));
        }
        table.rows.extend(rows);
        reports.push(report);
    }
    let known = reports.iter().filter(|report| report.recognised.is_some()).count();
    if 2 * known < reports.len() || known == 0 {
        let dark = reports.iter().filter(|report| report.detected == 0).count();
        let mut found = format!("{known} of {} images recognised", reports.len());
        if dark > 0 {
            found += &format!("; {dark} without any point of light: dark, or saturated all over");
        }
        return Err(InputError::new(images, "the pattern does not match the images")
            .found(found)
            .expected(format!("matches that chance makes in fewer than 1 of 1e{} cases", -LOG10_CHANCE_LIMIT))
            .help("are these images of this pattern, in focus and exposed, each named as its screen?"));
    }
    Ok((table, reports))
}

fn entries(images: &Path, pattern: &Pattern) -> Result<(Vec<ImageEntry>, Vec<String>), InputError> {
    let list = images.join("images.csv");
    if list.is_file() {
        return listed(images, &list, pattern);
    }
    let mut files: Vec<PathBuf> = std::fs::read_dir(images)
        .map_err(|error| {
            InputError::new(images, format!("cannot be read: {error}")).expected("a folder of camera images")
        })?
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.is_file())
        .collect();
    files.sort();
    let stem = |path: &Path| path.file_stem().map(|stem| stem.to_os_string());
    let mut out = Vec::new();
    for file in files {
        let of = |screen: &super::pattern::PatternScreen| stem(Path::new(&screen.file)) == stem(&file);
        if let Some(screen) = pattern.screens.iter().position(of) {
            out.push(ImageEntry {
                file,
                screen,
                exposure_s: None,
                time_s: None,
                temperature_c: None,
                camera_roll_deg: None,
                mounting: None,
                series: None,
                extra: Vec::new(),
            });
        }
    }
    if out.is_empty() {
        return Err(InputError::new(images, "holds no image of a screen of the pattern")
            .expected("files named as the screens (000.png, 000.tif, 000.fits), or a table images.csv"));
    }
    Ok((out, Vec::new()))
}

fn listed(
    images: &Path,
    list: &Path,
    pattern: &Pattern,
) -> Result<(Vec<ImageEntry>, Vec<String>), InputError> {
    let table = Table::read(list)?;
    table.require(&["image", "screen"])?;
    let own =
        ["image", "screen", "exposure_s", "time_s", "temperature_c", "camera_roll_deg", "mounting", "series"];
    let extra: Vec<String> = table.columns().iter().filter(|c| !own.contains(&c.as_str())).cloned().collect();
    let mut out: Vec<ImageEntry> = Vec::new();
    for row in 0..table.len() {
        let file = images.join(table.text(row, "image"));
        if out.iter().any(|entry| entry.file == file) {
            return Err(InputError::new(list, "the image is listed twice")
                .cell(table.line(row), "image")
                .found(format!("`{}`", table.text(row, "image")))
                .help("exposures are taken for independent: list each once"));
        }
        let name = table.text(row, "screen");
        let screen = pattern
            .screens
            .iter()
            .position(|screen| screen.file == name || screen.file.strip_suffix(".png") == Some(name))
            .ok_or_else(|| {
                InputError::new(list, "the pattern has no such screen")
                    .cell(table.line(row), "screen")
                    .found(format!("`{name}`"))
                    .expected(format!(
                        "000.png to {}",
                        pattern.screens.last().map_or("", |s| s.file.as_str())
                    ))
            })?;
        let number = |column: &str| table.number_or_empty(row, column);
        let extra = extra.iter().map(|column| Ok(number(column)?.unwrap_or(f64::NAN)));
        out.push(ImageEntry {
            file,
            screen,
            exposure_s: exposure(&table, row)?,
            time_s: number("time_s")?,
            temperature_c: number("temperature_c")?,
            camera_roll_deg: number("camera_roll_deg")?,
            mounting: number("mounting")?,
            series: Some(table.text(row, "series")).filter(|text| !text.is_empty()).map(Arc::from),
            extra: extra.collect::<Result<_, InputError>>()?,
        });
    }
    if out.is_empty() {
        return Err(InputError::new(list, "lists no image"));
    }
    Ok((out, extra))
}

fn source(path: &Path) -> Result<SourceFile, InputError> {
    Ok(SourceFile::new(path, hash_file(path)?))
}

fn exposure(table: &Table, row: usize) -> Result<Option<f64>, InputError> {
    let value = table.number_or_empty(row, "exposure_s")?;
    match value {
        Some(found) if found <= 0.0 => {
            Err(InputError::new(table.file(), "the exposure time is not positive")
                .cell(table.line(row), "exposure_s")
                .found(found)
                .expected("seconds above 0, or an empty cell"))
        }
        _ => Ok(value),
    }
}

fn rows_of(
    image: usize,
    entry: &ImageEntry,
    pattern: &Pattern,
    setup: &Setup,
    detect: &DetectOptions,
) -> Result<(Vec<PointRow>, ImageReport), InputError> {
    let picture =
        CameraImage::read(&entry.file, ReadOptions { bits: Some(setup.camera.bits), colour_to_grey: false })?;
    let (width, height) = (setup.camera.width_px, setup.camera.height_px);
    if (picture.width_px, picture.height_px) != (width, height) {
        return Err(InputError::new(&entry.file, "the image is not of the setup's camera")
            .found(format!("{} x {}", picture.width_px, picture.height_px))
            .expected(format!("{width} x {height}, as setup `{}` says", setup.name)));
    }
    let found = detect_points(&picture, detect);
    let (rows, recognition) = match_points(image, entry.screen, pattern, setup, &found.points);
    let report = ImageReport {
        file: entry.file.clone(),
        screen: pattern.screens[entry.screen].file.clone(),
        detected: found.points.len(),
        recognised: recognition.map(|r| (rows.len(), r.log10_chance)),
    };
    let complete = |row: PointRow| PointRow {
        exposure_s: entry.exposure_s,
        time_s: entry.time_s,
        temperature_c: entry.temperature_c,
        camera_roll_deg: entry.camera_roll_deg,
        mounting: entry.mounting,
        series: entry.series.clone(),
        ..row
    };
    Ok((rows.into_iter().map(complete).collect(), report))
}

/// The rows of an image's points of light that are points of a screen of the pattern.
pub fn match_points(
    image: usize,
    screen: usize,
    pattern: &Pattern,
    setup: &Setup,
    points: &[LightPoint],
) -> (Vec<PointRow>, Option<Recognition>) {
    let shown = &pattern.screens[screen].points;
    let places: Vec<DVec2> = shown.iter().map(super::pattern::PatternPoint::screen_px).collect();
    let seen: Vec<DVec2> = points.iter().map(|point| DVec2::new(point.x_px, point.y_px)).collect();
    let Some(recognition) = recognise(&places, &seen) else { return (Vec::new(), None) };
    let row = |&(i, j): &(usize, usize)| {
        let point = &points[j];
        (!point.blended).then(|| PointRow {
            channel: pattern.screens[screen].channel,
            sigma_px: Some(point.sigma_px),
            flux_dn: Some(point.flux_dn),
            saturated: point.saturated,
            row_load: Some(pattern.row_load(screen, shown[i].row, setup.screen.width_px)),
            ..PointRow::new(image, places[i], f64::from(shown[i].digital_count), seen[j])
        })
    };
    (recognition.pairs.iter().filter_map(row).collect(), Some(recognition))
}
