//! Which pixels a body covers.

use retina_batch::{BatchError, PngShape, png_bytes};

use crate::frames::LimbEllipse;

/// Covered pixels of an image, row by row.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Silhouette {
    pub(crate) width: usize,
    pub(crate) height: usize,
    covered: Vec<bool>,
}

impl Silhouette {
    /// Pixels of which at least half is covered.
    pub(crate) fn of_mask([width, height]: [usize; 2], mask: &[f32]) -> Self {
        Self { width, height, covered: mask.iter().map(|share| *share >= 0.5).collect() }
    }

    /// Pixels whose centre an ellipse has within.
    pub(crate) fn of_ellipse([width, height]: [usize; 2], limb: &LimbEllipse) -> Self {
        let (sin, cos) = limb.angle_deg.to_radians().sin_cos();
        let [a, b] = limb.semi_axes_px;
        let covered = (0..width * height)
            .map(|at| {
                let x = (at % width) as f64 + 0.5 - limb.center_px[0];
                let y = (at / width) as f64 + 0.5 - limb.center_px[1];
                let (along, across) = ((cos * x + sin * y) / a, (cos * y - sin * x) / b);
                along * along + across * across <= 1.0
            })
            .collect();
        Self { width, height, covered }
    }

    /// What of it the other does not cover.
    pub(crate) fn without(&self, other: &Self) -> Self {
        let covered = self.covered.iter().zip(&other.covered).map(|(own, other)| *own && !other).collect();
        Self { covered, ..*self }
    }

    /// Whether the pixel of a place in the image is covered.
    pub(crate) fn covers(&self, [x, y]: [f64; 2]) -> bool {
        let (column, row) = (x.floor() as usize, y.floor() as usize);
        x >= 0.0
            && y >= 0.0
            && column < self.width
            && row < self.height
            && self.covered[row * self.width + column]
    }

    pub(crate) fn area(&self) -> usize {
        self.covered.iter().filter(|covered| **covered).count()
    }

    /// The box about it: x, y, width, height, px; `None` where nothing is covered.
    pub(crate) fn bounds(&self) -> Option<[usize; 4]> {
        let (mut least, mut most) = ([usize::MAX; 2], [0; 2]);
        for (at, _) in self.covered.iter().enumerate().filter(|(_, covered)| **covered) {
            let place = [at % self.width, at / self.width];
            for axis in 0..2 {
                least[axis] = least[axis].min(place[axis]);
                most[axis] = most[axis].max(place[axis]);
            }
        }
        (least[0] != usize::MAX).then(|| [least[0], least[1], most[0] - least[0] + 1, most[1] - least[1] + 1])
    }

    /// Lengths of runs down the columns, uncovered ones first, as COCO has them.
    pub(crate) fn runs(&self) -> Vec<usize> {
        let mut runs = vec![0];
        let mut now = false;
        for column in 0..self.width {
            for row in 0..self.height {
                let covered = self.covered[row * self.width + column];
                if covered != now {
                    now = covered;
                    runs.push(0);
                }
                if let Some(last) = runs.last_mut() {
                    *last += 1;
                }
            }
        }
        runs
    }

    /// A grey PNG, 255 where it is covered.
    pub(crate) fn png(&self) -> Result<Vec<u8>, BatchError> {
        let samples: Vec<u8> = self.covered.iter().map(|covered| if *covered { 255 } else { 0 }).collect();
        let shape = PngShape {
            width_px: self.width as u32,
            height_px: self.height as u32,
            channels: 1,
            bits: 8,
            filtered: false,
        };
        png_bytes("a mask", shape, &samples, &[])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_disc_has_its_area_box_and_runs() {
        let limb = LimbEllipse { center_px: [20.0, 15.0], semi_axes_px: [10.0, 10.0], angle_deg: 0.0 };
        let disc = Silhouette::of_ellipse([40, 30], &limb);
        assert!((disc.area() as f64 / (std::f64::consts::PI * 100.0) - 1.0).abs() < 0.02);
        assert_eq!(disc.bounds(), Some([10, 5, 20, 20]));
        let runs = disc.runs();
        assert_eq!(runs.iter().sum::<usize>(), 40 * 30);
        assert_eq!(runs.iter().skip(1).step_by(2).sum::<usize>(), disc.area());
        // Ten columns of 30 rows, and in the next the first covered row.
        assert!(runs[0] > 300 && runs[0] < 330, "{runs:?}");
        assert_eq!(disc.without(&disc).bounds(), None);
    }

    #[test]
    fn an_ellipse_is_turned_from_x_towards_y() {
        let limb = LimbEllipse { center_px: [50.0, 50.0], semi_axes_px: [40.0, 4.0], angle_deg: 45.0 };
        let turned = Silhouette::of_ellipse([100, 100], &limb);
        assert!(turned.covered[70 * 100 + 70] && !turned.covered[30 * 100 + 70]);
    }
}
