//! Position from limb points: Christian and Robinson, "Noniterative horizon-based optical navigation by Cholesky
//! factorization", J. Guidance, Control, and Dynamics 39 (2016).
//!
//! In the space where the ellipsoid is the unit sphere (Q = diag(1 / semi-axes) in body axes) a line of sight s that
//! touches it obeys n . Q s / |Q s| = 1, linear in n; the centre is Q^-1 n / sqrt(n . n - 1).

use std::collections::HashMap;

use glam::{DMat3, DQuat, DVec2, DVec3};

use super::shape::RimPieces;
use super::{LimbBody, LimbCamera};

/// Points further out than so many standard deviations are rejected.
const REJECT_SIGMA: f64 = 3.5;
/// Median of |x| of normal noise in standard deviations.
pub(super) const NORMAL_MEDIAN: f64 = 0.674_49;

/// Relative precision of the variance beyond the points' own: far below its own uncertainty.
const EXCESS_PRECISION: f64 = 1e-4;

/// A point that goes into a fit.
#[derive(Debug, Clone, Copy)]
pub(super) struct Measured {
    pub pixel: DVec2,
    /// Outward normal of the outline, unit.
    pub normal: DVec2,
    pub sigma_px: f64,
    /// Place on the outline, index.
    pub index: usize,
}

/// Position, covariance and what became of the points.
#[derive(Debug, Clone)]
pub(super) struct Fit {
    pub position_m: DVec3,
    /// By the points alone, neighbours taken for unrelated.
    pub covariance_m2: DMat3,
    pub residuals_px: Vec<f64>,
    pub used: Vec<bool>,
    pub excess_sigma_px: f64,
}

/// One row of the linear system.
struct Row {
    direction: DVec3,
    /// Change of n . direction by a pixel along the normal is n . slope.
    slope: DVec3,
}

/// A least-squares problem of three unknowns with a row a point.
trait Rows {
    /// Whether a point has a row.
    fn has(&self, point: usize) -> bool;
    /// Unknowns and their covariance; weights are inverse variances in px^-2, those of points without a row 0. `about`
    /// are unknowns at which the rows' sensitivity to a pixel is taken; without, all have the same.
    fn solve(&self, weights: &[f64], about: Option<DVec3>) -> Option<(DVec3, DMat3)>;
    /// Measured less fitted along the outward normal, px; 0 without a row.
    fn residuals(&self, unknowns: DVec3) -> Vec<f64>;
}

/// What a robust fit of [`Rows`] gives.
struct Robust {
    unknowns: DVec3,
    covariance: DMat3,
    residuals_px: Vec<f64>,
    used: Vec<bool>,
    excess_sigma_px: f64,
}

/// First by absolute values, then by least squares without outliers; `None` where fewer than six points are left.
fn robust(rows: &impl Rows, points: &[Measured]) -> Option<Robust> {
    let there: Vec<bool> = (0..points.len()).map(|k| rows.has(k)).collect();
    let mut weights: Vec<f64> = there.iter().map(|there| f64::from(u8::from(*there))).collect();
    let (mut unknowns, _) = rows.solve(&weights, None)?;
    for _ in 0..12 {
        let residuals = rows.residuals(unknowns);
        for ((weight, there), residual) in weights.iter_mut().zip(&there).zip(&residuals) {
            *weight = if *there { 1.0 / (residual.abs() + 0.05) } else { 0.0 };
        }
        unknowns = rows.solve(&weights, Some(unknowns))?.0;
    }
    let mut used = there.clone();
    let mut excess = 0.0;
    let mut covariance = DMat3::ZERO;
    let mut spread_of: Option<f64> = None;
    for _ in 0..8 {
        let residuals = rows.residuals(unknowns);
        // The spread is taken from all points at first, then from those in use.
        let mut sizes: Vec<f64> =
            residuals.iter().zip(&used).filter(|(_, used)| **used).map(|(r, _)| r.abs()).collect();
        if sizes.len() < 6 {
            return None;
        }
        let middle = sizes.len() / 2;
        let spread = *sizes.select_nth_unstable_by(middle, f64::total_cmp).1 / NORMAL_MEDIAN;
        // It may shrink while outliers leave, and not grow again.
        let spread = spread_of.map_or(spread, |before: f64| before.min(spread));
        spread_of = Some(spread);
        for (k, used) in used.iter_mut().enumerate() {
            let limit = REJECT_SIGMA * spread.max(points[k].sigma_px);
            *used = there[k] && residuals[k].abs() < limit;
        }
        excess = excess_sigma(points, &residuals, &used)?;
        for k in 0..weights.len() {
            weights[k] = if used[k] { points[k].sigma_px.hypot(excess).powi(-2) } else { 0.0 };
        }
        (unknowns, covariance) = rows.solve(&weights, Some(unknowns))?;
    }
    Some(Robust {
        unknowns,
        covariance,
        residuals_px: rows.residuals(unknowns),
        used,
        excess_sigma_px: excess,
    })
}

