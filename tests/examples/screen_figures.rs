//! Figures of VALIDATION.md: compensation through D and by resampling, and the two quantisations,
//! as an ideal facility shows them: the light of screen pixel R arrives from the line of sight
//! D(K_f^-1 R), over the solid angle that the pixel has there.
//!
//! `cargo run --release -p retina-tests --example screen_figures [FOLDER]`; pictures go into FOLDER.

use std::f64::consts::{PI, TAU};
use std::path::PathBuf;
use std::time::Instant;

use glam::{DQuat, DVec2, DVec3};
use retina_geometry::{Distortion, Pinhole, Setup, WarpMap};
use retina_radiometry::{AU_M, LommelSeeliger, LunarLambert, PhaseFunction, Photometry, ScreenResponse};
use retina_render::{BodyModel, BodyState, FrameState, GpuDevice, GpuRenderer, GpuWarp, Planes, Quality};
use retina_screen::{PointPainter, Quantisation, ScreenEncoder};
use retina_tests::{moon, placed, sphere};

const MARGIN_PX: u32 = 40;
const MOON_DISTANCE_M: f64 = 4.1e7;

/// 1.5 % at the screen's corner, some decentring.
fn distortion() -> Distortion {
    Distortion::brown(1.3, 3e-4, 0.0)
}

fn setup() -> Setup {
    let file = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/setups/narrow-fov.toml"));
    Setup::read(&file).expect("the shipped setup is whole")
}

/// A screen image as it is seen.
struct Seen<'a> {
    painter: PointPainter,
    image: Pinhole,
    distortion: Option<&'a Distortion>,
    light: Vec<f64>,
}

impl<'a> Seen<'a> {
    fn new(image: Pinhole, distortion: Option<&'a Distortion>, light: Vec<f64>) -> Self {
        let painter = PointPainter::new(image, distortion.cloned(), ScreenResponse::power_law(2.2, 0.0));
        Self { painter, image, distortion, light }
    }

