//! The predicted pixel: surface, optics, detector.

use std::f64::consts::TAU;

use glam::{DMat2, DVec2};
use retina_formats::FramesEffect;

use crate::form::{Change, Form, harmonics};
use crate::grid::{Grid, Spline};
use crate::layers::Layers;
use crate::window::Window;

/// An effect that is part of the prediction.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Part {
    pub(crate) id: FramesEffect,
    pub(crate) form: Form,
    pub(crate) values: Vec<f64>,
}

/// What the prediction has beside the images it was made of.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct State {
    /// DN per unit of light, of each frame.
    pub(crate) gain: Vec<f64>,
    pub(crate) offset_dn: f64,
    /// Of each frame, px.
    pub(crate) shift_px: Vec<DVec2>,
    /// About the window's middle.
    pub(crate) roll_rad: f64,
    /// Relative change of size, about the window's middle.
    pub(crate) scale: f64,
    pub(crate) parts: Vec<Part>,
}

/// What a frame's prediction is made of.
pub(crate) struct Sight {
    pub(crate) window: Window,
    pub(crate) layers: Layers,
    /// The camera's principal point and half width, px.
    pub(crate) axis_px: DVec2,
    pub(crate) half_width_px: f64,
    pub(crate) full_scale_dn: f64,
    /// Exposure time, 1 where not known.
    pub(crate) exposure_s: f64,
}

/// Derivatives of images are taken after a blur of this variance, px^2: edges have none.
const SMOOTHED_PX2: f64 = 0.3;

/// Rays of the pupil through which coma is seen: rings of equal area, and directions of twice the pupil's angle.
const COMA_RINGS: usize = 4;
const COMA_ANGLES: usize = 8;

impl Sight {
    /// Digital numbers of light.
    pub(crate) fn detected(&self, frame: usize, state: &State, light: &Grid) -> Vec<f64> {
        let r = |at: usize| self.axis_r(at);
        let mut out: Vec<f64> =
            light.values.iter().map(|light| state.gain[frame] * f64::from(*light)).collect();
        for part in &state.parts {
            let a = part.values[0];
            match part.form.change {
                Change::Vignetting { power } => {
                    out.iter_mut().enumerate().for_each(|(at, dn)| *dn *= 1.0 - a * r(at).powi(power));
                }
                Change::DarkLevel => out.iter_mut().for_each(|dn| *dn += a),
                Change::DarkCurrent => out.iter_mut().for_each(|dn| *dn += a * self.exposure_s),
                _ => {}
            }
        }
        for part in &state.parts {
            let a = part.values[0];
            match part.form.change {
                Change::Nonlinearity => {
                    out.iter_mut().for_each(|dn| *dn += a * *dn * *dn / self.full_scale_dn);
                }
                Change::FullWell { share } => {
                    let well = share * self.full_scale_dn;
                    out.iter_mut().for_each(|dn| *dn += a * (dn.min(well) - *dn));
                }
                _ => {}
            }
        }
        out.iter_mut().for_each(|dn| *dn += state.offset_dn);
        out
    }

    /// Distance of a bin from the axis, 1 at half the camera's width.
    pub(crate) fn axis_r(&self, bin: usize) -> f64 {
        (self.bin_px(bin) - self.axis_px).length() / self.half_width_px
    }

    /// Middle of a bin, px.
    pub(crate) fn bin_px(&self, bin: usize) -> DVec2 {
        let side = self.window.bin as f64;
        let at =
            DVec2::new((bin % self.window.columns) as f64 + 0.5, (bin / self.window.columns) as f64 + 0.5);
        DVec2::new(self.window.left as f64, self.window.top as f64) + side * at
    }

    fn middle_r(&self) -> (f64, DVec2) {
        let from_axis = (self.window.middle() - self.axis_px) / self.half_width_px;
        (from_axis.length(), from_axis.normalize_or_zero())
    }

