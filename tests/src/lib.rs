//! Shared parts of the golden and end-to-end tests.

use glam::{DMat3, DQuat, DVec3};
use retina_geometry::Pinhole;
use retina_model::{Body, BuildSpec, build_body, load_body};
use retina_render::{BodyState, RadianceImage};

/// The project's Moon with smooth normals.
pub fn moon() -> Body {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/bodies/moon.glb");
    let mut body = load_body(&path).expect("the project's own Moon loads");
    body.smooth_normals();
    body
}

/// A smooth sphere of even triangles.
pub fn sphere(radius_m: f64, cells: u32) -> Body {
    let spec = BuildSpec {
        name: "sphere".into(),
        radius_m,
        relief: None,
        albedo: None,
        cells,
        texels: 8,
        jpeg_quality: None,
        sources: Vec::new(),
        copyright: None,
    };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("sphere.glb");
    std::fs::write(&path, build_body(&spec).expect("a sphere is built").glb).expect("the sphere is written");
    let mut body = load_body(&path).expect("the sphere loads");
    body.smooth_normals();
    body
}

/// A square pinhole image with the principal point in its middle.
pub fn square_image(side_px: u32, focal_px: f64) -> Pinhole {
    Pinhole::centred(focal_px, [side_px; 2])
}

/// A body in front of the camera, turned by `turn`, lit from the direction `sun_camera`.
pub fn placed(position_camera_m: DVec3, turn: DQuat, sun_camera: DVec3, sun_distance_m: f64) -> BodyState {
    let camera_from_body = DMat3::from_quat(turn);
    let sun_m = sun_camera.normalize() * sun_distance_m - position_camera_m;
    BodyState {
        position_camera_m,
        camera_from_body,
        sun_position_body_m: camera_from_body.transpose() * sun_m,
    }
}

/// How far an image is from its reference, in the reference's mean radiance over the body.
#[derive(Debug, Clone, Copy)]
pub struct Comparison {
    /// Root mean square over pixels farther than 1 px from any edge of visibility or shadow.
    pub interior_rms: f64,
    /// Largest difference among those.
    pub interior_worst: f64,
    /// Pixels that differ by more than 2 %, over the body's pixels; they are all near edges when
    /// `interior_worst` is below that.
    pub outlier_fraction: f64,
    /// Summed radiance of the image over the reference's.
    pub flux_ratio: f64,
    /// Pixels counted as interior.
    pub interior_pixels: usize,
}

/// Compares radiances. `reference` must hold all layers: its mask, depth and shadow say where the
/// edges are.
pub fn compare(reference: &RadianceImage, image: &RadianceImage) -> Comparison {
    let (width, height) = (reference.width_px as usize, reference.height_px as usize);
    let (mask, depth, shadow) = (reference.plane(2), reference.plane(3), reference.plane(10));
    // Along a smooth surface depth is nearly linear: a jump of its slope is an edge.
    let bend = |a: usize, b: usize, c: usize| f64::from((depth[a] - 2.0 * depth[b] + depth[c]).abs());
    let body: Vec<usize> = (0..width * height).filter(|&i| mask[i] > 0.0).collect();
    let depths = || body.iter().map(|&i| f64::from(depth[i]));
    let span = depths().fold(f64::NEG_INFINITY, f64::max) - depths().fold(f64::INFINITY, f64::min);
    let is_edge = |i: usize| {
        let (x, y) = (i % width, i / width);
        let partial = |v: f32| v > 1e-4 && v < 0.9999;
        let bent = x > 0
            && y > 0
            && x + 1 < width
            && y + 1 < height
            && (bend(i - 1, i, i + 1) > 0.05 * span || bend(i - width, i, i + width) > 0.05 * span);
        partial(mask[i]) || partial(shadow[i]) || bent
    };
    let edges: Vec<bool> = (0..width * height).map(is_edge).collect();
    let near_edge = |i: usize| {
        let (x, y) = ((i % width) as i64, (i / width) as i64);
        (-1..=1).any(|dy| {
            (-1..=1).any(|dx| {
                let (u, v) = (x + dx, y + dy);
                u >= 0 && v >= 0 && u < width as i64 && v < height as i64 && {
                    let j = (v * width as i64 + u) as usize;
                    edges[j] || (shadow[i] > 0.5) != (shadow[j] > 0.5) || (mask[i] > 0.5) != (mask[j] > 0.5)
                }
            })
        })
    };
    let (a, b) = (reference.radiance(), image.radiance());
    let mean = body.iter().map(|&i| f64::from(a[i])).sum::<f64>() / body.len() as f64;
    let difference = |i: usize| (f64::from(b[i]) - f64::from(a[i])).abs() / mean;
    let interior: Vec<usize> = body.iter().copied().filter(|&i| !near_edge(i)).collect();
    let sum = |image: &[f32]| image.iter().map(|&v| f64::from(v)).sum::<f64>();
    Comparison {
        interior_rms: (interior.iter().map(|&i| difference(i).powi(2)).sum::<f64>() / interior.len() as f64)
            .sqrt(),
        interior_worst: interior.iter().map(|&i| difference(i)).fold(0.0, f64::max),
        outlier_fraction: (0..width * height).filter(|&i| difference(i) > 0.02).count() as f64
            / body.len() as f64,
        flux_ratio: sum(b) / sum(a),
        interior_pixels: interior.len(),
    }
}
