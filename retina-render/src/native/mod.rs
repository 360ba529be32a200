//! The native renderer: f32 on the processor's cores, for machines without a graphics processor.
//!
//! 1. `frame`: vertices are projected, triangles that face the camera sorted into tiles of 16 x 16 pixels.
//! 2. First pass, a tile at a time: `coverage` measures how much of the pixel each triangle fills. Where they do not make up
//!    the pixel, `visibility` finds the triangle that each sample (`places`) sees. `shade` shades each triangle once a
//!    pixel, in its middle there, by the body's `law`; `sums` adds them up, with textures read at the places of `reads`.
//!    Where relief (bounded beforehand, `arrays::horizon`) or another body may stand before the Sun, a packet of eight
//!    rays from the pixel to the Sun's disc probes it (`pixels`).
//! 3. A pixel on an edge of visibility or of a shadow, itself or a neighbour, is listed.
//! 4. Second pass: listed pixels are sampled anew, each sample with a Sun ray of its own where there is doubt.
//!
//! Sums run in a fixed order and the arithmetic is the same on every processor: so are the bytes.

mod coverage;
mod frame;
mod law;
mod pixels;
mod places;
mod rays;
mod reads;
mod shade;
mod sums;
mod texture;
mod tiles;
mod visibility;

use glam::DVec2;
use rayon::prelude::*;
use retina_radiometry::Photometry;
use retina_simd::Level;

use crate::arrays::SceneArrays;
use crate::placing;
use crate::small::Window;
use crate::{BodyModel, FrameState, Planes, Quality, RadianceImage};
use frame::Prepared;
use pixels::{Owner, Pixel, Sunlit};
use tiles::{Sampling, TileWork};

/// A renderer of one set of bodies on the processor's cores.
pub struct NativeRenderer {
    arrays: SceneArrays,
    photometry: Vec<Photometry>,
    sampling: Sampling,
    planes: Planes,
    level: Level,
}

impl NativeRenderer {
    /// Prepares the bodies: the hierarchy that rays walk, and how high the relief stands everywhere.
    pub fn new(models: &[BodyModel], quality: Quality, planes: Planes) -> Self {
        let photometry = models.iter().map(|model| model.photometry).collect();
        Self {
            arrays: SceneArrays::new(models),
            photometry,
            sampling: Sampling::of(quality),
            planes,
            level: Level::detect(),
        }
    }

    /// The same renderer without the processor's wider vectors: slower, the same bytes.
    pub fn portable(self) -> Self {
        Self { level: Level::PORTABLE, ..self }
    }

    /// The vector instructions in use: `AVX-512`, `AVX2` or `portable`.
    pub fn instructions(&self) -> &'static str {
        self.level.set().name()
    }

    /// Renders a frame.
    pub fn render(&self, state: &FrameState) -> RadianceImage {
        let radii_m: Vec<f64> = self.arrays.ranges.iter().map(|range| range.bounding_radius_m).collect();
        match Window::of(state, &radii_m) {
            Some((window, enlarged)) => window.place(&self.render_as_is(&enlarged)),
            None => self.render_as_is(state),
        }
    }

    fn render_as_is(&self, state: &FrameState) -> RadianceImage {
        let (width, height) = (state.image.width_px, state.image.height_px);
        let pixels = width as usize * height as usize;
        let mut image = RadianceImage {
            width_px: width,
            height_px: height,
            data: vec![0.0; pixels * self.planes.count()],
            photocentre_px: None,
        };
        let Some(region) = placing::region(state, &self.arrays.ranges) else { return image };
        let (sampling, level) = (&self.sampling, self.level);
        let layers = self.planes == Planes::Layers;
        let (arrays, photometry) = (&self.arrays, &self.photometry);
        let frame = Prepared::new(arrays, photometry, state, region, sampling.contrast, level, layers);
        let tiles: Vec<Vec<Pixel>> = (0..frame.tile_count())
            .into_par_iter()
            .map_init(TileWork::default, |work, tile| work.first_pass(&frame, tile, sampling, layers))
            .collect();
        let lists = list(&frame, &tiles);
        let refined: Vec<Vec<(u32, Pixel)>> = lists
            .par_iter()
            .enumerate()
            .map_init(TileWork::default, |work, (tile, list)| {
                work.second_pass(&frame, tile, list, sampling, layers)
            })
            .collect();
        let planes = self.planes.count();
        let mut store = |at: usize, pixel: &Pixel| {
            for plane in 0..planes {
                image.data[plane * pixels + at] = pixel.planes[plane];
            }
        };
        for (index, tile_pixels) in tiles.iter().enumerate() {
            let tile = frame.tile(index);
            let at = |local: u32| {
                let [x, y] = tile.pixel(local);
                y as usize * width as usize + x as usize
            };
            for (local, pixel) in (0u32..).zip(tile_pixels) {
                if pixel.owner != Owner::Sky {
                    store(at(local), pixel);
                }
            }
            for (local, pixel) in &refined[index] {
                store(at(*local), pixel);
            }
            for listed in lists[index].iter().filter(|listed| listed.what == Listing::Dark) {
                store(at(listed.local), &tile_pixels[listed.local as usize].in_shadow());
            }
        }
        image
    }
}

