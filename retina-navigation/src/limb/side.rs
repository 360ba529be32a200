//! Which side of a nearly full disc is limb, where the Sun's direction is not known.
//!
//! The terminator of a phase angle a stands inside the limb by A cos^2 p at an angle p from the direction away from the
//! Sun, A = R (1 - cos a), and not at all on the side of the Sun. This is fitted to the border's residuals for each
//! direction of the Sun, together with what changes of the circle do to them. Directions count by how well they fit.

use std::f64::consts::TAU;

use glam::{DMat4, DVec2, DVec4};
use retina_geometry::LimbEllipse;

use super::fit::{Fit, Measured, NORMAL_MEDIAN};

/// Directions of the Sun that are tried.
const DIRECTIONS: usize = 72;
/// The terminator is taken for found where it improves chi square by so much: two parameters and the choice among
/// independent directions, at less than one chance in a thousand.
const LEAST_GAIN: f64 = 16.0;
/// Residuals beyond so many standard deviations pull no harder (Huber).
const HUBER_SIGMA: f64 = 3.0;
/// The brightness falls towards the terminator: what is seen as its edge may stand so many times deeper than itself, and
/// by so much in addition, px.
const SOFT_TERMINATOR: (f64, f64) = (3.0, 0.05);

/// What the border says of the Sun's side.
#[derive(Debug, Clone, Copy)]
pub(super) struct Side {
    /// Towards the Sun in the image, unit; `None` where no terminator stands out of the border.
    pub sun: Option<DVec2>,
    /// Second moments of what that leaves open: radius, centre x, centre y, px^2 (the fourth row and column are 0).
    pub open_px2: DMat4,
}

/// A border's point in the fit.
struct Place {
    /// Outward, unit, in the space where the outline is a circle, and in the image.
    outward: DVec2,
    normal: DVec2,
    residual_px: f64,
    sigma_px: f64,
    index: usize,
}

impl Place {
    /// What radius, centre and the terminator's depth do to the residual, for a direction of the Sun.
    fn row(&self, sun: DVec2) -> DVec4 {
        let away = (-self.outward.dot(sun)).max(0.0);
        DVec4::new(1.0, self.normal.x, self.normal.y, -away * away)
    }
}

/// One direction's fit.
#[derive(Clone, Copy)]
struct Trial {
    sun: DVec2,
    change: DVec4,
    covariance: DMat4,
    chi2: f64,
}

/// Judges the border of a disc that was fitted as a whole. `phase_rad` is the phase angle where it is known.
pub(super) fn side(points: &[Measured], whole: &Fit, outline: &LimbEllipse, phase_rad: Option<f64>) -> Side {
    let axes = DVec2::from_array(outline.semi_axes_px);
    let depth_px = phase_rad.map(|phase| 0.5 * axes.element_sum() * (1.0 - phase.cos()));
    let mut places: Vec<Place> = points
        .iter()
        .zip(&whole.residuals_px)
        .map(|(point, residual)| {
            let local = DVec2::from_angle(-outline.angle_rad).rotate(point.pixel - outline.center_px) / axes;
            Place {
                outward: DVec2::from_angle(outline.angle_rad).rotate(local).normalize_or_zero(),
                normal: point.normal,
                residual_px: *residual,
                sigma_px: point.sigma_px.hypot(whole.excess_sigma_px),
                index: point.index,
            }
        })
        .collect();
    let none = Side { sun: None, open_px2: DMat4::ZERO };
    let Some(first) = best(&trials(&places, depth_px)) else { return none };
    // The scatter about the whole has the terminator in it: what is left beside the best direction is the terrain's.
    let mut left: Vec<f64> = places
        .iter()
        .map(|place| (place.residual_px - place.row(first.sun).dot(first.change)).abs())
        .collect();
    let middle = left.len() / 2;
    let spread = *left.select_nth_unstable_by(middle, f64::total_cmp).1 / NORMAL_MEDIAN;
    for (place, point) in places.iter_mut().zip(points) {
        place.sigma_px = point.sigma_px.max(spread);
    }
    let all = trials(&places, depth_px);
    let (Some(best), Some(none_seen)) = (best(&all), fitted(&places, DVec2::X, Some(0.0))) else {
        return none;
    };
    let scaled: Vec<(usize, f64)> = places
        .iter()
        .map(|p| (p.index, (p.residual_px - p.row(best.sun).dot(best.change)) / p.sigma_px))
        .collect();
    let factor = super::judge::correlation_factor(&scaled);
    let found = (none_seen.chi2 - best.chi2) / factor > LEAST_GAIN;
    let chosen = if found { best.change } else { none_seen.change };
    let mut open_px2 = DMat4::ZERO;
    let mut sum = 0.0;
    for trial in &all {
        let weight = (-0.5 * (trial.chi2 - best.chi2) / factor).exp();
        let off = trial.change - chosen;
        let outer = DMat4::from_cols(off * off.x, off * off.y, off * off.z, off * off.w);
        // The half of the limb that is measured after a terminator was found has its own covariance.
        let more = if found { DMat4::ZERO } else { (trial.covariance - none_seen.covariance) * factor };
        open_px2 += (outer + more) * weight;
        sum += weight;
    }
    open_px2 *= 1.0 / sum;
    // Radius and centre are what is asked for.
    open_px2.w_axis = DVec4::ZERO;
    for column in [&mut open_px2.x_axis, &mut open_px2.y_axis, &mut open_px2.z_axis] {
        column.w = 0.0;
    }
    Side { sun: found.then_some(best.sun), open_px2 }
}

