//! The two ways of upstream compensation, judged after an ideal facility undoes the distortion:
//! what is shown at screen pixel R is seen at the line of sight D(K_f^-1 R).

use glam::{DQuat, DVec2, DVec3};
use retina_geometry::{Distortion, Pinhole, WarpMap};
use retina_radiometry::{AU_M, LommelSeeliger, PhaseFunction, Photometry};
use retina_render::{BodyModel, FrameState, GpuDevice, GpuRenderer, GpuWarp, Planes, Quality};
use retina_tests::{placed, sphere, square_image};

/// Half a pixel's worth of canvas beyond the screen on every side is plenty for the filter.
const MARGIN_PX: u32 = 24;

/// 1.5 % at the corner, as a facility has.
fn distortion() -> Distortion {
    Distortion::brown(1.3, 3e-4, 0.0)
}

/// What the camera's directions receive from a screen: the screen's radiance at K D^-1(K^-1 u),
/// bicubic (Catmull-Rom), with u over the pixels of K.
fn seen_through(facility: &Distortion, image: &Pinhole, screen: &[f32]) -> Vec<f32> {
    let (width, height) = (image.width_px as i64, image.height_px as i64);
    let cubic = |t: f64| {
        let a = t.abs();
        if a < 1.0 {
            1.5 * a * a * a - 2.5 * a * a + 1.0
        } else if a < 2.0 {
            -0.5 * a * a * a + 2.5 * a * a - 4.0 * a + 2.0
        } else {
            0.0
        }
    };
    let at =
        |x: i64, y: i64| f64::from(screen[(y.clamp(0, height - 1) * width + x.clamp(0, width - 1)) as usize]);
    (0..width * height)
        .map(|i| {
            let u = DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            let place =
                image.pixel(facility.undistort(image.line_of_sight(u)).expect("D is one-to-one here")) - 0.5;
            let whole = place.floor();
            let part = place - whole;
            let mut sum = 0.0;
            for j in -1..=2 {
                for k in -1..=2 {
                    let weight = cubic(part.x - k as f64) * cubic(part.y - j as f64);
                    sum += weight * at(whole.x as i64 + k, whole.y as i64 + j);
                }
            }
            sum as f32
        })
        .collect()
}

/// Flux, and the radiance-weighted second moment's radius: sqrt(2) times the rms distance from
/// the centroid is the radius of a uniform disc. With it the centroid.
fn moments(image: &Pinhole, radiance: &[f32]) -> (f64, f64, DVec2) {
    let width = image.width_px as usize;
    let position = |i: usize| DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
    let flux: f64 = radiance.iter().map(|&v| f64::from(v)).sum();
    let centroid = (0..radiance.len()).map(|i| position(i) * f64::from(radiance[i])).sum::<DVec2>() / flux;
    let second =
        (0..radiance.len()).map(|i| (position(i) - centroid).length_squared() * f64::from(radiance[i]));
    (flux, (2.0 * second.sum::<f64>() / flux).sqrt(), centroid)
}

#[test]
fn the_distortion_is_undone_to_the_sub_pixel() {
    let side = 256;
    let image = square_image(side, 1200.0);
    // Off the boresight, near a corner, where the distortion is largest; uniform disc at full phase.
    let body = placed(DVec3::new(4.0e5, 3.5e5, 1.0e7), DQuat::IDENTITY, DVec3::new(0.0, 0.0, -1.0), AU_M);
    let photometry = Photometry::new(LommelSeeliger, PhaseFunction::CONSTANT, Some(0.1));
    let models = vec![BodyModel { name: "disc".into(), shape: sphere(3.0e5, 96), photometry }];
    let Some(gpu) = GpuDevice::open_for_test() else { return };
    let mut renderer = GpuRenderer::new(gpu, models, Quality::Best, Planes::Radiance).expect("the body fits");
    let render = |renderer: &mut GpuRenderer, state: &FrameState| {
        renderer.start(state).expect("the frame starts");
        renderer.finish().expect("the frame ends").expect("one frame was started")
    };
    let straight = FrameState { image, distortion: None, bodies: vec![body] };
    let ideal = render(&mut renderer, &straight);
    let (flux, radius, centroid) = moments(&image, ideal.radiance());

    let direct = render(&mut renderer, &FrameState { distortion: Some(distortion()), ..straight.clone() });
    let margin = f64::from(MARGIN_PX);
    let canvas = Pinhole {
        cx_px: image.cx_px + margin,
        cy_px: image.cy_px + margin,
        width_px: side + 2 * MARGIN_PX,
        height_px: side + 2 * MARGIN_PX,
        ..image
    };
    let map = WarpMap { pinhole: image, distortion: distortion() };
    let origin = [-(MARGIN_PX as i32); 2];
    let size = [canvas.width_px, canvas.height_px];
    let warp = GpuWarp::new(renderer.device(), &map, origin, size).expect("the warp fits");
    renderer.set_warp(Some(warp));
    let resampled = render(&mut renderer, &FrameState { image: canvas, ..straight });

    for (name, screen) in [("direct", direct.radiance()), ("resample", resampled.radiance())] {
        let (seen_flux, seen_radius, seen_centroid) =
            moments(&image, &seen_through(&distortion(), &image, screen));
        let shift = (seen_centroid - centroid).length();
        println!(
            "{name}: flux {:+.2e}, radius {:+.5} px, centroid {shift:.5} px",
            seen_flux / flux - 1.0,
            seen_radius - radius
        );
        assert!((seen_flux / flux - 1.0).abs() < 1e-3, "{name}");
        assert!((seen_radius - radius).abs() < 0.01 && shift < 0.01, "{name}");
    }
    // The twin: a screen that was not compensated is seen distorted.
    let (_, _, uncompensated) = moments(&image, &seen_through(&distortion(), &image, ideal.radiance()));
    assert!((uncompensated - centroid).length() > 0.3, "an uncompensated screen passed");
}
