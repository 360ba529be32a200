//! A measured image: which of its pixels count, and where its light is.

use std::path::Path;

use glam::DVec2;
use retina_files::InputError;
use retina_geometry::Setup;
use retina_image::{CameraImage, Photograph, PhotographOptions, ReadOptions};

use crate::grid::Grid;
use crate::photograph::shared_within_px;
use crate::window::Window;

/// An image with its pixels' states.
pub(crate) struct Measured {
    pub(crate) image: CameraImage,
    /// What was done to make light of a photograph, in words.
    pub(crate) notes: Vec<String>,
    /// Pixels nearer than this share noise, px.
    pub(crate) shared_within_px: f64,
    /// Exposure time by the file's EXIF data, s.
    pub(crate) exposure_s: Option<f64>,
    /// Pixels that count.
    valid: Vec<bool>,
    saturated: Vec<bool>,
    masked: Vec<bool>,
}

/// What a window of an image holds, in bins.
pub(crate) struct Bins {
    /// Means over the bins.
    pub(crate) values: Vec<f64>,
    /// Bins whose pixels all count.
    pub(crate) valid: Vec<bool>,
    /// Pixels of the window left out: saturated, at 0 or beside one that is, masked.
    pub(crate) left_out: [usize; 3],
}

/// A patch of light.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Patch {
    /// Middle of the pixels above the threshold, px.
    pub(crate) centre: DVec2,
    /// Their box: left, top, right, bottom, px.
    pub(crate) bounds: [f64; 4],
}

impl Measured {
    /// Reads an image and its mask (pixels that are not 0 count).
    pub(crate) fn read(path: &Path, mask: Option<&Path>, setup: &Setup) -> Result<Self, InputError> {
        // The setup's camera counts pixels as the sensor does, however a viewer turns them.
        let photograph = Photograph::read(path, PhotographOptions::default())?;
        let (notes, shared_within_px) = (photograph.notes(), shared_within_px(&photograph));
        let exposure_s = photograph.exif.exposure_s;
        let mut image = photograph.image;
        let wanted = [setup.camera.width_px, setup.camera.height_px];
        let check = |file: &Path, what: &str, found: [u32; 2]| {
            if found == wanted {
                return Ok(());
            }
            Err(InputError::new(file, format!("the {what} is not the camera's"))
                .found(format!("{} x {} px", found[0], found[1]))
                .expected(format!("{} x {} px, the setup's camera", wanted[0], wanted[1])))
        };
        check(path, "image", [image.width_px, image.height_px])?;
        // A file of 8 bits ends at 255 whatever the camera has.
        image.full_scale_dn = image.full_scale_dn.min((2f64.powi(setup.camera.bits as i32) - 1.0) as f32);
        let (columns, rows) = (image.width_px as usize, image.height_px as usize);
        let saturated: Vec<bool> = image.values.iter().map(|v| *v >= image.full_scale_dn).collect();
        let mut valid: Vec<bool> = saturated.iter().map(|s| !s).collect();
        // The noise of a dark pixel is cut at 0, so that what is left beside zeros is too bright in the mean.
        for (at, value) in image.values.iter().enumerate() {
            if *value > 0.0 {
                continue;
            }
            let (x, y) = (at % columns, at / columns);
            for j in y.saturating_sub(1)..(y + 2).min(rows) {
                for i in x.saturating_sub(1)..(x + 2).min(columns) {
                    valid[j * columns + i] = false;
                }
            }
        }
        let mut masked = vec![false; valid.len()];
        if let Some(mask) = mask {
            let drawn = CameraImage::read(mask, ReadOptions { bits: None, colour_to_grey: true })?;
            check(mask, "mask", [drawn.width_px, drawn.height_px])?;
            masked = drawn.values.iter().map(|drawn| *drawn == 0.0).collect();
            valid.iter_mut().zip(&masked).for_each(|(valid, masked)| *valid &= !masked);
        }
        Ok(Self { image, notes, shared_within_px, exposure_s, valid, saturated, masked })
    }

