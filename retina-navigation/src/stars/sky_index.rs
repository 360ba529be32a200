//! Which directions lie near a given one: cells of equal declination bands.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

/// Unit vectors sorted into cells of a sphere: bands of declination, each cut into cells of about the same width.
#[derive(Debug, Clone)]
pub struct SkyIndex {
    directions: Vec<DVec3>,
    band_rad: f64,
    /// First cell of each band, and one beyond the last.
    bands: Vec<usize>,
    /// First entry of each cell, and one beyond the last.
    cells: Vec<u32>,
    /// Indices of directions, cell by cell, rising in each.
    entries: Vec<u32>,
    /// The directions in the order of `entries`: those of a cell stand together.
    sorted: Vec<DVec3>,
}

impl SkyIndex {
    /// Sorts unit vectors into cells about `cell_rad` wide.
    pub fn new(directions: Vec<DVec3>, cell_rad: f64) -> Self {
        let rows = (PI / cell_rad).ceil().clamp(1.0, 2000.0) as usize;
        let band_rad = PI / rows as f64;
        let mut bands = vec![0];
        for row in 0..rows {
            // The band's widest circle sets its number of cells.
            let (low, high) = (row as f64 * band_rad, (row + 1) as f64 * band_rad);
            let widest = if low < PI / 2.0 && high > PI / 2.0 { 1.0 } else { low.sin().max(high.sin()) };
            bands.push(bands[row] + ((TAU * widest / band_rad).ceil() as usize).max(1));
        }
        let mut index = Self {
            directions: Vec::new(),
            band_rad,
            bands,
            cells: Vec::new(),
            entries: Vec::new(),
            sorted: Vec::new(),
        };
        let of: Vec<usize> = directions.iter().map(|v| index.cell(*v)).collect();
        let count = index.bands[rows];
        let mut cells = vec![0u32; count + 1];
        for &cell in &of {
            cells[cell + 1] += 1;
        }
        for cell in 0..count {
            cells[cell + 1] += cells[cell];
        }
        let mut next = cells.clone();
        let mut entries = vec![0u32; directions.len()];
        for (at, &cell) in of.iter().enumerate() {
            entries[next[cell] as usize] = at as u32;
            next[cell] += 1;
        }
        index.sorted = entries.iter().map(|&at| directions[at as usize]).collect();
        (index.cells, index.entries, index.directions) = (cells, entries, directions);
        index
    }

    /// The unit vectors, in the order given.
    pub fn directions(&self) -> &[DVec3] {
        &self.directions
    }

    fn row(&self, v: DVec3) -> usize {
        ((v.z.clamp(-1.0, 1.0).acos() / self.band_rad) as usize).min(self.bands.len() - 2)
    }

    fn cell(&self, v: DVec3) -> usize {
        let row = self.row(v);
        let count = self.bands[row + 1] - self.bands[row];
        let turn = v.y.atan2(v.x).rem_euclid(TAU) / TAU;
        self.bands[row] + ((turn * count as f64) as usize).min(count - 1)
    }

    /// Calls `found` with the index of each direction within `radius_rad` of `axis` (unit vector), in a fixed order.
    pub fn for_each_within(&self, axis: DVec3, radius_rad: f64, mut found: impl FnMut(usize)) {
        let chord2 = (2.0 * (0.5 * radius_rad.min(PI)).sin()).powi(2);
        let polar = axis.z.clamp(-1.0, 1.0).acos();
        let rows = self.bands.len() - 1;
        let first = ((polar - radius_rad).max(0.0) / self.band_rad) as usize;
        let last = (((polar + radius_rad) / self.band_rad) as usize).min(rows - 1);
        // Half the range of right ascension that a cone covers; all of it where it holds a pole.
        let half_rad = if polar <= radius_rad || polar + radius_rad >= PI {
            PI
        } else {
            (radius_rad.sin() / polar.sin()).clamp(-1.0, 1.0).asin()
        };
        let middle = axis.y.atan2(axis.x).rem_euclid(TAU);
        for row in first.min(rows - 1)..=last {
            let count = self.bands[row + 1] - self.bands[row];
            let per = count as f64 / TAU;
            let from = ((middle - half_rad) * per).floor() as i64;
            let to = ((middle + half_rad) * per).floor() as i64;
            let cells = (to - from + 1).min(count as i64);
            for step in 0..cells {
                let cell = self.bands[row] + (from + step).rem_euclid(count as i64) as usize;
                let places = self.cells[cell] as usize..self.cells[cell + 1] as usize;
                for (direction, &entry) in self.sorted[places.clone()].iter().zip(&self.entries[places]) {
                    if direction.distance_squared(axis) <= chord2 {
                        found(entry as usize);
                    }
                }
            }
        }
    }

    /// The nearest direction within `radius_rad` of `axis`: its index.
    pub fn nearest_within(&self, axis: DVec3, radius_rad: f64) -> Option<usize> {
        let mut best: Option<(f64, usize)> = None;
        self.for_each_within(axis, radius_rad, |at| {
            let off = self.directions[at].distance_squared(axis);
            if best.is_none_or(|(least, _)| off < least) {
                best = Some((off, at));
            }
        });
        best.map(|(_, at)| at)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn spiral(count: usize) -> Vec<DVec3> {
        (0..count)
            .map(|i| {
                let z = 1.0 - (2.0 * i as f64 + 1.0) / count as f64;
                let turn = i as f64 * 2.399_963_229_728_653;
                DVec3::new((1.0 - z * z).sqrt() * turn.cos(), (1.0 - z * z).sqrt() * turn.sin(), z)
            })
            .collect()
    }

    proptest! {
        /// Against looking at every one.
        #[test]
        fn cones_hold_what_looking_at_all_finds(z in -1.0_f64..=1.0, a in 0.0_f64..TAU, radius in 0.001_f64..3.2) {
            let axis = DVec3::new((1.0 - z * z).sqrt() * a.cos(), (1.0 - z * z).sqrt() * a.sin(), z);
            let index = SkyIndex::new(spiral(700), 0.1);
            let mut found = Vec::new();
            index.for_each_within(axis, radius, |at| found.push(at));
            found.sort_unstable();
            let limit = radius.min(PI);
            let off = |v: &DVec3| 2.0 * (0.5 * v.distance(axis)).min(1.0).asin();
            let all: Vec<usize> = (0..700).filter(|&i| off(&index.directions()[i]) <= limit).collect();
            prop_assert_eq!(&found, &all);
            let nearest = index.nearest_within(axis, radius);
            prop_assert_eq!(nearest.is_some(), !all.is_empty());
        }
    }

    #[test]
    fn poles_are_in_cones_about_them() {
        let index = SkyIndex::new(vec![DVec3::Z, -DVec3::Z, DVec3::X], 0.05);
        assert_eq!(index.nearest_within(DVec3::new(0.01, 0.0, 1.0).normalize(), 0.02), Some(0));
        assert_eq!(index.nearest_within(DVec3::new(0.0, -0.01, -1.0).normalize(), 0.02), Some(1));
        assert_eq!(index.nearest_within(DVec3::Y, 0.02), None);
    }
}
