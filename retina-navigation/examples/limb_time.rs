//! Time of a limb's fit: a disc of 700 px across in an image of 1024 x 1024, at several phase angles.
//!
//! `cargo run --release --example limb_time`

use std::time::Instant;

use glam::DVec2;
use retina_geometry::Pinhole;
use retina_image::CameraImage;
use retina_navigation::limb::{LimbBody, LimbCamera, LimbOptions, solve_limb};

const SIZE: u32 = 1024;
const RADIUS_PX: f64 = 350.0;
const TURNS: usize = 50;

/// A Lambert sphere lit from +x, its edge blurred over a pixel, with a fixed pattern in the place of noise.
fn image(phase_rad: f64) -> CameraImage {
    let mut image = CameraImage::new(SIZE, SIZE, 4095.0);
    let sun = [phase_rad.sin(), phase_rad.cos()];
    for (k, value) in image.values.iter_mut().enumerate() {
        let at = DVec2::new((k % 1024) as f64 + 0.5, (k / 1024) as f64 + 0.5) - DVec2::new(515.3, 508.8);
        let unit = at / RADIUS_PX;
        let height = (1.0 - unit.length_squared()).max(0.0).sqrt();
        let cos_incidence = (sun[0] * unit.x + sun[1] * height).max(0.0);
        let inside = (RADIUS_PX - at.length() + 0.5).clamp(0.0, 1.0);
        let pattern = f64::from((k as u32).wrapping_mul(2_654_435_761) >> 28);
        *value = (60.0 + pattern + 3000.0 * inside * cos_incidence.sqrt()) as f32;
    }
    image
}

fn main() {
    let side = f64::from(SIZE);
    let pinhole = Pinhole {
        fx_px: 9770.0,
        fy_px: 9770.0,
        cx_px: side / 2.0,
        cy_px: side / 2.0,
        width_px: SIZE,
        height_px: SIZE,
    };
    let camera = LimbCamera::pinhole(pinhole);
    let options = LimbOptions { sun_direction_px: Some(DVec2::X), ..LimbOptions::default() };
    println!("{} threads", rayon::current_num_threads());
    for phase_deg in [5.0f64, 45.0, 90.0, 130.0] {
        let image = image(phase_deg.to_radians());
        let mut times_ms: Vec<f64> = Vec::new();
        let mut outcome = String::new();
        for _ in 0..TURNS {
            let start = Instant::now();
            let result = solve_limb(&image, &camera, &LimbBody::sphere(1_737_400.0), &options);
            times_ms.push(start.elapsed().as_secs_f64() * 1e3);
            outcome = result.map_or_else(|e| e.to_string(), |s| format!("radius {:.3} px", s.radius_px[0]));
        }
        times_ms.sort_by(f64::total_cmp);
        println!(
            "phase {phase_deg:3} deg: median {:.2} ms, least {:.2} ms; {outcome}",
            times_ms[TURNS / 2],
            times_ms[0]
        );
    }
}
