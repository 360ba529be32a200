//! Neighbours of points in the plane by a grid of cells.

use glam::DVec2;

/// Points sorted into square cells with about two points each.
#[derive(Debug, Clone)]
pub(crate) struct Grid {
    low: DVec2,
    cell: f64,
    columns: usize,
    rows: usize,
    cells: Vec<Vec<usize>>,
    spacing: f64,
}

impl Grid {
    pub(crate) fn new(points: &[DVec2]) -> Self {
        let low = points.iter().copied().fold(DVec2::INFINITY, DVec2::min);
        let high = points.iter().copied().fold(DVec2::NEG_INFINITY, DVec2::max);
        let extent = (high - low).max(DVec2::splat(1e-9));
        let spacing = (extent.x * extent.y / points.len().max(1) as f64).sqrt();
        let cell = (1.5 * spacing).max(extent.max_element() / 1000.0);
        let (columns, rows) = ((extent.x / cell) as usize + 1, (extent.y / cell) as usize + 1);
        let mut grid = Self { low, cell, columns, rows, cells: vec![Vec::new(); columns * rows], spacing };
        for (i, &point) in points.iter().enumerate() {
            let [column, row] = grid.place(point);
            grid.cells[row * columns + column].push(i);
        }
        grid
    }

    /// Mean distance of neighbours: the root of the area a point.
    pub(crate) fn spacing(&self) -> f64 {
        self.spacing
    }

    fn place(&self, at: DVec2) -> [usize; 2] {
        let cell = ((at - self.low) / self.cell).max(DVec2::ZERO);
        [(cell.x as usize).min(self.columns - 1), (cell.y as usize).min(self.rows - 1)]
    }

    fn around(&self, at: DVec2, reach: usize) -> impl Iterator<Item = usize> + '_ {
        let [column, row] = self.place(at);
        let rows = row.saturating_sub(reach)..=(row + reach).min(self.rows - 1);
        rows.flat_map(move |r| {
            let columns = column.saturating_sub(reach)..=(column + reach).min(self.columns - 1);
            columns.flat_map(move |c| self.cells[r * self.columns + c].iter().copied())
        })
    }

    /// Indices of the nearest `count` points, nearest first.
    pub(crate) fn nearest(&self, points: &[DVec2], at: DVec2, count: usize) -> Vec<usize> {
        let mut reach = 1;
        loop {
            let mut found: Vec<(f64, usize)> =
                self.around(at, reach).map(|i| ((points[i] - at).length_squared(), i)).collect();
            found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            // Cells reach at least so far; beyond, nearer points may lie outside them.
            let certain = (reach as f64 * self.cell).powi(2);
            let all = reach >= self.columns.max(self.rows);
            if all || found.get(count.saturating_sub(1)).is_some_and(|last| last.0 <= certain) {
                found.truncate(count);
                return found.into_iter().map(|f| f.1).collect();
            }
            reach += 1;
        }
    }

    fn inside<'a>(
        &'a self,
        points: &'a [DVec2],
        at: DVec2,
        radius: f64,
    ) -> impl Iterator<Item = (f64, usize)> + 'a {
        let reach = (radius / self.cell).ceil() as usize;
        // A place outside the grid is looked up from the nearest cell: distances decide.
        self.around(at, reach)
            .map(move |i| ((points[i] - at).length(), i))
            .filter(move |(distance, _)| *distance <= radius)
    }

    /// The nearest point within a radius.
    pub(crate) fn within(&self, points: &[DVec2], at: DVec2, radius: f64) -> Option<usize> {
        self.inside(points, at, radius).min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))).map(|f| f.1)
    }

    /// Number of points within a radius.
    pub(crate) fn count(&self, points: &[DVec2], at: DVec2, radius: f64) -> usize {
        self.inside(points, at, radius).count()
    }
}
