//! Times of the detection on a camera's full image: `cargo run --release -p retina-image --example detect_speed`.

use std::time::Instant;

use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use retina_image::{CameraImage, DetectOptions, detect_points};

/// An even level with noise of a few numbers.
fn sky(random: &mut ChaCha8Rng) -> CameraImage {
    let mut image = CameraImage::new(2048, 1536, 4095.0);
    for value in &mut image.values {
        *value = 100.0 + 4.0 * (random.random::<f32>() + random.random::<f32>() + random.random::<f32>());
    }
    image
}

fn add_spot(image: &mut CameraImage, at: [f32; 2], peak: f32, sigma: f32) {
    let reach = (5.0 * sigma) as usize + 1;
    for y in at[1] as usize - reach..at[1] as usize + reach + 1 {
        for x in at[0] as usize - reach..at[0] as usize + reach + 1 {
            let r2 = (x as f32 + 0.5 - at[0]).powi(2) + (y as f32 + 0.5 - at[1]).powi(2);
            image.values[y * 2048 + x] += peak * (-0.5 * r2 / (sigma * sigma)).exp();
        }
    }
}

fn report(name: &str, image: &CameraImage) {
    let mut times_ms: Vec<f64> = (0..21)
        .map(|_| {
            let start = Instant::now();
            std::hint::black_box(detect_points(image, &DetectOptions::default()));
            start.elapsed().as_secs_f64() * 1e3
        })
        .collect();
    times_ms.sort_by(f64::total_cmp);
    let found = detect_points(image, &DetectOptions::default()).points.len();
    println!(
        "2048 x 1536, {name} ({found} found): median {:.2} ms, best {:.2} ms",
        times_ms[10], times_ms[0]
    );
}

fn main() {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    for count in [30, 500, 2000] {
        let mut image = sky(&mut random);
        for _ in 0..count {
            let at = [random.random::<f32>() * 2000.0 + 20.0, random.random::<f32>() * 1490.0 + 20.0];
            add_spot(&mut image, at, 3000.0 * random.random::<f32>().powi(3) + 30.0, 1.5);
        }
        report(&format!("{count} points"), &image);
    }
    // Noise with heavy tails: clusters of a few pixels just above what is taken for a point.
    let mut image = sky(&mut random);
    for _ in 0..12_000 {
        let at = [random.random::<f32>() * 2000.0 + 20.0, random.random::<f32>() * 1490.0 + 20.0];
        add_spot(&mut image, at, 16.0 + 8.0 * random.random::<f32>(), 0.8);
    }
    report("tails of 12000 clusters", &image);
}
