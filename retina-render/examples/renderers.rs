//! Seconds a frame of each renderer, and how far its image is from a converged f64 one:
//! `cargo run --release -p retina-render --example renderers [-- --fast --phase DEG --law NAME --quality NAME]`.
//!
//! The shipped Moon from 41 000 km, 1920 x 1200, the narrow configuration's focal length, its middle off the pixel
//! grid. `--fast` leaves out the reference and the graphics adapter. On a machine without an adapter its rows say so.

use std::time::Instant;

use glam::{DMat3, DQuat, DVec3};
use retina_geometry::Pinhole;
use retina_model::{Body, load_body};
use retina_radiometry::{AU_M, Hapke, Lambert, Law, LommelSeeliger, LunarLambert, PhaseFunction, Photometry};
use retina_render::{
    BodyModel, BodyState, CpuRenderer, CpuSampling, FrameState, GpuDevice, GpuRenderer, NativeRenderer,
    Planes, Quality, RadianceImage,
};

const REFERENCE: CpuSampling = CpuSampling { grid: 16, refined_grid: 24, sun_points: 1, contrast: 0.05 };
const RUNS: usize = 7;
/// Rows of the image that the reference is rendered of.
const BAND_PX: u32 = 48;

fn moon() -> Body {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/bodies/moon.glb");
    let mut body = load_body(&path).expect("the shipped Moon loads");
    body.smooth_normals();
    body
}

fn state(phase_deg: f64, image: Pinhole) -> FrameState {
    let phase_rad = phase_deg.to_radians();
    let turn = DQuat::from_rotation_x(1.7) * DQuat::from_rotation_z(0.4);
    let sun = DVec3::new(phase_rad.sin(), 0.05, -phase_rad.cos());
    let (position_camera_m, camera_from_body) = (DVec3::new(2.4e4, -1.7e4, 4.1e7), DMat3::from_quat(turn));
    let sun_m = sun.normalize() * AU_M - position_camera_m;
    let sun_position_body_m = camera_from_body.transpose() * sun_m;
    let body = BodyState { position_camera_m, camera_from_body, sun_position_body_m };
    FrameState { image, distortion: None, bodies: vec![body] }
}

fn image() -> Pinhole {
    Pinhole { fx_px: 9000.0, fy_px: 9000.0, cx_px: 960.0, cy_px: 600.0, width_px: 1920, height_px: 1200 }
}

/// Rows of an image from `first` on.
fn rows(image: &RadianceImage, first: u32) -> Vec<f64> {
    let width = image.width_px as usize;
    let from = first as usize * width;
    image.radiance()[from..from + BAND_PX as usize * width].iter().map(|&v| f64::from(v)).collect()
}

