//! `retina warp`, and compensation in the pipeline, against direct evaluation.

use std::fs;

use crate::common::{self, Fixture, assert_done, assert_refused, counts, retina};
use image::{ImageBuffer, Luma, Rgb};
use retina_render::GpuDevice;

/// D of the fixture's calibration: radial, k1 = 12.
fn distort([x, y]: [f64; 2]) -> [f64; 2] {
    let gain = 1.0 + 12.0 * (x * x + y * y);
    [x * gain, y * gain]
}

/// The source position of an output pixel's centre, K D(K^-1 u), written out.
fn source(pixel: [u32; 2], focal: f64, center: [f64; 2]) -> [f64; 2] {
    let sight = [0, 1].map(|k| (f64::from(pixel[k]) + 0.5 - center[k]) / focal);
    let seen = distort(sight);
    [0, 1].map(|k| seen[k] * focal + center[k])
}

/// A smooth scene between 0.2 and 1: period 60 px and more, which Lanczos-3 follows to 0.2 %.
fn scene([x, y]: [f64; 2]) -> f64 {
    0.6 + 0.4 * (x * 0.1).sin() * (y * 0.07).cos()
}

fn warp(fixture: &Fixture, from: &str, direction: &str, to: &str) -> std::process::Output {
    retina()
        .arg("warp")
        .arg(fixture.path(from))
        .arg("--setup")
        .arg(fixture.path("setup.toml"))
        .arg("--calibration")
        .arg(fixture.path("calibration.toml"))
        .args(["--direction", direction, "--out"])
        .arg(fixture.path(to))
        .output()
        .unwrap()
}

#[test]
fn upstream_resamples_irradiance_through_the_response() {
    let fixture = Fixture::new();
    let count = |value: f64| 255.0 * value.powf(1.0 / 2.2);
    let image = ImageBuffer::from_fn(160, 100, |x, y| {
        let value = scene([f64::from(x) + 0.5, f64::from(y) + 0.5]);
        Rgb([count(value).round() as u8, count(0.5 * value).round() as u8, 0])
    });
    image.save(fixture.path("a.png")).unwrap();
    assert_done(&warp(&fixture, "a.png", "upstream", "b.png"));
    let out = image::open(fixture.path("b.png")).unwrap().into_rgb8();
    for (x, y, pixel) in
        out.enumerate_pixels().filter(|(x, y, _)| (12..148).contains(x) && (8..92).contains(y))
    {
        let value = scene(source([x, y], 900.0, [80.0, 50.0]));
        // Rounded twice, and the filter's 0.2 %.
        assert!((f64::from(pixel.0[0]) - count(value)).abs() < 1.6, "{x} {y}: {pixel:?} {}", count(value));
        assert!((f64::from(pixel.0[1]) - count(0.5 * value)).abs() < 1.6);
        assert_eq!(pixel.0[2], 0);
    }
    // Resampling the counts themselves would differ: the test can tell D from none.
    let moved = scene(source([20, 15], 900.0, [80.0, 50.0])) - scene([20.5, 15.5]);
    assert!(moved.abs() > 0.02, "{moved}");
}

#[test]
fn downstream_is_linear_and_keeps_the_bits() {
    let fixture = Fixture::new();
    // C: 5 mm over 5 um is 1000 px; 120 x 90 pixels.
    let image = ImageBuffer::from_fn(120, 90, |x, y| {
        Luma([(60_000.0 * scene([f64::from(x) + 0.5, f64::from(y) + 0.5])).round() as u16])
    });
    for (from, to) in [("a.png", "b.png"), ("a.tif", "b.tiff"), ("a.png", "c.tif")] {
        image.save(fixture.path(from)).unwrap();
        assert_done(&warp(&fixture, from, "downstream", to));
        let out = image::open(fixture.path(to)).unwrap();
        let out = out.as_luma16().expect("16 bits of grey");
        for (x, y, pixel) in
            out.enumerate_pixels().filter(|(x, y, _)| (8..112).contains(x) && (8..82).contains(y))
        {
            let value = 60_000.0 * scene(source([x, y], 1000.0, [60.0, 45.0]));
            assert!((f64::from(pixel.0[0]) - value).abs() < 120.0, "{x} {y}: {pixel:?} {value}");
        }
    }
}