    pub(crate) fn surface(&self, parts: &[Part]) -> Grid {
        let layers = &self.layers;
        let mut out = layers.light.clone();
        for part in parts {
            if let (Change::Relief, Some(mesh)) = (part.form.change, &layers.mesh) {
                let share = part.values[0] as f32;
                out = out.map2(&mesh.light, |smooth, mesh| (1.0 - share) * smooth + share * mesh);
            }
        }
        for part in parts {
            match part.form.change {
                Change::Law(law) => {
                    if let Some(ratios) = layers.ratios(&law, has(parts, Change::Relief)) {
                        let share = part.values[0];
                        // Both laws give the same light in all: the gain keeps its meaning.
                        let (mut before, mut after) = (0.0, 0.0);
                        for (light, ratio) in out.values.iter().zip(ratios.iter()) {
                            before += f64::from(*light);
                            after += f64::from(*light * ratio);
                        }
                        let norm = if after > 0.0 { before / after } else { 1.0 };
                        for (light, ratio) in out.values.iter_mut().zip(ratios.iter()) {
                            *light *= (1.0 + share * (norm * f64::from(*ratio) - 1.0)) as f32;
                        }
                    }
                }
                Change::Map { power } => {
                    if let Some(map) = &layers.map {
                        let contrast = part.values[0];
                        let (power, contrast) = (power as f32, contrast as f32);
                        out = out
                            .map2(map, |light, t| light * (1.0 + contrast * (t.max(0.0).powf(power) - 1.0)));
                    }
                }
                Change::Harmonics => {
                    if let Some(places) = &layers.place_rad {
                        for (light, place) in out.values.iter_mut().zip(places) {
                            if place[0].is_finite() && *light > 0.0 {
                                let values = harmonics(f64::from(place[0]), f64::from(place[1]));
                                let sum: f64 = values.iter().zip(&part.values).map(|(y, c)| y * c).sum();
                                *light *= (1.0 + sum) as f32;
                            }
                        }
                    }
                }
                Change::Shadow => {
                    if let Some(mesh) = &layers.mesh {
                        let share = part.values[0] as f32;
                        out = out.map2(&mesh.shadow, |light, shadow| light * (1.0 - share * shadow));
                    }
                }
                _ => {}
            }
        }
        out
    }

    /// Moved in the camera's image; cells beyond the edge are the edge's.
    pub(crate) fn moved(&self, cells: &Spline, shift_px: DVec2, roll_rad: f64, scale: f64) -> Grid {
        let [columns, rows] = cells.size();
        let middle = 0.5 * DVec2::new(columns as f64, rows as f64);
        let back = DMat2::from_angle(-roll_rad) * (1.0 / (1.0 + scale));
        let shift = shift_px * self.window.cells_per_px();
        Grid::from_fn(columns, rows, |x, y| {
            let at = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
            cells.at(middle + back * (at - middle - shift)) as f32
        })
    }

    pub(crate) fn through_optics(&self, cells: &Grid, part: &Part) -> Grid {
        let a = part.values[0];
        let per_px = self.window.cells_per_px();
        let (r, radial) = self.middle_r();
        match part.form.change {
            Change::Blur => cells.blurred(a.max(0.0) * per_px * per_px),
            Change::FieldBlur => {
                // The width at the window's outermost pixel, taken in by r^4.
                let window = &self.window;
                let corners = [
                    0,
                    window.columns - 1,
                    (window.rows - 1) * window.columns,
                    window.rows * window.columns - 1,
                ];
                let most = corners.into_iter().map(|bin| self.axis_r(bin)).fold(0.0, f64::max).max(1e-6);
                let wide = cells.blurred(a.max(0.0) * most.powi(4) * per_px * per_px);
                let fine = window.fine;
                Grid::from_fn(cells.columns, cells.rows, |x, y| {
                    let share = (self.axis_r(y / fine * window.columns + x / fine) / most).powi(4) as f32;
                    let at = y * cells.columns + x;
                    cells.values[at] + share * (wide.values[at] - cells.values[at])
                })
            }
            Change::Coma => self.comatic(cells, a),
            Change::Astigmatism => {
                let [xx, xy, yy] = second(&cells.blurred(SMOOTHED_PX2 * per_px * per_px));
                // Second derivatives along and across the radius: a turn by twice its angle.
                let (c, s) = (radial.x * radial.x - radial.y * radial.y, 2.0 * radial.x * radial.y);
                let difference = xx.map2(&yy, |a, b| a - b);
                let turned = difference.map2(&xy, |d, m| (c * f64::from(d) + 2.0 * s * f64::from(m)) as f32);
                let factor = (0.5 * a * r * r * per_px * per_px) as f32;
                cells.map2(&turned, |light, d| light + factor * d)
            }
            _ => cells.clone(),
        }
    }

