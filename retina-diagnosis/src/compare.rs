//! How far a model is from the data: errors against the noise, the worst groups, what the errors depend on.

use crate::added::{AddedEffect, adjusted};
use crate::data::{ARCSEC_PER_RAD, Dataset};
use crate::decode::{Decoded, decode};
use crate::doubts::doubts;
use crate::flips::Flips;
use crate::noise::{Weights, lost_groups, robust_fit};
use crate::scatter::{Noise, noise};
use crate::score::Frame;
use crate::screens::{screen_p_values, screens};
use crate::search::MOST_ROWS;
use crate::together::Together;
use retina_formats::TableKind;

/// Percentiles that are reported.
pub(crate) const PERCENTILES: [u32; 6] = [50, 68, 90, 95, 96, 99];
/// Worst groups that are reported.
const WORST: usize = 5;
const FLIPS: usize = 999;

/// A group with large errors.
#[derive(Debug, Clone)]
pub struct WorstGroup {
    /// Its name.
    pub name: String,
    /// Weighted rms per component.
    pub rms: f64,
    /// Its rows that are no outliers.
    pub rows: usize,
}

/// Errors as a function of columns.
#[derive(Debug, Clone)]
pub struct Dependence {
    /// The columns.
    pub covariates: Vec<String>,
    /// p-value, corrected for the number of screens.
    pub p_value: f64,
    /// Share of the errors' weighted squares that it explains.
    pub share: f64,
}

/// The comparison of a model with a table.
#[derive(Debug, Clone)]
pub struct Comparison {
    /// Rows of the files.
    pub rows: usize,
    /// Outliers.
    pub outliers: usize,
    /// Saturated rows, left out.
    pub saturated: usize,
    /// Rms per component, without outliers, weighted by the noise that this model leaves.
    pub rms: f64,
    /// The same without weights, as the percentiles.
    pub rms_unweighted: f64,
    /// What the measurements scatter by.
    pub noise: Noise,
    /// Standard deviation of a group's common error, per component.
    pub jitter: f64,
    /// Percentiles of the errors' lengths without outliers, in the order 50, 68, 90, 95, 96, 99.
    pub percentiles: [f64; 6],
    /// Points: share of errors within 10 arcsec, without outliers.
    pub fraction_within_10_arcsec: Option<f64>,
    /// Groups with the largest errors.
    pub worst_groups: Vec<WorstGroup>,
    /// What the screens found for each set of columns, most significant first.
    pub dependence: Vec<Dependence>,
    /// The baseline's polynomial, or a held calibration's, as physics.
    pub decoded: Option<Decoded>,
    /// What the user ought to know.
    pub notes: Vec<String>,
}

