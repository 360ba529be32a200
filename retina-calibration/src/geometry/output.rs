//! The results as JSON, text and a table of residuals.

use std::fmt::Write as _;
use std::path::Path;

use retina_files::{InputError, write_atomic};
use retina_formats::{PointsTable, csv_text};
use retina_geometry::{ARCSEC_PER_RAD, Setup};
use serde_json::{Value, json};

use super::calibrate::GeometryCalibration;
use super::errors::{ErrorSummary, PERCENTILES};
use super::form::ModelForm;
use super::physical::PhysicalFit;

fn store(path: &Path, text: &str) -> Result<(), InputError> {
    write_atomic(path, text.as_bytes())
        .map_err(|error| InputError::new(path, format!("cannot be written: {error}")))
}

fn errors_json(errors: &ErrorSummary) -> Value {
    let percentiles: serde_json::Map<String, Value> = PERCENTILES
        .iter()
        .zip(errors.percentiles_arcsec)
        .map(|(percent, value)| (percent.to_string(), json!(value)))
        .collect();
    json!({
        "points": errors.points,
        "rms_arcsec": errors.rms_arcsec,
        "percentiles_arcsec": percentiles,
        "fraction_within_10_arcsec": errors.fraction_within_10_arcsec,
    })
}

fn form_json(form: &ModelForm) -> Value {
    json!({
        "degree": form.degree,
        "irradiance_degree": form.irradiance_degree,
        "irradiance_power": form.irradiance_power,
        "rings": form.rings,
    })
}

fn physical_json(physical: &PhysicalFit, setup: &Setup) -> Value {
    let k = setup.facility_pinhole();
    let with_sigma = |value: f64, sigma: f64| json!({ "value": value, "sigma": sigma });
    json!({
        "optical_centre_screen_px": {
            "dx": with_sigma(physical.center_on_screen.x * k.fx_px, physical.center_sigma.x * k.fx_px),
            "dy": with_sigma(physical.center_on_screen.y * k.fy_px, physical.center_sigma.y * k.fy_px),
            "identical_to": "decentering",
        },
        "roll_deg": with_sigma(physical.roll_rad.to_degrees(), physical.roll_sigma_rad.to_degrees()),
        "scale": with_sigma(physical.scale, physical.scale_sigma),
        "scale_x_over_y": physical.aspect,
        "k1": with_sigma(physical.radial[0].0, physical.radial[0].1),
        "k2": with_sigma(physical.radial[1].0, physical.radial[1].1),
        "rms_arcsec_per_axis": physical.rms_arcsec,
    })
}

/// `calibrate geometry --json`, schema `retina.geometry-calibration/1`.
pub fn to_json(result: &GeometryCalibration, setup: &Setup) -> Value {
    let inverse = &result.inverse;
    let n = inverse.columns();
    // Of a coefficient, the mean of x and y: the file has both and what they share.
    let covariance = |i: usize, j: usize| {
        0.5 * (result.covariance[i * 2 * n + j] + result.covariance[(n + i) * 2 * n + n + j])
    };
    let sigma = |i: usize| covariance(i, i).sqrt();
    let terms = inverse.terms.iter().enumerate();
    let mut coefficients: Vec<Value> = terms
        .map(|(row, ([i, j, k], c))| json!({ "i": i, "j": j, "k": k, "a": c.x, "b": c.y, "sigma": sigma(row) }))
        .collect();
    if let Some(field) = &inverse.rings {
        coefficients.extend(field.coefficients.iter().enumerate().map(|(column, c)| {
            let row = inverse.terms.len() + column;
            let along = ["x", "y"][column % 2];
            json!({ "ring": column / 2, "along": along, "a": c.x, "b": c.y, "sigma": sigma(row) })
        }));
    }
    let ladder: Vec<Value> = result
        .ladder
        .iter()
        .map(|rung| {
            let mut value = form_json(&rung.form);
            value["heldout_rms_arcsec_per_axis"] = json!(rung.heldout_rms_arcsec);
            value["standard_errors_behind_best"] = json!(rung.behind_best);
            value["chosen"] = json!(rung.form == result.form);
            value
        })
        .collect();
    let mut heldout = errors_json(&result.heldout);
    heldout["outliers"] = json!(result.outliers);
    heldout["by"] = json!(if result.heldout_by_points { "points" } else { "exposures" });
    let mut document = json!({ "schema": "retina.geometry-calibration/1" });
    if let (Some(into), Value::Object(errors)) = (document.as_object_mut(), errors_json(&result.errors)) {
        into.extend(errors);
    }
    let rest = json!({
        "warnings": result.warnings,
        "rows": result.rows,
        "outliers": result.outliers,
        "saturated": result.saturated,
        "exposures": result.exposures,
        "jitter_arcsec_per_axis": result.jitter_arcsec,
        "heldout": heldout,
        "form": form_json(&result.form),
        "reference_log10_irradiance": inverse.reference_log10_irradiance,
        "range_log10_irradiance": inverse.range_log10_irradiance,
        "rings": inverse.rings.as_ref().map(|field| {
            let rings = field.rings;
            json!({
                "center": rings.center.to_array(),
                "radius": rings.radius,
                "intervals": rings.intervals,
                "prior_sigma": result.rings_prior_sigma,
            })
        }),
        "coefficients": coefficients,
        "covariance": (0..n).map(|i| (0..n).map(|j| covariance(i, j)).collect()).collect::<Vec<Vec<f64>>>(),
        "direct": { "degree": result.direct.degree, "inverse_error_arcsec": result.direct.worst_arcsec, "inverse_error_rms_arcsec": result.direct.rms_arcsec },
        "physical": result.physical.as_ref().map(|physical| physical_json(physical, setup)),
        "ladder": ladder,
    });
    if let (Some(into), Value::Object(rest)) = (document.as_object_mut(), rest) {
        into.extend(rest);
    }
    document
}

