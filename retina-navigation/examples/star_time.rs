//! Pixels to attitude: frames of 2048 x 1536 pixels at random attitudes, found, measured and solved, with the times and
//! what became of each star.
//!
//! `RAYON_NUM_THREADS=1 cargo run --release -p retina-navigation --example star_time [FRAMES]`

use std::time::Instant;

use glam::{DQuat, DVec2, DVec3};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng as _;
use rand_distr::{Distribution as _, StandardNormal};
use retina_image::{Background, CameraImage, DetectOptions, detect_points};
use retina_navigation::image::{ImageContext, solve_image};
use retina_navigation::stars::{SolverOptions, StarCamera, StarSolver};
use retina_navigation::synthetic::sources;
use retina_sky::ephemeris::{ASTRONOMICAL_UNIT_M, Ephemeris};
use retina_sky::observer::Observer;

const SIZE: [u32; 2] = [2048, 1536];
/// Horizontal field, deg: 2048 pixels of 3.45 um behind 25 mm.
const FIELD_DEG: f64 = 16.09;
/// Standard deviation of a spot, px, and of the read noise, DN; DN of a star of V 3; electrons per DN.
const SPOT_PX: f64 = 1.2;
const READ_NOISE_DN: f64 = 3.0;
const LIGHT_V3_DN: f64 = 20_000.0;
const GAIN_E_PER_DN: f64 = 2.6;
/// Stars drawn: the faintest are below the noise.
const DEEPEST_MAGNITUDE: f64 = 8.4;
/// Least signal-to-noise ratio, by the read noise in the spot, of stars that count as to be found.
const SURE_SNR: f64 = 10.0;
/// A point within this distance of a star is that star, px.
const SAME_PX: f64 = 1.5;

/// Each frame is solved so many times, and the least time counts: other work of the machine takes its part of the rest.
const TURNS: usize = 10;
const STAGES: [&str; 4] =
    ["background (a part of the points)", "pixels to points", "points to attitude", "pixels to attitude"];

/// A star in the image: place, px, and light, DN.
type Spot = (DVec2, f64);

/// What each frame gave.
#[derive(Default)]
struct Totals {
    /// Of each of [`STAGES`].
    times_ms: [Vec<f64>; 4],
    solved: usize,
    sure: usize,
    sure_found: usize,
    points: usize,
    strangers: usize,
    /// Squared distances of sure, single stars from their points, px^2.
    squares: Vec<f64>,
    boresight_arcsec: Vec<f64>,
}

fn draw(spots: &[Spot], random: &mut ChaCha8Rng) -> CameraImage {
    let [width, height] = SIZE.map(|side| side as usize);
    let mut light = vec![0.0f32; width * height];
    for (at, total_dn) in spots {
        let span = |c: f64, size: usize| (c - 8.0).max(0.0) as usize..((c + 9.0).max(0.0) as usize).min(size);
        for y in span(at.y, height) {
            for x in span(at.x, width) {
                let off = DVec2::new(x as f64 + 0.5, y as f64 + 0.5) - *at;
                let share = (-0.5 * off.length_squared() / (SPOT_PX * SPOT_PX)).exp()
                    / (std::f64::consts::TAU * SPOT_PX * SPOT_PX);
                light[y * width + x] += (total_dn * share) as f32;
            }
        }
    }
    let mut image = CameraImage::new(SIZE[0], SIZE[1], 4095.0);
    for (k, (value, light)) in image.values.iter_mut().zip(&light).enumerate() {
        let normal: f64 = StandardNormal.sample(random);
        let (x, y) = ((k % width) as f64, (k / width) as f64);
        let sigma = (READ_NOISE_DN.powi(2) + f64::from(*light) / GAIN_E_PER_DN).sqrt();
        // A level with a gradient, as stray light gives it.
        let expected = 100.0 + 0.004 * x - 0.003 * y + f64::from(*light);
        *value = (expected + sigma * normal).round().clamp(0.0, 4095.0) as f32;
    }
    image
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let frames: u64 = std::env::args().nth(1).map_or(Ok(50), |text| text.parse())?;
    let camera = StarCamera::from_field(FIELD_DEG.to_radians(), SIZE);
    let observer = Observer::new(
        &Ephemeris::analytic(),
        27.0 * 365.25 * 86_400.0,
        DVec3::X * ASTRONOMICAL_UNIT_M,
        Some(DVec3::Y * 3e4),
    )?;
    let solver = StarSolver::new(&camera, SolverOptions::default());
    let context = ImageContext { observer: Some(observer.clone()), ..ImageContext::default() };
    let options = DetectOptions::default();
    let mut totals = Totals::default();
    for seed in 0..frames {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let [x, y, z, w] = [(); 4].map(|()| StandardNormal.sample(&mut random));
        let truth = DQuat::from_xyzw(x, y, z, w).normalize();
        let spots: Vec<Spot> = sources(&observer, truth, &camera.pinhole, DEEPEST_MAGNITUDE)?
            .iter()
            .map(|source| {
                let at = camera.pinhole.pixel(source.line_of_sight);
                (at, LIGHT_V3_DN * 10f64.powf(0.4 * (3.0 - source.magnitude)))
            })
            .collect();
        let image = draw(&spots, &mut random);
        let mut least_ms = [f64::INFINITY; 4];
        let mut result = solve_image(&image, &camera, &solver, &options, &context)?;
        for _ in 0..TURNS {
            let start = Instant::now();
            std::hint::black_box(Background::estimate(&image, options.mesh_px));
            let background_ms = start.elapsed().as_secs_f64() * 1e3;
            result = solve_image(&image, &camera, &solver, &options, &context)?;
            let (points_ms, solve_ms) = (result.detect_ms, result.solve_ms);
            let times_ms = [background_ms, points_ms, solve_ms, points_ms + solve_ms];
            least_ms = std::array::from_fn(|k| least_ms[k].min(times_ms[k]));
        }
        for (all, least) in totals.times_ms.iter_mut().zip(least_ms) {
            all.push(least);
        }
        if let Ok(solution) = &result.solution {
            totals.solved += 1;
            let found = solution.camera_from_inertial();
            let off = (found.inverse() * DVec3::Z).angle_between(truth.inverse() * DVec3::Z);
            totals.boresight_arcsec.push(off.to_degrees() * 3600.0);
        }
        totals.count(&spots, &image);
    }
    totals.print(frames);
    Ok(())
}

