//! `fit --out`: baseline and effects as a calibration, which is accepted wherever a calibration is.

use std::fmt::Write as _;
use std::path::Path;

use glam::DVec2;
use retina_calibration::geometry::{CalibrateOptions, PointRow, PointsTable, calibrate, log10_irradiance};
use retina_files::{InputError, write_atomic};
use retina_geometry::Setup;
use retina_radiometry::ScreenResponse;

use crate::added::AddedEffect;
use crate::data::{Dataset, TableKind};
use crate::fit::Fit;

/// Writes the model: its predictions at the table's own points, as a calibration of D and of D^-1 with irradiance.
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
    // The model's own predictions, without noise, on the table's points.
    let camera = setup.camera_pinhole();
    let mut predicted = PointsTable {
        images: vec!["model".to_owned()],
        files: table.files.clone(),
        ..PointsTable::default()
    };
    let response = ScreenResponse::power_law(setup.response_gamma(), setup.brightest_magnitude());
    let mut range = [f64::INFINITY, f64::NEG_INFINITY];
    for row in 0..data.len() {
        if fit.outlier[row] {
            continue;
        }
        let frame = &data.frame[row];
        let px = |i: usize| {
            let shift: f64 = (0..2).map(|j| frame.to_table[i][j] * fit.residual[2 * row + j]).sum();
            frame.measured[i] - shift
        };
        let source = table
            .rows
            .get(data.order[row])
            .ok_or_else(|| InputError::new(path, "the table has changed while it was fitted"))?;
        let l = log10_irradiance(&response, source.channel, source.digital_count);
        range = [range[0].min(l), range[1].max(l)];
        predicted.rows.push(PointRow {
            image: 0,
            camera_px: DVec2::new(px(0), px(1)),
            sigma_px: None,
            exposure_s: None,
            flux_dn: None,
            ..source.clone()
        });
    }
    let options = CalibrateOptions::default();
    let result = calibrate(&predicted, setup, &options)?;
    let mut text = format!(
        "schema = \"retina.calibration/1\"\nsetup = {}\nsource = {}\n",
        toml::Value::String(setup.name.clone()),
        toml::Value::String(format!(
            "retina fit: baseline + {}",
            added.iter().map(AddedEffect::name).collect::<Vec<_>>().join(" + ")
        ))
    );
    let rms = result.errors.rms_arcsec / std::f64::consts::SQRT_2;
    let _ = writeln!(
        text,
        "\n# Polynomials fitted to the model's predictions, {rms:.2e} arcsec rms per axis from them."
    );
    text.push_str("# r = D(r_u) at the reference irradiance: rows [i, j, a, b].\n[distortion]\nterms = [\n");
    for (i, j, a, b) in &result.direct.terms {
        let _ = writeln!(text, "  [{i}, {j}, {a:?}, {b:?}],");
    }
    text.push_str("]\n\n# r_u = D^-1(r, L): rows [i, j, k, a, b].\n[inverse]\n");
    let _ = writeln!(text, "reference_log10_irradiance = {:?}", result.reference_log10_irradiance);
    let _ = writeln!(text, "range_log10_irradiance = [{:?}, {:?}]\nterms = [", range[0], range[1]);
    for ([i, j, k], c) in result.terms.iter().zip(&result.coefficients) {
        let _ = writeln!(text, "  [{i}, {j}, {k}, {:?}, {:?}],", c.x, c.y);
    }
    let (k, c) = (setup.facility_pinhole(), camera);
    let _ = writeln!(
        text,
        "]\n\n[provenance]\nk_f_px = [{:?}, {:?}, {:?}, {:?}]\ncamera_px = [{:?}, {:?}, {:?}, {:?}, {:?}, {:?}]\nsoftware = \"retina {}\"",
        k.fx_px,
        k.fy_px,
        k.cx_px,
        k.cy_px,
        c.fx_px,
        c.fy_px,
        c.cx_px,
        c.cy_px,
        f64::from(c.width_px),
        f64::from(c.height_px),
        env!("CARGO_PKG_VERSION")
    );
    write_atomic(path, text.as_bytes())
        .map_err(|error| InputError::new(path, format!("cannot be written: {error}")))?;
    Ok(rms)
}
