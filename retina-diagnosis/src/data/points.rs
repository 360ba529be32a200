//! `points.csv` as data: camera lines of sight against displayed ones, in the facility's frame, arcsec.

use std::sync::{Arc, OnceLock};

use glam::{DMat2, DVec2};
use retina_files::InputError;
use retina_formats::{
    Calibration, Channel, PointRow, PointsTable, TableKind, log10_irradiance, measured_or_power_law,
};
use retina_geometry::{ARCSEC_PER_RAD, LensModel, Pinhole};

use super::read::{Baseline, Named, Source, add_made, covariates, first_file, leave_out_lacking, stated};
use crate::field::{Held, HeldModel};

use super::copies::{exposures, leave_out_copies, refuse_constant, refuse_repeated};
use super::lens::{self, FittedLens, LensProblem, Shown};
use super::lens_choice;
use super::places::{Known, true_places_px};
use super::scale::check_scale;
use super::{Covariate, Dataset, DisplayDepth, Flip, Group, RowFrame, Term};

/// When the camera was mounted for a row.
#[derive(Clone, Copy, PartialEq)]
enum Mounted {
    /// For the table with this number.
    ForTable(usize),
    /// At the time with this number, which tables share.
    Numbered(f64),
}

impl Mounted {
    fn of(row: &PointRow) -> Self {
        match row.mounting {
            Some(0.0) => Self::ForTable(0),
            Some(number) => Self::Numbered(number),
            None => Self::ForTable(row.file),
        }
    }
}

/// The rows in the data's order: where each was shown and seen, and how bright.
#[derive(Default)]
struct Seen {
    /// Displayed line of sight K_f^-1 R^s.
    undistorted: Vec<DVec2>,
    /// Measured line of sight C^-1 R^c.
    sight: Vec<DVec2>,
    camera_px: Vec<DVec2>,
    screen_px: Vec<DVec2>,
    /// log10 of the irradiance relative to white at full count.
    l: Vec<f64>,
    channel: Vec<Channel>,
    /// Which mounting (time and roll of the camera) each row belongs to, and how many there are.
    mounting: Vec<usize>,
    mountings: usize,
}

impl Seen {
    fn of(source: &Source<'_>, rows: &[&PointRow]) -> Self {
        let (facility, camera) = (source.setup.facility_pinhole(), source.setup.camera_pinhole());
        // The irradiance that the calibration's D^-1 means is that of its own response.
        let response = match source.calibration {
            Some(calibration) => calibration.screen_response(source.setup),
            None => measured_or_power_law(None, source.setup),
        };
        let mut out = Self::default();
        let mut mountings: Vec<(Mounted, Option<f64>)> = Vec::new();
        for row in rows {
            out.channel.push(row.channel);
            // Below one count the interpolation starts from no light, whose logarithm is none.
            out.l.push(log10_irradiance(&response, row.channel, row.digital_count).max(-6.0));
            out.undistorted.push(facility.line_of_sight(row.screen_px));
            out.sight.push(camera.line_of_sight(row.camera_px));
            out.camera_px.push(row.camera_px);
            out.screen_px.push(row.screen_px);
            let key = (Mounted::of(row), row.camera_roll_deg);
            let known = mountings.iter().position(|m| *m == key);
            out.mounting.push(known.unwrap_or(mountings.len()));
            if known.is_none() {
                mountings.push(key);
            }
        }
        out.mountings = mountings.len();
        out
    }
}

/// The rows by a model, before the baseline's columns are fitted.
struct Explained {
    /// Errors in the facility's frame, arcsec.
    y: Vec<f64>,
    /// How each goes back to camera pixels.
    frame: Vec<RowFrame>,
    roll_rad: Vec<f64>,
    /// The model's places, camera px.
    predicted_px: Vec<DVec2>,
    lens: Option<Arc<FittedLens>>,
}

/// Errors on the tangent plane.
fn on_tangent_plane(seen: &Seen, predicted: &[DVec2], camera: &Pinhole) -> Explained {
    let roll_rad = rolls(predicted, &seen.sight, &seen.mounting, seen.mountings);
    let (mut y, mut frame) = (Vec::with_capacity(2 * predicted.len()), Vec::with_capacity(predicted.len()));
    let mut predicted_px = Vec::with_capacity(predicted.len());
    for (i, predicted) in predicted.iter().enumerate() {
        let facility_from_camera = DMat2::from_angle(roll_rad[seen.mounting[i]]);
        let off = (facility_from_camera * seen.sight[i] - *predicted) * ARCSEC_PER_RAD;
        y.extend([off.x, off.y]);
        let back = facility_from_camera.transpose();
        predicted_px.push(camera.pixel(back * *predicted));
        let px = |row: usize, column: usize| {
            let focal = if row == 0 { camera.fx_px } else { camera.fy_px };
            back.col(column)[row] * focal / ARCSEC_PER_RAD
        };
        frame.push(RowFrame {
            measured: seen.camera_px[i].to_array(),
            to_table: [[px(0, 0), px(0, 1)], [px(1, 0), px(1, 1)]],
        });
    }
    Explained { y, frame, roll_rad, predicted_px, lens: None }
}