fn best(trials: &[Trial]) -> Option<Trial> {
    trials.iter().copied().min_by(|a, b| a.chi2.total_cmp(&b.chi2))
}

fn trials(places: &[Place], depth_px: Option<f64>) -> Vec<Trial> {
    let bounds = depth_px.map(|depth| [depth, SOFT_TERMINATOR.0 * depth + SOFT_TERMINATOR.1]);
    (0..DIRECTIONS)
        .filter_map(|k| {
            let sun = DVec2::from_angle(TAU * k as f64 / DIRECTIONS as f64);
            let free = fitted(places, sun, None)?;
            let [least, most] = bounds.unwrap_or([0.0, f64::INFINITY]);
            if (least..=most).contains(&free.change.w) {
                return Some(free);
            }
            fitted(places, sun, Some(free.change.w.clamp(least, most)))
        })
        .collect()
}

/// Least squares with Huber's weights; the terminator's depth is free, or held at `held_px`.
fn fitted(places: &[Place], sun: DVec2, held_px: Option<f64>) -> Option<Trial> {
    let depth = held_px.unwrap_or(0.0);
    let mut change = DVec4::new(0.0, 0.0, 0.0, depth);
    let mut covariance = DMat4::ZERO;
    for turn in 0..3 {
        let (mut normal, mut right) = (DMat4::ZERO, DVec4::ZERO);
        for place in places {
            let mut row = place.row(sun);
            let off = (place.residual_px - row.dot(change)).abs() / place.sigma_px;
            let weight = if turn == 0 { 1.0 } else { (HUBER_SIGMA / off).min(1.0) } / place.sigma_px.powi(2);
            let mut residual = place.residual_px;
            if held_px.is_some() {
                residual -= row.w * depth;
                row.w = 0.0;
            }
            normal += DMat4::from_cols(row * row.x, row * row.y, row * row.z, row * row.w) * weight;
            right += row * (weight * residual);
        }
        if held_px.is_some() {
            normal.w_axis.w = 1.0;
        }
        let scale = DVec4::from_array([0, 1, 2, 3].map(|k| normal.col(k)[k].max(1e-30).sqrt().recip()));
        let scaling = DMat4::from_diagonal(scale);
        let scaled = scaling * normal * scaling;
        if !scaled.is_finite() || scaled.determinant() < 1e-9 {
            return None;
        }
        covariance = scaling * scaled.inverse() * scaling;
        change = covariance * right;
        if held_px.is_some() {
            change.w = depth;
        }
    }
    let chi2 = places
        .iter()
        .map(|place| {
            let off = ((place.residual_px - place.row(sun).dot(change)) / place.sigma_px).abs();
            if off < HUBER_SIGMA { off * off } else { HUBER_SIGMA * (2.0 * off - HUBER_SIGMA) }
        })
        .sum();
    Some(Trial { sun, change, covariance, chi2 })
}