/// Robust fit; `None` where fewer than six points are left or they fit no body in front of the camera.
pub(super) fn fit(points: &[Measured], camera: &LimbCamera, body: &LimbBody, height_m: f64) -> Option<Fit> {
    // The unit sphere's space, turned so that the points are about +z: keeps the digits.
    let axes_m = body.semi_axes_m + height_m;
    let q = DMat3::from_diagonal(axes_m.recip()) * body.camera_from_body.transpose();
    let ray = |pixel: DVec2| camera.line_of_sight(pixel).map(|r| (q * r.extend(1.0)).normalize());
    let rays: Vec<Option<(DVec3, DVec3)>> = points
        .iter()
        .map(|point| {
            const STEP_PX: f64 = 0.25;
            let [out, inn] = [STEP_PX, -STEP_PX].map(|step| ray(point.pixel + point.normal * step));
            Some((ray(point.pixel)?, (out? - inn?) / (2.0 * STEP_PX)))
        })
        .collect();
    let mean: DVec3 = rays.iter().flatten().map(|(direction, _)| *direction).sum();
    if mean.length() < 1e-9 {
        return None;
    }
    let turn = DMat3::from_quat(DQuat::from_rotation_arc(mean.normalize(), DVec3::Z));
    let rows: Vec<Option<Row>> = rays
        .iter()
        .map(|ray| ray.map(|(direction, slope)| Row { direction: turn * direction, slope: turn * slope }))
        .collect();
    let found = robust(&Ellipsoid(rows), points)?;
    let n = found.unknowns;
    let level = n.length_squared() - 1.0;
    if level <= 0.0 {
        return None;
    }
    // P = Q^-1 turn^-1 n / sqrt(n . n - 1), and its derivative by n.
    let back = q.inverse() * turn.transpose();
    let outer = DMat3::from_cols(n * n.x, n * n.y, n * n.z);
    let derivative = back * (DMat3::IDENTITY * level.powf(-0.5) - outer * level.powf(-1.5));
    let covariance_m2 = derivative * found.covariance * derivative.transpose();
    found.at(back * n / level.sqrt(), covariance_m2)
}

impl Robust {
    fn at(self, position_m: DVec3, covariance_m2: DMat3) -> Option<Fit> {
        let Self { residuals_px, used, excess_sigma_px, .. } = self;
        (position_m.is_finite() && position_m.z > 0.0).then_some(Fit {
            position_m,
            covariance_m2,
            residuals_px,
            used,
            excess_sigma_px,
        })
    }
}

/// Robust fit of a mesh's silhouette that was taken at `position_m`: its places stay on the body while this moves. To
/// first order they do, since a silhouette slides along the surface.
pub(super) fn fit_rim(
    points: &[Measured],
    camera: &LimbCamera,
    rim: &RimPieces,
    position_m: DVec3,
) -> Option<Fit> {
    let places = rim.nodes.iter().map(|node| (node.index, node.at)).collect::<HashMap<_, _>>();
    let step_m = 1e-6 * position_m.length();
    let pixel = |at: DVec3| camera.pixel(at.truncate() / at.z);
    let rows = points.iter().map(|point| {
        let at = position_m + *rim.offsets_m.get(point.index)?;
        let by = |axis: DVec3| {
            Some(point.normal.dot(pixel(at + axis * step_m)? - pixel(at - axis * step_m)?) / (2.0 * step_m))
        };
        let per_m = DVec3::new(by(DVec3::X)?, by(DVec3::Y)?, by(DVec3::Z)?);
        Some(RimRow { per_m, off_px: point.normal.dot(point.pixel - *places.get(&point.index)?) })
    });
    let found = robust(&Silhouette(rows.collect()), points)?;
    let (moved_m, covariance_m2) = (found.unknowns, found.covariance);
    found.at(position_m + moved_m, covariance_m2)
}

