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

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec2, DVec3, Vec2, Vec3};
    use retina_geometry::Pinhole;
    use retina_model::{Body, Surface, Vertex};
    use retina_radiometry::{AU_M, Lambert, PhaseFunction, Photometry};

    use crate::{BodyModel, BodyState, FrameState, NativeRenderer, Planes, Quality, RadianceImage};

    const SIDE_PX: u32 = 32;
    const DISTANCE_M: f64 = 1e6;

    /// A roof that fills the image. Its ridge runs through the image's middle along (cos, sin) of `turn`.
    fn roof(turn: f64, quality: Quality) -> RadianceImage {
        let (along, across) = (DVec2::from_angle(turn), DVec2::from_angle(turn).perp());
        let corner = |a: f64, b: f64| Vertex {
            position_m: (1e4 * (a * along + b * across)).extend(3e3 * b.abs()),
            normal: Vec3::NEG_Z,
            uv: Vec2::ZERO,
        };
        let surface = Surface {
            name: "roof".into(),
            flat: true,
            albedo_map: None,
            albedo_factor: 1.0,
            slope_map: None,
            double_sided: false,
        };
        let shape = Body {
            vertices: [(-1, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (1, 1)]
                .map(|(a, b)| corner(f64::from(a), f64::from(b)))
                .to_vec(),
            // Counter-clockwise as the camera sees them: y runs down in the image.
            triangles: vec![[0, 2, 1], [1, 2, 3], [2, 4, 3], [3, 4, 5]],
            triangle_surface: vec![0; 4],
            surfaces: vec![surface],
            ..Body::default()
        };
        let photometry = Photometry::new(Lambert, PhaseFunction::CONSTANT, Some(0.1));
        let model = BodyModel { name: "roof".into(), shape, photometry };
        let body = BodyState {
            position_camera_m: DISTANCE_M * DVec3::Z,
            camera_from_body: DMat3::IDENTITY,
            sun_position_body_m: AU_M * DVec3::new(0.5, 0.2, -0.8).normalize(),
        };
        let image = Pinhole::centred(4000.0, [SIDE_PX; 2]);
        let state = FrameState { image, distortion: None, bodies: vec![body] };
        NativeRenderer::new(&[model], quality, Planes::Radiance).render(&state)
    }

    /// The part of the unit square about `middle` where n . p > 0, by the area that a line cuts off a corner.
    fn share(middle: DVec2, n: DVec2) -> f64 {
        let (a, b) = (n.x.abs(), n.y.abs());
        let depth = n.dot(middle) + 0.5 * (a + b);
        let corner = |d: f64| d.max(0.0).powi(2);
        (corner(depth) - corner(depth - a) - corner(depth - b) + corner(depth - a - b)) / (2.0 * a * b)
    }

    /// The largest error of a pixel, over the difference of the roof's two sides.
    fn worst(turn: f64, quality: Quality) -> f64 {
        let image = roof(turn, quality);
        let light = image.radiance();
        let across = DVec2::from_angle(turn).perp();
        let at = |i: usize| {
            let i = i as u32;
            DVec2::new(f64::from(i % SIDE_PX), f64::from(i / SIDE_PX)) + 0.5 - 0.5 * f64::from(SIDE_PX)
        };
        let beyond = |i: usize| across.dot(at(i));
        let side = |far: Option<usize>| f64::from(light[far.expect("the image has pixels")]);
        let by_place = |a: &usize, b: &usize| beyond(*a).total_cmp(&beyond(*b));
        let low = side((0..light.len()).min_by(by_place));
        let high = side((0..light.len()).max_by(by_place));
        assert!((high / low - 1.0).abs() > 0.02, "the sides differ: {low}, {high}");
        let error = |i: usize| (f64::from(light[i]) - low) / (high - low) - share(at(i), across);
        (0..light.len()).map(error).fold(0.0, |worst, error| error.abs().max(worst))
    }

    /// Pixels on a ridge have the mean of its sides by their areas; counted in four samples it is not so.
    #[test]
    fn a_pixel_on_a_ridge_is_shared_by_areas() {
        for turn in [0.3, 1.1, 2.4, 4.0] {
            for quality in [Quality::Default, Quality::Best] {
                let found = worst(turn, quality);
                assert!(found < 1e-4, "{quality:?}, {turn}: {found}");
            }
            assert!(worst(turn, Quality::Draft) > 0.01, "the measure sees samples, {turn}");
        }
    }
}
