//! Where in a pixel textures are read, and what each read sees.

use glam::Vec2;
use retina_simd::Kernel;

/// There are more reads than samples: a map often changes within a pixel.
pub(crate) struct Reads {
    /// From the pixel's middle along x and along y, pixels.
    pub s: Vec<f32>,
    pub t: Vec<f32>,
    /// The sample that lies nearest.
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
            s: places.iter().map(|place| place.x - 0.5).collect(),
            t: places.iter().map(|place| place.y - 0.5).collect(),
            nearest: places.iter().map(|&place| nearest(place)).collect(),
            apart_px: 1.0 / (places.len() as f32).sqrt(),
        }
    }

    pub(crate) fn count(&self) -> usize {
        self.nearest.len()
    }

    pub(crate) fn places(&self) -> impl Iterator<Item = [f32; 2]> {
        self.s.iter().zip(&self.t).map(|(&s, &t)| [s, t])
    }
}

/// An edge function within a pixel: its value in the middle, and its growth along x and along y.
pub(crate) type Edge = [f32; 3];

/// Finds the triangle that each read falls into, where none hides another.
pub(crate) struct Find<'a> {
    pub reads: &'a Reads,
    /// Of each triangle; all three are positive inside.
    pub triangles: &'a [[Edge; 3]],
    /// Of each read; left as it is where a read lies in no triangle, by rounding.
    pub found: &'a mut [u32],
}

impl Kernel for Find<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { reads, triangles, found } = self;
        for (index, &[u, v, w]) in (0u32..).zip(triangles) {
            let places = reads.s.iter().zip(&reads.t);
            for ((&s, &t), found) in places.zip(&mut *found) {
                let at = |[middle, x, y]: Edge| middle + x * s + y * t;
                let inside = (at(u) >= 0.0) & (at(v) >= 0.0) & (at(w) >= 0.0);
                *found = if inside { index } else { *found };
            }
        }
    }
}
