//! `points.csv` as data: camera lines of sight against displayed ones, in the facility's frame, arcsec.

use std::collections::HashMap;
use std::sync::OnceLock;

use glam::{DMat2, DVec2};
use retina_calibration::geometry::{Channel, log10_irradiance};
use retina_files::{InputError, Table};
use retina_radiometry::ScreenResponse;

use super::read::{Baseline, Place, Source, channel_of, covariates, number_in};
use crate::field::{Held, HeldModel};

use super::places::{Known, true_places_px};
use super::{Covariate, Dataset, Group, RowFrame, TableKind, Term};

pub(crate) const ARCSEC_PER_RAD: f64 = 206_264.806_247_096_36;

const REQUIRED: [&str; 6] =
    ["image", "screen_x_px", "screen_y_px", "digital_count", "camera_x_px", "camera_y_px"];
/// Columns that are the measurement or say how good it is, and no cause of it.
const NOT_COVARIATES: [&str; 8] =
    ["image", "camera_x_px", "camera_y_px", "sigma_px", "saturated", "screen_x_px", "screen_y_px", "flux_dn"];

/// A measured pixel; far off the sensor it is a slip of the table, not an outlier.
fn camera_px(table: &Table, row: usize, column: &str, source: &Source<'_>) -> Result<f64, InputError> {
    let camera = &source.setup.camera;
    let most = 4.0 * f64::from(camera.width_px.max(camera.height_px));
    let value = table.number(row, column)?;
    if value.abs() <= most {
        return Ok(value);
    }
    Err(InputError::new(table.file(), "the point is nowhere near the sensor")
        .cell(table.line(row), column)
        .found(value)
        .expected(format!("pixels of a camera of {} x {}", camera.width_px, camera.height_px)))
}