/// Errors of a lens model that is fitted to the rows: pixels by the angle that a pixel is at its place.
fn by_lens(
    model: LensModel,
    seen: &Seen,
    camera: &Pinhole,
    table: &PointsTable,
    rows: &[&PointRow],
    notes: &mut Vec<String>,
) -> Result<Explained, InputError> {
    let points: Vec<Shown> = (0..rows.len())
        .map(|i| Shown {
            displayed: seen.undistorted[i],
            camera_px: seen.camera_px[i],
            mounting: seen.mounting[i],
        })
        .collect();
    let refused = |problem: LensProblem| refused_by_lens(model, table, rows, problem);
    let fitted = lens::fitted(model, camera, &points).map_err(refused)?;
    notes.push(format!("the baseline starts from {}", fitted.text()));
    notes.extend(lens_choice::better(model, camera, &points));
    let mut out = Explained {
        y: Vec::with_capacity(2 * rows.len()),
        frame: Vec::with_capacity(rows.len()),
        roll_rad: fitted.mountings.iter().map(|[_, _, turn]| -turn).collect(),
        predicted_px: Vec::with_capacity(rows.len()),
        lens: None,
    };
    for (row, point) in points.iter().enumerate() {
        let (off, px_per_arcsec, place_px) = lens::residual(&fitted, point, row).map_err(refused)?;
        out.y.extend(off.to_array());
        let [a, b] = [0, 1].map(|axis| px_per_arcsec.row(axis).to_array());
        out.frame.push(RowFrame { measured: point.camera_px.to_array(), to_table: [a, b] });
        out.predicted_px.push(place_px);
    }
    out.lens = Some(Arc::new(fitted));
    Ok(out)
}

/// What a user reads of rows that a lens model cannot take.
fn refused_by_lens(
    model: LensModel,
    table: &PointsTable,
    rows: &[&PointRow],
    problem: LensProblem,
) -> InputError {
    let name = model.name();
    let at = |row: usize, problem: String| table.refused(rows[row], &problem, "screen_x_px");
    let others =
        "choose a baseline of wider fields (fisheye:...), leave out the rows, or look at the setup's K_f";
    match problem {
        LensProblem::NoImage(row, why) => at(row, format!("the baseline `{name}` has no image of the displayed point"))
            .found(why)
            .expected("a direction within the model's domain")
            .help(others),
        LensProblem::TurnsBack(row, angle, turn) => {
            at(row, format!("the fitted baseline `{name}` turns back before it reaches the displayed point"))
                .found(format!(
                    "a point at {:.2} deg from the optical axis; from {:.2} deg on the image radius falls",
                    angle.to_degrees(),
                    turn.to_degrees()
                ))
                .expected("a radius that grows with the angle over all points")
                .help("choose a baseline with fewer coefficients, add points at the edge of the field, or leave out such rows")
        }
        LensProblem::Singular(row) => {
            at(row, format!("the fitted baseline `{name}` does not tell directions apart at the displayed point"))
                .found("an image that does not change with the direction")
                .expected("a place in the image for each direction")
                .help(others)
        }
        LensProblem::TooFew(least) => {
            InputError::new(first_file(&table.files), format!("has too few points for the baseline `{name}`"))
                .found(format!("{} usable rows", rows.len()))
                .expected(format!("at least {least}"))
                .help("choose a baseline with fewer coefficients")
        }
    }
}

/// Exposures whose extent is below this share of the whole table's cover a part of the field.
const PART_OF_FIELD: f64 = 0.6;

/// Whether an exposure's shift can be told from the lens. Boards fill a part of the field each: a lens that does not fit
/// then shows as shifts of the exposures, and with these free there is nothing left to hold it.
fn exposures_cover_the_field(known: &[Known]) -> bool {
    let extent = |rows: &[&Known]| {
        let at = |k: &&Known| DVec2::new(k.x, k.y);
        let mean = rows.iter().map(at).sum::<DVec2>() / rows.len() as f64;
        (rows.iter().map(|k| at(k).distance_squared(mean)).sum::<f64>() / rows.len() as f64).sqrt()
    };
    let all: Vec<&Known> = known.iter().collect();
    let own: Vec<f64> = all.chunk_by(|a, b| a.group == b.group).map(extent).collect();
    crate::series::median(&own) >= PART_OF_FIELD * extent(&all)
}

