//! The two passes over a tile.

use glam::DVec2;

use super::Listed;
use super::Listing;
use super::frame::{Prepared, Tile};
use super::pixels::{Pixel, PixelWork, View, disc_points, square_point};
use super::rays::LANES;
use super::visibility::{Draw, Samples, Setup};
use crate::Quality;

/// How many samples pixels get, as powers of two.
pub(crate) struct Sampling {
    first_log2: u32,
    /// Rays of a pixel of the first pass where there is doubt about the Sun.
    pub(crate) probes: u32,
    edge_log2: u32,
    inner_log2: u32,
    /// A pixel is refined when its fragments differ by more than this part of the body's mean radiance factor: its
    /// samples give their areas to some per cent.
    pub(crate) contrast: f64,
}

impl Sampling {
    pub(crate) fn of(quality: Quality) -> Self {
        match quality {
            Quality::Draft => Self { first_log2: 2, probes: 4, edge_log2: 5, inner_log2: 4, contrast: 0.5 },
            Quality::Default => {
                Self { first_log2: 4, probes: 8, edge_log2: 8, inner_log2: 6, contrast: 0.03 }
            }
            Quality::Best => Self { first_log2: 6, probes: 16, edge_log2: 8, inner_log2: 8, contrast: 0.01 },
        }
    }
}

/// Work space of one thread.
#[derive(Default)]
pub(crate) struct TileWork {
    samples: Samples,
    setups: Vec<Setup>,
    /// What is to be drawn: see [`Draw`].
    runs: Vec<[u32; 3]>,
    pixels: PixelWork,
}

/// Reference of a tile: where lines of sight are counted from.
struct Reference {
    centre_px: DVec2,
    sight: DVec2,
}

impl Reference {
    fn of(frame: &Prepared<'_>, tile: &Tile) -> Self {
        let corner = DVec2::new(f64::from(tile.origin[0]), f64::from(tile.origin[1]));
        let centre_px = corner + 0.5 * DVec2::new(f64::from(tile.size[0]), f64::from(tile.size[1]));
        Self { centre_px, sight: frame.sight(centre_px) }
    }
}

impl TileWork {
    /// The pixels of a tile, row by row.
    pub(crate) fn first_pass(
        &mut self,
        frame: &Prepared<'_>,
        index: usize,
        sampling: &Sampling,
        layers: bool,
    ) -> Vec<Pixel> {
        let tile = frame.tile(index);
        let [width, height] = tile.size.map(|side| side as usize);
        let triangles = frame.triangles(index);
        if triangles.is_empty() {
            return vec![Pixel::SKY; width * height];
        }
        let reference = Reference::of(frame, &tile);
        let n = 1usize << sampling.first_log2;
        self.samples.clear(width * height * n);
        let all = (0..(width * height) as u32).enumerate();
        self.place(frame, &tile, &reference, sampling.first_log2, all);
        self.setups.clear();
        self.runs.clear();
        for triangle in triangles {
            let setup = Setup::new(frame, triangle.triangle, reference.sight);
            let (from, to) = (triangle.low[0] as usize, (triangle.high[0] as usize + 1).min(width));
            for row in triangle.low[1] as usize..=(triangle.high[1] as usize).min(height - 1) {
                let run = [(row * width + from) * n, (row * width + to) * n, self.setups.len()];
                self.runs.push(run.map(|number| number as u32));
            }
            self.setups.push(setup);
        }
        self.pixels.begin(self.setups.len());
        frame.level.run(Draw { samples: &mut self.samples, setups: &self.setups, runs: &self.runs });
        let mut view = View {
            frame,
            setups: &self.setups,
            samples: &self.samples,
            sight: reference.sight.as_vec2().to_array(),
            layers,
            disc_points: &[],
            pixel: 0,
        };
        let mut out = Vec::with_capacity(width * height);
        for local in 0..width * height {
            view.pixel = pixel_number(frame, &tile, local as u32);
            out.push(self.pixels.first(&view, local * n..(local + 1) * n));
        }
        out
    }

    /// Listed pixels anew, with their numbers in the tile.
    pub(crate) fn second_pass(
        &mut self,
        frame: &Prepared<'_>,
        index: usize,
        list: &[Listed],
        sampling: &Sampling,
        layers: bool,
    ) -> Vec<(u32, Pixel)> {
        let mut out = Vec::with_capacity(list.len());
        for (what, n_log2) in [(Listing::Edge, sampling.edge_log2), (Listing::Inner, sampling.inner_log2)] {
            let chosen: Vec<u32> =
                list.iter().filter(|listed| listed.what == what).map(|listed| listed.local).collect();
            // A few at a time, so that their samples stay near the processor.
            for some in chosen.chunks(64) {
                self.sample_again(frame, index, some, n_log2, layers, &mut out);
            }
        }
        out
    }

