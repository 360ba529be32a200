//! The OLED: digital counts to the light of sub-pixels.

use std::ops::Range;

use rayon::prelude::*;
use retina_geometry::Setup;

use crate::{BenchError, hash};

/// What the screen is asked to show: digital counts, red, green, blue, row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct ScreenImage {
    /// Width, pixels.
    pub width_px: u32,
    /// Height, pixels.
    pub height_px: u32,
    /// Counts.
    pub counts: Vec<[u8; 3]>,
}

impl ScreenImage {
    /// All dark.
    pub fn dark(width_px: u32, height_px: u32) -> Self {
        Self { width_px, height_px, counts: vec![[0; 3]; width_px as usize * height_px as usize] }
    }

    /// Equal counts in the three channels.
    pub fn grey(width_px: u32, height_px: u32, counts: &[u8]) -> Self {
        Self { width_px, height_px, counts: counts.iter().map(|&b| [b; 3]).collect() }
    }

    /// Sets a pixel that is on the screen.
    pub fn set(&mut self, column: u32, row: u32, counts: [u8; 3]) {
        self.counts[row as usize * self.width_px as usize + column as usize] = counts;
    }
}

/// A lit sub-pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SubPixel {
    /// Centre of its cell, screen pixels.
    pub at_px: [f64; 2],
    /// 0 red, 1 green, 2 blue.
    pub channel: usize,
    /// Its light above black, 1 at count 255.
    pub light: f64,
}

/// The display: response, black, geometry of the sub-pixels.
#[derive(Debug, Clone, PartialEq)]
pub struct Display {
    /// Width and height, pixels.
    pub size_px: [u32; 2],
    /// Pitch along x and y, mm.
    pub pitch_mm: [f64; 2],
    /// Light of each channel above black at each count, 1 at 255.
    pub levels: [Vec<f64>; 3],
    /// Light at count 0.
    pub black: f64,
    /// Displacement of each channel's sub-pixel from the pixel's centre along x, pixels: stripes side by
    /// side at a third.
    pub stripe_px: [f64; 3],
    /// Extent of a sub-pixel's shining area, pixels.
    pub emission_px: [f64; 2],
    /// Standard deviation of the sub-pixels' light.
    pub mura: f64,
    /// Seed of the pattern.
    pub seed: u64,
    /// Displacement along x at full load of a pixel's row, px: the row's supply sags.
    pub row_loading_px: f64,
}

impl Display {
    /// The setup's display.
    pub fn new(setup: &Setup, seed: u64) -> Self {
        let screen = &setup.screen;
        let gamma = setup.response_gamma();
        let black = setup.optics.black_level;
        let level = |b: usize| (b as f64 / 255.0).powf(gamma) * (1.0 - black);
        let levels: Vec<f64> = (0..256).map(level).collect();
        let [fill_x, fill_y] = setup.optics.emission_fill;
        Self {
            size_px: [screen.width_px, screen.height_px],
            pitch_mm: [
                screen.width_mm / f64::from(screen.width_px),
                screen.height_mm / f64::from(screen.height_px),
            ],
            levels: [levels.clone(), levels.clone(), levels],
            black,
            stripe_px: [-1.0 / 3.0, 0.0, 1.0 / 3.0],
            emission_px: [fill_x / 3.0, fill_y],
            mura: setup.optics.mura,
            seed,
            row_loading_px: 0.0,
        }
    }