    fn pixels(&self) -> impl Iterator<Item = (DVec2, f64)> {
        let width = self.image.width_px as usize;
        self.light
            .iter()
            .enumerate()
            .map(move |(i, &light)| (DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5), light))
    }

    /// Where a pixel is seen, in pixels of the undistorted K_f image.
    fn place(&self, center_px: DVec2) -> DVec2 {
        let sight = self.image.line_of_sight(center_px);
        self.image.pixel(self.distortion.map_or(sight, |d| d.distort(sight)))
    }

    /// Flux (radiance times solid angle) and its centroid.
    fn flux(&self) -> (f64, DVec2) {
        let (mut flux, mut moment) = (0.0, DVec2::ZERO);
        for (center, light) in self.pixels().filter(|(_, light)| *light > 0.0) {
            let part = light * self.painter.relative_sr(center);
            flux += part;
            moment += part * self.place(center);
        }
        (flux, moment / flux)
    }

    /// The edge about a circle: in each sector of position angle the place of the half level, px
    /// outside the circle, and the distance from 90 to 10 % of the profile, its median over the
    /// sectors. `lit` picks the position angles that are looked at.
    fn edge(&self, center_px: DVec2, radius_px: f64, lit: impl Fn(f64) -> bool) -> (Vec<Option<f64>>, f64) {
        const SECTORS: usize = 72;
        const BINS: usize = 120;
        const REACH_PX: f64 = 3.0;
        let mut sums = vec![[(0.0, 0usize); BINS]; SECTORS];
        for (center, light) in self.pixels() {
            let from = self.place(center) - center_px;
            let (out, angle) = (from.length() - radius_px, from.to_angle());
            if out.abs() < REACH_PX && lit(angle) {
                let sector = ((angle + PI) / TAU * SECTORS as f64) as usize % SECTORS;
                let bin = ((out + REACH_PX) / (2.0 * REACH_PX) * BINS as f64) as usize;
                let cell = &mut sums[sector][bin.min(BINS - 1)];
                *cell = (cell.0 + light, cell.1 + 1);
            }
        }
        let at = |bin: usize| (bin as f64 + 0.5) / BINS as f64 * 2.0 * REACH_PX - REACH_PX;
        // The half level's place from the profile's integral: a step of the same height and area.
        let step = |profile: &[(f64, usize)]| -> Option<f64> {
            let known: Vec<(f64, f64)> = profile
                .iter()
                .enumerate()
                .filter(|(_, (_, n))| *n > 0)
                .map(|(bin, (sum, n))| (at(bin), sum / *n as f64))
                .collect();
            let inside: Vec<f64> = known.iter().filter(|(out, _)| *out < -1.5).map(|(_, v)| *v).collect();
            let level = inside.iter().sum::<f64>() / inside.len() as f64;
            let area: f64 = known.windows(2).map(|w| 0.5 * (w[0].1 + w[1].1) * (w[1].0 - w[0].0)).sum();
            (known.len() > BINS / 2 && level > 0.0).then(|| area / level + known[0].0)
        };
        let places: Vec<Option<f64>> = sums.iter().map(|profile| step(profile)).collect();
        // The profile of one sector, empty bins left out: where it last exceeds a part of its level.
        let spread = |profile: &[(f64, usize)]| -> f64 {
            let known: Vec<(f64, f64)> = (0..BINS)
                .filter(|&bin| profile[bin].1 > 0)
                .map(|bin| (at(bin), profile[bin].0 / profile[bin].1 as f64))
                .collect();
            let inside: Vec<f64> = known.iter().filter(|(out, _)| *out < -1.5).map(|(_, v)| *v).collect();
            let level = inside.iter().sum::<f64>() / inside.len() as f64;
            let crossing = |part: f64| {
                let last = known.iter().rposition(|(_, v)| *v > part * level).unwrap_or(0);
                let (a, b) = (known[last], known[(last + 1).min(known.len() - 1)]);
                a.0 + (a.1 - part * level) / (a.1 - b.1).max(1e-30) * (b.0 - a.0)
            };
            crossing(0.1) - crossing(0.9)
        };
        let mut spreads: Vec<f64> = sums
            .iter()
            .zip(&places)
            .filter(|(_, place)| place.is_some())
            .map(|(profile, _)| spread(profile))
            .collect();
        spreads.sort_by(f64::total_cmp);
        let median = spreads[spreads.len() / 2];
        (places, median)
    }
}

/// Mean and rms of the differences of an edge's places from a reference's, px.
fn off(edge: &[Option<f64>], reference: &[Option<f64>]) -> (f64, f64) {
    let both: Vec<f64> = edge.iter().zip(reference).filter_map(|(a, b)| Some((*a)? - (*b)?)).collect();
    let mean = both.iter().sum::<f64>() / both.len() as f64;
    (mean, (both.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / both.len() as f64).sqrt())
}

struct Bench {
    renderer: GpuRenderer,
    body: BodyState,
    image: Pinhole,
}

impl Bench {
    fn new(model: BodyModel, body: BodyState, image: Pinhole, quality: Quality) -> Self {
        let gpu = GpuDevice::open().expect("an adapter is there");
        let renderer = GpuRenderer::new(gpu, vec![model], quality, Planes::Radiance).expect("the body fits");
        Self { renderer, body, image }
    }

    /// The screen's radiance, and the seconds it took (best of `runs`).
    fn render(&mut self, image: Pinhole, distortion: Option<Distortion>, runs: usize) -> (Vec<f64>, f64) {
        let state = FrameState { image, distortion, bodies: vec![self.body] };
        let mut least_s = f64::INFINITY;
        let mut light = Vec::new();
        for _ in 0..runs {
            let start = Instant::now();
            self.renderer.start(&state).expect("the frame starts");
            let frame = self.renderer.finish().expect("the frame ends").expect("one was started");
            least_s = least_s.min(start.elapsed().as_secs_f64());
            light = frame.radiance().iter().map(|&v| f64::from(v)).collect();
        }
        (light, least_s)
    }

