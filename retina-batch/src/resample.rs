//! Resampling through the distortion in f64: the definition of shaders/warp.wgsl on its own.

use std::f64::consts::PI;

use glam::DVec2;
use rayon::prelude::*;
use retina_geometry::WarpMap;

/// Pixels kept beyond the farthest place that is read: the filter reaches 3.
const MARGIN_PX: f64 = 8.0;

/// The image that is read, in the output's pixel coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Canvas {
    /// Where its corner lies; negative where it has a margin.
    pub origin_px: [i32; 2],
    /// Its size.
    pub size_px: [u32; 2],
}

impl Canvas {
    /// The image itself, without a margin.
    pub fn of_image(map: &WarpMap) -> Self {
        Self { origin_px: [0, 0], size_px: [map.pinhole.width_px, map.pinhole.height_px] }
    }

    /// An image that holds every place that an output pixel reads, and the output's own area.
    pub fn around(map: &WarpMap) -> Self {
        let size = DVec2::new(f64::from(map.pinhole.width_px), f64::from(map.pinhole.height_px));
        let (mut low, mut high) = (DVec2::ZERO, size);
        // D is one-to-one over the screen, so what is farthest out is read at its border.
        let steps = map.pinhole.width_px.max(map.pinhole.height_px);
        for step in 0..=steps {
            let t = f64::from(step) / f64::from(steps);
            for corner in [DVec2::new(t, 0.0), DVec2::new(t, 1.0), DVec2::new(0.0, t), DVec2::new(1.0, t)] {
                let source = map.source_of(corner * size);
                low = low.min(source - MARGIN_PX);
                high = high.max(source + MARGIN_PX);
            }
        }
        let (low, high) = (low.floor(), high.ceil());
        Self {
            origin_px: [low.x as i32, low.y as i32],
            size_px: [(high.x - low.x) as u32, (high.y - low.y) as u32],
        }
    }
}

/// Resamples canvases into images: output pixel R reads the canvas at D(K^-1 R), with Lanczos-3
/// weights normalised to a sum of 1, held between 0 and the sum of the least and the most of the
/// 4 x 4 pixels about, borders continued outwards.
#[derive(Debug, Clone)]
pub struct Resampler {
    map: WarpMap,
    canvas: Canvas,
}

impl Resampler {
    /// From a canvas into an image of the map's pinhole.
    pub fn new(map: WarpMap, canvas: Canvas) -> Self {
        Self { map, canvas }
    }

    /// The image resampled from `source`, row by row, of the canvas' size.
    ///
    /// # Panics
    /// `source` does not have the canvas' size.
    pub fn resample(&self, source: &[f32]) -> Vec<f32> {
        let [source_width, source_height] = self.canvas.size_px.map(|side| side as usize);
        assert_eq!(source.len(), source_width * source_height, "the canvas has another size");
        let width = self.map.pinhole.width_px as usize;
        let mut out = vec![0f32; width * self.map.pinhole.height_px as usize];
        let origin = DVec2::new(f64::from(self.canvas.origin_px[0]), f64::from(self.canvas.origin_px[1]));
        out.par_chunks_exact_mut(width).enumerate().for_each(|(y, row)| {
            for (x, value) in row.iter_mut().enumerate() {
                let pixel = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
                *value = interpolate(source, source_width, source_height, self.map.source_of(pixel) - origin);
            }
        });
        out
    }
}

fn interpolate(source: &[f32], width: usize, height: usize, place: DVec2) -> f32 {
    let place = place - 0.5;
    let whole = place.floor();
    let (weights_x, weights_y) = (lanczos3(place.x - whole.x), lanczos3(place.y - whole.y));
    let clamped = |at: f64, size: usize| at.clamp(0.0, (size - 1) as f64) as usize;
    let columns: [usize; 6] = std::array::from_fn(|i| clamped(whole.x + i as f64 - 2.0, width));
    let (mut sum, mut weights) = (0.0, 0.0);
    let (mut least, mut most) = (f32::INFINITY, f32::NEG_INFINITY);
    for (j, weight_y) in weights_y.iter().enumerate() {
        let row = clamped(whole.y + j as f64 - 2.0, height) * width;
        for (i, (column, weight_x)) in columns.iter().zip(&weights_x).enumerate() {
            let value = source[row + column];
            sum += weight_y * weight_x * f64::from(value);
            weights += weight_y * weight_x;
            if (1..5).contains(&i) && (1..5).contains(&j) {
                least = least.min(value);
                most = most.max(value);
            }
        }
    }
    // Light cannot be negative; an edge's undershoot cut alone would add light, so its overshoot is
    // held by as much. Far from darkness nothing is held.
    let value = (sum / weights) as f32;
    if least < 0.0 { value } else { value.clamp(0.0, most + least) }
}

