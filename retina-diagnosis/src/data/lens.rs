//! A lens model fitted to a table of points, as a baseline: residuals in arcsec of the field, and a column for each
//! parameter.
//!
//! A displayed line of sight (x, y, 1) / |..| is turned into the camera's frame by
//! camera_from_facility = R_z(c) R_x(a) R_y(b) and projected by the [`Lens`]. Parameters are found by
//! Levenberg-Marquardt on camera pixels, robustly; the columns at the optimum then stand beside the effects, so that all
//! are estimated together.

use glam::{DMat2, DMat3, DVec2, DVec3};
use rayon::prelude::*;
use retina_geometry::{ARCSEC_PER_RAD, Lens, LensImage, LensModel, MOST_COEFFICIENTS, OutOfDomain, Pinhole};

use super::{Dataset, Term};
use crate::linear::solve_positive;

/// Parameters that all mountings share: focal lengths, principal point, coefficients.
const SHARED: usize = 4 + MOST_COEFFICIENTS;
/// Angles of a mounting.
const ANGLES: usize = 3;
/// The parameters come from so many rows at most, evenly taken; the columns beside the effects use all rows.
const MOST_ROWS: usize = 10_000;
const FEWEST_OF_MOUNTING: usize = 500;
/// Rounds of weights, the first of which are Huber's, and steps within each.
const ROUNDS: usize = 24;
const HUBER_ROUNDS: usize = 16;
const STEPS: usize = 12;
/// Huber's and Tukey's constants, in standard deviations of one axis.
const HUBER: f64 = 1.5;
const TUKEY: f64 = 5.1;
/// Median length of a normal error in the plane, in standard deviations of one axis.
const MEDIAN_LENGTH: f64 = 1.177_41;
/// Errors below this are rounding, px.
const LEAST_SIGMA_PX: f64 = 1e-7;
/// Coefficients of a rational model that is nearly equidistant: the Pade form [4/4] of arctan(r) / r.
const PADE_ARCTAN: [f64; MOST_COEFFICIENTS] =
    [735.0 / 945.0, 64.0 / 945.0, 0.0, 0.0, 0.0, 1050.0 / 945.0, 225.0 / 945.0, 0.0];

/// A point: where it was shown and seen.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shown {
    /// Displayed line of sight on the tangent plane.
    pub(super) displayed: DVec2,
    /// Measured place, px.
    pub(super) camera_px: DVec2,
    /// Which mounting.
    pub(super) mounting: usize,
}

/// A lens with the mountings of its camera.
#[derive(Debug, Clone, PartialEq)]
pub struct FittedLens {
    /// The lens.
    pub lens: Lens,
    /// For each mounting the angles a, b, c of camera_from_facility = R_z(c) R_x(a) R_y(b), rad.
    pub mountings: Vec<[f64; ANGLES]>,
}

/// Why a lens cannot be fitted.
#[derive(Debug)]
pub(super) enum LensProblem {
    /// A row (index into the points) has no image.
    NoImage(usize, OutOfDomain),
    /// Beyond an angle the fitted law turns back: the row furthest from the axis, its angle and that of the turn, rad.
    TurnsBack(usize, f64, f64),
    /// The image does not change with the direction at a row.
    Singular(usize),
    /// Too few points for the parameters.
    TooFew(usize),
}

/// R_z(c) R_x(a) R_y(b) and its derivatives by a, b, c.
fn rotation([a, b, c]: [f64; ANGLES]) -> (DMat3, [DMat3; ANGLES]) {
    let (x, y, z) = (DMat3::from_rotation_x(a), DMat3::from_rotation_y(b), DMat3::from_rotation_z(c));
    // The derivative of a turn about an axis is the turn times the axis's cross product.
    let cross =
        |axis: DVec3| DMat3::from_cols(axis.cross(DVec3::X), axis.cross(DVec3::Y), axis.cross(DVec3::Z));
    let by = [z * x * cross(DVec3::X) * y, z * x * y * cross(DVec3::Y), cross(DVec3::Z) * z * x * y];
    (z * x * y, by)
}

/// Two directions across a unit direction d: the facility's x and y, carried there along the great circle from the
/// boresight.
fn across(d: DVec3) -> [DVec3; 2] {
    let k = 1.0 / (1.0 + d.z);
    [
        DVec3::new(1.0 - d.x * d.x * k, -d.x * d.y * k, -d.x),
        DVec3::new(-d.x * d.y * k, 1.0 - d.y * d.y * k, -d.y),
    ]
}

