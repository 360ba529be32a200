//! How much of a pixel a triangle covers, exactly: the pixel's square clipped by the triangle's edge functions.

use super::visibility::Setup;

/// A pixel in lines of sight from the tile's reference: its middle, and what a step of one pixel adds.
#[derive(Clone, Copy, Default)]
pub(crate) struct Square {
    pub middle: [f32; 2],
    /// Along x, along y.
    pub steps: [[f32; 2]; 2],
}

/// A part of a pixel.
#[derive(Clone, Copy, Default)]
pub(crate) struct Part {
    /// Of the pixel's area, 0..1.
    pub area: f32,
    /// Its centre of area, as a line of sight from the tile's reference.
    pub middle: [f32; 2],
}

/// Corners at most: a square has four, and each edge adds one.
const CORNERS: usize = 7;

impl Square {
    /// The part of the pixel inside a triangle, whatever stands before it.
    pub(crate) fn part(&self, setup: &Setup) -> Part {
        let mut corners = [[0.0f32; 2]; CORNERS];
        corners[..4].copy_from_slice(&[[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]);
        let mut count = 4;
        for edge in &setup.edges {
            let [at, x, y] = edge.over(self.middle, self.steps);
            let value = |[s, t]: [f32; 2]| at + x * s + y * t;
            // How far the edge function strays from its value in the middle.
            let range = 0.5 * (x.abs() + y.abs());
            if at - range >= 0.0 {
                continue;
            }
            if at + range <= 0.0 {
                return Part::default();
            }
            let before = corners;
            let last = count;
            count = 0;
            let mut keep = |corner: [f32; 2]| {
                if let Some(slot) = corners.get_mut(count) {
                    *slot = corner;
                    count += 1;
                }
            };
            for k in 0..last {
                let (a, b) = (before[k], before[if k + 1 == last { 0 } else { k + 1 }]);
                let (at_a, at_b) = (value(a), value(b));
                if at_a >= 0.0 {
                    keep(a);
                }
                if (at_a >= 0.0) != (at_b >= 0.0) {
                    let share = at_a / (at_a - at_b);
                    keep([a[0] + (b[0] - a[0]) * share, a[1] + (b[1] - a[1]) * share]);
                }
            }
        }
        self.polygon(&corners[..count])
    }

    /// Area and centre of a convex polygon by its triangles about the first corner.
    fn polygon(&self, corners: &[[f32; 2]]) -> Part {
        let [first, rest @ ..] = corners else { return Part::default() };
        let (mut area, mut centre) = (0.0f32, [0.0f32; 2]);
        for pair in rest.windows(2) {
            let [a, b] = [pair[0], pair[1]].map(|corner| [corner[0] - first[0], corner[1] - first[1]]);
            let twice = a[0] * b[1] - a[1] * b[0];
            area += 0.5 * twice;
            for k in 0..2 {
                centre[k] += twice * (a[k] + b[k]);
            }
        }
        if area <= 1e-7 {
            return Part::default();
        }
        let [s, t] = [0, 1].map(|k| first[k] + centre[k] / (6.0 * area));
        let [x, y] = self.step([s, t]);
        Part { area, middle: [self.middle[0] + x, self.middle[1] + y] }
    }

    /// What a step within the pixel adds to the line of sight.
    #[inline(always)]
    pub(crate) fn step(&self, [s, t]: [f32; 2]) -> [f32; 2] {
        std::array::from_fn(|k| self.steps[0][k] * s + self.steps[1][k] * t)
    }
}