impl Totals {
    /// Stars that were found, and points that are none.
    fn count(&mut self, spots: &[Spot], image: &CameraImage) {
        let found = detect_points(image, &DetectOptions::default()).points;
        let at = |point: &retina_image::LightPoint| DVec2::new(point.x_px, point.y_px);
        self.points += found.len();
        self.strangers += found
            .iter()
            .filter(|point| spots.iter().all(|spot| spot.0.distance(at(point)) > 2.0 * SAME_PX))
            .count();
        let edge = DVec2::splat(8.0);
        let last = DVec2::new(f64::from(SIZE[0]), f64::from(SIZE[1])) - edge;
        let noise_dn = READ_NOISE_DN * (4.0 * std::f64::consts::PI).sqrt() * SPOT_PX;
        for (k, (place, light)) in spots.iter().enumerate() {
            let inside = place.cmpgt(edge).all() && place.cmplt(last).all();
            let alone = spots
                .iter()
                .enumerate()
                .all(|(other, spot)| other == k || spot.0.distance(*place) > 15.0 || spot.1 < 0.01 * light);
            if !inside || !alone || *light < SURE_SNR * noise_dn {
                continue;
            }
            self.sure += 1;
            let nearest = found
                .iter()
                .min_by(|a, b| at(a).distance_squared(*place).total_cmp(&at(b).distance_squared(*place)));
            if let Some(point) = nearest.filter(|point| at(point).distance(*place) < SAME_PX) {
                self.sure_found += 1;
                if !point.saturated {
                    self.squares.push(at(point).distance_squared(*place));
                }
            }
        }
    }

    fn print(mut self, frames: u64) {
        println!("{} threads, {frames} frames of {} x {}", rayon::current_num_threads(), SIZE[0], SIZE[1]);
        println!("times: the least of {TURNS} turns of each frame");
        for (name, times) in STAGES.into_iter().zip(&mut self.times_ms) {
            let [middle, most] = [0.5, 0.95].map(|share| percentile(times, share));
            println!("{name}: median {middle:.2} ms, 95th percentile {most:.2} ms");
        }
        println!(
            "{} of {frames} solved, boresight {:.2} arcsec (median)",
            self.solved,
            percentile(&mut self.boresight_arcsec, 0.5)
        );
        let rms = (self.squares.iter().sum::<f64>() / (2 * self.squares.len()).max(1) as f64).sqrt();
        println!(
            "{} of {} stars of signal-to-noise {SURE_SNR} and more found, rms {rms:.5} px per axis; {} points, {} of them no \
             star",
            self.sure_found, self.sure, self.points, self.strangers
        );
    }
}

fn percentile(values: &mut [f64], share: f64) -> f64 {
    if values.is_empty() {
        return f64::NAN;
    }
    values.sort_by(f64::total_cmp);
    values[((values.len() as f64 * share) as usize).min(values.len() - 1)]
}