/// Covariates that are made of places, light and channel. `known` are the rows as the model knows them.
fn made_covariates(seen: &Seen, known: &[Known]) -> Vec<Covariate> {
    let spots_px = true_places_px(known, &seen.camera_px);
    let phase = |px: &[DVec2], axis: usize| px.iter().map(|c| c[axis].rem_euclid(1.0)).collect();
    let mut out = Vec::new();
    let mut add = |name: &str, values: Vec<f64>| out.push(Covariate { name: name.to_owned(), values });
    add("x", known.iter().map(|k| k.x).collect());
    add("y", known.iter().map(|k| k.y).collect());
    add("r", known.iter().map(|k| k.x.hypot(k.y)).collect());
    add("log10_irradiance", seen.l.clone());
    add("camera_phase_x", phase(&spots_px, 0));
    add("camera_phase_y", phase(&spots_px, 1));
    // The bench has a continuous range of phases or a single one.
    add("screen_phase_x", phase(&seen.screen_px, 0));
    add("screen_phase_y", phase(&seen.screen_px, 1));
    if seen.channel.iter().any(|c| *c != seen.channel[0]) {
        for (colour, name) in Channel::COLOURS.into_iter().zip(["channel_r", "channel_g", "channel_b"]) {
            add(name, seen.channel.iter().map(|c| f64::from(u8::from(*c == colour))).collect());
        }
    }
    out
}

pub(super) fn read(source: &Source<'_>, table: &PointsTable) -> Result<Dataset, InputError> {
    refuse_repeated(table)?;
    refuse_constant(table)?;
    let mut notes = Vec::new();
    let (mut groups, saturated) = exposures(table);
    notes.extend(leave_out_copies(table, &mut groups));
    let row = |at: usize| &table.rows[at];
    let named: [Named<'_>; 6] = [
        ("digital_count", &|at| Some(row(at).digital_count)),
        ("time_s", &|at| row(at).time_s),
        ("temperature_c", &|at| row(at).temperature_c),
        ("row_load", &|at| row(at).row_load),
        ("exposure_s", &|at| row(at).exposure_s),
        ("camera_roll_deg", &|at| row(at).camera_roll_deg),
    ];
    leave_out_lacking(groups.iter_mut().map(|(_, rows)| rows), &named, &table.extra, &mut notes);
    groups.retain(|(_, rows)| !rows.is_empty());
    let order: Vec<usize> = groups.iter().flat_map(|(_, rows)| rows.iter().copied()).collect();
    if order.is_empty() {
        return Err(InputError::new(first_file(&table.files), "holds no usable points")
            .found(if saturated > 0 { format!("{saturated} saturated rows") } else { "no row".to_owned() }));
    }
    let rows: Vec<&PointRow> = order.iter().map(|&at| &table.rows[at]).collect();
    let (facility, camera) = (source.setup.facility_pinhole(), source.setup.camera_pinhole());
    let seen = Seen::of(source, &rows);
    if !matches!(source.baseline, Baseline::Lens(_)) || source.calibration.is_some() {
        notes.extend(check_scale(
            table,
            &rows,
            &seen.undistorted,
            &seen.sight,
            &seen.mounting,
            source.setup,
        )?);
    }
    let predicted: Vec<DVec2> = match source.calibration {
        None => seen.undistorted.clone(),
        Some(calibration) => fixed(calibration, &seen.undistorted, &seen.l).map_err(|problem| {
            InputError::new(&calibration.file, problem).help("is it this facility's calibration?")
        })?,
    };
    let held = source.calibration.map(|calibration| HeldModel::new(calibration, predicted.clone(), &seen.l));
    if held.as_ref().is_some_and(|held| !held.has_covariance()) {
        notes.push(
            "the calibration states no covariance: these data alone tell its error, as a smooth field"
                .to_owned(),
        );
    }
    let half_tan = 0.5 * f64::from(camera.width_px) / camera.fx_px;
    let explained = match (source.calibration, source.baseline) {
        (None, Baseline::Lens(model)) => by_lens(model, &seen, &camera, table, &rows, &mut notes)?,
        _ => on_tangent_plane(&seen, &predicted, &camera),
    };
    let Explained { y, frame, roll_rad, predicted_px, lens } = explained;
    let mut all = covariates(&table.files, &order, &named, &table.extra, &mut notes)?;
    let of_group =
        groups.iter().enumerate().flat_map(|(group, (_, rows))| std::iter::repeat_n(group, rows.len()));
    let known: Vec<Known> = of_group
        .enumerate()
        .map(|(i, group)| {
            let position = seen.undistorted[i] / half_tan;
            Known {
                predicted_px: predicted_px[i],
                x: position.x,
                y: position.y,
                l: seen.l[i],
                channel: seen.channel[i],
                mounting: seen.mounting[i],
                group,
            }
        })
        .collect();
    let covered = lens.is_none() || exposures_cover_the_field(&known);
    // Of one point, what it has alone and what its exposure has are the same.
    let jitters = covered && groups.len() < rows.len();
    if !covered {
        notes.push(
            "each exposure covers a small part of the field: a common error of its own is not told from the lens and is not fitted"
                .to_owned(),
        );
    }
    add_made(first_file(&table.files), &mut all, made_covariates(&seen, &known))?;
    let stated: Option<Vec<f64>> = stated("sigma_px", rows.iter().map(|row| row.sigma_px), &mut notes)
        .map(|sigma| sigma.iter().map(|sigma| sigma * ARCSEC_PER_RAD / camera.fx_px).collect());
    let noise_key = match &stated {
        Some(sigma) => sigma.iter().map(|sigma| sigma.ln()).collect(),
        None => noise_key(&rows, &seen.l),
    };
    Ok(Dataset {
        kind: TableKind::Points,
        y,
        groups: Group::in_order(groups.into_iter().map(|(name, rows)| (name, rows.len()))),
        order,
        table_rows: table.rows.len(),
        in_part: false,
        saturated,
        covariates: all,
        noise_key,
        isotropic_from_error: None,
        jitters,
        flip: Flip::Groups,
        wander: 0.0,
        stated,
        channel: seen.channel,
        white_share: [1.0 / 3.0; 3],
        mounting: seen.mounting,
        roll_rad,
        half_tan,
        half_height: f64::from(camera.height_px) / f64::from(camera.width_px),
        display: None,
        default_lenses: false,
        display_depth: DisplayDepth::default(),
        form_error: Arc::default(),
        tracer: None,
        found_coma: None,
        found_gamma: None,
        screen_pixel_arcsec: ARCSEC_PER_RAD / facility.fx_px,
        frame,
        baseline: if source.calibration.is_some() { Baseline::Similarity } else { source.baseline },
        held: held.map(Held::Geometry),
        field: OnceLock::new(),
        pixels: None,
        lens,
        files: table.files.iter().map(|file| file.path.clone()).collect(),
        notes,
    })
}

