//! Images on regular grids: blurred, warped, averaged.

use glam::DVec2;
use rayon::prelude::*;

/// Values on a grid, row by row.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Grid {
    pub(crate) columns: usize,
    pub(crate) rows: usize,
    pub(crate) values: Vec<f32>,
}

/// Gaussians reach this many standard deviations.
const REACH: f64 = 4.0;

impl Grid {
    pub(crate) fn new(columns: usize, rows: usize) -> Self {
        Self { columns, rows, values: vec![0.0; columns * rows] }
    }

    /// From a function of the cell.
    pub(crate) fn from_fn(columns: usize, rows: usize, value: impl Fn(usize, usize) -> f32 + Sync) -> Self {
        let mut out = Self::new(columns, rows);
        out.values.par_chunks_mut(columns.max(1)).enumerate().for_each(|(y, row)| {
            row.iter_mut().enumerate().for_each(|(x, cell)| *cell = value(x, y));
        });
        out
    }

    pub(crate) fn map2(&self, other: &Self, value: impl Fn(f32, f32) -> f32) -> Self {
        let values = self.values.iter().zip(&other.values).map(|(a, b)| value(*a, *b)).collect();
        Self { values, ..*self }
    }

    /// The cell; beyond the edge the edge's own.
    pub(crate) fn held(&self, x: i64, y: i64) -> f32 {
        let x = x.clamp(0, self.columns as i64 - 1) as usize;
        let y = y.clamp(0, self.rows as i64 - 1) as usize;
        self.values[y * self.columns + x]
    }

    /// Coefficients of the cubic spline through the cells, mirrored at the edges (M. Unser, IEEE Signal Processing
    /// Magazine 16, 1999): moved by parts of a cell it keeps third derivatives, which a convolution would change.
    pub(crate) fn spline(&self) -> Spline {
        let mut along = self.clone();
        along.values.par_chunks_mut(self.columns).for_each(to_coefficients);
        let mut across = along.transposed();
        across.values.par_chunks_mut(self.rows).for_each(to_coefficients);
        Spline(across.transposed())
    }

    /// Convolved with a Gaussian of this variance in cells^2; sum and second moment are exact.
    pub(crate) fn blurred(&self, variance: f64) -> Self {
        if variance <= 0.0 {
            return self.clone();
        }
        let kernel = kernel(variance);
        self.convolved_rows(&kernel).transposed().convolved_rows(&kernel).transposed()
    }

    fn convolved_rows(&self, kernel: &[f32]) -> Self {
        let (columns, reach) = (self.columns, kernel.len() / 2);
        let mut out = Self::new(columns, self.rows);
        out.values.par_chunks_mut(columns).zip(self.values.par_chunks(columns)).for_each(|(out, row)| {
            let mut wide = Vec::with_capacity(columns + 2 * reach);
            wide.extend(std::iter::repeat_n(row[0], reach));
            wide.extend_from_slice(row);
            wide.extend(std::iter::repeat_n(row[columns - 1], reach));
            for (k, weight) in kernel.iter().enumerate() {
                out.iter_mut().zip(&wide[k..]).for_each(|(sum, value)| *sum += weight * value);
            }
        });
        out
    }

    fn transposed(&self) -> Self {
        // Bands of columns: each line of the source is read once a band.
        const BAND: usize = 16;
        let (columns, rows) = (self.columns, self.rows);
        let mut out = Self::new(rows, columns);
        out.values.par_chunks_mut((BAND * rows).max(1)).enumerate().for_each(|(band, lines)| {
            for y in 0..rows {
                for (x, line) in lines.chunks_exact_mut(rows).enumerate() {
                    line[y] = self.values[y * columns + band * BAND + x];
                }
            }
        });
        out
    }

    /// Averages over squares of `side` cells.
    pub(crate) fn averaged(&self, side: usize) -> Self {
        let (columns, rows) = (self.columns / side, self.rows / side);
        let norm = 1.0 / (side * side) as f32;
        Self::from_fn(columns, rows, |x, y| {
            let mut sum = 0.0;
            for j in 0..side {
                let first = (y * side + j) * self.columns + x * side;
                sum += self.values[first..first + side].iter().sum::<f32>();
            }
            sum * norm
        })
    }

