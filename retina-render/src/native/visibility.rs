//! Which triangle each sample of a tile sees: homogeneous edge functions, which need no clipping and hold for lines of
//! sight that a distortion bends (Olano and Greer 1997, "Triangle scan conversion using 2D homogeneous coordinates").

use glam::{DVec2, DVec3};

use retina_simd::Kernel;

use super::coverage::Square;
use super::frame::Prepared;
use super::reads::Edge;

/// A linear function of the line of sight: value at the tile's reference, growth along x and along y.
#[derive(Clone, Copy, Default)]
pub(crate) struct Linear([f32; 3]);

impl Linear {
    fn of(vector: DVec3, sight: DVec2) -> Self {
        let at = vector.x * sight.x + vector.y * sight.y + vector.z;
        Self([at as f32, vector.x as f32, vector.y as f32])
    }

    #[inline(always)]
    pub(crate) fn at(&self, x: f32, y: f32) -> f32 {
        self.0[0] + self.0[1] * x + self.0[2] * y
    }

    /// The same function within a pixel.
    pub(crate) fn within(&self, square: &Square) -> Edge {
        let [middle_x, middle_y] = square.middle;
        let along = square.steps.map(|[x, y]| self.0[1] * x + self.0[2] * y);
        [self.at(middle_x, middle_y), along[0], along[1]]
    }
}

/// A triangle as seen from the camera. For a line of sight r the edge functions u = r . (b x c), v = r . (c x a) and
/// w = r . (a x b) have one sign inside, their shares of u + v + w are the weights of a, b and c at the point that is
/// seen, and depth_sum over u + v + w is its depth, from the reference depth on. The edge that two triangles share has
/// exactly opposite values in both: f64 products change sign exactly, scales are powers of two.
#[derive(Clone, Copy, Default)]
pub(crate) struct Setup {
    pub triangle: u32,
    pub edges: [Linear; 3],
    depth_sum: Linear,
    /// Lines of sight of its corners, from the tile's reference; NaN where one is not before the camera.
    pub corners: [[f32; 2]; 3],
}

impl Setup {
    /// `sight` is the tile's reference line of sight.
    pub(crate) fn new(frame: &Prepared<'_>, triangle: u32, sight: DVec2) -> Self {
        let [a, b, c] = frame.corners_m(triangle);
        let edges = [b.cross(c), c.cross(a), a.cross(b)];
        let facing = a.dot(edges[0]);
        let largest = edges.iter().map(|edge| edge.abs().max_element()).fold(f64::MIN_POSITIVE, f64::max);
        // The largest power of two below it, by its exponent's bits.
        let power = f64::from_bits(largest.to_bits() & 0x7ff0_0000_0000_0000);
        let scale = facing.signum() / power;
        let edges = edges.map(|edge| edge * scale);
        let depths = [a, b, c].map(|corner| corner.z - frame.reference_depth_m);
        let seen = |corner: DVec3| {
            let at = DVec2::new(corner.x, corner.y) / corner.z - sight;
            if corner.z > 0.0 { at.as_vec2().to_array() } else { [f32::NAN; 2] }
        };
        let depth_sum = edges[0] * depths[0] + edges[1] * depths[1] + edges[2] * depths[2];
        Self {
            triangle,
            edges: edges.map(|edge| Linear::of(edge, sight)),
            depth_sum: Linear::of(depth_sum, sight),
            corners: [a, b, c].map(seen),
        }
    }

    /// Weights of the triangle's corners at a line of sight, and the depth beyond the reference depth, m. Held within
    /// the triangle: the mean place of its samples may lie outside by rounding.
    #[inline(always)]
    pub(crate) fn weights_and_depth(&self, x: f32, y: f32) -> ([f32; 3], f32) {
        let [u, v, w] = self.edges.map(|edge| edge.at(x, y).max(0.0));
        let sum = (u + v + w).max(f32::MIN_POSITIVE);
        ([u / sum, v / sum, w / sum], self.depth_sum.at(x, y) / sum)
    }
}

/// Samples and what they see.
#[derive(Default)]
pub(crate) struct Samples {
    /// Line of sight from the tile's reference.
    pub x: Vec<f32>,
    pub y: Vec<f32>,
    depth: Vec<f32>,
    /// Index of the tile's triangle + 1; 0 is the sky.
    pub seen: Vec<u32>,
}

impl Samples {
    /// Makes room for `count` samples that see nothing yet.
    pub(crate) fn clear(&mut self, count: usize) {
        for places in [&mut self.x, &mut self.y] {
            places.clear();
            places.resize(count, 0.0);
        }
        self.depth.clear();
        self.depth.resize(count, f32::INFINITY);
        self.seen.clear();
        self.seen.resize(count, 0);
    }
}

/// Draws triangles into runs of samples. Of two at the same depth the one drawn first stays.
pub(crate) struct Draw<'a> {
    pub samples: &'a mut Samples,
    pub setups: &'a [Setup],
    /// First and last sample (excluded), and index of the triangle.
    pub runs: &'a [[u32; 3]],
}

impl Kernel for Draw<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for &[from, to, index] in self.runs {
            let setup = &self.setups[index as usize];
            let run = from as usize..to as usize;
            let samples = &mut *self.samples;
            let places = samples.x[run.clone()].iter().zip(&samples.y[run.clone()]);
            let stores = samples.depth[run.clone()].iter_mut().zip(&mut samples.seen[run]);
            let [u, v, w] = setup.edges;
            let number = index.wrapping_add(1);
            for ((&x, &y), (depth, seen)) in places.zip(stores) {
                let (u, v, w) = (u.at(x, y), v.at(x, y), w.at(x, y));
                let found = setup.depth_sum.at(x, y) / (u + v + w);
                let nearer = (u >= 0.0) & (v >= 0.0) & (w >= 0.0) & (found < *depth);
                *depth = if nearer { found } else { *depth };
                *seen = if nearer { number } else { *seen };
            }
        }
    }
}