pub(super) fn read(source: &Source<'_>, tables: &[Table]) -> Result<Dataset, InputError> {
    let mut notes = Vec::new();
    let mut groups: Vec<(String, Vec<Place>)> = Vec::new();
    let mut index: HashMap<(usize, String), usize> = HashMap::new();
    let (mut saturated, mut table_rows, mut first_row) = (0, 0, Vec::new());
    for (t, table) in tables.iter().enumerate() {
        table.require(&REQUIRED)?;
        first_row.push(table_rows);
        table_rows += table.len();
        for row in 0..table.len() {
            let image = table.text(row, "image");
            if image.is_empty() {
                return Err(InputError::new(table.file(), "the cell is empty")
                    .cell(table.line(row), "image")
                    .expected("the exposure's name"));
            }
            if table.number_or_empty(row, "saturated")?.is_some_and(|value| value != 0.0) {
                saturated += 1;
                continue;
            }
            let next = groups.len();
            let group = *index.entry((t, image.to_owned())).or_insert(next);
            if group == next {
                groups.push((image.to_owned(), Vec::new()));
            }
            groups[group].1.push(Place { table: t, row });
        }
    }
    let places: Vec<Place> = groups.iter().flat_map(|(_, rows)| rows.iter().copied()).collect();
    let order: Vec<usize> = places.iter().map(|p| first_row[p.table] + p.row).collect();

    let (facility, camera) = (source.setup.facility_pinhole(), source.setup.camera_pinhole());
    let response =
        ScreenResponse::power_law(source.setup.response_gamma(), source.setup.brightest_magnitude());
    let mut undistorted = Vec::with_capacity(places.len());
    let mut sights = Vec::with_capacity(places.len());
    let mut measured = Vec::with_capacity(places.len());
    let (mut l, mut channel, mut mounting) = (Vec::new(), Vec::new(), Vec::new());
    let mut mountings: Vec<(usize, Option<f64>)> = Vec::new();
    let (mut screen, mut counts) = (Vec::new(), Vec::new());
    for place in &places {
        let (table, row) = (&tables[place.table], place.row);
        let count = number_in(table, row, "digital_count", 1e-9..=255.0, "a count above 0, at most 255")?;
        let at = DVec2::new(table.number(row, "screen_x_px")?, table.number(row, "screen_y_px")?);
        let seen = DVec2::new(
            camera_px(table, row, "camera_x_px", source)?,
            camera_px(table, row, "camera_y_px", source)?,
        );
        let name = channel_of(table, row)?;
        let light = [Channel::R, Channel::G, Channel::B, Channel::W][usize::from(name)];
        channel.push(name);
        // Below one count the interpolation starts from no light, whose logarithm is none.
        l.push(log10_irradiance(&response, light, count).max(-6.0));
        counts.push(count);
        undistorted.push(facility.line_of_sight(at));
        sights.push(camera.line_of_sight(seen));
        measured.push(seen);
        screen.push(at);
        let key = (place.table, table.number_or_empty(row, "camera_roll_deg")?);
        let known = mountings.iter().position(|m| *m == key);
        mounting.push(known.unwrap_or(mountings.len()));
        if known.is_none() {
            mountings.push(key);
        }
    }
    if undistorted.is_empty() {
        return Err(InputError::new(tables[0].file(), "holds no usable points")
            .found(format!("{saturated} saturated rows")));
    }
    let predicted: Vec<DVec2> = match source.calibration {
        None => undistorted.clone(),
        Some(calibration) => fixed(calibration, &undistorted, &l).map_err(|problem| {
            InputError::new(&calibration.file, problem).help("is it this facility's calibration?")
        })?,
    };
    let held = source.calibration.map(|calibration| HeldModel::new(calibration, predicted.clone(), &l));
    if held.as_ref().is_some_and(|held| !held.has_covariance()) {
        notes.push(
            "the calibration states no covariance: its error is told from these data alone, as a smooth field"
                .to_owned(),
        );
    }
    let roll_rad = rolls(&predicted, &sights, &mounting, mountings.len());
    let half_tan = 0.5 * f64::from(camera.width_px) / camera.fx_px;
    let mut y = Vec::with_capacity(2 * places.len());
    let mut frame = Vec::with_capacity(places.len());
    for i in 0..places.len() {
        let facility_from_camera = DMat2::from_angle(roll_rad[mounting[i]]);
        let off = (facility_from_camera * sights[i] - predicted[i]) * ARCSEC_PER_RAD;
        y.extend([off.x, off.y]);
        let back = facility_from_camera.transpose();
        let px = |row: usize, column: usize| {
            let focal = if row == 0 { camera.fx_px } else { camera.fy_px };
            back.col(column)[row] * focal / ARCSEC_PER_RAD
        };
        frame.push(RowFrame {
            measured: measured[i].to_array(),
            to_table: [[px(0, 0), px(0, 1)], [px(1, 0), px(1, 1)]],
        });
    }

    let mut all = covariates(tables, &places, &NOT_COVARIATES, &["channel", "series"], &mut notes)?;
    let position: Vec<DVec2> = undistorted.iter().map(|u| *u / half_tan).collect();
    let known: Vec<Known> = groups
        .iter()
        .enumerate()
        .flat_map(|(group, (_, rows))| std::iter::repeat_n(group, rows.len()))
        .enumerate()
        .map(|(i, group)| {
            let camera_from_facility = DMat2::from_angle(-roll_rad[mounting[i]]);
            Known {
                predicted_px: camera.pixel(camera_from_facility * predicted[i]),
                x: position[i].x,
                y: position[i].y,
                l: l[i],
                channel: channel[i],
                mounting: mounting[i],
                group,
            }
        })
        .collect();
    let spots_px = true_places_px(&known, &measured);
    let mut add = |name: &str, values: Vec<f64>| all.push(Covariate { name: name.to_owned(), values });
    add("x", position.iter().map(|p| p.x).collect());
    add("y", position.iter().map(|p| p.y).collect());
    add("r", position.iter().map(|p| p.length()).collect());
    add("log10_irradiance", l.clone());
    add("camera_phase_x", spots_px.iter().map(|c| c.x.rem_euclid(1.0)).collect());
    add("camera_phase_y", spots_px.iter().map(|c| c.y.rem_euclid(1.0)).collect());
    // The bench has a continuous range of phases or a single one.
    add("screen_phase_x", screen.iter().map(|c| c.x.rem_euclid(1.0)).collect());
    add("screen_phase_y", screen.iter().map(|c| c.y.rem_euclid(1.0)).collect());
    if channel.iter().any(|c| *c != channel[0]) {
        for (k, name) in ["channel_r", "channel_g", "channel_b"].into_iter().enumerate() {
            add(name, channel.iter().map(|c| f64::from(u8::from(usize::from(*c) == k))).collect());
        }
    }
    let noise_key = noise_key(tables, &places, &l)?;
    let mut start = 0;
    let groups = groups
        .into_iter()
        .map(|(name, rows)| {
            start += rows.len();
            Group { name, rows: start - rows.len()..start }
        })
        .collect();
    let baseline = if source.calibration.is_some() { Baseline::Similarity } else { source.baseline };
    Ok(Dataset {
        kind: TableKind::Points,
        y,
        groups,
        order,
        table_rows,
        in_part: false,
        saturated,
        covariates: all,
        noise_key,
        jitters: true,
        channel,
        mounting,
        roll_rad,
        half_tan,
        screen_pixel_arcsec: ARCSEC_PER_RAD / facility.fx_px,
        frame,
        baseline,
        held: held.map(Held::Geometry),
        field: OnceLock::new(),
        pixels: None,
        files: source.files.to_vec(),
        notes,
    })
}

/// The calibration's line of sight for each displayed point: its inverse undone at the point's own irradiance, else D.
fn fixed(
    calibration: &retina_geometry::Calibration,
    undistorted: &[DVec2],
    l: &[f64],
) -> Result<Vec<DVec2>, String> {
    let Some(inverse) = &calibration.inverse else {
        return Ok(undistorted.iter().map(|u| calibration.distortion.distort(*u)).collect());
    };
    undistorted
        .iter()
        .zip(l)
        .map(|(u, l)| {
            let held = inverse.held(*l);
            let mut guess = calibration.distortion.distort(*u);
            for _ in 0..50 {
                let off = inverse.undistort(guess, held) - *u;
                if off.length() < 1e-14 {
                    return Ok(guess);
                }
                guess -= inverse.jacobian(guess, held).inverse() * off;
            }
            let off = inverse.undistort(guess, held) - *u;
            if off.length() < 1e-11 {
                return Ok(guess);
            }
            Err(format!("D^-1 cannot be undone at the line of sight ({:.4}, {:.4})", u.x, u.y))
        })
        .collect()
}