    /// A position on the screen (pixels) as mm from its centre.
    pub fn mm(&self, at_px: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|k| (at_px[k] - f64::from(self.size_px[k]) / 2.0) * self.pitch_mm[k])
    }

    /// Standard deviation of a pixel's light about its middle, the mean of the two axes, mm: the sub-pixels of the lit
    /// channels side by side, each a box.
    pub(crate) fn emission_sigma_mm(&self, lit: Range<usize>) -> f64 {
        let lit = &self.stripe_px[lit];
        let middle = lit.iter().sum::<f64>() / lit.len() as f64;
        let stripes = lit.iter().map(|shift| (shift - middle).powi(2)).sum::<f64>() / lit.len() as f64;
        let [x, y] = self.emission_px.map(|extent| extent * extent / 12.0);
        let variances = [(x + stripes) * self.pitch_mm[0].powi(2), y * self.pitch_mm[1].powi(2)];
        (0.5 * (variances[0] + variances[1])).sqrt()
    }

    /// The lit sub-pixels, row by row.
    ///
    /// # Errors
    /// The image has another size than the screen.
    pub fn sub_pixels(&self, image: &ScreenImage) -> Result<Vec<SubPixel>, BenchError> {
        self.check_size(image)?;
        let width = image.width_px as usize;
        let rows = image.counts.par_chunks_exact(width).enumerate();
        Ok(rows.flat_map_iter(|(row, counts)| self.sub_pixels_of_row(row, counts)).collect())
    }

    fn sub_pixels_of_row(&self, row: usize, counts: &[[u8; 3]]) -> Vec<SubPixel> {
        let lit = lit(counts).collect::<Vec<_>>();
        let shift = if lit.is_empty() { 0.0 } else { self.row_shift_px(counts) };
        let of = |(column, counts): (usize, [u8; 3])| {
            let pixel = (row * self.size_px[0] as usize + column) as u64;
            (0..3).filter(move |&channel| counts[channel] > 0).map(move |channel| {
                let pattern = if self.mura == 0.0 { 1.0 } else { self.pattern(pixel, channel) };
                SubPixel {
                    at_px: [column as f64 + 0.5 + self.stripe_px[channel] + shift, row as f64 + 0.5],
                    channel,
                    light: pattern * self.levels[channel][usize::from(counts[channel])],
                }
            })
        };
        lit.into_iter().flat_map(of).collect()
    }

    /// Light of a sub-pixel over the mean of all: the display's mura.
    fn pattern(&self, pixel: u64, channel: usize) -> f64 {
        1.0 + self.mura * hash::normal(self.seed ^ 0x6d75_7261, 3 * pixel + channel as u64)
    }

    /// [`Display::pattern`] of all sub-pixels, row by row; `None` where they are equal.
    pub(crate) fn patterns(&self) -> Option<Vec<[f32; 3]>> {
        let pixels = u64::from(self.size_px[0]) * u64::from(self.size_px[1]);
        let of = |pixel: u64| [0, 1, 2].map(|channel| self.pattern(pixel, channel) as f32);
        (self.mura != 0.0).then(|| (0..pixels).into_par_iter().map(of).collect())
    }

    /// How far a row's sub-pixels are shifted along x, px.
    pub(crate) fn row_shift_px(&self, counts: &[[u8; 3]]) -> f64 {
        match self.row_loading_px {
            0.0 => 0.0,
            full => full * row_load(counts),
        }
    }

    /// # Errors
    /// The image has another size than the screen.
    pub(crate) fn check_size(&self, image: &ScreenImage) -> Result<(), BenchError> {
        let found_px = [image.width_px, image.height_px];
        if found_px == self.size_px {
            return Ok(());
        }
        Err(BenchError::ScreenSize { found_px, expected_px: self.size_px })
    }
}

/// Pixels that are not dark, with their places in the slice. Dark stretches are passed over whole.
pub(crate) fn lit(counts: &[[u8; 3]]) -> impl Iterator<Item = (usize, [u8; 3])> {
    const STRETCH: usize = 64;
    let bright = |stretch: &&[[u8; 3]]| stretch.as_flattened().iter().fold(0, |any, count| any | count) != 0;
    let stretches = counts.chunks(STRETCH).enumerate().filter(move |(_, stretch)| bright(stretch));
    stretches.flat_map(|(k, stretch)| {
        let pixels = stretch.iter().copied().enumerate().map(move |(i, counts)| (STRETCH * k + i, counts));
        pixels.filter(|(_, counts)| *counts != [0; 3])
    })
}

/// Mean drive of a row, 0 to 1.
fn row_load(counts: &[[u8; 3]]) -> f64 {
    let sum: u64 = counts.iter().flatten().map(|&b| u64::from(b)).sum();
    sum as f64 / (counts.len() * 3 * 255) as f64
}