/// The calibration's line of sight for each displayed point: its inverse undone at the point's own irradiance, else D.
fn fixed(calibration: &Calibration, undistorted: &[DVec2], l: &[f64]) -> Result<Vec<DVec2>, String> {
    let Some(inverse) = &calibration.inverse else {
        return Ok(undistorted.iter().map(|u| calibration.distortion.distort(*u)).collect());
    };
    undistorted
        .iter()
        .zip(l)
        .map(|(u, l)| {
            let cannot = |_| format!("D^-1 cannot be undone at the line of sight ({:.4}, {:.4})", u.x, u.y);
            inverse.distort(*u, inverse.held(*l)).map_err(cannot)
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

/// ln of what the noise is told from where no row states it: 1 / flux, else 1 / (irradiance x exposure).
fn noise_key(rows: &[&PointRow], l: &[f64]) -> Vec<f64> {
    let flux: Option<Vec<f64>> = rows.iter().map(|row| row.flux_dn.filter(|flux| *flux > 0.0)).collect();
    if let Some(flux) = flux {
        return flux.iter().map(|f| -f.ln()).collect();
    }
    let exposure: Option<Vec<f64>> = rows.iter().map(|row| row.exposure_s).collect();
    let ln_exposure = |i: usize| exposure.as_ref().map_or(0.0, |e| e[i].ln());
    l.iter().enumerate().map(|(i, l)| -l * std::f64::consts::LN_10 - ln_exposure(i)).collect()
}

/// Shift and linear terms of each mounting, radial terms of all (`Physical`); a polynomial; a similarity; or a lens's
/// parameters.
pub(super) fn baseline(data: &Dataset) -> Vec<Term<'_>> {
    if let Some(lens) = &data.lens {
        return lens::baseline(data, lens);
    }
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
        Baseline::Similarity | Baseline::Lens(_) => {}
    }
    out
}