    /// The largest patch of light: pixels above a fifth of the way from the background to the bright.
    pub(crate) fn patch(&self) -> Option<Patch> {
        let grid = Grid {
            columns: self.image.width_px as usize,
            rows: self.image.height_px as usize,
            values: self.image.values.clone(),
        };
        largest_patch(&grid)
    }

    /// A window's bins.
    pub(crate) fn bins(&self, window: &Window) -> Bins {
        let width = self.image.width_px as usize;
        let mut out = Bins { values: Vec::new(), valid: Vec::new(), left_out: [0; 3] };
        let norm = (window.bin * window.bin) as f64;
        for row in 0..window.rows {
            for column in 0..window.columns {
                let (mut sum, mut valid) = (0.0, true);
                for j in 0..window.bin {
                    for i in 0..window.bin {
                        let at = (window.top + row * window.bin + j) * width
                            + window.left
                            + column * window.bin
                            + i;
                        sum += f64::from(self.image.values[at]);
                        valid &= self.valid[at];
                        if !self.valid[at] {
                            let why = match (self.masked[at], self.saturated[at]) {
                                (true, _) => 2,
                                (false, true) => 0,
                                (false, false) => 1,
                            };
                            out.left_out[why] += 1;
                        }
                    }
                }
                out.values.push(sum / norm);
                out.valid.push(valid);
            }
        }
        out
    }
}

/// The largest connected patch of cells above a fifth of the way from the median to the brightest thousandth.
pub(crate) fn largest_patch(grid: &Grid) -> Option<Patch> {
    const LEVEL: f32 = 0.2;
    let mut sorted = grid.values.clone();
    let count = sorted.len();
    let mut at =
        |share: f64| *sorted.select_nth_unstable_by(((count - 1) as f64 * share) as usize, f32::total_cmp).1;
    let (dark, mut bright) = (at(0.5), at(0.9995));
    if bright <= dark {
        bright = at(1.0);
    }
    // A body that fills the image has no dark median.
    let dark = if bright < 2.0 * dark { at(0.0) } else { dark };
    if bright <= dark {
        return None;
    }
    largest_patch_above(grid, dark + LEVEL * (bright - dark))
}

/// The largest connected patch of cells above a threshold.
pub(crate) fn largest_patch_above(grid: &Grid, threshold: f32) -> Option<Patch> {
    let count = grid.values.len();
    let mut seen: Vec<bool> = grid.values.iter().map(|v| *v <= threshold).collect();
    let mut best: Option<(usize, Patch)> = None;
    for start in 0..count {
        if seen[start] {
            continue;
        }
        seen[start] = true;
        let mut open = vec![start];
        let (mut cells, mut sum) = (0, DVec2::ZERO);
        let mut bounds = [f64::INFINITY, f64::INFINITY, 0.0, 0.0];
        while let Some(cell) = open.pop() {
            let (x, y) = (cell % grid.columns, cell / grid.columns);
            cells += 1;
            sum += DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
            bounds = [
                bounds[0].min(x as f64),
                bounds[1].min(y as f64),
                bounds[2].max(x as f64 + 1.0),
                bounds[3].max(y as f64 + 1.0),
            ];
            let mut push = |inside: bool, next: usize| {
                if inside && !seen[next] {
                    seen[next] = true;
                    open.push(next);
                }
            };
            push(x > 0, cell.wrapping_sub(1));
            push(x + 1 < grid.columns, cell + 1);
            push(y > 0, cell.wrapping_sub(grid.columns));
            push(y + 1 < grid.rows, cell + grid.columns);
        }
        if best.is_none_or(|(most, _)| cells > most) {
            best = Some((cells, Patch { centre: sum / cells as f64, bounds }));
        }
    }
    best.map(|(_, patch)| patch)
}
