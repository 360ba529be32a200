//! How much of a pixel a triangle covers, exactly, by integrals along the triangle's edges (Green's theorem): with an edge
//! at x(y) held within the pixel, the area is the sum over edges of the integral of x dy, and the centre of area follows
//! from those of x^2 / 2 dy and x y dy.

use retina_simd::{Kernel, clamp, max, min};

use super::visibility::Setup;

/// A pixel in lines of sight from the tile's reference: its middle, and what a step of one pixel adds.
#[derive(Clone, Copy, Default)]
pub(crate) struct Square {
    pub middle: [f32; 2],
    /// Along x, along y.
    pub steps: [[f32; 2]; 2],
}

impl Square {
    /// What a step within the pixel adds to the line of sight.
    #[inline(always)]
    pub(crate) fn step(&self, [s, t]: [f32; 2]) -> [f32; 2] {
        std::array::from_fn(|k| self.steps[0][k] * s + self.steps[1][k] * t)
    }

    /// Rows that take lines of sight from the middle to places in the pixel, -1/2 to 1/2 within it.
    #[inline(always)]
    fn inverse(&self) -> [[f32; 2]; 2] {
        let [[a, c], [b, d]] = self.steps;
        let scale = 1.0 / (a * d - b * c);
        [[d * scale, -b * scale], [-c * scale, a * scale]]
    }
}

/// A part of a pixel.
#[derive(Clone, Copy, Default)]
pub(crate) struct Part {
    /// Of the pixel's area, 0..1; NaN where the triangle is not known as a whole.
    pub area: f32,
    /// Its centre of area, as a line of sight from the tile's reference.
    pub middle: [f32; 2],
}

/// Triangles that are measured at once.
const LANES: usize = 8;

type Lane = [f32; LANES];

/// The parts of a pixel inside some triangles, whatever stands before them.
pub(crate) struct Measure<'a> {
    pub square: Square,
    pub setups: &'a [Setup],
    /// Indices of triangles.
    pub candidates: &'a [u32],
    /// One for each of them.
    pub parts: &'a mut Vec<Part>,
}

impl Kernel for Measure<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { square, setups, candidates, parts } = self;
        let [to_s, to_t] = square.inverse();
        parts.clear();
        for some in candidates.chunks(LANES) {
            let mut s = [[0.0; LANES]; 3];
            let mut t = [[0.0; LANES]; 3];
            for (k, &candidate) in some.iter().enumerate() {
                for (corner, [x, y]) in setups[candidate as usize].corners.into_iter().enumerate() {
                    s[corner][k] = x;
                    t[corner][k] = y;
                }
            }
            for (s, t) in s.iter_mut().zip(&mut t) {
                for k in 0..LANES {
                    let (x, y) = (s[k] - square.middle[0], t[k] - square.middle[1]);
                    s[k] = to_s[0] * x + to_s[1] * y;
                    t[k] = to_t[0] * x + to_t[1] * y;
                }
            }
            let (mut area, mut moment_s, mut moment_t) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
            for corner in 0..3 {
                let next = (corner + 1) % 3;
                add_edge(
                    [&s[corner], &t[corner], &s[next], &t[next]],
                    [&mut area, &mut moment_s, &mut moment_t],
                );
            }
            for k in 0..some.len() {
                // Corners may run either way round. What holds numbers within bounds loses a NaN.
                let known = s[0][k] + s[1][k] + s[2][k];
                let size = if known.is_nan() { f32::NAN } else { area[k].abs() };
                let part = if size <= 1e-7 {
                    Part::default()
                } else {
                    let [x, y] = square.step([moment_s[k] / area[k], moment_t[k] / area[k]]);
                    Part { area: size, middle: [square.middle[0] + x, square.middle[1] + y] }
                };
                parts.push(part);
            }
        }
    }
}

