//! `fit --out`: baseline and effects as a calibration, which is accepted wherever a calibration is.

use std::path::Path;

use glam::DVec2;
use retina_calibration::geometry::{CalibrateOptions, GeometryCalibration, calibrate};
use retina_files::InputError;
use retina_formats::{
    Calibration, CalibrationFile, CovarianceRecord, PointRow, PointsTable, SourceFile, TableKind,
};
use retina_geometry::Setup;

use crate::added::{AddedEffect, adjusted};
use crate::data::{ARCSEC_PER_RAD, Dataset};
use crate::fit::Fit;
use crate::linear::Basis;
use crate::uncertainty::independent_errors;

/// Writes the model: its predictions at the table's own points, as a calibration of D and of D^-1 with irradiance, with
/// the response of the calibration that was held fixed and the covariance that the fit and that calibration leave.
/// Returns the rms difference between the two, arcsec per axis.
///
/// # Errors
/// The table is none of points, an effect depends on more than the place in the field and the irradiance, the model
/// cannot be inverted, or the file cannot be written.
pub fn write_model(
    path: &Path,
    data: &Dataset,
    fit: &Fit,
    added: &[AddedEffect],
    setup: &Setup,
    table: &PointsTable,
    held: Option<&Calibration>,
) -> Result<f64, InputError> {
    if data.kind != TableKind::Points {
        return Err(InputError::new(
            path,
            format!("a model of {} is no calibration of the geometry", data.kind.name()),
        )
        .expected("a table of points")
        .help("leave out --out; --json and --predictions hold the fit"));
    }
    // What a calibration's polynomials are over.
    const HELD: [&str; 7] = ["x", "y", "r", "log10_irradiance", "L", "F", "digital_count"];
    let beyond = |effect: &AddedEffect| effect.columns().into_iter().any(|column| !HELD.contains(&column));
    if let Some(other) = added.iter().find(|effect| beyond(effect)) {
        return Err(InputError::new(path, format!("a calibration cannot hold `{}`", other.name()))
            .found(format!("it depends on {}", other.columns().join(", ")))
            .expected("effects of the place in the field and of the irradiance")
            .help("leave that effect out of the model file; --predictions holds it"));
    }
    fit.check_covers(path, data)?;
    if data.roll_rad.len() > 1 {
        return Err(InputError::new(path, "a calibration holds one mounting of the camera")
            .found(format!("{} mountings", data.roll_rad.len()))
            .help("fit the campaign of that mounting alone"));
    }
    let predicted = predictions(path, data, fit, table)?;
    let response = held.and_then(|calibration| calibration.response.clone());
    let record = response.as_ref().map(|measured| measured.record.clone());
    let result = calibrate(&predicted, setup, &CalibrateOptions { response, ..CalibrateOptions::default() })?;
    let rms = result.errors.rms_arcsec / std::f64::consts::SQRT_2;
    let names: Vec<&str> = added.iter().map(AddedEffect::name).collect();
    let mut file = CalibrationFile::new(setup);
    file.source = format!(
        "retina fit: baseline + {}; polynomials {rms:.2e} arcsec rms per axis from the model",
        names.join(" + ")
    );
    result.store(&mut file);
    file.covariance = covariance(&result, data, fit, added);
    file.provenance = Some(CalibrationFile::provenance_of(setup));
    file.response = record;
    file.write(path)?;
    Ok(rms)
}

/// The model's own predictions, without noise, on the table's points.
fn predictions(
    path: &Path,
    data: &Dataset,
    fit: &Fit,
    table: &PointsTable,
) -> Result<PointsTable, InputError> {
    let files = table.files.iter().map(|file| SourceFile { setup: None, ..file.clone() });
    let mut out =
        PointsTable { images: vec!["model".to_owned()], files: files.collect(), ..PointsTable::default() };
    for row in (0..data.len()).filter(|&row| !fit.outlier[row]) {
        let frame = &data.frame[row];
        let px = |i: usize| {
            let shift: f64 = (0..2).map(|j| frame.to_table[i][j] * fit.residual[2 * row + j]).sum();
            frame.measured[i] - shift
        };
        let source = table
            .rows
            .get(data.order[row])
            .ok_or_else(|| InputError::new(path, "the table has changed while it was fitted"))?;
        out.rows.push(PointRow {
            channel: source.channel,
            file: source.file,
            line: source.line,
            ..PointRow::new(0, source.screen_px, source.digital_count, DVec2::new(px(0), px(1)))
        });
    }
    Ok(out)
}

/// Rows over which the model's error is taken.
const SAMPLE: usize = 1500;

/// Covariance of the mapping's coefficients, a before b: the model's prediction error over the rows, put into
/// the mapping by least squares. The error is that of the fitted parameters (P their covariance, B their columns:
/// B P B^T) and that of the calibration held fixed (its own columns F: F F^T). The data lessen the latter a little,
/// which is not counted: the covariance is rather too large.
fn covariance(
    result: &GeometryCalibration,
    data: &Dataset,
    fit: &Fit,
    added: &[AddedEffect],
) -> Option<CovarianceRecord> {
    let base = adjusted(data, added).base;
    let sigma: Vec<f64> = fit.parameters[..base.len()].iter().map(|p| p.sigma.unwrap_or(0.0)).collect();
    let stride = data.len().div_ceil(SAMPLE).max(1);
    let rows: Vec<usize> = (0..data.len()).step_by(stride).collect();
    let at = |column: &[f64], axis: usize| -> Vec<f64> {
        rows.iter().map(|&row| column[2 * row + axis] / ARCSEC_PER_RAD).collect()
    };
    // Independent errors of unit variance, axis by axis.
    let independent = independent_errors(data, &base, &sigma, &fit.correlation)?;
    let errors = independent.iter().map(|column| [at(column, 0), at(column, 1)]);
    let inverse = &result.inverse;
    let side = inverse.columns();
    // Columns about 1 at the camera's edge: the covariance's own scale is put back at the end.
    let mut scale: Vec<f64> =
        inverse.terms.iter().map(|(term, _)| data.half_tan.powi(-((term[0] + term[1]) as i32))).collect();
    scale.resize(side, 1.0);
    let (x, y) = (data.values("x"), data.values("y"));
    let l = data.values("log10_irradiance");
    let values: Vec<Vec<f64>> = rows
        .iter()
        .map(|&row| {
            let mut out = vec![0.0; side];
            inverse.fill(data.half_tan * DVec2::new(x[row], y[row]), inverse.held(l[row]), &mut out);
            out
        })
        .collect();
    let column = |c: usize| values.iter().map(|row| row[c] * scale[c]).collect::<Vec<f64>>();
    let basis = Basis::of((0..side).map(column));
    let mut matrix = vec![0.0; 4 * side * side];
    for error in errors {
        let fitted = error.iter().flat_map(|along| basis.coefficients(along));
        let coefficients: Vec<f64> = fitted.zip(scale.iter().cycle()).map(|(c, scale)| c * scale).collect();
        for (i, row) in matrix.chunks_exact_mut(2 * side).enumerate() {
            row.iter_mut().zip(&coefficients).for_each(|(sum, c)| *sum += coefficients[i] * c);
        }
    }
    Some(CovarianceRecord::of_matrix(&matrix, 2 * side))
}
