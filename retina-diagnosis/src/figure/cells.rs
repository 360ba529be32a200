//! The field in cells: how many points each has, and their mean errors.

use retina_plot::HeatMap;

use crate::data::Dataset;

/// Rows that a cell has on average.
const ROWS_A_CELL: f64 = 8.0;
/// Cells across.
const ACROSS: [f64; 2] = [6.0, 24.0];

/// Cells over the camera's field, and beyond it where points are.
pub(crate) struct Cells {
    /// Across and down.
    number: [usize; 2],
    /// x and y of the last edges; the first are their negatives.
    pub(crate) half: [f64; 2],
    /// The cell of each row.
    of_row: Vec<usize>,
}

impl Cells {
    /// For a table of points.
    pub(crate) fn of(data: &Dataset) -> Self {
        Self::over(data.values("x"), data.values("y"), data.half_height)
    }

    fn over(x: &[f64], y: &[f64], half_height: f64) -> Self {
        let half = [(x, 1.0), (y, half_height)]
            .map(|(values, edge)| values.iter().fold(edge, |h, v| h.max(v.abs())));
        let across = (x.len() as f64 / ROWS_A_CELL * half[0] / half[1]).sqrt().clamp(ACROSS[0], ACROSS[1]);
        let number = [across.round(), (across * half[1] / half[0]).round().max(2.0)].map(|n| n as usize);
        let cell = |axis: usize, value: f64| {
            let t = 0.5 * (value / half[axis] + 1.0);
            // The last edge belongs to the last cell.
            ((t * number[axis] as f64) as usize).min(number[axis] - 1)
        };
        let of_row = x.iter().zip(y).map(|(&x, &y)| cell(1, y) * number[0] + cell(0, x)).collect();
        Self { number, half, of_row }
    }

    fn pitch(&self) -> [f64; 2] {
        [0, 1].map(|axis| 2.0 * self.half[axis] / self.number[axis] as f64)
    }

    fn len(&self) -> usize {
        self.number[0] * self.number[1]
    }

    /// Centres of the cells, row by row.
    pub(crate) fn centres(&self) -> Vec<[f64; 2]> {
        let pitch = self.pitch();
        let at = |i: usize, axis: usize| (i as f64 + 0.5) * pitch[axis] - self.half[axis];
        (0..self.len()).map(|cell| [at(cell % self.number[0], 0), at(cell / self.number[0], 1)]).collect()
    }

    /// Rows in each cell.
    pub(crate) fn counts(&self, rows: impl IntoIterator<Item = usize>) -> Vec<usize> {
        let mut out = vec![0; self.len()];
        rows.into_iter().for_each(|row| out[self.of_row[row]] += 1);
        out
    }

    /// Weighted means of a quantity of the rows; NaN in cells without a row.
    pub(crate) fn means(
        &self,
        rows: &[usize],
        weight: impl Fn(usize) -> f64,
        of: impl Fn(usize) -> f64,
    ) -> Vec<f64> {
        let (mut sums, mut weights) = (vec![0.0; self.len()], vec![0.0; self.len()]);
        for &row in rows {
            sums[self.of_row[row]] += weight(row) * of(row);
            weights[self.of_row[row]] += weight(row);
        }
        sums.iter().zip(weights).map(|(sum, weight)| sum / weight).collect()
    }

    /// A value in each cell as a map, coloured from `low` (or the least value, if that is less) to the largest value.
    pub(crate) fn map(&self, values: Vec<f64>, low: f64, label: &str) -> HeatMap {
        let pitch = self.pitch();
        let finite = || values.iter().copied().filter(|v| v.is_finite());
        let (least, most) = (finite().fold(low, f64::min), finite().fold(f64::NEG_INFINITY, f64::max));
        HeatMap {
            origin: [0, 1].map(|axis| 0.5 * pitch[axis] - self.half[axis]),
            pitch,
            columns: self.number[0],
            range: [least, if most > least { most } else { least + 1.0 }],
            values,
            label: label.to_owned(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points in the upper left quarter alone: its cells have them all, and the means are those of the rows.
    #[test]
    fn a_quarter_is_covered_and_the_rest_is_not() {
        let x: Vec<f64> = (0..400).map(|i| -1.0 + (f64::from(i) * 0.618).fract()).collect();
        let y: Vec<f64> = (0..400).map(|i| -0.75 + 0.75 * (f64::from(i) * 0.414).fract()).collect();
        let cells = Cells::over(&x, &y, 0.75);
        assert_eq!(cells.number, [8, 6]);
        let rows: Vec<usize> = (0..400).collect();
        let (counts, means) = (cells.counts(0..400), cells.means(&rows, |_| 2.0, |row| x[row]));
        assert_eq!(counts.iter().sum::<usize>(), 400);
        for (cell, [x, y]) in cells.centres().into_iter().enumerate() {
            assert_eq!(counts[cell] > 0, x < 0.0 && y < 0.0, "{x} {y}");
            assert!(if counts[cell] > 0 { (means[cell] - x).abs() < 0.125 } else { means[cell].is_nan() });
        }
        // A point on the camera's edge is in the field, one beyond it widens the map.
        assert_eq!(Cells::over(&[1.0], &[0.75], 0.75).of_row, [Cells::over(&[1.0], &[0.75], 0.75).len() - 1]);
        assert_eq!(Cells::over(&[1.5], &[0.0], 0.75).half, [1.5, 0.75]);
    }
}