/// A point's place by the model, with derivatives.
struct Place {
    px: DVec2,
    /// px per rad of the direction, along the two directions across it.
    by_direction: DMat2,
    /// px per unit of each parameter, those of the point's own mounting last.
    by_parameter: [DVec2; SHARED + ANGLES],
}

impl FittedLens {
    fn place(&self, displayed: DVec2, angles: [f64; ANGLES]) -> Result<Place, OutOfDomain> {
        let (camera_from_facility, by_angle) = rotation(angles);
        let direction = displayed.extend(1.0).normalize();
        let image = self.lens.image(camera_from_facility * direction)?;
        let LensImage { normalised, gradient, by_coefficient } = image;
        let focal = self.lens.focal_px;
        let along = |step: DVec3| focal * DVec2::new(gradient[0].dot(step), gradient[1].dot(step));
        let [first, second] = across(direction);
        let mut by_parameter = [DVec2::ZERO; SHARED + ANGLES];
        by_parameter[0] = DVec2::new(normalised.x, 0.0);
        by_parameter[1] = DVec2::new(0.0, normalised.y);
        by_parameter[2] = DVec2::X;
        by_parameter[3] = DVec2::Y;
        for (out, by) in by_parameter[4..SHARED].iter_mut().zip(by_coefficient) {
            *out = focal * by;
        }
        for (out, by) in by_parameter[SHARED..].iter_mut().zip(by_angle) {
            *out = along(by * direction);
        }
        let by_direction =
            DMat2::from_cols(along(camera_from_facility * first), along(camera_from_facility * second));
        Ok(Place { px: self.lens.pixel_of(&image), by_direction, by_parameter })
    }

    /// Parameters one after the other, mountings last.
    fn values(&self) -> Vec<f64> {
        let Lens { focal_px, centre_px, coefficients, .. } = self.lens;
        let mut out = vec![focal_px.x, focal_px.y, centre_px.x, centre_px.y];
        out.extend(coefficients);
        out.extend(self.mountings.iter().flatten());
        out
    }

    fn of_values(model: LensModel, values: &[f64]) -> Self {
        let mut coefficients = [0.0; MOST_COEFFICIENTS];
        coefficients.copy_from_slice(&values[4..SHARED]);
        let mut lens = Lens::new(model, DVec2::new(values[0], values[1]), DVec2::new(values[2], values[3]));
        lens.coefficients = coefficients;
        let mountings = values[SHARED..].chunks_exact(ANGLES).map(|a| [a[0], a[1], a[2]]).collect();
        Self { lens, mountings }
    }

    /// How it reads in a note.
    pub(super) fn text(&self) -> String {
        let Lens { model, focal_px, centre_px, coefficients } = self.lens;
        let named = model.coefficient_names().iter().zip(coefficients).map(|(n, c)| format!(", {n} {c:.6}"));
        format!(
            "{}: fx {:.3} px, fy {:.3} px, cx {:.3} px, cy {:.3} px{}",
            model.name(),
            focal_px.x,
            focal_px.y,
            centre_px.x,
            centre_px.y,
            named.collect::<String>()
        )
    }
}

/// Fits a model; `camera` is where the search starts.
pub(super) fn fitted(
    model: LensModel,
    camera: &Pinhole,
    points: &[Shown],
) -> Result<FittedLens, LensProblem> {
    let count = mountings(points);
    let coefficients = model.coefficient_names().len();
    if points.len() < 4 + coefficients + ANGLES * count {
        return Err(LensProblem::TooFew(4 + coefficients + ANGLES * count));
    }
    let start = start(model, camera, points, count)?;
    let chosen = evenly(points, MOST_ROWS, FEWEST_OF_MOUNTING);
    let mut starts = vec![start.clone()];
    if model == LensModel::Rational {
        let mut wide = start;
        wide.lens.coefficients = PADE_ARCTAN;
        starts.push(wide);
    }
    let best = starts
        .into_iter()
        .filter_map(|start| {
            let plain = descended(start, &chosen, false);
            let whole = if coefficients > 0 { descended(plain, &chosen, true) } else { plain };
            errors(&whole, &chosen).map(|errors| (sigma_px(&errors), whole))
        })
        .min_by(|a, b| a.0.total_cmp(&b.0));
    // The start was evaluated before, and no step leaves the model's domain.
    let Some((_, best)) = best else { return Err(LensProblem::TooFew(0)) };
    check(&best, points)?;
    Ok(best)
}

/// At most so many points or so, of each mounting its share, and as many as `fewest`.
pub(super) fn evenly(points: &[Shown], most: usize, fewest: usize) -> Vec<Shown> {
    let mut out = Vec::new();
    for m in 0..mountings(points) {
        let own: Vec<Shown> = points.iter().filter(|p| p.mounting == m).copied().collect();
        let most = (most * own.len() / points.len()).max(fewest);
        out.extend(own.iter().step_by(own.len().div_ceil(most).max(1)));
    }
    out
}