    fn modes(&mut self, runs: usize) -> [(&'static str, Vec<f64>, f64); 3] {
        let image = self.image;
        let (plain, plain_s) = self.render(image, None, runs);
        let (direct, direct_s) = self.render(image, Some(distortion()), runs);
        let margin = f64::from(MARGIN_PX);
        let canvas = Pinhole {
            cx_px: image.cx_px + margin,
            cy_px: image.cy_px + margin,
            width_px: image.width_px + 2 * MARGIN_PX,
            height_px: image.height_px + 2 * MARGIN_PX,
            ..image
        };
        let map = WarpMap { pinhole: image, distortion: distortion() };
        let size = [canvas.width_px, canvas.height_px];
        let warp = GpuWarp::new(self.renderer.device(), &map, [-(MARGIN_PX as i32); 2], size);
        self.renderer.set_warp(Some(warp.expect("the warp fits")));
        let (resampled, resample_s) = self.render(canvas, None, runs);
        self.renderer.set_warp(None);
        [("none", plain, plain_s), ("direct", direct, direct_s), ("resample", resampled, resample_s)]
    }
}

fn compensation(setup: &Setup) {
    let image = setup.facility_pinhole();
    println!("compensation, uniform disc of 380 px beside the centre, quality best:");
    let distance_m = 1.0e7;
    let radius_m = 380.0 / image.fx_px * distance_m;
    let at = DVec3::new(500.0 / image.fx_px, 190.0 / image.fy_px, 1.0) * distance_m;
    let body = placed(at, DQuat::IDENTITY, -at.normalize(), AU_M);
    let photometry = Photometry::new(LommelSeeliger, PhaseFunction::CONSTANT, Some(0.1));
    let disc = BodyModel { name: "disc".into(), shape: sphere(radius_m, 200), photometry };
    let mut bench = Bench::new(disc, body, image, Quality::Best);
    let modes = bench.modes(1);
    let ideal = Seen::new(image, None, modes[0].1.clone());
    let (flux, centroid) = ideal.flux();
    // The limb is an ellipse, nearly a circle: the edge is compared with the ideal's own.
    let limb_px = |seen: &Seen<'_>| seen.edge(centroid, 380.0, |_| true);
    let (reference, _) = limb_px(&ideal);
    let d = distortion();
    for (name, light, _) in &modes {
        let seen = Seen::new(image, (*name != "none").then_some(&d), light.clone());
        let (seen_flux, seen_centroid) = seen.flux();
        let (edge, spread) = limb_px(&seen);
        let (mean, rms) = off(&edge, &reference);
        println!(
            "  {name:8} flux {:+.1e}  centroid {:.5} px  limb {mean:+.5} px, rms over 72 sectors {rms:.5} px  edge 90-10 % {spread:.3} px",
            seen_flux / flux - 1.0,
            seen_centroid.distance(centroid),
        );
    }
}

fn moon_frames(setup: &Setup, folder: Option<&PathBuf>) {
    let image = setup.facility_pinhole();
    let photometry =
        Photometry::new(LunarLambert { decay_rad: PI / 3.0 }, PhaseFunction::CONSTANT, Some(0.12));
    for phase_deg in [20.0f64, 90.0] {
        let at = DVec3::new(0.0, 0.0, MOON_DISTANCE_M);
        let phase = phase_deg.to_radians();
        let body =
            placed(at, DQuat::from_rotation_x(PI / 2.0), DVec3::new(phase.sin(), 0.0, -phase.cos()), AU_M);
        let mut shape = moon();
        shape.smooth_normals();
        let model = BodyModel { name: "moon".into(), shape, photometry };
        let mut bench = Bench::new(model, body, image, Quality::Default);
        let modes = bench.modes(4);
        println!("Moon at 41 000 km, phase {phase_deg} deg, quality default:");
        for (name, _, seconds) in &modes {
            println!("  {name:8} {seconds:.3} s");
        }
        let screen = ScreenEncoder::new(setup);
        let response = screen.response();
        let light: Vec<f32> = modes[0].1.iter().map(|&v| v as f32).collect();
        let brightest = light.iter().fold(0f32, |a, &b| a.max(b));
        let radius_px = image.fx_px * (1.7374e6 / MOON_DISTANCE_M).asin().tan();
        let center_px = image.pixel(DVec2::ZERO);
        let lit = |angle: f64| angle.cos() > 0.2;
        for dim in [1.0, 0.05] {
            let scale = dim * screen.scale_for_brightest(f64::from(brightest));
            let factor = scale * image.boresight_pixel_sr();
            let wanted = Seen::new(image, None, modes[0].1.iter().map(|v| v * factor).collect());
            let (flux, centroid) = wanted.flux();
            let (ideal, _) = wanted.edge(center_px, radius_px, lit);
            let mut pictures = Vec::new();
            for quantisation in [Quantisation::Nearest, Quantisation::Diffused] {
                let start = Instant::now();
                let encoded = screen.encode(&light, scale, quantisation).expect("radiance is finite");
                let seconds = start.elapsed().as_secs_f64();
                let shown: Vec<f64> =
                    encoded.counts.iter().map(|&b| response.irradiance_w_m2_nm([b; 3])).collect();
                let seen = Seen::new(image, None, shown);
                let (seen_flux, seen_centroid) = seen.flux();
                let (mean, rms) = off(&seen.edge(center_px, radius_px, lit).0, &ideal);
                println!(
                    "  {:8} brightest {:.2} of full: flux {:+.1e}  centroid {:.5} px  limb {mean:+.5} px, rms over sectors {rms:.5} px  {:.0} ms",
                    quantisation.name(),
                    dim,
                    seen_flux / flux - 1.0,
                    seen_centroid.distance(centroid),
                    seconds * 1e3,
                );
                pictures.push(encoded.counts);
            }
            if let (Some(folder), [nearest, diffused]) = (folder, &pictures[..]) {
                let name = format!("quantisation-{phase_deg:.0}-{dim}.png");
                write_picture(&folder.join(name), [nearest, diffused], image.width_px);
            }
        }
    }
}

/// A part of the disc by nearest counts and by diffused ones, side by side, enlarged, its counts
/// spread over the whole scale.
fn write_picture(path: &PathBuf, counts: [&[u8]; 2], width: u32) {
    const PART: [usize; 4] = [900, 480, 110, 110];
    const TIMES: usize = 4;
    const GAP: usize = 8;
    let [left, top, columns, rows] = PART;
    let at = |image: usize, x: usize, y: usize| counts[image][(top + y) * width as usize + left + x];
    let part = || (0..rows).flat_map(move |y| (0..columns).map(move |x| at(0, x, y)));
    let (low, high) = (part().min().unwrap_or(0), part().max().unwrap_or(255));
    let across = 2 * columns * TIMES + GAP;
    let grey: Vec<u8> = (0..rows * TIMES * across)
        .map(|i| {
            let (x, y) = (i % across, i / across / TIMES);
            let image = usize::from(x >= columns * TIMES);
            let own = if image == 0 { x } else { x.saturating_sub(columns * TIMES + GAP) };
            if image == 1 && x < columns * TIMES + GAP {
                return 255;
            }
            let spread =
                f64::from(at(image, own / TIMES, y).saturating_sub(low)) / f64::from((high - low).max(1));
            (255.0 * spread).min(255.0).round() as u8
        })
        .collect();
    let file = std::fs::File::create(path).expect("the folder takes files");
    let mut encoder = png::Encoder::new(file, across as u32, (rows * TIMES) as u32);
    encoder.set_color(png::ColorType::Grayscale);
    let mut writer = encoder.write_header().expect("a header is written");
    writer.write_image_data(&grey).expect("the picture is written");
}

fn main() {
    let folder = std::env::args().nth(1).map(PathBuf::from);
    let setup = setup();
    compensation(&setup);
    moon_frames(&setup, folder.as_ref());
}
