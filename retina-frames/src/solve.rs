//! The prediction's parameters fitted to the pixels.

use faer::linalg::solvers::{DenseSolveCore as _, Solve as _};
use faer::{Mat, Side};
use rayon::prelude::*;
use retina_calibration::NoiseGroups;

use crate::model::State;
use crate::pixels::PixelRows;
use crate::predicted::{Predicted, View};

/// A number of a state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Parameter {
    /// Relative.
    Gain(usize),
    Offset,
    ShiftX(usize),
    ShiftY(usize),
    Roll,
    Scale,
    /// Of a part.
    Part(usize, usize),
}

impl Parameter {
    /// The baseline's parameters: gains alone, or with registration and offset.
    pub(crate) fn baseline(frames: usize, registered: bool) -> Vec<Self> {
        let mut out: Vec<Self> = (0..frames).map(Self::Gain).collect();
        if registered {
            out.push(Self::Offset);
            out.extend((0..frames).flat_map(|frame| [Self::ShiftX(frame), Self::ShiftY(frame)]));
            out.extend([Self::Roll, Self::Scale]);
        }
        out
    }

    /// Those of the parts.
    pub(crate) fn of_parts(state: &State) -> Vec<Self> {
        let parts = state.parts.iter().enumerate();
        parts.flat_map(|(i, part)| (0..part.values.len()).map(move |k| Self::Part(i, k))).collect()
    }

    /// Its name, with the unit.
    pub(crate) fn name(self, frames: usize) -> String {
        let of = |frame: usize, name: &str| {
            if frames == 1 { name.to_owned() } else { format!("{name}_of_image_{}", frame + 1) }
        };
        match self {
            Self::Gain(frame) => of(frame, "gain_relative"),
            Self::Offset => "offset_dn".to_owned(),
            Self::ShiftX(frame) => of(frame, "shift_x_px"),
            Self::ShiftY(frame) => of(frame, "shift_y_px"),
            Self::Roll => "roll_rad".to_owned(),
            Self::Scale => "scale_relative".to_owned(),
            Self::Part(..) => String::new(),
        }
    }

    /// The one frame that it changes.
    pub(crate) fn frame(self) -> Option<usize> {
        match self {
            Self::Gain(frame) | Self::ShiftX(frame) | Self::ShiftY(frame) => Some(frame),
            _ => None,
        }
    }

    /// The value that its tangent's coefficient is added to.
    pub(crate) fn value(self, state: &State) -> f64 {
        match self {
            Self::Gain(_) => 0.0,
            Self::Offset => state.offset_dn,
            Self::ShiftX(frame) => state.shift_px[frame].x,
            Self::ShiftY(frame) => state.shift_px[frame].y,
            Self::Roll => state.roll_rad,
            Self::Scale => state.scale,
            Self::Part(part, k) => state.parts[part].values[k],
        }
    }

    /// The state with it changed.
    pub(crate) fn moved(self, state: &State, by: f64) -> State {
        let mut out = state.clone();
        match self {
            Self::Gain(frame) => out.gain[frame] *= 1.0 + by,
            Self::Offset => out.offset_dn += by,
            Self::ShiftX(frame) => out.shift_px[frame].x += by,
            Self::ShiftY(frame) => out.shift_px[frame].y += by,
            Self::Roll => out.roll_rad += by,
            Self::Scale => out.scale += by,
            Self::Part(part, k) => {
                let [low, high] = out.parts[part].form.change.range();
                let value = &mut out.parts[part].values[k];
                *value = (*value + by).clamp(low, high);
            }
        }
        out
    }

    /// A step over which a tangent is taken.
    pub(crate) fn step(self, state: &State) -> f64 {
        match self {
            Self::Gain(_) => 1e-3,
            Self::Offset => 1.0,
            Self::ShiftX(_) | Self::ShiftY(_) => 0.05,
            Self::Roll | Self::Scale => 5e-4,
            Self::Part(part, k) => {
                let part = &state.parts[part];
                (0.1 * part.values[k].abs()).max(0.05 * part.form.change.probe())
            }
        }
    }
}

/// Rows further off than this many sigmas do not count.
const OUTLIER_SIGMAS: f64 = 6.0;
const ROUNDS: usize = 5;
const TURNS: usize = 8;

/// Standard deviations of errors, in groups of like brightness.
pub(crate) fn sigmas(rows: &PixelRows, key: &[f64], error: &[f64], fitted: usize) -> Vec<f64> {
    let length: Vec<f64> = error.iter().map(|e| e.abs()).collect();
    let groups =
        NoiseGroups { rows: 120, fitted: fitted as f64, median_of_normal: 0.674_49, least: rows.least_noise };
    groups.sigmas(key, &length, &vec![false; error.len()])
}

/// How rows count: inverse variance times Tukey's factor.
pub(crate) fn weights(rows: &PixelRows, key: &[f64], error: &[f64], fitted: usize) -> Vec<f64> {
    error
        .iter()
        .zip(sigmas(rows, key, error, fitted))
        .map(|(e, s)| {
            let t = e.abs() / (s * OUTLIER_SIGMAS);
            if t < 1.0 { (1.0 - t * t).powi(2) / (s * s) } else { 0.0 }
        })
        .collect()
}

