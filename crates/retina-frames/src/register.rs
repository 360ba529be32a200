//! Where a predicted body is in a measured image, to begin with: patches of light brought together, then the roll by
//! which they look alike.

use std::f64::consts::TAU;

use glam::DVec2;
use rayon::prelude::*;
use retina_geometry::Pinhole;

use crate::grid::Grid;
use crate::measured::{Measured, largest_patch};
use crate::place::Origin;
use crate::window::{Pose, Window};

/// Rolls that are tried.
const ROLLS: usize = 72;
/// The tables' own roll is taken unless another's correlation is better by this.
const CLEARLY: f64 = 0.02;
/// Cells of the preview across the body.
const ACROSS: f64 = 48.0;

/// The pose by which the prediction's light falls on the measured, or why there is none.
pub(crate) fn find(camera: &Pinhole, origin: &Origin, measured: &Measured) -> Result<Pose, &'static str> {
    let patch = measured.patch().ok_or("the image holds no light")?;
    let (middle, radius) =
        origin.outline(camera).ok_or("the prediction holds no body in front of the camera")?;
    // A window about the predicted body, wherever it is: coordinates beyond the image do no harm.
    let half = 1.6 * radius + 4.0;
    let bin = (2.0 * half / (1.6 * ACROSS)).ceil().max(1.0);
    let side = (2.0 * half / bin).ceil() as usize;
    let corner = middle - half;
    // The preview's own camera has the window's corner at pixel (0, 0).
    let near = Pinhole { cx_px: camera.cx_px - corner.x, cy_px: camera.cy_px - corner.y, ..*camera };
    let window = Window { left: 0, top: 0, columns: side, rows: side, bin: bin as usize, fine: 1 };
    let preview = origin.preview(&near, &window, &Pose::NOMINAL);
    let spline = preview.spline();
    let own = largest_patch(&preview).ok_or("the predicted body is dark")?;
    let from_cells = own.centre;
    let reach = 0.5 * side as f64;
    let offsets: Vec<DVec2> = (0..side * side)
        .map(|at| DVec2::new((at % side) as f64 + 0.5, (at / side) as f64 + 0.5) - reach)
        .filter(|offset| offset.length() < reach)
        .collect();
    let width = measured.image.width_px as usize;
    let seen = Grid {
        columns: width,
        rows: measured.image.height_px as usize,
        values: measured.image.values.clone(),
    };
    let mean_over_bin = |at_px: DVec2| -> f64 {
        let n = (bin as usize).min(4);
        let mut sum = 0.0;
        for k in 0..n * n {
            let inner = (DVec2::new((k % n) as f64 + 0.5, (k / n) as f64 + 0.5) / n as f64 - 0.5) * bin;
            let at = at_px + inner;
            sum += f64::from(seen.held(at.x.floor() as i64, at.y.floor() as i64));
        }
        sum / (n * n) as f64
    };
    let measured_values: Vec<f64> = offsets.iter().map(|o| mean_over_bin(patch.centre + *o * bin)).collect();
    let correlations: Vec<f64> = (0..ROLLS)
        .into_par_iter()
        .map(|k| {
            let turn = DVec2::from_angle(-TAU * k as f64 / ROLLS as f64);
            let predicted: Vec<f64> =
                offsets.iter().map(|o| spline.at(from_cells + turn.rotate(*o))).collect();
            correlation(&predicted, &measured_values)
        })
        .collect();
    let best = (0..ROLLS).max_by(|&a, &b| correlations[a].total_cmp(&correlations[b])).unwrap_or(0);
    let roll = if correlations[best] > correlations[0] + CLEARLY { best } else { 0 };
    if correlations[roll] < 0.3 {
        return Err("the predicted light looks nothing like the measured");
    }
    Ok(Pose { from: corner + from_cells * bin, to: patch.centre, roll_rad: TAU * roll as f64 / ROLLS as f64 })
}

fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len().max(1) as f64;
    let (ma, mb) = (mean(a), mean(b));
    let (mut ab, mut aa, mut bb) = (0.0, 0.0, 0.0);
    for (x, y) in a.iter().zip(b) {
        ab += (x - ma) * (y - mb);
        aa += (x - ma).powi(2);
        bb += (y - mb).powi(2);
    }
    ab / (aa * bb).sqrt().max(1e-300)
}
