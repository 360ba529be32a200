//! The geometric calibration in one piece: pattern, images, fit, and a check on points that the fit has not seen.

use std::path::{Path, PathBuf};

use retina_calibration::geometry::{
    CalibrateOptions, GeometryCalibration, Pattern, PatternOptions, calibrate, points_from_images,
    write_calibration,
};
use retina_files::InputError;
use retina_formats::{Calibration, PointsTable, log10_irradiance};
use retina_geometry::Setup;
use retina_image::DetectOptions;

use crate::{CaptureOptions, LabError, Rig, Sequence, capture};

/// What a calibration is to be.
#[derive(Debug, Clone, PartialEq)]
pub struct LabCalibration {
    /// The pattern.
    pub pattern: PatternOptions,
    /// How its screens are taken.
    pub capture: CaptureOptions,
    /// Screens of fresh points for the check.
    pub check_screens: usize,
}

/// What a calibration gave.
#[derive(Debug, Clone)]
pub struct LabCalibrated {
    /// The fit.
    pub fit: GeometryCalibration,
    /// The calibration file.
    pub file: PathBuf,
    /// Errors of the fresh points, arcsec, rising.
    pub fresh_arcsec: Vec<f64>,
}

impl LabCalibrated {
    /// RMS of the fresh points' errors, arcsec.
    pub fn fresh_rms_arcsec(&self) -> f64 {
        let sum: f64 = self.fresh_arcsec.iter().map(|error| error * error).sum();
        (sum / self.fresh_arcsec.len() as f64).sqrt()
    }

    /// Error that a share of the fresh points does not exceed, arcsec.
    pub fn fresh_quantile_arcsec(&self, share: f64) -> f64 {
        let last = self.fresh_arcsec.len() - 1;
        self.fresh_arcsec[(share * last as f64).round() as usize]
    }
}

/// A step that begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    /// The pattern is photographed: so many of so many images.
    Pattern(usize, usize),
    /// The mapping is fitted.
    Fit,
    /// Fresh points are photographed.
    Check(usize, usize),
}

/// Calibrates the facility: everything lies in `out` afterwards: `pattern/`, `capture/`, `calibration.toml`, and the same
/// of the check in `check/`. What an interrupted run left is kept.
///
/// # Errors
/// A device fails; the pattern is not found in the images; the points determine no mapping.
pub fn calibrate_geometry(
    setup: &Setup,
    rig: &mut Rig<'_>,
    options: &LabCalibration,
    out: &Path,
    mut progress: impl FnMut(Step),
) -> Result<LabCalibrated, LabError> {
    let table = measure(setup, rig, &options.pattern, &options.capture, out, |done, of| {
        progress(Step::Pattern(done, of));
    })?;
    progress(Step::Fit);
    let fit = calibrate(&table, setup, &CalibrateOptions::default())?;
    let file = out.join("calibration.toml");
    write_calibration(&file, &fit, &table, setup)?;
    let calibration = Calibration::read(&file, setup)?;
    let fresh = PatternOptions {
        screens: Some(options.check_screens),
        // Other places than those of the fit.
        seed: options.pattern.seed ^ 0x6672_6573_6800,
        ..options.pattern.clone()
    };
    let folder = out.join("check");
    let table = measure(setup, rig, &fresh, &options.capture, &folder, |done, of| {
        progress(Step::Check(done, of));
    })?;
    let fresh_arcsec = errors_arcsec(&table, &calibration, setup)?;
    Ok(LabCalibrated { fit, file, fresh_arcsec })
}

/// Shows a pattern, photographs it and finds its points.
fn measure(
    setup: &Setup,
    rig: &mut Rig<'_>,
    pattern: &PatternOptions,
    options: &CaptureOptions,
    out: &Path,
    progress: impl FnMut(usize, usize),
) -> Result<PointsTable, LabError> {
    let folder = out.join("pattern");
    if !folder.join("pattern.toml").is_file() {
        Pattern::make(setup, pattern)?.write(&folder, setup, pattern.seed)?;
    }
    let sequence = Sequence::read(&folder, setup)?;
    let taken = out.join("capture");
    capture(&sequence, rig, options, &taken, &mut |_, _| Ok(()), progress)?;
    let (table, _) = points_from_images(&taken.join("images"), &folder, setup, &DetectOptions::default())?;
    table.write(&out.join("points.csv"), setup)?;
    Ok(table)
}

pub(crate) fn no_inverse(calibration: &Calibration) -> InputError {
    InputError::new(&calibration.file, "holds no inverse distortion")
        .help("make the calibration with `retina calibrate geometry`")
}

/// Angles between where the points are seen and where the calibration says, arcsec, rising.
fn errors_arcsec(
    table: &PointsTable,
    calibration: &Calibration,
    setup: &Setup,
) -> Result<Vec<f64>, LabError> {
    let Some(inverse) = &calibration.inverse else {
        return Err(no_inverse(calibration).into());
    };
    let (facility, camera) = (setup.facility_pinhole(), setup.camera_pinhole());
    let response = calibration.screen_response(setup);
    let mut errors: Vec<f64> = table
        .rows
        .iter()
        .filter(|row| !row.saturated)
        .map(|row| {
            let light = log10_irradiance(&response, row.channel, row.digital_count);
            let seen = inverse.undistort(camera.line_of_sight(row.camera_px), light).extend(1.0);
            let shown = facility.line_of_sight(row.screen_px).extend(1.0);
            seen.angle_between(shown).to_degrees() * 3600.0
        })
        .collect();
    errors.sort_by(f64::total_cmp);
    if errors.is_empty() {
        return Err(InputError::new(&calibration.file, "no fresh point was seen for the check").into());
    }
    Ok(errors)
}
