//! Sums over the neighbourhood of each pixel, weighted by products of one weight along x and one along y.

use rayon::prelude::*;

/// Values on a grid, row by row.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Grid {
    pub(crate) width: usize,
    pub(crate) values: Vec<f32>,
}

impl Grid {
    /// From a value for each column and row.
    pub(crate) fn of([width, height]: [usize; 2], value: impl Fn(usize, usize) -> f32 + Sync) -> Self {
        let mut values = vec![0.0; width * height];
        values.par_chunks_mut(width.max(1)).enumerate().for_each(|(y, row)| {
            row.iter_mut().enumerate().for_each(|(x, to)| *to = value(x, y));
        });
        Self { width, values }
    }

    pub(crate) fn at(&self, x: usize, y: usize) -> f32 {
        self.values[y * self.width + x]
    }

    /// Product with another of the same size, value by value.
    pub(crate) fn times(&self, other: &Self) -> Self {
        let values = self.values.iter().zip(&other.values).map(|(a, b)| a * b).collect();
        Self { width: self.width, values }
    }

    /// Weighted sums along the rows: `taps[k]` weighs the pixel that lies `k - taps.len() / 2` to the right. Outside the
    /// grid all is 0.
    pub(crate) fn along_rows(&self, taps: &[f32]) -> Self {
        let (width, half) = (self.width, taps.len() / 2);
        let mut values = vec![0.0; self.values.len()];
        let lines = values.par_chunks_mut(width.max(1)).zip(self.values.par_chunks(width.max(1)));
        lines.for_each(|(to, from)| {
            for (k, &tap) in taps.iter().enumerate() {
                let (first, last) = (half.saturating_sub(k), (width + half).saturating_sub(k).min(width));
                if first < last {
                    let from = &from[first + k - half..last + k - half];
                    to[first..last].iter_mut().zip(from).for_each(|(to, from)| *to += tap * from);
                }
            }
        });
        Self { width, values }
    }

    /// The same along the columns, downwards.
    pub(crate) fn along_columns(&self, taps: &[f32]) -> Self {
        let (width, half) = (self.width, taps.len() / 2);
        let height = self.values.len().checked_div(width).unwrap_or(0);
        let mut values = vec![0.0; self.values.len()];
        values.par_chunks_mut(width.max(1)).enumerate().for_each(|(y, to)| {
            for (k, &tap) in taps.iter().enumerate() {
                let Some(row) = (y + k).checked_sub(half).filter(|row| *row < height) else { continue };
                let from = &self.values[row * width..(row + 1) * width];
                to.iter_mut().zip(from).for_each(|(to, from)| *to += tap * from);
            }
        });
        Self { width, values }
    }
}

/// Weights by the power of the distance, 0 to 2, times a Gaussian's bell that ends at three standard deviations.
pub(crate) fn bell(sigma_px: f64, power: i32) -> Vec<f32> {
    let half = (3.0 * sigma_px).ceil() as i32;
    let weight = |off: i32| {
        let off = f64::from(off);
        (off.powi(power) * (-0.5 * (off / sigma_px).powi(2)).exp()) as f32
    };
    (-half..=half).map(weight).collect()
}

/// Shares that a Gaussian spot of unit light has in the pixels of a line through its middle, which is a pixel's.
pub(crate) fn spot_shares(sigma_px: f64) -> Vec<f32> {
    /// Places in a pixel whose mean is the integral, to 1e-4 for spots of a third of a pixel and wider.
    const PLACES: i32 = 16;
    let half = (4.0 * sigma_px).ceil() as i32;
    let bell = |off: f64| (-0.5 * (off / sigma_px).powi(2)).exp();
    let pixel = |off: i32| {
        let place = |k: i32| f64::from(off) - 0.5 + (f64::from(k) + 0.5) / f64::from(PLACES);
        (0..PLACES).map(|k| bell(place(k))).sum::<f64>()
    };
    let shares: Vec<f64> = (-half..=half).map(pixel).collect();
    let whole: f64 = shares.iter().sum();
    shares.iter().map(|share| (share / whole) as f32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_are_those_of_the_double_loop_and_nothing_is_outside() {
        let grid = Grid::of([7, 5], |x, y| (x * x + 3 * y) as f32);
        let (across, down) = ([1.0f32, 2.0, 4.0], [0.5f32, -1.0, 3.0, 1.0, 2.0]);
        let sums = grid.along_rows(&across).along_columns(&down);
        for y in 0..5usize {
            for x in 0..7usize {
                let mut expected = 0.0;
                for (j, b) in down.iter().enumerate() {
                    for (i, a) in across.iter().enumerate() {
                        let (c, r) = ((x + i).wrapping_sub(1), (y + j).wrapping_sub(2));
                        if c < 7 && r < 5 {
                            expected += a * b * grid.at(c, r);
                        }
                    }
                }
                assert!((sums.at(x, y) - expected).abs() < 1e-3, "{x} {y}");
            }
        }
        // erf(0.5 / (2.4 sqrt 2)) = 0.165 03: the middle pixel's share of a line.
        assert!((spot_shares(2.4)[10] - 0.165_03).abs() < 2e-4);
    }
}
