//! Where in a pixel textures are read, and which triangle each place sees.

use glam::Vec2;
use retina_simd::Kernel;

/// Places within a pixel, from its middle along x and along y, pixels.
pub(crate) struct Places {
    s: Vec<f32>,
    t: Vec<f32>,
}

impl Places {
    /// `places` lie in 0..1.
    pub(crate) fn new(places: &[Vec2]) -> Self {
        Self {
            s: places.iter().map(|place| place.x - 0.5).collect(),
            t: places.iter().map(|place| place.y - 0.5).collect(),
        }
    }

    pub(crate) fn count(&self) -> usize {
        self.s.len()
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = [f32; 2]> {
        self.s.iter().zip(&self.t).map(|(&s, &t)| [s, t])
    }
}

/// There are more reads than samples: a map often changes within a pixel.
pub(crate) struct Reads {
    pub places: Places,
    /// The sample that lies nearest to each.
    pub nearest: Vec<u32>,
    /// Mean distance of reads, pixels.
    pub apart_px: f32,
}

impl Reads {
    /// `places` and the samples' own places lie in 0..1.
    pub(crate) fn new(places: &[Vec2], samples: &[Vec2]) -> Self {
        let nearest = |place: Vec2| {
            let distance = |sample: u32| samples[sample as usize].distance_squared(place);
            (0..samples.len() as u32).min_by(|&a, &b| distance(a).total_cmp(&distance(b))).unwrap_or(0)
        };
        Self {
            places: Places::new(places),
            nearest: places.iter().map(|&place| nearest(place)).collect(),
            apart_px: 1.0 / (places.len() as f32).sqrt(),
        }
    }
}

/// An edge function within a pixel: its value in the middle, and its growth along x and along y.
pub(crate) type Edge = [f32; 3];

/// Finds the triangle that each place falls into, where none hides another.
pub(crate) struct Find<'a> {
    pub places: &'a Places,
    /// Of each triangle; all three are positive inside.
    pub triangles: &'a [[Edge; 3]],
    /// Of each place; left as it is where a place lies in no triangle, by rounding.
    pub found: &'a mut [u32],
}

impl Kernel for Find<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { places, triangles, found } = self;
        for (index, &[u, v, w]) in (0u32..).zip(triangles) {
            for ((&s, &t), found) in places.s.iter().zip(&places.t).zip(&mut *found) {
                let at = |[middle, x, y]: Edge| middle + x * s + y * t;
                let inside = (at(u) >= 0.0) & (at(v) >= 0.0) & (at(w) >= 0.0);
                *found = if inside { index } else { *found };
            }
        }
    }
}
