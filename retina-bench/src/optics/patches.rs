//! The image in parts that overlap: each spot's, or each tile's of a scene.

use rayon::prelude::*;

/// Rows of the image that know their patches together.
const BAND_ROWS: usize = 32;

/// A rectangle of the image with its own electrons, which may reach beyond the sensor.
pub(super) struct Patch {
    pub(super) x: i64,
    pub(super) y: i64,
    pub(super) width: usize,
    pub(super) values: Vec<f32>,
}

/// An image that is the sum of patches.
pub(crate) struct Patches {
    patches: Vec<Patch>,
    /// For each band of rows the patches that it has a part of, in their order: so sums do not depend on threads.
    bands: Vec<Vec<usize>>,
}

impl Patches {
    /// Patches of an image of so many rows.
    pub(super) fn new(rows: usize, patches: Vec<Patch>) -> Self {
        let mut bands = vec![Vec::new(); rows.div_ceil(BAND_ROWS)];
        for (k, patch) in patches.iter().enumerate() {
            let band = |y: i64| y.clamp(0, rows as i64) as usize;
            let touched = band(patch.y) / BAND_ROWS..band(patch.y + patch.rows() as i64).div_ceil(BAND_ROWS);
            bands[touched].iter_mut().for_each(|band: &mut Vec<usize>| band.push(k));
        }
        Self { patches, bands }
    }

    /// Adds them to a row of the image.
    #[inline(always)]
    pub(crate) fn add_to_row(&self, y: usize, row: &mut [f32]) {
        for &patch in &self.bands[y / BAND_ROWS] {
            self.patches[patch].add_to_row(y as i64, row);
        }
    }

    /// Adds them to an image.
    pub(super) fn add_to(&self, image: &mut [f32], width: usize) {
        image.par_chunks_exact_mut(width).enumerate().for_each(|(y, row)| self.add_to_row(y, row));
    }

    /// Their memory, to be used again.
    pub(crate) fn into_buffers(self) -> impl Iterator<Item = Vec<f32>> {
        self.patches.into_iter().map(|patch| patch.values)
    }
}

impl Patch {
    fn rows(&self) -> usize {
        self.values.len() / self.width
    }

    /// Adds its part of row `y` of the image, if it has one.
    #[inline(always)]
    fn add_to_row(&self, y: i64, row: &mut [f32]) {
        let Some(own) = usize::try_from(y - self.y).ok().filter(|own| *own < self.rows()) else { return };
        let from = (-self.x).clamp(0, self.width as i64) as usize;
        let to = (row.len() as i64 - self.x).clamp(0, self.width as i64) as usize;
        if from < to {
            let values = &self.values[own * self.width..][from..to];
            let line = &mut row[(self.x + from as i64) as usize..][..to - from];
            line.iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
        }
    }
}