/// How far each mounting of the camera is turned against the facility, from the points themselves: distortion and
/// effects are radial in the facility's axes, so that a turn by half a degree would show as a swirl of k1.
fn rolls(predicted: &[DVec2], sights: &[DVec2], mounting: &[usize], count: usize) -> Vec<f64> {
    let angle = |m: usize| {
        let rows: Vec<usize> = (0..mounting.len()).filter(|&i| mounting[i] == m).collect();
        let mean = |of: &[DVec2]| rows.iter().map(|&i| of[i]).sum::<DVec2>() / rows.len() as f64;
        let (a, b) = (mean(predicted), mean(sights));
        let (mut cross, mut along) = (0.0, 0.0);
        for &i in &rows {
            let (u, s) = (predicted[i] - a, sights[i] - b);
            cross += s.perp_dot(u);
            along += s.dot(u);
        }
        cross.atan2(along)
    };
    (0..count).map(angle).collect()
}

/// ln of what the noise is told from: sigma_px, else 1 / flux, else 1 / (irradiance x exposure).
fn noise_key(tables: &[Table], places: &[Place], l: &[f64]) -> Result<Vec<f64>, InputError> {
    let column = |name: &str| -> Result<Option<Vec<f64>>, InputError> {
        let mut out = Vec::with_capacity(places.len());
        for place in places {
            match tables[place.table].number_or_empty(place.row, name)? {
                Some(value) if value > 0.0 => out.push(value),
                Some(value) if name != "flux_dn" => {
                    return Err(InputError::new(
                        tables[place.table].file(),
                        "the value is outside its range",
                    )
                    .cell(tables[place.table].line(place.row), name)
                    .found(value)
                    .expected("a number above 0"));
                }
                _ => return Ok(None),
            }
        }
        Ok(Some(out))
    };
    if let Some(sigma) = column("sigma_px")? {
        return Ok(sigma.iter().map(|s| s.ln()).collect());
    }
    if let Some(flux) = column("flux_dn")? {
        return Ok(flux.iter().map(|f| -f.ln()).collect());
    }
    let exposure = column("exposure_s")?;
    let ln_exposure = |i: usize| exposure.as_ref().map_or(0.0, |e| e[i].ln());
    Ok(l.iter().enumerate().map(|(i, l)| -l * std::f64::consts::LN_10 - ln_exposure(i)).collect())
}

/// Shift and linear terms of each mounting, radial terms of all (`Physical`); a polynomial; or a similarity.
pub(super) fn baseline(data: &Dataset) -> Vec<Term<'_>> {
    let (x, y) = (data.values("x"), data.values("y"));
    let mut out = Vec::new();
    for m in 0..data.roll_rad.len() {
        let here = move |row: usize| f64::from(u8::from(data.mounting[row] == m));
        let suffix = if m == 0 { String::new() } else { format!("_{m}") };
        out.push(Term::new(format!("shift_x_arcsec{suffix}"), move |i| [here(i), 0.0]));
        out.push(Term::new(format!("shift_y_arcsec{suffix}"), move |i| [0.0, here(i)]));
        if data.baseline == Baseline::Similarity {
            out.push(Term::new(format!("scale_arcsec{suffix}"), move |i| [here(i) * x[i], here(i) * y[i]]));
            out.push(Term::new(format!("rotation_arcsec{suffix}"), move |i| {
                [-here(i) * y[i], here(i) * x[i]]
            }));
        } else {
            out.push(Term::new(format!("xx_arcsec{suffix}"), move |i| [here(i) * x[i], 0.0]));
            out.push(Term::new(format!("xy_arcsec{suffix}"), move |i| [here(i) * y[i], 0.0]));
            out.push(Term::new(format!("yx_arcsec{suffix}"), move |i| [0.0, here(i) * x[i]]));
            out.push(Term::new(format!("yy_arcsec{suffix}"), move |i| [0.0, here(i) * y[i]]));
        }
    }
    match data.baseline {
        Baseline::Physical => out.push(Term::new("k1_arcsec", move |i| {
            let r2 = x[i] * x[i] + y[i] * y[i];
            [x[i] * r2, y[i] * r2]
        })),
        Baseline::Polynomial(degree) => {
            for total in 2..=degree as i32 {
                for i in 0..=total {
                    let value = move |row: usize| x[row].powi(i) * y[row].powi(total - i);
                    out.push(Term::new(format!("x{i}y{}_x_arcsec", total - i), move |row| [value(row), 0.0]));
                    out.push(Term::new(format!("x{i}y{}_y_arcsec", total - i), move |row| [0.0, value(row)]));
                }
            }
        }
        Baseline::Similarity => {}
    }
    out
}