    /// Through Seidel's coma (W. J. Smith, Modern Optical Engineering, ch. 3): a ray at rho, theta in the pupil meets the
    /// image at c r (rho^2 (2 + cos 2 theta) along the radius, rho^2 sin 2 theta across), in px, with r from the axis,
    /// 1 at half the camera's width. The rays' mean, c r, is left out: the pose has it.
    fn comatic(&self, cells: &Grid, c: f64) -> Grid {
        let rays: Vec<DVec2> = (0..COMA_RINGS * COMA_ANGLES)
            .map(|k| {
                let rho2 = ((k / COMA_ANGLES) as f64 + 0.5) / COMA_RINGS as f64;
                let twice_theta = TAU * ((k % COMA_ANGLES) as f64 + 0.5) / COMA_ANGLES as f64;
                DVec2::new(rho2 * (2.0 + twice_theta.cos()) - 1.0, rho2 * twice_theta.sin())
            })
            .collect();
        let per_px = self.window.cells_per_px();
        let corner = DVec2::new(self.window.left as f64, self.window.top as f64);
        let spline = cells.spline();
        Grid::from_fn(cells.columns, cells.rows, |x, y| {
            let at = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
            // From the axis, over half the width: its length is r and its direction the radius.
            let radius = (corner + at / per_px - self.axis_px) / self.half_width_px;
            let sum: f64 = rays.iter().map(|ray| spline.at(at - c * per_px * radius.rotate(*ray))).sum();
            (sum / rays.len() as f64) as f32
        })
    }

    /// Light that goes astray over many pixels.
    pub(crate) fn scattered(&self, bins: &Grid, part: &Part) -> Grid {
        let a = part.values[0] as f32;
        match part.form.change {
            Change::Glare { width_px } => {
                // A core with wings: three Gaussians, each twice as wide as the one before.
                let mut halo = Grid::new(bins.columns, bins.rows);
                for (k, weight) in [(1.0, 0.5), (2.0, 0.3), (4.0, 0.2)] {
                    let sigma = k * width_px / self.window.bin as f64;
                    halo = halo.map2(&bins.blurred(sigma * sigma), |sum, v| sum + weight * v);
                }
                bins.map2(&halo, |light, halo| light + a * (halo - light))
            }
            Change::MeanGlare => {
                let mean = bins.values.iter().sum::<f32>() / bins.values.len() as f32;
                Grid { values: bins.values.iter().map(|light| light + a * mean).collect(), ..*bins }
            }
            Change::Ghost => {
                let window = &self.window;
                let spline = bins.spline();
                Grid::from_fn(bins.columns, bins.rows, |x, y| {
                    let at = y * bins.columns + x;
                    let mirrored = 2.0 * self.axis_px - self.bin_px(at);
                    let cell =
                        (mirrored - DVec2::new(window.left as f64, window.top as f64)) / window.bin as f64;
                    let inside = cell.cmpge(DVec2::ZERO).all()
                        && cell.x < bins.columns as f64
                        && cell.y < bins.rows as f64;
                    bins.values[at] + if inside { a * spline.at(cell) as f32 } else { 0.0 }
                })
            }
            _ => bins.clone(),
        }
    }
}

fn has(parts: &[Part], change: Change) -> bool {
    parts.iter().any(|part| part.form.change == change && part.values[0] > 0.5)
}

/// Second derivatives: xx, xy, yy.
fn second(grid: &Grid) -> [Grid; 3] {
    let at = |f: &dyn Fn(i64, i64) -> f32| {
        let mut out = Grid::new(grid.columns, grid.rows);
        for y in 0..grid.rows {
            for x in 0..grid.columns {
                out.values[y * grid.columns + x] = f(x as i64, y as i64);
            }
        }
        out
    };
    let v = |x: i64, y: i64| grid.held(x, y);
    [
        at(&|x, y| v(x + 1, y) - 2.0 * v(x, y) + v(x - 1, y)),
        at(&|x, y| 0.25 * (v(x + 1, y + 1) - v(x - 1, y + 1) - v(x + 1, y - 1) + v(x - 1, y - 1))),
        at(&|x, y| v(x, y + 1) - 2.0 * v(x, y) + v(x, y - 1)),
    ]
}
