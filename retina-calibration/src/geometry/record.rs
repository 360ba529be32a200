//! The result as `calibration.toml`.

use std::path::Path;

use retina_files::InputError;
use retina_formats::{
    CalibrationFile, CovarianceRecord, DistortionRecord, FieldRecord, InverseRecord, PointsTable, RingsRecord,
};
use retina_geometry::{InverseTerm, Setup};
use toml::Value;

use super::calibrate::GeometryCalibration;
use super::errors::PERCENTILES;

/// Digits of errors in the provenance: they are for people.
const ERROR_DIGITS: f64 = 1e6;

/// Writes D, D^-1, their covariance, the response by which irradiance is meant, and provenance as `calibration.toml`.
///
/// # Errors
/// The file cannot be written, or one that is there is no calibration of this setup, or holds another response than
/// the fit took.
pub fn write_calibration(
    path: &Path,
    result: &GeometryCalibration,
    table: &PointsTable,
    setup: &Setup,
) -> Result<(), InputError> {
    let mut file = CalibrationFile::read_or_new(path, setup)?;
    if file.response.is_some() && file.response != result.response {
        return Err(InputError::new(path, "holds a response that the fit did not take")
            .at("table `response`")
            .expected("the response by which D^-1 depends on irradiance")
            .help("calibrate with this response, or give --out another name"));
    }
    file.source = format!(
        "retina calibrate geometry, {} points in {} exposures",
        result.errors.points, result.exposures
    );
    file.provenance = Some(provenance(result, table, setup));
    file.response.clone_from(&result.response);
    result.store(&mut file);
    file.write(path)
}

impl GeometryCalibration {
    /// Puts D, D^-1 and covariance into a file.
    pub fn store(&self, file: &mut CalibrationFile) {
        let direct = self.direct.terms.iter().map(|&(i, j, a, b)| (f64::from(i), f64::from(j), a, b));
        file.distortion = Some(DistortionRecord { terms: direct.collect() });
        let inverse = &self.inverse;
        let row = |(powers, c): &InverseTerm| {
            let [i, j, k] = powers.map(f64::from);
            (i, j, k, c.x, c.y)
        };
        file.inverse = Some(InverseRecord {
            reference_log10_irradiance: inverse.reference_log10_irradiance,
            range_log10_irradiance: inverse.range_log10_irradiance,
            field: inverse.field.map(|field| FieldRecord {
                low: field.low.to_array(),
                high: field.high.to_array(),
                radius: field.radius,
            }),
            terms: inverse.terms.iter().map(row).collect(),
            rings: inverse.rings.as_ref().map(|field| RingsRecord {
                center: field.rings.center.to_array(),
                radius: field.rings.radius,
                terms: field.coefficients.chunks(2).map(|c| [c[0].x, c[1].x, c[0].y, c[1].y]).collect(),
            }),
        });
        file.covariance = Some(CovarianceRecord::of_matrix(&self.covariance, 2 * inverse.columns()));
    }
}

fn provenance(result: &GeometryCalibration, table: &PointsTable, setup: &Setup) -> toml::Table {
    let mut out = CalibrationFile::provenance_of(setup);
    let mut put = |key: &str, value: Value| out.insert(key.to_owned(), value);
    let count = |value: usize| Value::Integer(value as i64);
    let error = |value: f64| Value::Float((value * ERROR_DIGITS).round() / ERROR_DIGITS);
    let inputs = table.files.iter().map(|file| {
        // The name without its folder: the same data elsewhere are the same data.
        let name = file.path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        Value::Table(toml::Table::from_iter([
            ("file".to_owned(), Value::String(name)),
            ("blake3".to_owned(), Value::String(file.blake3.clone())),
        ]))
    });
    put("inputs", Value::Array(inputs.collect()));
    for (key, value) in [
        ("rows", result.rows),
        ("points", result.errors.points),
        ("outliers", result.outliers),
        ("saturated", result.saturated),
        ("exposures", result.exposures),
    ] {
        put(key, count(value));
    }
    for (key, value) in [
        ("jitter_arcsec", result.jitter_arcsec),
        ("rms_arcsec", result.errors.rms_arcsec),
        ("heldout_rms_arcsec", result.heldout.rms_arcsec),
        ("inverse_error_arcsec", result.direct.worst_arcsec),
    ] {
        put(key, error(value));
    }
    let percentiles = PERCENTILES.iter().zip(result.heldout.percentiles_arcsec);
    let percentiles = percentiles.map(|(percent, value)| (percent.to_string(), error(value)));
    put("heldout_percentiles_arcsec", Value::Table(percentiles.collect()));
    // Degree in x and y, degree of L's coefficients, highest power of L, intervals of the rings, error of exposures left out
    // (arcsec per axis), standard errors behind the best.
    let rungs = result.ladder.iter().map(|rung| {
        let form = rung.form;
        let powers = [form.degree, form.irradiance_degree, form.irradiance_power, form.rings];
        let mut row: Vec<Value> = powers.map(|power| Value::Integer(i64::from(power))).to_vec();
        row.extend([error(rung.heldout_rms_arcsec), error(rung.behind_best)]);
        Value::Array(row)
    });
    put("ladder", Value::Array(rungs.collect()));
    out
}