    fn sample_again(
        &mut self,
        frame: &Prepared<'_>,
        index: usize,
        chosen: &[u32],
        n_log2: u32,
        layers: bool,
        out: &mut Vec<(u32, Pixel)>,
    ) {
        let tile = frame.tile(index);
        let reference = Reference::of(frame, &tile);
        let n = 1usize << n_log2;
        self.samples.clear(chosen.len() * n);
        self.place(frame, &tile, &reference, n_log2, chosen.iter().copied().enumerate());
        // For each row the listed pixels in it, by their order in `chosen`.
        let width = tile.size[0];
        let mut rows: Vec<Vec<(u8, usize)>> = vec![Vec::new(); tile.size[1] as usize];
        for (slot, &local) in chosen.iter().enumerate() {
            rows[(local / width) as usize].push(((local % width) as u8, slot));
        }
        self.setups.clear();
        self.runs.clear();
        for triangle in frame.triangles(index) {
            let mut setup = None;
            for row in triangle.low[1]..=triangle.high[1] {
                let Some(row) = rows.get(row as usize) else { continue };
                for &(column, slot) in row {
                    if column >= triangle.low[0] && column <= triangle.high[0] {
                        setup.get_or_insert_with(|| Setup::new(frame, triangle.triangle, reference.sight));
                        let run = [slot * n, (slot + 1) * n, self.setups.len()];
                        self.runs.push(run.map(|number| number as u32));
                    }
                }
            }
            self.setups.extend(setup);
        }
        self.pixels.begin(self.setups.len());
        frame.level.run(Draw { samples: &mut self.samples, setups: &self.setups, runs: &self.runs });
        let points = disc_points(n as u32);
        let mut view = View {
            frame,
            setups: &self.setups,
            samples: &self.samples,
            sight: reference.sight.as_vec2().to_array(),
            layers,
            disc_points: &points,
            pixel: 0,
        };
        for (slot, &local) in chosen.iter().enumerate() {
            view.pixel = pixel_number(frame, &tile, local);
            let planes = self.pixels.refined(&view, slot * n..(slot + 1) * n);
            out.push((local, Pixel { planes, ..Pixel::SKY }));
        }
    }

    /// Sets the samples' lines of sight: those of the pixel in slot k begin at k * 2^n_log2.
    fn place(
        &mut self,
        frame: &Prepared<'_>,
        tile: &Tile,
        reference: &Reference,
        n_log2: u32,
        pixels: impl Iterator<Item = (usize, u32)>,
    ) {
        let n = 1usize << n_log2;
        let points: Vec<[f32; 2]> = (0..n as u32).map(|k| square_point(k, n_log2).to_array()).collect();
        let [inverse_fx, inverse_fy] = frame.inverse_focal_px;
        // From the tile's middle to its corner.
        let corner = DVec2::new(f64::from(tile.origin[0]), f64::from(tile.origin[1])) - reference.centre_px;
        let (corner_x, corner_y) = (corner.x as f32, corner.y as f32);
        for (slot, local) in pixels {
            let (x, y) = ((local % tile.size[0]) as f32, (local / tile.size[0]) as f32);
            let run = slot * n..(slot + 1) * n;
            let places = self.samples.x[run.clone()].iter_mut().zip(&mut self.samples.y[run]);
            for ((to_x, to_y), [px, py]) in places.zip(&points) {
                *to_x = (corner_x + x + px) * inverse_fx;
                *to_y = (corner_y + y + py) * inverse_fy;
            }
        }
        if let Some(distortion) = &frame.state.distortion {
            let middle = frame.state.image.line_of_sight(reference.centre_px).as_vec2();
            let sight = reference.sight.as_vec2();
            let coefficients: Vec<[f32; 2]> =
                distortion.coefficients().iter().map(|c| c.as_vec2().to_array()).collect();
            let lanes = self.samples.x.chunks_mut(LANES).zip(self.samples.y.chunks_mut(LANES));
            for (x, y) in lanes {
                bend(distortion.degree() as usize, &coefficients, middle.to_array(), sight.to_array(), x, y);
            }
        }
    }
}

/// Undistorted places about `middle` become lines of sight about `sight`: Horner in x of Horner in y.
#[inline(always)]
fn bend(
    degree: usize,
    coefficients: &[[f32; 2]],
    middle: [f32; 2],
    sight: [f32; 2],
    x: &mut [f32],
    y: &mut [f32],
) {
    let count = x.len().min(LANES);
    let (mut at_x, mut at_y) = ([0.0f32; LANES], [0.0f32; LANES]);
    at_x[..count].copy_from_slice(&x[..count]);
    at_y[..count].copy_from_slice(&y[..count]);
    for k in 0..LANES {
        at_x[k] += middle[0];
        at_y[k] += middle[1];
    }
    let (mut sum_x, mut sum_y) = ([0.0f32; LANES], [0.0f32; LANES]);
    let mut index = coefficients.len();
    for i in 0..=degree {
        let (mut row_x, mut row_y) = ([0.0f32; LANES], [0.0f32; LANES]);
        for _ in 0..=i {
            index -= 1;
            let [cx, cy] = coefficients[index];
            for k in 0..LANES {
                row_x[k] = row_x[k] * at_y[k] + cx;
                row_y[k] = row_y[k] * at_y[k] + cy;
            }
        }
        for k in 0..LANES {
            sum_x[k] = sum_x[k] * at_x[k] + row_x[k];
            sum_y[k] = sum_y[k] * at_x[k] + row_y[k];
        }
    }
    for k in 0..count {
        x[k] = sum_x[k] - sight[0];
        y[k] = sum_y[k] - sight[1];
    }
}

/// A pixel's number in the image.
fn pixel_number(frame: &Prepared<'_>, tile: &Tile, local: u32) -> u32 {
    (tile.origin[1] + local / tile.size[0]) * frame.state.image.width_px
        + tile.origin[0]
        + local % tile.size[0]
}