/// A short account for people.
pub fn text_summary(result: &GeometryCalibration, setup: &Setup) -> String {
    let mut text = String::new();
    let _ = writeln!(
        text,
        "{} points in {} exposures; {} outliers, {} saturated left out; exposures jitter by {:.2} arcsec per axis",
        result.errors.points, result.exposures, result.outliers, result.saturated, result.jitter_arcsec
    );
    let _ = writeln!(
        text,
        "\n                    rms     50 %    68 %    90 %    95 %    96 %    99 %   within 10 arcsec"
    );
    let left_out = if result.heldout_by_points { "points left out" } else { "exposures left out" };
    for (name, errors) in [("fitted", &result.errors), (left_out, &result.heldout)] {
        let cells: Vec<String> = errors.percentiles_arcsec.iter().map(|v| format!("{v:7.2}")).collect();
        let _ = writeln!(
            text,
            "{name:<19}{:6.2} {}   {:6.2} %",
            errors.rms_arcsec,
            cells.join(" "),
            100.0 * errors.fraction_within_10_arcsec
        );
    }
    let _ = writeln!(
        text,
        "\n  rings  degree  of L's terms  powers of L  columns  left out, arcsec per axis  behind the best, sigmas"
    );
    // Of each number of rings and degree without and with irradiance the best rung.
    for rings in [0, super::select::RINGS] {
        for (degree, with) in (1..=super::select::HIGHEST_DEGREE).flat_map(|d| [(d, false), (d, true)]) {
            let of = |rung: &&super::Rung| {
                let form = rung.form;
                (form.rings, form.degree, form.irradiance_power > 0) == (rings, degree, with)
            };
            let chosen = result.ladder.iter().filter(of).find(|rung| rung.form == result.form);
            let best = result
                .ladder
                .iter()
                .filter(of)
                .min_by(|a, b| a.heldout_rms_arcsec.total_cmp(&b.heldout_rms_arcsec));
            if let Some(rung) = chosen.or(best) {
                let ModelForm { irradiance_degree, irradiance_power, .. } = rung.form;
                let rings = if rings > 0 { rings.to_string() } else { "-".to_owned() };
                let of_l = if with { irradiance_degree.to_string() } else { "-".to_owned() };
                let mark = if rung.form == result.form { "   <- chosen" } else { "" };
                let _ = writeln!(
                    text,
                    "  {rings:>5}  {degree:>6}  {of_l:>12}  {irradiance_power:>11}  {:>7}  {:>25.3}  {:>23.1}{mark}",
                    rung.form.len(),
                    rung.heldout_rms_arcsec,
                    rung.behind_best
                );
            }
        }
    }
    let _ = writeln!(
        text,
        "\nD at log10 irradiance {:.2}: degree {}, undone by D^-1 to {:.1e} arcsec over the field, {:.1e} rms",
        result.inverse.reference_log10_irradiance,
        result.direct.degree,
        result.direct.worst_arcsec,
        result.direct.rms_arcsec
    );
    for warning in &result.warnings {
        let _ = writeln!(text, "warning: {warning}");
    }
    match &result.physical {
        Some(p) => {
            let k = setup.facility_pinhole();
            let _ = writeln!(
                text,
                "centre of distortion ({:+.2} +- {:.2}, {:+.2} +- {:.2}) px from the screen's (decentring looks the same); roll {:.4} deg; scale {:.6}, x over y {:.6}; k1 {:.4} +- {:.4}; {:.2} arcsec per axis left",
                p.center_on_screen.x * k.fx_px,
                p.center_sigma.x * k.fx_px,
                p.center_on_screen.y * k.fy_px,
                p.center_sigma.y * k.fy_px,
                p.roll_rad.to_degrees(),
                p.scale,
                p.aspect,
                p.radial[0].0,
                p.radial[0].1,
                p.rms_arcsec
            );
        }
        None => text.push_str("where the distortion's centre lies cannot be told: it is too weak, or not radial (four radial terms about a free centre were tried)\n"),
    }
    text
}

/// For each row that was used, its residual and weight: row of the tables (from 0, all files together), line of sight,
/// L, residual (arcsec on the tangent plane of r_u), sigma per axis, angles, outlier.
///
/// # Errors
/// The file cannot be written.
pub fn write_residuals(
    path: &Path,
    result: &GeometryCalibration,
    table: &PointsTable,
) -> Result<(), InputError> {
    let mut text = String::from(
        "row,image,line_of_sight_x,line_of_sight_y,log10_irradiance,residual_x_arcsec,residual_y_arcsec,sigma_arcsec,error_arcsec,heldout_arcsec,outlier\n",
    );
    for point in &result.points {
        let _ = writeln!(
            text,
            "{},{},{:?},{:?},{:?},{:?},{:?},{:?},{:.6},{:.6},{}",
            point.row,
            csv_text(&table.images[table.rows[point.row].image]),
            point.sight.x,
            point.sight.y,
            point.log10_irradiance,
            point.residual.x * ARCSEC_PER_RAD,
            point.residual.y * ARCSEC_PER_RAD,
            point.sigma * ARCSEC_PER_RAD,
            point.error_arcsec,
            point.heldout_arcsec,
            u8::from(point.outlier)
        );
    }
    store(path, &text)
}