/// Fits parameters by D. Marquardt's method (SIAM Journal 11, 1963), weights anew in each round.
pub(crate) fn fit(view: View<'_>, start: Predicted, parameters: &[Parameter]) -> Predicted {
    let mut now = start;
    for _ in 0..ROUNDS {
        let key = view.rows.noise_key(view.sights, &now);
        let mut error = now.error(view);
        let weight = weights(view.rows, &key, &error, parameters.len());
        let cost = |error: &[f64]| error.iter().zip(&weight).map(|(e, w)| w * e * e).sum::<f64>();
        let mut costs = cost(&error);
        let first = costs;
        let mut damping = 1e-4;
        let mut tangents = now.tangents(view, parameters);
        for _ in 0..TURNS {
            let Some(step) = solved(&tangents, &error, &weight, damping) else { break };
            let mut trial = now.state.clone();
            for (parameter, by) in parameters.iter().zip(&step) {
                trial = parameter.moved(&trial, *by);
            }
            let there = now.beside(view, trial);
            let left = there.error(view);
            let then = cost(&left);
            if then.is_finite() && then <= costs {
                let done = costs - then < 1e-5 * costs;
                (now, error, costs) = (there, left, then);
                damping = (damping * 0.2).max(1e-9);
                if done {
                    break;
                }
                tangents = now.tangents(view, parameters);
            } else {
                damping *= 20.0;
                if damping > 1e6 {
                    break;
                }
            }
        }
        if first - costs < 1e-4 * first {
            break;
        }
    }
    now
}

/// Normal equations, scaled to a unit diagonal: the matrix, and the columns' sizes.
fn normal(columns: &[Vec<f64>], weight: &[f64], damping: f64) -> (Mat<f64>, Vec<f64>) {
    let n = columns.len();
    let entries: Vec<Vec<f64>> = (0..n)
        .into_par_iter()
        .map(|i| (0..=i).map(|j| over(&columns[i], &columns[j], weight)).collect())
        .collect();
    let size: Vec<f64> = (0..n).map(|i| entries[i][i].sqrt().max(1e-150)).collect();
    let mut normal = Mat::<f64>::zeros(n, n);
    for i in 0..n {
        for j in 0..=i {
            let value = entries[i][j] / (size[i] * size[j]);
            normal[(i, j)] = value;
            normal[(j, i)] = value;
        }
        // A trace of ridge for columns that say nothing.
        normal[(i, i)] = (entries[i][i] / (size[i] * size[i])) * (1.0 + damping) + 1e-9;
    }
    (normal, size)
}

fn over(a: &[f64], b: &[f64], weight: &[f64]) -> f64 {
    a.iter().zip(b).zip(weight).map(|((a, b), w)| a * b * w).sum()
}

/// Weighted least squares with a damped diagonal; `None` where it has no solution.
pub(crate) fn solved(columns: &[Vec<f64>], y: &[f64], weight: &[f64], damping: f64) -> Option<Vec<f64>> {
    let (normal, size) = normal(columns, weight, damping);
    let right: Vec<f64> =
        columns.par_iter().zip(&size).map(|(column, size)| over(column, y, weight) / size).collect();
    let right = Mat::<f64>::from_fn(right.len(), 1, |i, _| right[i]);
    let solution = normal.llt(Side::Lower).ok()?.solve(&right);
    let out: Vec<f64> = (0..size.len()).map(|i| solution[(i, 0)] / size[i]).collect();
    out.iter().all(|v| v.is_finite()).then_some(out)
}

/// Covariance of the columns' amplitudes where `weight` are inverse variances.
pub(crate) fn covariance(columns: &[Vec<f64>], weight: &[f64]) -> Option<Mat<f64>> {
    let (normal, size) = normal(columns, weight, 0.0);
    let inverse = normal.llt(Side::Lower).ok()?.inverse();
    Some(Mat::from_fn(size.len(), size.len(), |i, j| inverse[(i, j)] / (size[i] * size[j])))
}

/// Weighted squares that columns leave.
pub(crate) fn squares_left(columns: &[Vec<f64>], amplitudes: &[f64], y: &[f64], weight: &[f64]) -> f64 {
    (0..y.len())
        .map(|row| {
            let fitted: f64 = columns.iter().zip(amplitudes).map(|(c, a)| c[row] * a).sum();
            weight[row] * (y[row] - fitted).powi(2)
        })
        .sum()
}

/// Tiles are left out in this many parts.
const FOLDS: usize = 10;

/// Amplitudes of columns, and the weighted squares of tiles that were left out part by part.
pub(crate) fn held_out(
    rows: &PixelRows,
    columns: &[Vec<f64>],
    y: &[f64],
    weight: &[f64],
) -> Option<(Vec<f64>, f64)> {
    let whole = solved(columns, y, weight, 0.0)?;
    let parts: Vec<Option<f64>> = (0..FOLDS)
        .into_par_iter()
        .map(|fold| {
            let (mut kept, mut left) = (weight.to_vec(), vec![0.0; weight.len()]);
            let mut start = 0;
            for (tile, (_, count)) in rows.tiles.iter().enumerate() {
                if tile % FOLDS == fold {
                    left[start..start + count].copy_from_slice(&weight[start..start + count]);
                    kept[start..start + count].fill(0.0);
                }
                start += count;
            }
            Some(squares_left(columns, &solved(columns, y, &kept, 0.0)?, y, &left))
        })
        .collect();
    Some((whole, parts.into_iter().sum::<Option<f64>>()?))
}