/// A pixel that is sampled anew, by its number in the tile.
#[derive(Clone, Copy)]
pub(crate) struct Listed {
    local: u32,
    what: Listing,
}

/// Why a pixel is listed.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Listing {
    /// On an edge of visibility.
    Edge,
    /// Within a body, on a shadow's edge or of much contrast.
    Inner,
    /// In shadow as a whole: nothing is sampled.
    Dark,
}

/// For each tile the pixels that the second pass takes.
fn list(frame: &Prepared<'_>, tiles: &[Vec<Pixel>]) -> Vec<Vec<Listed>> {
    let [width, height] = frame.region.size;
    let (wide, high) = (width as usize, height as usize);
    // What neighbours are asked for, by rows of the region.
    let mut owners = vec![Owner::Sky; wide * high];
    let mut lights = vec![Sunlit::UNSEEN; wide * high];
    for (index, pixels) in tiles.iter().enumerate() {
        let tile = frame.tile(index);
        let x = (tile.origin[0] - frame.region.origin[0]) as usize;
        let y = (tile.origin[1] - frame.region.origin[1]) as usize;
        for (row, pixels) in pixels.chunks(tile.size[0] as usize).enumerate() {
            for (column, pixel) in pixels.iter().enumerate() {
                let at = (y + row) * wide + x + column;
                owners[at] = pixel.owner;
                lights[at] = pixel.light;
            }
        }
    }
    (0..tiles.len())
        .into_par_iter()
        .map(|index| {
            let tile = frame.tile(index);
            let mut out = Vec::new();
            if frame.triangles(index).is_empty() || frame.night(index).is_some() {
                return out;
            }
            for (local, pixel) in (0u32..).zip(&tiles[index]) {
                let [column, row] = tile.pixel(local);
                let x = (column - frame.region.origin[0]) as usize;
                let y = (row - frame.region.origin[1]) as usize;
                let middle = DVec2::new(f64::from(column) + 0.5, f64::from(row) + 0.5);
                let (mut edge, mut light) = (pixel.owner == Owner::Mixed, pixel.light.0);
                for row in y.saturating_sub(1)..=(y + 1).min(high - 1) {
                    for at in row * wide + x.saturating_sub(1)..=row * wide + (x + 1).min(wide - 1) {
                        edge |= owners[at] != pixel.owner;
                        light |= lights[at].0;
                    }
                }
                // A body of a few pixels may slip between all samples.
                edge |= frame.small.iter().any(|(centre, radius)| middle.distance(*centre) < radius + 1.0);
                let what = if edge {
                    Listing::Edge
                } else if pixel.owner == Owner::Sky {
                    continue;
                } else if pixel.uneven || (light == Sunlit::EDGE.0 && pixel.light != Sunlit::UNSEEN) {
                    Listing::Inner
                } else if light == Sunlit::DARK.0 {
                    Listing::Dark
                } else {
                    continue;
                };
                out.push(Listed { local, what });
            }
            out
        })
        .collect()
}