fn mountings(points: &[Shown]) -> usize {
    points.iter().map(|p| p.mounting + 1).max().unwrap_or(0)
}

/// The setup's camera, turned and scaled as the points of each mounting tell by a similarity.
fn start(
    model: LensModel,
    camera: &Pinhole,
    points: &[Shown],
    count: usize,
) -> Result<FittedLens, LensProblem> {
    let (focal, centre) = (DVec2::new(camera.fx_px, camera.fy_px), DVec2::new(camera.cx_px, camera.cy_px));
    let mut out = FittedLens { lens: Lens::new(model, focal, centre), mountings: vec![[0.0; ANGLES]; count] };
    let mut scales = Vec::new();
    for m in 0..count {
        let mut pairs = Vec::new();
        for (row, point) in points.iter().enumerate().filter(|(_, p)| p.mounting == m) {
            let place =
                out.place(point.displayed, [0.0; ANGLES]).map_err(|e| LensProblem::NoImage(row, e))?;
            pairs.push((place.px, point.camera_px));
        }
        let mean =
            |of: fn(&(DVec2, DVec2)) -> DVec2| pairs.iter().map(of).sum::<DVec2>() / pairs.len() as f64;
        let (a, b) = (mean(|p| p.0), mean(|p| p.1));
        let (mut cross, mut along, mut square) = (0.0, 0.0, 0.0);
        for (from, to) in &pairs {
            cross += (*from - a).perp_dot(*to - b);
            along += (*from - a).dot(*to - b);
            square += (*from - a).length_squared();
        }
        out.mountings[m][2] = cross.atan2(along);
        scales.push(cross.hypot(along) / square);
    }
    let scale = crate::series::median(&scales);
    if scale.is_finite() && scale > 0.0 {
        out.lens.focal_px *= scale;
    }
    Ok(out)
}

/// Errors of all points, px; `None` where one has no image.
pub(super) fn errors(fitted: &FittedLens, points: &[Shown]) -> Option<Vec<DVec2>> {
    points
        .par_iter()
        .map(|p| {
            let direction = rotation(fitted.mountings[p.mounting]).0 * p.displayed.extend(1.0);
            let off = p.camera_px - fitted.lens.pixel(direction).ok()?;
            off.is_finite().then_some(off)
        })
        .collect()
}

/// Standard deviation of one axis by the median length.
pub(super) fn sigma_px(errors: &[DVec2]) -> f64 {
    let lengths: Vec<f64> = errors.iter().map(|e| e.length()).collect();
    (crate::series::median(&lengths) / MEDIAN_LENGTH).max(LEAST_SIGMA_PX)
}

/// D. Marquardt's method (SIAM Journal 11, 1963) under weights that are found anew in each round; with or without the
/// coefficients.
fn descended(start: FittedLens, points: &[Shown], with_coefficients: bool) -> FittedLens {
    let model = start.lens.model;
    let coefficients = if with_coefficients { model.coefficient_names().len() } else { 0 };
    let mountings = start.mountings.len();
    // Which entries of `values` are free.
    let free: Vec<usize> = (0..4 + coefficients).chain(SHARED..SHARED + ANGLES * mountings).collect();
    let mut found = start;
    let Some(mut off) = errors(&found, points) else { return found };
    let mut damping = 1e-3;
    for round in 0..ROUNDS {
        let sigma = sigma_px(&off);
        let weights: Vec<f64> =
            off.iter().map(|e| weight(e.length() / sigma, round < HUBER_ROUNDS)).collect();
        let cost_of =
            |off: &[DVec2]| -> f64 { off.iter().zip(&weights).map(|(e, w)| w * e.length_squared()).sum() };
        let mut cost = cost_of(&off);
        let before = cost;
        for _ in 0..STEPS {
            let (mut normal, right) = normal_equations(&found, points, &off, &weights, &free);
            let n = free.len();
            for k in 0..n {
                // A parameter that nothing depends on stays.
                normal[k * n + k] = (normal[k * n + k] * (1.0 + damping)).max(f64::MIN_POSITIVE);
            }
            let scale: Vec<f64> = (0..n).map(|k| normal[k * n + k].sqrt().max(1e-150)).collect();
            let scaled: Vec<f64> =
                (0..n * n).map(|at| normal[at] / (scale[at / n] * scale[at % n])).collect();
            let scaled_right: Vec<f64> = right.iter().zip(&scale).map(|(r, s)| r / s).collect();
            let trial = solve_positive(&scaled, &scaled_right).and_then(|step| {
                let mut values = found.values();
                for ((&at, step), scale) in free.iter().zip(&step).zip(&scale) {
                    values[at] += step / scale;
                }
                let trial = FittedLens::of_values(model, &values);
                let off = errors(&trial, points)?;
                Some((cost_of(&off), trial, off))
            });
            match trial {
                Some((next, trial, errors)) if next <= cost => {
                    let done = cost - next <= 1e-10 * cost;
                    (cost, found, off) = (next, trial, errors);
                    damping = (damping * 0.1).max(1e-12);
                    if done {
                        break;
                    }
                }
                _ => {
                    damping *= 10.0;
                    if damping > 1e10 {
                        damping = 1e-3;
                        break;
                    }
                }
            }
        }
        // The last rounds are Tukey's, whatever the first ones did.
        if round > HUBER_ROUNDS && before - cost <= 1e-9 * before {
            break;
        }
    }
    found
}

