//! Light where it should not be: ghosts and veiling glare.
//!
//! A ghost (two reflections between lens surfaces) takes a direction on the screen to s = g theta and spreads
//! a pencil over a disc there; seen from the camera, a screen point shines at theta = s / g through a disc
//! of the pencil's radius over g. Both figures are traced: a chief ray off the axis and the pencil on it.

use glam::DVec2;
use rayon::prelude::*;
use retina_geometry::Setup;
use retina_optics::analysis::ghosts;
use retina_optics::{Clipping, Launcher, OpticalSystem, Tracer};

use super::{CameraPose, Landed};
use crate::BenchError;

/// Ghosts wider than this share of the sensor's height are glare.
const WIDEST: f64 = 0.5;
/// Cell of the grid on which ghosts are laid, pixels: they are smooth.
const CELL_PX: usize = 8;
/// Ghosts that make less than this in any pixel are not laid, electrons.
const NEGLIGIBLE_E: f64 = 0.02;
/// A tangent at which the ghosts' chief rays are traced.
const CHIEF_TAN: f64 = 0.02;

struct Ghost {
    /// Its share of the light.
    share: f64,
    /// Direction it shines at, over that of its source.
    scale: f64,
    /// Radius of its disc, px.
    radius_px: f64,
}

/// Stray light of a bench.
pub(super) struct Ghosts {
    ghosts: Vec<Ghost>,
    /// Share of the light that is spread evenly over the image.
    glare: f64,
}

impl Ghosts {
    /// `beyond`: light that the kernels do not hold.
    pub(super) fn new(system: &OpticalSystem, setup: &Setup, beyond: f64) -> Result<Self, BenchError> {
        let pinhole = setup.camera_pinhole();
        let facility_mm = 1.0 / retina_optics::paraxial::Paraxial::primary(system)?.power();
        let launcher = Launcher::new(system)?;
        let mut found = Vec::new();
        let mut glare = setup.optics.veiling_glare + beyond;
        for ghost in ghosts(system, Some(setup.optics.coating_reflectance))? {
            let share = ghost.reflectance * ghost.transmitted;
            if share <= 0.0 {
                continue;
            }
            let tracer =
                Tracer::ghost(system, system.primary_nm(), Clipping::Off, ghost.first - 1, ghost.second - 1)?;
            let ray = launcher.ray([CHIEF_TAN, 0.0], [0.0, 0.0])?;
            let lands = tracer.trace_to_image(&ray).ok().map(|hit| hit.local_mm.x / CHIEF_TAN);
            let disc = lands.and_then(|g| {
                let rms_mm = ghost.rms_radius_mm?;
                // A disc's rms radius is its radius over sqrt(2).
                let radius_px = 2f64.sqrt() * rms_mm / g.abs() * pinhole.fx_px;
                Some((facility_mm / g, radius_px))
                    .filter(|(scale, radius)| scale.is_finite() && radius.is_finite())
            });
            match disc {
                Some((scale, radius_px)) if radius_px < WIDEST * f64::from(pinhole.height_px) => {
                    found.push(Ghost { share, scale, radius_px });
                }
                _ => glare += share,
            }
        }
        Ok(Self { ghosts: found, glare })
    }

    /// The stray light of a screen image.
    pub(super) fn of(&self, [width, height]: [usize; 2], camera: &CameraPose, landed: &Landed) -> Stray {
        let total = landed.total_e();
        let mut even = total * self.glare / (width * height) as f64;
        // All light in one place would make this of a ghost; below it a ghost is as good as glare.
        let counts = |ghost: &&Ghost| {
            total * ghost.share / (std::f64::consts::PI * ghost.radius_px.max(1.0).powi(2)) > NEGLIGIBLE_E
        };
        let faint = self.ghosts.iter().filter(|ghost| !counts(ghost)).map(|ghost| ghost.share).sum::<f64>();
        even += total * faint / (width * height) as f64;
        let even = even as f32;
        let cells = [width.div_ceil(CELL_PX), height.div_ceil(CELL_PX)];
        let centre = DVec2::new(camera.pinhole.cx_px, camera.pinhole.cy_px);
        // The light on the coarse grid once; each ghost lays the lit cells.
        let cell_of = |at: DVec2| {
            let cell = at / CELL_PX as f64;
            let on = cell.x >= 0.0 && cell.y >= 0.0 && cell.x < cells[0] as f64 && cell.y < cells[1] as f64;
            on.then(|| cell.y as usize * cells[0] + cell.x as usize)
        };
        let lit = match landed {
            Landed::Scene(light) => light.binned([width, height], CELL_PX),
            Landed::Points(sources) => {
                let mut lit = vec![0f64; cells[0] * cells[1]];
                for source in sources {
                    if let Some(cell) = cell_of(source.at_px) {
                        lit[cell] += source.electrons;
                    }
                }
                lit
            }
        };
        let mut stray = vec![even; cells[0] * cells[1]];
        let lay = |other: &mut Vec<f32>, ghost: &Ghost| {
            let mut laid = vec![0f32; cells[0] * cells[1]];
            for (cell, &electrons) in lit.iter().enumerate().filter(|(_, electrons)| **electrons > 0.0) {
                let at = DVec2::new((cell % cells[0]) as f64 + 0.5, (cell / cells[0]) as f64 + 0.5)
                    * CELL_PX as f64;
                if let Some(cell) = cell_of(centre + (at - centre) * ghost.scale) {
                    laid[cell] += (electrons * ghost.share) as f32 / (CELL_PX * CELL_PX) as f32;
                }
            }
            spread(&mut laid, other, cells, ghost.radius_px / CELL_PX as f64);
            laid
        };
        // Added in their order, so that sums do not depend on threads.
        let kept: Vec<&Ghost> = self.ghosts.iter().filter(counts).collect();
        for laid in kept.par_iter().map_init(Vec::new, |other, ghost| lay(other, ghost)).collect::<Vec<_>>() {
            stray.iter_mut().zip(laid).for_each(|(sum, value)| *sum += value);
        }
        if kept.is_empty() { Stray::Even(even) } else { Stray::Cells { columns: cells[0], electrons: stray } }
    }
}