/// A place of a silhouette: how far the edge is off it, and what it moves by with the body.
struct RimRow {
    per_m: DVec3,
    off_px: f64,
}

struct Silhouette(Vec<Option<RimRow>>);

impl Rows for Silhouette {
    fn has(&self, point: usize) -> bool {
        self.0[point].is_some()
    }

    fn solve(&self, weights: &[f64], _about: Option<DVec3>) -> Option<(DVec3, DMat3)> {
        least_squares(
            self.0
                .iter()
                .zip(weights)
                .filter_map(|(row, weight)| row.as_ref().map(|row| (row.per_m, row.off_px, *weight))),
        )
    }

    fn residuals(&self, moved_m: DVec3) -> Vec<f64> {
        self.0.iter().map(|row| row.as_ref().map_or(0.0, |row| row.off_px - row.per_m.dot(moved_m))).collect()
    }
}

/// Standard deviation beyond the points' own that makes the mean squared weighted residual one.
fn excess_sigma(points: &[Measured], residuals: &[f64], used: &[bool]) -> Option<f64> {
    let rows: Vec<(f64, f64)> = points
        .iter()
        .zip(residuals)
        .zip(used)
        .filter(|(_, used)| **used)
        .map(|((point, residual), _)| (point.sigma_px.powi(2), residual * residual))
        .collect();
    if rows.len() < 6 {
        return None;
    }
    let freedom = rows.len() as f64 - 3.0;
    let surplus = |variance: f64| rows.iter().map(|(own, r2)| r2 / (own + variance)).sum::<f64>() - freedom;
    if surplus(0.0) <= 0.0 {
        return Some(0.0);
    }
    let (mut low, mut high) = (0.0, rows.iter().map(|(_, r2)| r2).sum::<f64>());
    while high - low > EXCESS_PRECISION * high {
        let middle = 0.5 * (low + high);
        if surplus(middle) > 0.0 { low = middle } else { high = middle }
    }
    Some(high.sqrt())
}

struct Ellipsoid(Vec<Option<Row>>);

impl Rows for Ellipsoid {
    fn has(&self, point: usize) -> bool {
        self.0[point].is_some()
    }

    /// n with its covariance.
    fn solve(&self, weights: &[f64], about: Option<DVec3>) -> Option<(DVec3, DMat3)> {
        least_squares(self.0.iter().zip(weights).filter_map(|(row, weight)| {
            let row = row.as_ref()?;
            let per_px = about.map_or(1.0, |n| n.dot(row.slope));
            Some((row.direction, 1.0, weight / (per_px * per_px)))
        }))
    }

    fn residuals(&self, n: DVec3) -> Vec<f64> {
        // n . s falls below one outside the limb.
        let residual = |row: &Row| (n.dot(row.direction) - 1.0) / n.dot(row.slope);
        self.0.iter().map(|row| row.as_ref().map_or(0.0, residual)).collect()
    }
}

/// Unknowns and their covariance from rows (coefficients, value, weight).
fn least_squares(rows: impl Iterator<Item = (DVec3, f64, f64)>) -> Option<(DVec3, DMat3)> {
    let (mut normal, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for (row, value, weight) in rows {
        normal += DMat3::from_cols(row * row.x, row * row.y, row * row.z) * weight;
        right += row * (weight * value);
    }
    let scale = DVec3::new(normal.x_axis.x, normal.y_axis.y, normal.z_axis.z).map(|v| v.sqrt().recip());
    let scaling = DMat3::from_diagonal(scale);
    let scaled = scaling * normal * scaling;
    if !scaled.is_finite() || scaled.determinant() < 1e-13 {
        return None;
    }
    let covariance = scaling * scaled.inverse() * scaling;
    let unknowns = covariance * right;
    unknowns.is_finite().then_some((unknowns, covariance))
}