/// Compares baseline and added effects with the data.
pub fn compare(data: &Dataset, added: &[AddedEffect]) -> Comparison {
    let scatter = noise(data);
    let fitted_part = data.fitted_part();
    let data = fitted_part.as_ref().unwrap_or(data);
    let screened_part = data.thinned(MOST_ROWS);
    let mut notes = screened_part.as_ref().unwrap_or(data).notes.clone();
    let mut screened = adjusted(screened_part.as_ref().unwrap_or(data), added);
    if let Some(noise) = &scatter {
        noise.apply(&mut screened.data);
    }
    let first = robust_fit(&screened.data, &screened.base);
    let frame = Frame::with_outliers_cut(&screened.data, &screened.base, &first);
    let all = screens(&frame);
    let flips = Flips::draw(&screened.data, FLIPS, 1);
    let p = screen_p_values(&all, &flips);
    let mut adjusted = adjusted(data, added);
    if let Some(noise) = &scatter {
        noise.weigh(&mut adjusted.data);
    }
    let data = &adjusted.data;
    let n = data.components();
    let fit = robust_fit(data, &adjusted.base);
    notes.extend(lost_groups(data, &fit.weights));
    notes.extend(Together::of(data, &fit.residual, &fit.weights).map(|together| together.note()));
    let noise = Noise::beside(scatter, data, &fit);
    notes.extend(doubts(data, &noise, &fit.weights));
    let total: f64 = frame.error.iter().map(|e| e * e).sum();
    let mut order: Vec<usize> = (0..all.len()).collect();
    order.sort_by(|&a, &b| {
        p[a].total_cmp(&p[b]).then(all[b].score.deviate().total_cmp(&all[a].score.deviate()))
    });
    // Several screens look at the same columns: the most significant speaks.
    let first = |at: usize| !order[..at].iter().any(|&i| all[i].covariates == all[order[at]].covariates);
    let dependence = (0..order.len())
        .filter(|&at| first(at))
        .map(|at| &order[at])
        .map(|&i| Dependence {
            covariates: all[i].covariates.clone(),
            p_value: p[i],
            share: ((all[i].score.statistic - all[i].score.rank() as f64) / total).clamp(0.0, 1.0),
        })
        .collect();
    let lengths: Vec<f64> = (0..data.len()).map(|row| length(data, &fit.residual, row)).collect();
    let mut kept: Vec<f64> =
        lengths.iter().zip(&fit.weights.outlier).filter(|(_, out)| !**out).map(|(l, _)| *l).collect();
    kept.sort_by(f64::total_cmp);
    let percentiles = PERCENTILES.map(|percent| {
        let at = (f64::from(percent) / 100.0 * kept.len() as f64).ceil() as usize;
        kept.get(at.saturating_sub(1).min(kept.len().saturating_sub(1))).copied().unwrap_or(0.0)
    });
    let within = kept.iter().filter(|l| **l <= 10.0).count() as f64 / kept.len().max(1) as f64;
    Comparison {
        rows: data.table_rows,
        outliers: fit.weights.outlier.iter().filter(|out| **out).count(),
        saturated: data.saturated,
        rms: fit.weights.rms(n, &fit.residual),
        rms_unweighted: fit.weights.rms_unweighted(n, &fit.residual),
        noise,
        jitter: fit.weights.jitter_variance.sqrt(),
        percentiles,
        fraction_within_10_arcsec: (data.kind == TableKind::Points).then_some(within),
        worst_groups: worst(data, &fit.residual, &fit.weights),
        dependence,
        decoded: decode(data),
        notes,
    }
}

/// Length of a row's error; of points the angle between the two lines of sight.
fn length(data: &Dataset, residual: &[f64], row: usize) -> f64 {
    if data.kind != TableKind::Points {
        return residual[row].abs();
    }
    let (x, y) = (data.values("x")[row] * data.half_tan, data.values("y")[row] * data.half_tan);
    let (dx, dy) = (residual[2 * row], residual[2 * row + 1]);
    if data.lens.is_some() {
        // These are angles already.
        return dx.hypot(dy);
    }
    // On the tangent plane an angle is smaller along the radius by 1 + r^2 and across it by its root.
    let r2 = x * x + y * y;
    let along = if r2 > 0.0 { (dx * x + dy * y) / r2.sqrt() } else { 0.0 };
    let across2 = dx * dx + dy * dy - along * along;
    let small = (along / (1.0 + r2)).powi(2) + across2.max(0.0) / (1.0 + r2);
    // Small angles are those of the plane; large ones are capped by the arc.
    (small.sqrt() / ARCSEC_PER_RAD).atan() * ARCSEC_PER_RAD
}

fn worst(data: &Dataset, residual: &[f64], weights: &Weights) -> Vec<WorstGroup> {
    let n = data.components();
    let mut out: Vec<WorstGroup> = data
        .groups
        .iter()
        .map(|group| {
            let (mut squares, mut sum, mut rows) = (0.0, 0.0, 0);
            for row in group.rows.clone() {
                let own: f64 = residual[row * n..(row + 1) * n].iter().map(|r| r * r).sum();
                squares += weights.weight[row] * own;
                sum += weights.weight[row] * n as f64;
                rows += usize::from(!weights.outlier[row]);
            }
            WorstGroup {
                name: group.name.clone(),
                rms: if sum > 0.0 { (squares / sum).sqrt() } else { 0.0 },
                rows,
            }
        })
        .collect();
    out.sort_by(|a, b| b.rms.total_cmp(&a.rms));
    out.truncate(WORST);
    out
}
