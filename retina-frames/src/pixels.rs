//! Which bins count, in tiles.

use crate::measured::Bins;
use crate::model::Sight;
use crate::predicted::Predicted;

/// About as many tiles there are, where bins are enough.
const TILES: usize = 150;
/// Smallest side of a tile, bins: errors of neighbours are alike.
const LEAST_SIDE: usize = 4;
/// Noise follows the light, and where that is uncertain the light of the surroundings; bins^2.
const KEY_BLUR: f64 = 4.0;
/// Levels below this part of the brightest have one noise.
const KEY_FLOOR: f64 = 0.004;

/// The rows of a table of frames.
pub(crate) struct PixelRows {
    /// Frame and bin of each, sorted by tile.
    pub(crate) bins: Vec<(usize, usize)>,
    /// Name and number of rows of each tile.
    pub(crate) tiles: Vec<(String, usize)>,
    /// Measured, DN.
    pub(crate) measured: Vec<f64>,
    /// Standard deviation of rounding to whole digital numbers, over a bin.
    pub(crate) least_noise: f64,
}

/// Frame, row and column of a tile.
type Tile = (usize, usize, usize);
/// Frame and bin.
type Place = (usize, usize);

impl PixelRows {
    pub(crate) fn new(sights: &[Sight], measured: &[Bins]) -> Self {
        let total: usize = measured.iter().map(|bins| bins.valid.iter().filter(|v| **v).count()).sum();
        let side = ((total as f64 / TILES as f64).sqrt().round() as usize).max(LEAST_SIDE);
        let mut rows: Vec<(Tile, Place)> = Vec::new();
        for (frame, (sight, bins)) in sights.iter().zip(measured).enumerate() {
            for bin in (0..bins.valid.len()).filter(|&bin| bins.valid[bin]) {
                let (x, y) = (bin % sight.window.columns, bin / sight.window.columns);
                rows.push(((frame, y / side, x / side), (frame, bin)));
            }
        }
        rows.sort_unstable();
        let mut tiles: Vec<(String, usize)> = Vec::new();
        let mut last = None;
        for ((frame, y, x), _) in &rows {
            if last != Some((*frame, *y, *x)) {
                last = Some((*frame, *y, *x));
                let window = &sights[*frame].window;
                let corner = [window.left + x * side * window.bin, window.top + y * side * window.bin];
                tiles.push((format!("image {} tile ({}, {})", frame + 1, corner[0], corner[1]), 0));
            }
            if let Some(tile) = tiles.last_mut() {
                tile.1 += 1;
            }
        }
        let bin = sights.iter().map(|sight| sight.window.bin).min().unwrap_or(1);
        Self {
            measured: rows.iter().map(|(_, (frame, bin))| measured[*frame].values[*bin]).collect(),
            bins: rows.into_iter().map(|(_, place)| place).collect(),
            tiles,
            least_noise: 1.0 / 12f64.sqrt() / bin as f64,
        }
    }

    /// ln of the light of a bin's surroundings, DN.
    pub(crate) fn noise_key(&self, sights: &[Sight], predicted: &Predicted) -> Vec<f64> {
        let state = &predicted.state;
        let images: Vec<Vec<f64>> = (0..sights.len())
            .map(|frame| {
                let light = predicted.light(frame).blurred(KEY_BLUR);
                let top = light.values.iter().copied().fold(0.0, f32::max);
                let floor = KEY_FLOOR * f64::from(top);
                light
                    .values
                    .iter()
                    .map(|v| (state.gain[frame].abs() * f64::from(*v).max(floor)).max(1e-9).ln())
                    .collect()
            })
            .collect();
        self.bins.iter().map(|&(frame, bin)| images[frame][bin]).collect()
    }
}