#[test]
fn exr_keeps_all_channels() {
    use exr::prelude::*;
    let fixture = Fixture::new();
    let value = |x: usize, y: usize| scene([x as f64 + 0.5, y as f64 + 0.5]) as f32;
    let write = |name: &str, bad: bool| {
        let channels = SpecificChannels::build().with_channel("Y").with_channel("other").with_pixel_fn(
            |at: Vec2<usize>| {
                (value(at.x(), at.y()), if bad { f32::INFINITY } else { -3.0 * value(at.x(), at.y()) })
            },
        );
        Image::from_channels((160, 100), channels).write().to_file(fixture.path(name)).unwrap();
    };
    write("a.exr", false);
    assert_done(&warp(&fixture, "a.exr", "upstream", "b.exr"));
    let out =
        read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer().all_attributes();
    let list = out.from_file(fixture.path("b.exr")).unwrap().layer_data.channel_data.list;
    assert_eq!(list.iter().map(|c| c.name.to_string()).collect::<Vec<_>>(), ["Y", "other"]);
    for (channel, gain) in list.iter().zip([1.0, -3.0]) {
        let values: Vec<f32> = channel.sample_data.values_as_f32().collect();
        let found = f64::from(values[30 * 160 + 40]);
        let expected = gain * scene(source([40, 30], 900.0, [80.0, 50.0]));
        assert!((found / expected - 1.0).abs() < 4e-3, "{found} {expected}");
    }
    write("bad.exr", true);
    // What cannot be interpolated is left out, and said so.
    let made = warp(&fixture, "bad.exr", "upstream", "c.exr");
    assert_done(&made);
    assert!(common::stderr(&made).contains("channel `other`"));
    let out =
        read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer().all_attributes();
    let list = out.from_file(fixture.path("c.exr")).unwrap().layer_data.channel_data.list;
    assert_eq!(list.iter().map(|c| c.name.to_string()).collect::<Vec<_>>(), ["Y"]);
}

#[test]
fn images_that_do_not_fit_are_refused() {
    let fixture = Fixture::new();
    image::GrayImage::new(160, 100).save(fixture.path("screen.png")).unwrap();
    image::RgbaImage::new(160, 100).save(fixture.path("clear.png")).unwrap();
    fixture.write("text.png", "no image");
    for (from, direction, to, words) in [
        ("screen.png", "downstream", "o.png", &["screen.png", "160 x 100", "120 x 90"][..]),
        ("screen.png", "upstream", "o.jpg", &["o.jpg", "PNG or TIFF"]),
        ("screen.png", "upstream", "o.exr", &["o.exr"]),
        ("screen.png", "upstream", "nowhere/o.png", &["nowhere", "does not exist"]),
        ("clear.png", "upstream", "o.png", &["clear.png", "transparency"]),
        ("text.png", "upstream", "o.png", &["text.png"]),
        ("absent.png", "upstream", "o.png", &["absent.png", "cannot be read"]),
        ("screen.png", "sideways", "o.png", &["sideways"]),
    ] {
        assert_refused(&warp(&fixture, from, direction, to), words);
        assert!(!fixture.path(to).exists());
    }
    let bytes = fs::read(fixture.path("screen.png")).unwrap();
    fs::write(fixture.path("cut.png"), &bytes[..bytes.len() - 20]).unwrap();
    assert_refused(&warp(&fixture, "cut.png", "upstream", "o.png"), &["cut.png"]);
}

/// Both modes show the same scene at the same lines of sight, whichever renderer makes it.
fn modes_agree(backend: &str) {
    let images = ["direct", "resample"].map(|mode| {
        let fixture = Fixture::new();
        fixture.edit("scene.toml", "\"none\"", &format!("\"{mode}\""));
        fixture.edit("scene.toml", "\"auto\"", "0.001");
        // The camera is moved aside, so that the disc lies where D moves it by 1 px and more.
        fixture.edit("poses.csv", "0,0,0,-22500", "0,-800,-500,-22500");
        assert_done(&fixture.render("out", &["--frames", "0..1", "--backend", backend, "--quality", "best"]));
        counts(&fixture.path("out/frames/000000.png"))
    });
    let radiance = |count: u8| (f64::from(count) / 255.0).powf(2.2);
    let most = images[0].iter().map(|&c| radiance(c)).fold(0.0, f64::max);
    let total: f64 = images[0].iter().map(|&c| radiance(c)).sum();
    let off: f64 = images[0].iter().zip(&images[1]).map(|(&a, &b)| (radiance(a) - radiance(b)).abs()).sum();
    assert!(most > 0.1 && off / total < 0.01, "{most} {}", off / total);
    // Without compensation the disc is elsewhere: 1 px already changes 2 % of the light.
    let fixture = Fixture::new();
    fixture.edit("scene.toml", "\"auto\"", "0.001");
    fixture.edit("poses.csv", "0,0,0,-22500", "0,-800,-500,-22500");
    assert_done(&fixture.render("out", &["--frames", "0..1", "--backend", backend]));
    let plain = counts(&fixture.path("out/frames/000000.png"));
    let off: f64 = images[0].iter().zip(&plain).map(|(&a, &b)| (radiance(a) - radiance(b)).abs()).sum();
    assert!(off / total > 0.02, "{}", off / total);
}

#[test]
fn resampled_and_direct_compensation_agree_on_the_cpu() {
    modes_agree("cpu");
}

#[test]
fn resampled_and_direct_compensation_agree_on_the_gpu() {
    if GpuDevice::open_for_test().is_some() {
        modes_agree("gpu");
    }
}