/// Robust weight of an error in standard deviations.
fn weight(z: f64, huber: bool) -> f64 {
    if huber {
        if z > HUBER { HUBER / z } else { 1.0 }
    } else {
        let u = (z / TUKEY).powi(2);
        if u < 1.0 { (1.0 - u).powi(2) } else { 0.0 }
    }
}

/// J^T W J and J^T W e over the free parameters; sums run in a fixed order.
fn normal_equations(
    fitted: &FittedLens,
    points: &[Shown],
    off: &[DVec2],
    weights: &[f64],
    free: &[usize],
) -> (Vec<f64>, Vec<f64>) {
    let n = free.len();
    // Where an entry of a place's derivatives goes.
    let shared = free.iter().filter(|&&at| at < SHARED).count();
    let (mut normal, mut right) = (vec![0.0; n * n], vec![0.0; n]);
    let places: Vec<Option<Place>> =
        points.par_iter().map(|p| fitted.place(p.displayed, fitted.mountings[p.mounting]).ok()).collect();
    for ((point, place), (off, weight)) in points.iter().zip(&places).zip(off.iter().zip(weights)) {
        let Some(place) = place.as_ref().filter(|_| *weight > 0.0) else { continue };
        let angles = (0..ANGLES).map(|k| (shared + ANGLES * point.mounting + k, SHARED + k));
        let entries: Vec<(usize, DVec2)> = (0..shared)
            .map(|k| (k, free[k]))
            .chain(angles)
            .map(|(to, from)| (to, place.by_parameter[from]))
            .collect();
        for &(i, a) in &entries {
            right[i] += weight * a.dot(*off);
            for &(j, b) in &entries {
                normal[i * n + j] += weight * a.dot(b);
            }
        }
    }
    (normal, right)
}

/// Refuses a lens that does not map every point to a place of its own.
fn check(fitted: &FittedLens, points: &[Shown]) -> Result<(), LensProblem> {
    let mut furthest = (0, 0.0);
    for (row, point) in points.iter().enumerate() {
        let angles = fitted.mountings[point.mounting];
        let direction = rotation(angles).0 * point.displayed.extend(1.0);
        let theta = direction.x.hypot(direction.y).atan2(direction.z);
        if theta > furthest.1 {
            furthest = (row, theta);
        }
        let place = fitted.place(point.displayed, angles).map_err(|e| LensProblem::NoImage(row, e))?;
        let determinant = place.by_direction.determinant();
        if !determinant.is_finite() || determinant.abs() < 1e-9 * place.by_direction.col(0).length_squared() {
            return Err(LensProblem::Singular(row));
        }
    }
    match fitted.lens.turning_angle_rad(furthest.1) {
        Some(turn) => Err(LensProblem::TurnsBack(furthest.0, furthest.1, turn)),
        None => Ok(()),
    }
}

/// A row's residual, arcsec; px per arcsec; and the model's place, px.
pub(super) fn residual(
    fitted: &FittedLens,
    point: &Shown,
    row: usize,
) -> Result<(DVec2, DMat2, DVec2), LensProblem> {
    let angles = fitted.mountings[point.mounting];
    let place = fitted.place(point.displayed, angles).map_err(|e| LensProblem::NoImage(row, e))?;
    let px_per_arcsec = place.by_direction * (1.0 / ARCSEC_PER_RAD);
    Ok((px_per_arcsec.inverse() * (point.camera_px - place.px), px_per_arcsec, place.px))
}