/// Root mean square differences over the band's lit mean: all pixels, those inside, those on the limb.
fn errors(reference: &[f64], mask: &[f32], found: &[f64]) -> [f64; 3] {
    let lit: Vec<f64> = reference.iter().copied().filter(|&v| v > 0.0).collect();
    let mean = lit.iter().sum::<f64>() / lit.len() as f64;
    let rms = |wanted: &dyn Fn(f32) -> bool| {
        let squares: Vec<f64> = (0..reference.len())
            .filter(|&i| wanted(mask[i]))
            .map(|i| ((found[i] - reference[i]) / mean).powi(2))
            .collect();
        (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
    };
    [rms(&|m| m > 0.0), rms(&|m| m == 1.0), rms(&|m| m > 0.0 && m < 1.0)]
}

/// Processor seconds that this process has taken; 0 where the system does not say.
fn processor_s() -> f64 {
    let text = std::fs::read_to_string("/proc/self/schedstat").unwrap_or_default();
    let threads = std::fs::read_dir("/proc/self/task").map(Iterator::collect::<Vec<_>>).unwrap_or_default();
    let of = |text: &str| text.split(' ').next().and_then(|ns| ns.parse::<f64>().ok()).unwrap_or(0.0);
    let sum: f64 = threads
        .into_iter()
        .filter_map(|entry| std::fs::read_to_string(entry.ok()?.path().join("schedstat")).ok())
        .map(|text| of(&text))
        .sum();
    1e-9 * if sum > 0.0 { sum } else { of(&text) }
}

/// Median of the seconds a frame, mean of the processor's, and the last image.
fn timed(mut render: impl FnMut() -> RadianceImage) -> ([f64; 2], RadianceImage) {
    let mut times = Vec::new();
    let mut last = render();
    let before_s = processor_s();
    for _ in 0..RUNS {
        let start = Instant::now();
        last = render();
        times.push(start.elapsed().as_secs_f64());
    }
    let processor_s = (processor_s() - before_s) / RUNS as f64;
    times.sort_by(f64::total_cmp);
    ([times[RUNS / 2], processor_s], last)
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let fast = arguments.iter().any(|argument| argument == "--fast");
    let value = |name: &str| arguments.iter().position(|a| a == name).and_then(|at| arguments.get(at + 1));
    let phase_deg: f64 = value("--phase").map_or(60.0, |text| text.parse().expect("--phase takes degrees"));
    let law: Law = match value("--law").map_or("lambert", String::as_str) {
        "lambert" => Lambert.into(),
        "lommel-seeliger" => LommelSeeliger.into(),
        "lunar-lambert" => LunarLambert { decay_rad: 1.0 }.into(),
        "hapke" => Hapke::lunar().into(),
        other => panic!("no law {other} here: lambert, lommel-seeliger, lunar-lambert, hapke"),
    };
    let photometry = Photometry::new(law, PhaseFunction::CONSTANT, Some(0.12));
    let model = || BodyModel { name: "moon".into(), shape: moon(), photometry };
    let frame = state(phase_deg, image());
    println!("phase {phase_deg} deg, {} triangles", model().shape.triangles.len());
    let first_row = 600 - BAND_PX / 2;
    let reference = (!fast).then(|| {
        let band = Pinhole { cy_px: 600.0 - f64::from(first_row), height_px: BAND_PX, ..image() };
        CpuRenderer::new(vec![model()], REFERENCE, Planes::Layers).render(&state(phase_deg, band))
    });
    let tell = |name: &str, [seconds, processor_s]: [f64; 2], found: &RadianceImage| {
        let errors = reference.as_ref().map(|reference| {
            let light: Vec<f64> = reference.radiance().iter().map(|&v| f64::from(v)).collect();
            errors(&light, reference.plane(2), &rows(found, first_row))
        });
        let errors = errors.map_or(String::new(), |[all, inside, limb]| {
            format!("   all {:.3} %, inside {:.3} %, limb {:.3} %", 1e2 * all, 1e2 * inside, 1e2 * limb)
        });
        println!("{name:<42} {seconds:>7.3} s {processor_s:>7.3} CPU s{errors}");
    };
    let only = value("--quality").map(|text| text.to_lowercase());
    for quality in [Quality::Draft, Quality::Default, Quality::Best] {
        if only.as_ref().is_some_and(|name| *name != format!("{quality:?}").to_lowercase()) {
            continue;
        }
        let start = Instant::now();
        let native = NativeRenderer::new(&[model()], quality, Planes::Radiance);
        let ready_s = start.elapsed().as_secs_f64();
        let (seconds, found) = timed(|| native.render(&frame));
        tell(&format!("native {quality:?}, {}", native.instructions()), seconds, &found);
        if quality == Quality::Default && !fast {
            println!("   made ready in {ready_s:.2} s");
            let portable = native.portable();
            let (seconds, again) = timed(|| portable.render(&frame));
            tell("native Default, portable", seconds, &again);
            println!("   the same bytes: {}", again == found);
        }
    }
    if fast {
        return;
    }
    for quality in [Quality::Default, Quality::Best] {
        match GpuDevice::open() {
            Err(error) => println!("gpu {quality:?}: {error}"),
            Ok(device) => {
                let name = format!("{} {quality:?}", device.name());
                let mut renderer = GpuRenderer::new(device, vec![model()], quality, Planes::Radiance)
                    .expect("the Moon fits the adapter");
                let (seconds, found) = timed(|| {
                    renderer.start(&frame).expect("the frame starts");
                    renderer.finish().expect("the frame ends").expect("one frame was started")
                });
                tell(&name, seconds, &found);
            }
        }
    }
}
