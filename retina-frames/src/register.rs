//! Where a predicted body is in a measured image, to begin with: where the table has it, unless patches of light that are
//! brought together look more alike, turned by some roll.

use std::f64::consts::TAU;

use glam::DVec2;
use rayon::prelude::*;
use retina_geometry::Pinhole;

use crate::grid::{Grid, Spline};
use crate::measured::{Measured, largest_patch};
use crate::place::Origin;
use crate::window::{Pose, Window};

/// Rolls that are tried.
const ROLLS: usize = 72;
/// The tables' own place and roll are taken unless another's correlation is better by this.
const CLEARLY: f64 = 0.02;
/// Cells of the preview across the body.
const ACROSS: f64 = 48.0;

/// A mirrored image is told by what its flipped correlation leaves of 1 beside the straight one's.
const MIRRORED: f64 = 0.6;
/// Correlations that differ by less say nothing of a mirror.
const MIRRORED_LEAST: f64 = 0.004;

/// Why no pose was found.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Lost {
    /// What is wrong.
    Why(&'static str),
    /// Correlations as it is and flipped left to right.
    Mirrored(f64, f64),
}

/// Measured light about its middle, at offsets in cells of a preview.
struct Seen {
    offsets: Vec<DVec2>,
    values: Vec<f64>,
}

/// How a preview is laid on what is seen: turned, moved by cells, flipped.
#[derive(Clone, Copy)]
struct Laid {
    roll_rad: f64,
    shift: DVec2,
    flipped: bool,
}

impl Seen {
    fn correlation(&self, preview: &Spline, middle: DVec2, laid: Laid) -> f64 {
        let turn = DVec2::from_angle(-laid.roll_rad);
        let predicted: Vec<f64> = self
            .offsets
            .iter()
            .map(|offset| {
                let straight = if laid.flipped { DVec2::new(-offset.x, offset.y) } else { *offset };
                preview.at(middle + turn.rotate(straight - laid.shift))
            })
            .collect();
        correlation(&predicted, &self.values)
    }

    /// The best correlation of a preview, over all rolls and then by smaller and smaller steps of roll and shift.
    fn best(&self, preview: &Spline, middle: DVec2, flipped: bool) -> f64 {
        const HALVINGS: usize = 4;
        let at = |laid: Laid| self.correlation(preview, middle, laid);
        let (mut best, mut laid) = (0..ROLLS)
            .into_par_iter()
            .map(|k| Laid { roll_rad: TAU * k as f64 / ROLLS as f64, shift: DVec2::ZERO, flipped })
            .map(|laid| (at(laid), laid))
            .reduce_with(|a, b| if b.0 > a.0 { b } else { a })
            .unwrap_or((-1.0, Laid { roll_rad: 0.0, shift: DVec2::ZERO, flipped }));
        let (mut turn, mut step) = (0.5 * TAU / ROLLS as f64, 1.0);
        for _ in 0..HALVINGS {
            loop {
                let moved = [
                    Laid { roll_rad: laid.roll_rad + turn, ..laid },
                    Laid { roll_rad: laid.roll_rad - turn, ..laid },
                    Laid { shift: laid.shift + DVec2::new(step, 0.0), ..laid },
                    Laid { shift: laid.shift - DVec2::new(step, 0.0), ..laid },
                    Laid { shift: laid.shift + DVec2::new(0.0, step), ..laid },
                    Laid { shift: laid.shift - DVec2::new(0.0, step), ..laid },
                ];
                let next = moved.map(|laid| (at(laid), laid));
                let Some(next) = next.into_iter().max_by(|a, b| a.0.total_cmp(&b.0)) else { break };
                if next.0 <= best {
                    break;
                }
                (best, laid) = next;
            }
            (turn, step) = (0.5 * turn, 0.5 * step);
        }
        best
    }
}

/// The pose by which the prediction's light falls on the measured, or why there is none.
pub(crate) fn find(camera: &Pinhole, origin: &Origin, measured: &Measured) -> Result<Pose, Lost> {
    let lost = Lost::Why;
    let patch = measured.patch().ok_or(lost("the image holds no light"))?;
    let (middle, radius) =
        origin.outline(camera).ok_or(lost("the prediction holds no body in front of the camera"))?;
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
    let own = largest_patch(&preview).ok_or(lost("the predicted body is dark"))?;
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
    let seen_at = |place: DVec2| Seen {
        offsets: offsets.clone(),
        values: offsets.iter().map(|o| mean_over_bin(place + *o * bin)).collect(),
    };
    let seen_there = seen_at(patch.centre);
    let correlations: Vec<f64> = (0..ROLLS)
        .into_par_iter()
        .map(|k| {
            let roll_rad = TAU * k as f64 / ROLLS as f64;
            seen_there.correlation(&spline, from_cells, Laid { roll_rad, shift: DVec2::ZERO, flipped: false })
        })
        .collect();
    let best = (0..ROLLS).max_by(|&a, &b| correlations[a].total_cmp(&correlations[b])).unwrap_or(0);
    let roll = if correlations[best] > correlations[0] + CLEARLY { best } else { 0 };
    // A glow or another body may be the largest patch.
    let as_told = seen_at(middle);
    let told = as_told.correlation(
        &spline,
        DVec2::splat(reach),
        Laid { roll_rad: 0.0, shift: DVec2::ZERO, flipped: false },
    );
    let stays = told + CLEARLY >= correlations[roll];
    if correlations[roll].max(told) < 0.3 {
        return Err(lost("the predicted light looks nothing like the measured"));
    }
    let seen_there = if stays { as_told } else { seen_there };
    // A smooth ball looks the same in a mirror: what lies on it tells.
    let detail = origin.detail(&near, &window);
    if let Some(own) = largest_patch(&detail) {
        let spline = detail.spline();
        let middle = if stays { DVec2::splat(reach) } else { own.centre };
        let [straight, flipped] = [false, true].map(|flipped| seen_there.best(&spline, middle, flipped));
        if 1.0 - flipped < MIRRORED * (1.0 - straight) && flipped - straight > MIRRORED_LEAST {
            return Err(Lost::Mirrored(straight, flipped));
        }
    }
    let from = corner + from_cells * bin;
    match stays {
        true => Ok(Pose { from, to: from, roll_rad: 0.0 }),
        false => Ok(Pose { from, to: patch.centre, roll_rad: TAU * roll as f64 / ROLLS as f64 }),
    }
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