/// Names of the baseline's parameters, those of all mountings, with the factor from the fit's unit to the name's.
fn names(model: LensModel, mountings: usize) -> Vec<(String, f64)> {
    let mut out: Vec<(String, f64)> =
        ["fx_px", "fy_px", "cx_px", "cy_px"].map(|n| (n.to_owned(), 1.0)).into();
    out.extend(model.coefficient_names().iter().map(|n| ((*n).to_owned(), 1.0)));
    for m in 0..mountings {
        let suffix = if m == 0 { String::new() } else { format!("_{m}") };
        let degrees = 1f64.to_degrees();
        out.extend(["x", "y", "z"].map(|axis| (format!("rotation_{axis}_deg{suffix}"), degrees)));
    }
    out
}

/// Entries of `FittedLens::values` that are parameters, in the order of [`names`].
fn entries(model: LensModel, mountings: usize) -> impl Iterator<Item = usize> {
    (0..4 + model.coefficient_names().len()).chain(SHARED..SHARED + ANGLES * mountings)
}

/// Values that the baseline's coefficients are counted from.
pub(super) fn values(fitted: &FittedLens, mountings: usize) -> Vec<f64> {
    let model = fitted.lens.model;
    let mut all = fitted.values();
    // A design with more mountings than were measured repeats them.
    all.resize(SHARED + ANGLES * mountings, 0.0);
    entries(model, mountings).zip(names(model, mountings)).map(|(at, (_, unit))| all[at] * unit).collect()
}

/// The lens that a fit has found beside its effects; `None` where the baseline is none of a lens model.
pub fn lens_of_fit(data: &Dataset, fit: &crate::fit::Fit) -> Option<Lens> {
    let mut lens = data.lens.as_ref()?.lens;
    let value = |name: &str| fit.parameters.iter().find(|p| p.name == name).map(|p| p.value);
    lens.focal_px = DVec2::new(value("fx_px")?, value("fy_px")?);
    lens.centre_px = DVec2::new(value("cx_px")?, value("cy_px")?);
    for (coefficient, name) in lens.coefficients.iter_mut().zip(lens.model.coefficient_names()) {
        *coefficient = value(name)?;
    }
    Some(lens)
}

/// Where each row is by the model, and arcsec per px there; `None` of a row that has no image.
fn places(data: &Dataset, fitted: &FittedLens) -> Vec<Option<(DMat2, Place)>> {
    let (x, y) = (data.values("x"), data.values("y"));
    (0..data.len())
        .into_par_iter()
        .map(|row| {
            let m = data.mounting[row];
            let [a, b, _] = fitted.mountings[m % fitted.mountings.len()];
            // The roll is the data's own: a design may turn the camera.
            let angles = [a, b, -data.roll_rad[m]];
            let place = fitted.place(DVec2::new(x[row], y[row]) * data.half_tan, angles).ok()?;
            Some((place.by_direction.inverse() * ARCSEC_PER_RAD, place))
        })
        .collect()
}

/// What a lens of a longer focal length does, in arcsec where a pinhole's image at half the camera's width would move by
/// one: image points go outwards in proportion to their own distance from the principal point, which is not the tangent.
pub(crate) fn longer_focal(data: &Dataset, fitted: &FittedLens) -> Vec<[f64; 2]> {
    let per_half_width = 1.0 / (ARCSEC_PER_RAD * data.half_tan);
    let of = |place: Option<(DMat2, Place)>| {
        let (arcsec_per_px, place) = place?;
        let [fx, fy] = fitted.lens.focal_px.to_array();
        let px = place.by_parameter[0] * fx + place.by_parameter[1] * fy;
        Some((arcsec_per_px * px * per_half_width).to_array())
    };
    places(data, fitted).into_iter().map(|place| of(place).unwrap_or_default()).collect()
}

/// A column for each parameter, arcsec per its unit.
pub(super) fn baseline<'a>(data: &Dataset, fitted: &FittedLens) -> Vec<Term<'a>> {
    let mountings = data.roll_rad.len();
    let model = fitted.lens.model;
    let places = places(data, fitted);
    entries(model, mountings)
        .zip(names(model, mountings))
        .map(|(at, (name, unit))| {
            let of = |row: usize| {
                let Some((arcsec_per_px, place)) = &places[row] else { return [0.0; 2] };
                let own = match at.checked_sub(SHARED) {
                    None => at,
                    Some(angle) if angle / ANGLES == data.mounting[row] => SHARED + angle % ANGLES,
                    Some(_) => return [0.0; 2],
                };
                (*arcsec_per_px * place.by_parameter[own] / unit).to_array()
            };
            let column: Vec<[f64; 2]> = (0..data.len()).map(of).collect();
            Term::new(name, move |row| column[row])
        })
        .collect()
}