    /// Distance to the edge of `inside`, in cells, positive outside: chamfer metric 3-4 (G. Borgefors, Computer Vision,
    /// Graphics, and Image Processing 34, 1986; at most 8 % off).
    pub(crate) fn edge_distance(&self, inside: impl Fn(f32) -> bool) -> Vec<f64> {
        let is: Vec<bool> = self.values.iter().map(|v| inside(*v)).collect();
        let to = |wanted: bool| self.chamfer(&is.iter().map(|i| *i == wanted).collect::<Vec<_>>());
        let (outside, within) = (to(true), to(false));
        outside.iter().zip(&within).map(|(o, w)| if *w > 0.0 { 0.5 - w } else { o - 0.5 }).collect()
    }

    fn chamfer(&self, source: &[bool]) -> Vec<f64> {
        let far = (self.columns + self.rows) as f64;
        let mut out: Vec<f64> = source.iter().map(|s| if *s { 0.0 } else { far }).collect();
        let (columns, rows) = (self.columns as i64, self.rows as i64);
        let mut relax = |x: i64, y: i64, steps: [(i64, i64, f64); 4]| {
            let at = (y * columns + x) as usize;
            for (dx, dy, step) in steps {
                let (i, j) = (x + dx, y + dy);
                if (0..columns).contains(&i) && (0..rows).contains(&j) {
                    out[at] = out[at].min(out[(j * columns + i) as usize] + step);
                }
            }
        };
        let (near, diagonal) = (1.0, 4.0 / 3.0);
        for y in 0..rows {
            for x in 0..columns {
                relax(x, y, [(-1, 0, near), (0, -1, near), (-1, -1, diagonal), (1, -1, diagonal)]);
            }
        }
        for y in (0..rows).rev() {
            for x in (0..columns).rev() {
                relax(x, y, [(1, 0, near), (0, 1, near), (1, 1, diagonal), (-1, 1, diagonal)]);
            }
        }
        out
    }
}

/// A cubic spline through the cells of a grid.
#[derive(Debug)]
pub(crate) struct Spline(Grid);

impl Spline {
    /// Its value; cell centres at half-integers.
    pub(crate) fn at(&self, at: DVec2) -> f64 {
        let (x, y) = (at.x - 0.5, at.y - 0.5);
        let (left, top) = (floor(x), floor(y));
        let weights = |t: f32| {
            let u = 1.0 - t;
            [u * u * u, (3.0 * t - 6.0) * t * t + 4.0, (3.0 * u - 6.0) * u * u + 4.0, t * t * t]
                .map(|w| w * (1.0 / 6.0))
        };
        let (wx, wy) = (weights((x - left as f64) as f32), weights((y - top as f64) as f32));
        let (left, top) = (left - 1, top - 1);
        let (columns, rows) = (self.0.columns as i64, self.0.rows as i64);
        // Column sums first: four lanes at once.
        let mut sums = [0f32; 4];
        if left >= 0 && top >= 0 && left + 4 <= columns && top + 4 <= rows {
            for (j, wy) in wy.iter().enumerate() {
                let first = (top as usize + j) * self.0.columns + left as usize;
                sums.iter_mut().zip(&self.0.values[first..first + 4]).for_each(|(sum, v)| *sum += wy * v);
            }
        } else {
            for (j, wy) in wy.iter().enumerate() {
                for (i, sum) in sums.iter_mut().enumerate() {
                    *sum += wy * self.0.held(left + i as i64, top + j as i64);
                }
            }
        }
        sums.iter().zip(&wx).map(|(sum, w)| sum * w).sum::<f32>().into()
    }

    /// Columns and rows.
    pub(crate) fn size(&self) -> [usize; 2] {
        [self.0.columns, self.0.rows]
    }
}