/// Adds an edge's integrals over the pixel: of x dy, x^2 / 2 dy and x y dy, each with x held within the pixel and counted
/// from its left side, or its middle where the closed way round leaves no difference.
#[inline(always)]
fn add_edge([x0, y0, x1, y1]: [&Lane; 4], [area, moment_x, moment_y]: [&mut Lane; 3]) {
    const HALF: f32 = 0.5;
    let held = |value: f32| clamp(value, -HALF, HALF);
    let share = |value: f32| clamp(value, 0.0, 1.0);
    // An edge along x, or a piece along y, has no share that depends on this.
    let inverse = |value: f32| 1.0 / if value.abs() < 1e-20 { 1e-20 } else { value };
    for k in 0..LANES {
        let (dx, dy) = (x1[k] - x0[k], y1[k] - y0[k]);
        // The piece within the pixel's rows.
        let (ya, yb) = (held(y0[k]), held(y1[k]));
        let inverse_dy = inverse(dy);
        let xa = x0[k] + dx * share((ya - y0[k]) * inverse_dy);
        let xb = x0[k] + dx * share((yb - y0[k]) * inverse_dy);
        let (dx, dy) = (xb - xa, yb - ya);
        // Of that the piece within its columns, as shares from a to b.
        let inverse_dx = inverse(dx);
        let (left, right) = ((-HALF - xa) * inverse_dx, (HALF - xa) * inverse_dx);
        let (from, to) = (share(min(left, right)), share(max(left, right)));
        // x, from the left side, at its ends and before and after it, where x stays; y at its ends.
        let (before, after) = (held(xa) + HALF, held(xb) + HALF);
        let (first, last) = (held(xa + dx * from) + HALF, held(xa + dx * to) + HALF);
        let (yc, yd) = (ya + dy * from, ya + dy * to);
        let (h0, h1, h2) = (dy * from, dy * (to - from), dy * (1.0 - to));
        area[k] += h0 * before + h1 * (0.5 * (first + last)) + h2 * after;
        // Before and after it x is -1/2 or 1/2: x^2 - 1/4 is 0.
        let (c, d) = (first - HALF, last - HALF);
        moment_x[k] += 0.5 * h1 * ((c * c + c * d + d * d) * (1.0 / 3.0) - 0.25);
        moment_y[k] += 0.5 * (h0 * before * (ya + yc) + h2 * after * (yd + yb))
            + h1 * (1.0 / 6.0) * (yc * (2.0 * first + last) + yd * (first + 2.0 * last));
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec2, DVec3, Vec2, Vec3};
    use retina_geometry::Pinhole;
    use retina_model::{Body, Surface, Vertex};
    use retina_radiometry::{AU_M, Lambert, PhaseFunction, Photometry};

    use super::{Measure, Part, Setup, Square};
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

    /// Area and centre of area of a triangle in the square from -1/2 to 1/2, in f64: the polygon is cut by each of the
    /// square's sides.
    fn clipped(triangle: [DVec2; 3]) -> (f64, DVec2) {
        let mut polygon = triangle.to_vec();
        for side in [DVec2::X, DVec2::NEG_X, DVec2::Y, DVec2::NEG_Y] {
            let inside = |p: DVec2| 0.5 - side.dot(p);
            let mut cut = Vec::new();
            for (k, &a) in polygon.iter().enumerate() {
                let b = polygon[(k + 1) % polygon.len()];
                let (at_a, at_b) = (inside(a), inside(b));
                if at_a >= 0.0 {
                    cut.push(a);
                }
                if (at_a >= 0.0) != (at_b >= 0.0) {
                    cut.push(a + (b - a) * (at_a / (at_a - at_b)));
                }
            }
            polygon = cut;
        }
        let (mut area, mut moment) = (0.0, DVec2::ZERO);
        for (k, &a) in polygon.iter().enumerate() {
            let b = polygon[(k + 1) % polygon.len()];
            area += 0.5 * a.perp_dot(b);
            moment += a.perp_dot(b) * (a + b) / 6.0;
        }
        (area.abs(), moment / area)
    }

    fn measured(square: Square, triangles: &[[DVec2; 3]]) -> Vec<Part> {
        let setups: Vec<Setup> = triangles
            .iter()
            .map(|triangle| {
                let mut setup = Setup::default();
                setup.corners = triangle.map(|at| {
                    let [x, y] = square.step(at.as_vec2().to_array());
                    [square.middle[0] + x, square.middle[1] + y]
                });
                setup
            })
            .collect();
        let candidates: Vec<u32> = (0..setups.len() as u32).collect();
        let mut parts = Vec::new();
        let kernel = Measure { square, setups: &setups, candidates: &candidates, parts: &mut parts };
        retina_simd::Level::detect().run(kernel);
        parts
    }

    /// Triangles of all sizes, turned either way, some with corners and edges on the pixel's own, against a polygon that is
    /// cut in f64; and one of which a corner is not known.
    #[test]
    fn areas_are_those_of_cut_polygons() {
        // Some pixels from the middle of its tile.
        let square = Square { middle: [6e-4, -4e-4], steps: [[1e-4, 2e-6], [-3e-6, 1.1e-4]] };
        let mut state = 1u64;
        let mut draw = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f64 / 16_777_216.0 - 0.5
        };
        let triangles: Vec<[DVec2; 3]> = (0..4000)
            .map(|k| {
                let size = [0.3, 1.0, 3.0, 20.0][k % 4];
                let corner = [(); 3].map(|()| size * DVec2::new(draw(), draw()));
                if k % 5 == 0 { corner.map(|at| (2.0 * at).round() / 2.0) } else { corner }
            })
            .collect();
        let mut seen = 0;
        for (part, triangle) in measured(square, &triangles).iter().zip(&triangles) {
            let (area, centre) = clipped(*triangle);
            assert!((f64::from(part.area) - area).abs() < 1e-5, "{triangle:?}: {} {area}", part.area);
            if area > 0.01 {
                seen += 1;
                let [x, y] = square.step(centre.as_vec2().to_array());
                let off = [part.middle[0] - square.middle[0] - x, part.middle[1] - square.middle[1] - y];
                assert!(off[0].abs().max(off[1].abs()) < 2e-3 * 1e-4, "{triangle:?}: {off:?}");
            }
        }
        assert!(seen > 1000, "{seen}");
        let unknown = [DVec2::ZERO, DVec2::X, DVec2::NAN];
        assert!(measured(square, &[unknown])[0].area.is_nan());
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