/// sinc(d) sinc(d / 3) at d = i - part for i = -2..=3, `part` in [0, 1).
fn lanczos3(part: f64) -> [f64; 6] {
    // sin(pi d) = -(-1)^i sin(pi part), and the sine of a third of it by the addition theorem.
    let sine = (PI * part).sin();
    let (third_sin, third_cos) = (PI * part / 3.0).sin_cos();
    const HALF_ROOT_3: f64 = 0.866_025_403_784_438_6;
    // sin and cos of pi i / 3.
    const THIRDS: [(f64, f64); 6] = [
        (-HALF_ROOT_3, -0.5),
        (-HALF_ROOT_3, 0.5),
        (0.0, 1.0),
        (HALF_ROOT_3, 0.5),
        (HALF_ROOT_3, -0.5),
        (0.0, -1.0),
    ];
    std::array::from_fn(|k| {
        let i = k as f64 - 2.0;
        let d = i - part;
        if d.abs() < 1e-7 {
            return 1.0;
        }
        let signed = if k % 2 == 0 { -sine } else { sine };
        let (sin, cos) = THIRDS[k];
        3.0 * signed * (sin * third_cos - cos * third_sin) / (PI * d * PI * d)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use retina_geometry::{Distortion, Pinhole};

    #[test]
    fn weights_are_the_lanczos_window_by_definition() {
        let sinc = |x: f64| if x == 0.0 { 1.0 } else { (PI * x).sin() / (PI * x) };
        for part in [0.0, 1e-9, 1e-5, 0.25, 0.5, 0.75, 0.999_99] {
            for (k, weight) in lanczos3(part).iter().enumerate() {
                let d = k as f64 - 2.0 - part;
                let expected = if d.abs() < 3.0 { sinc(d) * sinc(d / 3.0) } else { 0.0 };
                assert!((weight - expected).abs() < 1e-9, "{part} {k}: {weight} {expected}");
            }
        }
    }

    fn barrel() -> WarpMap {
        let pinhole =
            Pinhole { fx_px: 900.0, fy_px: 900.0, cx_px: 81.0, cy_px: 49.0, width_px: 160, height_px: 100 };
        WarpMap { pinhole, distortion: Distortion::brown(2.0, 0.0, 0.0) }
    }

    #[test]
    fn a_smooth_scene_is_read_where_d_says() {
        let map = barrel();
        let canvas = Canvas::around(&map);
        assert!(canvas.origin_px[0] < -8 && canvas.size_px[0] > 176, "{canvas:?}");
        // Period 25 px: the Lanczos-3 window's own error there is 4.3e-3 of an amplitude, a product
        // of two such waves has it twice.
        let scene = |at: DVec2| 3.0 + (at.x * 0.25).sin() * (at.y * 0.25).cos();
        let source: Vec<f32> = (0..canvas.size_px[0] * canvas.size_px[1])
            .map(|i| {
                let (x, y) = (i % canvas.size_px[0], i / canvas.size_px[0]);
                let corner = DVec2::new(f64::from(canvas.origin_px[0]), f64::from(canvas.origin_px[1]));
                scene(corner + DVec2::new(f64::from(x), f64::from(y)) + 0.5) as f32
            })
            .collect();
        let out = Resampler::new(map.clone(), canvas).resample(&source);
        for (i, value) in out.iter().enumerate() {
            let pixel = DVec2::new((i % 160) as f64, (i / 160) as f64) + 0.5;
            let expected = scene(map.source_of(pixel));
            assert!((f64::from(*value) - expected).abs() < 8.6e-3, "{pixel}: {value} {expected}");
        }
    }

    #[test]
    fn without_distortion_nothing_changes_and_edges_against_darkness_do_not_ring() {
        let map = WarpMap { distortion: Distortion::identity(), ..barrel() };
        let source: Vec<f32> = (0..16_000).map(|i| if i % 160 < 20 { 0.0 } else { 7.0 }).collect();
        let same = Resampler::new(map.clone(), Canvas::of_image(&map)).resample(&source);
        assert!(same.iter().zip(&source).all(|(a, b)| (a - b).abs() < 1e-5));
        let warped = Resampler::new(barrel(), Canvas::of_image(&barrel())).resample(&source);
        assert!(warped.iter().all(|&v| (0.0..=7.0).contains(&v)));
        let lifted: Vec<f32> = source.iter().map(|v| v + 7.0).collect();
        let warped = Resampler::new(barrel(), Canvas::of_image(&barrel())).resample(&lifted);
        assert!(warped.iter().any(|&v| v > 14.0), "Lanczos-3 rings where nothing holds it");
    }
}