/// The largest whole number below: the library's own is a call where the processor's is not known to be there.
fn floor(x: f64) -> i64 {
    let whole = x as i64;
    whole - i64::from(x < whole as f64)
}

/// Values of a line into coefficients, in place.
fn to_coefficients(line: &mut [f32]) {
    // sqrt(3) - 2, and how far its powers count.
    const POLE: f64 = -0.267_949_192_431_122_7;
    const HORIZON: usize = 24;
    let n = line.len();
    if n < 2 {
        return;
    }
    let mut c: Vec<f64> = line.iter().map(|v| 6.0 * f64::from(*v)).collect();
    let mut power = 1.0;
    c[0] = c
        .iter()
        .take(HORIZON)
        .map(|v| {
            let part = power * v;
            power *= POLE;
            part
        })
        .sum();
    for k in 1..n {
        c[k] += POLE * c[k - 1];
    }
    c[n - 1] = POLE / (POLE * POLE - 1.0) * (c[n - 1] + POLE * c[n - 2]);
    for k in (0..n - 1).rev() {
        c[k] = POLE * (c[k + 1] - c[k]);
    }
    line.iter_mut().zip(&c).for_each(|(v, c)| *v = *c as f32);
}

/// A Gaussian over cells. One narrower than a cell falls between samples: three weights then have its variance.
fn kernel(variance: f64) -> Vec<f32> {
    const NARROW: f64 = 0.4;
    const POINTS: i32 = 8;
    if variance < NARROW {
        return vec![0.5 * variance as f32, 1.0 - variance as f32, 0.5 * variance as f32];
    }
    // Averaged over cells, whose own variance is a twelfth.
    let sigma = (variance - 1.0 / 12.0).sqrt();
    let reach = (REACH * sigma).ceil() as i64;
    let weight = |k: i64| -> f64 {
        (0..POINTS)
            .map(|i| {
                let t = (k as f64 + (f64::from(i) + 0.5) / f64::from(POINTS) - 0.5) / sigma;
                (-0.5 * t * t).exp()
            })
            .sum()
    };
    let weights: Vec<f64> = (-reach..=reach).map(weight).collect();
    let sum: f64 = weights.iter().sum();
    weights.iter().map(|w| (w / sum) as f32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The variance of what a point becomes is the Gaussian's, also of narrow ones.
    #[test]
    fn a_blurred_point_has_the_gaussians_variance() {
        for variance in [0.1, 0.5, 1.0, 6.0] {
            let mut point = Grid::new(41, 41);
            point.values[20 * 41 + 20] = 1.0;
            let blurred = point.blurred(variance);
            let total: f64 = blurred.values.iter().map(|v| f64::from(*v)).sum();
            let found: f64 = (0..41 * 41)
                .map(|at| f64::from(blurred.values[at]) * ((at % 41) as f64 - 20.0).powi(2))
                .sum();
            assert!((total - 1.0).abs() < 1e-5);
            assert!((found - variance).abs() < 0.005 * variance, "{variance} {found}");
        }
    }

    /// Far from the edges a cubic spline is any cubic.
    #[test]
    fn a_spline_reproduces_a_cubic() {
        let grid = Grid::from_fn(60, 60, |x, y| {
            let (x, y) = (x as f32 + 0.5, y as f32 + 0.5);
            1e-3 * x * x * x - 0.5 * x * y
        });
        let at = DVec2::new(29.3, 27.8);
        assert!((grid.spline().at(at) - (1e-3 * at.x.powi(3) - 0.5 * at.x * at.y)).abs() < 1e-3);
    }

    /// Beside a half-plane the distance is that to its edge, between cells 5 and 6.
    #[test]
    fn distance_to_an_edge() {
        let grid = Grid::from_fn(20, 9, |x, _| f32::from(x < 6));
        let distance = grid.edge_distance(|v| v > 0.5);
        assert_eq!(distance[4 * 20 + 5], -0.5);
        assert_eq!(distance[4 * 20 + 6], 0.5);
        assert_eq!(distance[4 * 20 + 9], 3.5);
    }
}