/// Stray light of one screen image, electrons a pixel.
pub(crate) enum Stray {
    /// The same everywhere.
    Even(f32),
    /// At the centres of cells, row by row.
    Cells { columns: usize, electrons: Vec<f32> },
}

impl Stray {
    /// Adds it to a row of the image; `line` is work space.
    #[inline(always)]
    pub(crate) fn add_to_row(&self, y: usize, row: &mut [f32], line: &mut Vec<f32>) {
        let (columns, electrons) = match self {
            Self::Even(even) => return row.iter_mut().for_each(|value| *value += even),
            Self::Cells { columns, electrons } => (*columns, electrons),
        };
        // Bilinear between the cells' centres: a row of cells at this height, then along it.
        let rows = electrons.len() / columns;
        let v = ((y as f32 + 0.5) / CELL_PX as f32 - 0.5).clamp(0.0, (rows - 1) as f32);
        let above = (v as usize).min(rows.saturating_sub(2));
        let below = (above + 1).min(rows - 1);
        let fy = v - above as f32;
        let (above, below) =
            (&electrons[above * columns..][..columns], &electrons[below * columns..][..columns]);
        line.clear();
        line.extend(above.iter().zip(below).map(|(above, below)| above + fy * (below - above)));
        let half = (CELL_PX / 2).min(row.len());
        let (first, rest) = row.split_at_mut(half);
        first.iter_mut().for_each(|value| *value += line[0]);
        // Of cells whose size the compiler knows it makes vectors.
        let (cells, last) = rest.as_chunks_mut::<CELL_PX>();
        let ends = |i: usize| (line[i], line[(i + 1).min(columns - 1)]);
        let whole = cells.len();
        cells.iter_mut().enumerate().for_each(|(i, cell)| add_slope(cell, ends(i)));
        if !last.is_empty() {
            add_slope(last, ends(whole));
        }
    }
}

/// Adds to pixels from a cell's centre on what goes evenly from there to the next one's.
#[inline(always)]
fn add_slope(pixels: &mut [f32], (from, to): (f32, f32)) {
    for (k, value) in pixels.iter_mut().enumerate() {
        *value += from + (to - from) * ((k as f32 + 0.5) / CELL_PX as f32);
    }
}

/// Spreads light over discs by three passes of boxes along each axis, of the same second moment: r^2 / 4 an axis.
/// `other` is work space.
fn spread(light: &mut Vec<f32>, other: &mut Vec<f32>, [width, height]: [usize; 2], radius: f64) {
    // A box of w cells has (w^2 - 1) / 12.
    let box_half = (0.5 * ((12.0 * radius * radius / 4.0 / 3.0 + 1.0).sqrt() - 1.0)).round() as usize;
    if box_half == 0 {
        return;
    }
    for [columns, rows] in [[width, height], [height, width]] {
        other.resize(light.len(), 0.0);
        for _ in 0..3 {
            box_along_columns(light, other, columns, box_half.min(rows));
            std::mem::swap(light, other);
        }
        transpose(light, other, columns);
        std::mem::swap(light, other);
    }
}

/// Means over 2 `half` + 1 rows, a row at a time: whole rows are added to a running sum, and taken from it. Roundings add up
/// to a few 1e-6 of the largest sum.
fn box_along_columns(from: &[f32], to: &mut [f32], columns: usize, half: usize) {
    let rows = from.len() / columns;
    let row = |y: usize| &from[y * columns..(y + 1) * columns];
    let mut sum = vec![0.0; columns];
    for y in 0..half.min(rows) {
        sum.iter_mut().zip(row(y)).for_each(|(sum, value)| *sum += value);
    }
    let share = 1.0 / (2 * half + 1) as f32;
    for (y, to) in to.chunks_exact_mut(columns).enumerate() {
        if y + half < rows {
            sum.iter_mut().zip(row(y + half)).for_each(|(sum, value)| *sum += value);
        }
        if let Some(gone) = y.checked_sub(half + 1) {
            sum.iter_mut().zip(row(gone)).for_each(|(sum, value)| *sum -= value);
        }
        to.iter_mut().zip(&sum).for_each(|(to, sum)| *to = sum * share);
    }
}

fn transpose(from: &[f32], to: &mut [f32], columns: usize) {
    let rows = from.len() / columns;
    for (y, row) in from.chunks_exact(columns).enumerate() {
        for (x, value) in row.iter().enumerate() {
            to[x * rows + y] = *value;
        }
    }
}
